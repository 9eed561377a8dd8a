"""A document that was found to fit is not checked again, and nothing else is ever taken for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment, schema, schema_cache
from srprov.errors import DefinitionError

EDF = "edf: 1\nname: a\nservices:\n  one:\n    image: busybox\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Use a cache folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    schema_cache._lines.cache_clear()
    return tmp_path / "cache" / "srprov" / "documents"


@pytest.fixture
def checks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """List the kinds that are really checked."""
    done: list[str] = []
    real = schema._validator
    monkeypatch.setattr(schema, "_validator", lambda kind: done.append(kind) or real(kind))
    return done


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "x.edf"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_what_fits_is_checked_once(tmp_path: Path, checks: list[str], folder: Path) -> None:
    load_experiment(written(tmp_path, EDF))
    load_experiment(written(tmp_path, f"# a comment changes nothing\n{EDF}"))
    assert checks == ["edf"] and len(folder.read_text().split()) == 1
    load_experiment(written(tmp_path, EDF + "    cost: 2\n"))
    assert checks == ["edf", "edf"]


def test_faults_are_told_every_time(tmp_path: Path, checks: list[str], folder: Path) -> None:
    for _ in range(3):
        with pytest.raises(DefinitionError):
            load_experiment(written(tmp_path, EDF + "    imagine: 1\n"))
    assert checks == ["edf"] * 3 and not folder.exists()


@pytest.mark.parametrize("spoil", ["mode", "garbage", "folder"])
def test_a_file_that_is_not_to_be_trusted_is_not(tmp_path: Path, checks: list[str], folder: Path, spoil: str) -> None:
    load_experiment(written(tmp_path, EDF))
    if spoil == "mode":
        folder.chmod(0o666)
    else:
        folder.unlink()
        folder.mkdir() if spoil == "folder" else folder.write_bytes(b"\xff\n" * 40_000)
    schema_cache._lines.cache_clear()
    load_experiment(written(tmp_path, EDF))
    assert checks == ["edf", "edf"]


def test_quotes_count(tmp_path: Path, checks: list[str]) -> None:
    """`"1"` is text where `1` is a number."""
    load_experiment(written(tmp_path, EDF + "    cost: 2\n"))
    with pytest.raises(DefinitionError):
        load_experiment(written(tmp_path, EDF + '    cost: "2"\n'))


def test_the_file_stays_small(folder: Path) -> None:
    for number in range(3000):
        schema_cache.add(f"{number:064x}")
    assert folder.stat().st_size <= 64 * 1024
    assert schema_cache.is_known(f"{2999:064x}") and not schema_cache.is_known("0" * 64)


def test_passwords_leave_no_trace(tmp_path: Path, folder: Path) -> None:
    """Two inventories that differ in their passwords are one to the memory: it cannot be asked to confirm a guess."""
    from srprov.definitions import load_inventory

    for password in ("hunter2", "correct horse"):
        path = tmp_path / "lab.yml"
        values = f"{{ansible_host: 10.0.0.1, srprov_slots: 2, ansible_password: {password}}}"
        path.write_text(f"all:\n  hosts:\n    r1: {values}\n")
        load_inventory([str(path)])
    assert len(folder.read_text().split()) == 1


def test_a_link_is_neither_read_nor_written_to(tmp_path: Path, checks: list[str], folder: Path) -> None:
    """In a folder of somebody else's it leads to one of the user's: what a stranger wrote, or what is cut off here."""
    load_experiment(written(tmp_path, EDF))
    folder.symlink_to(folder.rename(tmp_path / "cloned"))
    (tmp_path / "cloned").chmod(0o644)
    before = (tmp_path / "cloned").read_text()
    schema_cache._lines.cache_clear()
    load_experiment(written(tmp_path, EDF))
    load_experiment(written(tmp_path, EDF + "    cost: 2\n"))
    assert checks == ["edf"] * 3 and (tmp_path / "cloned").read_text() == before
