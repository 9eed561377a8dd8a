"""What robots give is kept under harmless names, up to a size, in time that grows with it alone."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterable
from pathlib import Path

import pytest

from srprov.record import results
from srprov.record.results import Kept, LogTooLong, unpack, write_log
from tests.bounded import bounded


def unpacked(folder: Path, names: Iterable[str]) -> list[Kept]:
    with tarfile.open(folder / "tar", "w", format=tarfile.PAX_FORMAT) as tar:
        for name in names:
            member = tarfile.TarInfo(name)
            member.size = 1
            tar.addfile(member, io.BytesIO(b"x"))
    (folder / "home").mkdir()
    return list(unpack(folder / "tar", folder / "home"))


def test_names_that_differ_only_by_case_are_no_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "_write", lambda *_where: "")
    names = ["".join(c.upper() if number >> bit & 1 else c for bit, c in enumerate("abcdefghijklm"))
             for number in range(3000)]  # fmt: skip
    kept = bounded(lambda: unpacked(tmp_path, names))
    assert len({one.name.casefold() for one in kept}) == 3000 and [one.path for one in kept] == names


def test_a_folder_of_a_files_name_but_for_case_is_another(tmp_path: Path) -> None:
    kept = unpacked(tmp_path, ["A", "a/x", "a/X", "SS", "\u00df/y", 'abc"'])
    assert [one.name for one in kept] == ["A", "a%2/x", "a%2/X%2", "SS", "\u00df%2/y", "abc%22"]
    assert all((tmp_path / "home" / one.name).read_text() == "x" for one in kept)


def test_what_lies_too_deep_is_listed(tmp_path: Path) -> None:
    deep = "a/" * 2000 + "x"
    kept = bounded(lambda: unpacked(tmp_path, ["b", deep, "c"]))
    assert [one.name for one in kept] == ["b", "", "c"]
    assert kept[1].path == deep and kept[1].note == "it lies deeper than 100 folders"


def test_a_log_has_a_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "MOST_LOG", 5 << 20)
    path = tmp_path / "logs" / "robot1.a.log"
    write_log(iter(["x" * 1023] * 5120), path)
    assert path.stat().st_size == 5 << 20
    with pytest.raises(LogTooLong, match="its log has more than 5 MiB"):
        write_log(iter(["x" * 1023] * 5121), path)
