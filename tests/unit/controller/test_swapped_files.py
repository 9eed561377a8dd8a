"""Whoever can write to an experiment's folder changes it after its files were checked: what was checked is shipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov import disk
from srprov.controller.saved import plan_file
from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.errors import SrprovError
from tests.fakes import World
from tests.worlds import made

_DECOY = b"DECOY"


@pytest.fixture(name="victim")
def a_folder_of_somebody_else(tmp_path: Path) -> Path:
    victim = tmp_path / "victim"
    (victim / "data" / "deep").mkdir(parents=True)
    for place in (victim / "key", victim / "data" / "key", victim / "data" / "deep" / "key"):
        place.write_bytes(_DECOY)
    return victim


@pytest.fixture(name="checked")
def an_experiment_that_was_checked(tmp_path: Path) -> tuple[Path, Definitions]:
    folder = tmp_path / "exp"
    (folder / "www" / "deep").mkdir(parents=True)
    (folder / "sub" / "data").mkdir(parents=True)
    for place in ("www/key", "www/deep/key", "sub/data/key", "file.txt"):
        (folder / place).write_text("own")
    (folder / "img").mkdir()
    (folder / "img" / "Dockerfile").write_text("FROM busybox\n")
    (folder / "img" / "key").write_text("own")
    (folder / "a.cdf").write_text("cdf: 1\nname: a\nbase: busybox\nfiles: [{src: file.txt, dest: /f}]\n")
    (folder / "b.cdf").write_text("cdf: 1\nname: b\ndockerfile: img/Dockerfile\n")
    volumes = "['./www:/www', './sub/data:/data', './file.txt:/f']"
    (folder / "e.edf").write_text(
        "edf: 1\nname: swapped\nplacement: {slots_per_robot: 9}\nservices:\n"
        f"  a: {{cdf: a.cdf, network: none, volumes: {volumes}}}\n  b: {{cdf: b.cdf, network: none}}\n"
    )
    return folder, load_experiment(folder / "e.edf")


def shipped(definitions: Definitions) -> bytes:
    """Return all that a plan would send or write down."""
    saved = plan_file(made(World().add("r1"), definitions))
    blobs = [getattr(step.want.params, "blob", None) or b"" for step in saved.plan.steps if step.want]
    return b"\0".join([*blobs, *saved.contexts.values(), *(text.encode() for text in saved.inputs.values())])


@pytest.mark.parametrize(
    ("place", "target"),
    [
        ("www", "/run/docker.sock"), ("www", "victim/data"), ("sub", "victim"), ("file.txt", "victim/key"),
        ("www/key", "/dev/zero"), ("img", "victim"), ("img/key", "victim/key"), ("www/deep", "victim/data/deep"),
    ],
)  # fmt: skip
def test_a_link_that_took_a_files_place_is_never_followed(
    tmp_path: Path, checked: tuple[Path, Definitions], victim: Path, place: str, target: str
) -> None:
    """A link inside a shipped folder is shipped as a link, as it would have been before."""
    folder, definitions = checked
    (folder / place).rename(tmp_path / "moved")
    (folder / place).symlink_to(tmp_path / target)
    inner = place in ("www/key", "img/key", "www/deep")
    try:
        assert _DECOY not in shipped(definitions) and inner
    except SrprovError as error:
        told = [str(error), *(one.message for one in getattr(error, "problems", ()))]
        assert not inner and any("changed while it was read" in one for one in told) and error.exit_code == 5


def test_what_is_judged_of_definitions_is_what_is_built_and_recorded(checked: tuple[Path, Definitions]) -> None:
    folder, definitions = checked
    before = shipped(definitions)
    (folder / "img" / "Dockerfile").write_text("FROM busybox\nADD http://127.0.0.1/x /x\n")
    for name in ("e.edf", "a.cdf"):
        (folder / name).unlink()
        (folder / name).symlink_to("/dev/zero")
    after = shipped(definitions)
    assert after == before and b"FROM busybox" in after and b"cdf: 1\nname: a" in after


def test_a_folder_that_is_swapped_while_it_is_read_gives_nothing_of_another(
    checked: tuple[Path, Definitions], victim: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link in the place of a folder that was listed already: no name and no content behind it is shipped."""
    folder, _ = checked
    found = disk._found

    def swapping(path: str, *rest: object) -> object:
        one = found(path, *rest)  # type: ignore[arg-type]
        if path == "deep":
            (folder / "www" / "deep").rename(folder / "moved")
            (folder / "www" / "deep").symlink_to(victim / "data" / "deep")
        return one

    monkeypatch.setattr(disk, "_found", swapping)
    with pytest.raises(OSError, match="changed while it was read"):
        disk.tree_tar(str(folder / "www"))
