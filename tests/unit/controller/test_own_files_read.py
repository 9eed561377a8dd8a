"""What a build reads of the user's own files, shipped or not, and records around files elsewhere: somebody is asked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.controller.dockerfiles import dockerfiles
from srprov.controller.own_files import asked_for, permit_copies
from srprov.definitions import load_experiment
from srprov.definitions.model import Inventory
from srprov.errors import RefusedError
from srprov.own_records import KEPT_OUT

EDF = "edf: 1\nname: nav\nservices: {a: {cdf: CDF}}\n"
KEY = "-----BEGIN OPENSSH PRIVATE KEY-----\nb3BlbnNzaC1rZXktdjEAAAAA\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name in ("lab/k/ctx", "mine"):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "lab")
    Path("e.edf").write_text(EDF.replace("CDF", "k/a.cdf"))
    Path("k/a.cdf").write_text("cdf: 1\ndockerfile: ctx/Dockerfile\n")
    Path("k/ctx/Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    yield tmp_path / "lab"


def asked() -> list[str]:
    """Return each file, from the folder, that is asked for as `outside`."""
    made = asked_for(load_experiment("e.edf", outside=True), Inventory(hosts={}, groups={}))
    return [os.path.relpath(what.partition(": it ")[0]) for _, what in made.experiment.outside]


@pytest.mark.parametrize("lines", [".dockerignore\nacme\n", "*\n", "acme\n", f"{'x' * 300}\n", "[z-a]\n", "x" * 70_000])
def test_a_dockerignore_of_the_user_s_is_asked_for_also_where_it_leaves_itself_out(here: Path, lines: str) -> None:
    """What is in the image tells which names stand in it, and so does what is wrong with a line of it."""
    for name in ("acme", "globex"):
        Path("k/ctx", name).write_text(name)
    Path("k/ctx/.dockerignore").write_text(lines)
    assert asked() == []
    Path("k/ctx/.dockerignore").unlink()
    Path("../mine/.dockerignore").write_text(lines)
    os.link("../mine/.dockerignore", "k/ctx/.dockerignore")
    assert asked() == ["k/ctx/.dockerignore"]
    with pytest.raises(RefusedError, match=r"k/ctx/\.dockerignore: it has another name, elsewhere"):
        permit_copies(load_experiment("e.edf"), ())
    Path("k/ctx/.dockerignore").unlink()
    Path("k/ctx/.dockerignore").symlink_to("Dockerfile")  # no line of it is taken
    assert asked() == []


def test_a_dockerfile_is_asked_for_also_where_its_folder_leaves_it_out(here: Path) -> None:
    Path("k/ctx/.dockerignore").write_text("Dockerfile\n")
    assert asked() == []
    Path("k/ctx/Dockerfile").write_text("FROM busybox\nRUN echo ansible_become_password=kuka-4711\n")
    assert asked() == ["k/ctx/Dockerfile"]


@pytest.mark.parametrize("kept", ["link", "key", "record"])
@pytest.mark.parametrize("cdf", ["dockerfile: ctx/Dockerfile", "base: busybox\nfiles: [{src: ctx, dest: /ws}]"])
def test_show_has_no_hash_of_the_user_s_own_files_unasked(here: Path, kept: str, cdf: str) -> None:
    """An image's tag is a hash of all that goes in: whoever has the rest tries words until one fits."""
    Path("k/a.cdf").write_text(f"cdf: 1\n{cdf}\n")
    assert "image: srprov/a:" in dockerfiles(load_experiment("e.edf"), (), ())[0]
    if kept == "record":
        Path("k/ctx/.gitignore").write_text(KEPT_OUT)
    Path("../mine/token").write_text(KEY if kept == "key" else "1234")
    if kept == "link":
        os.link("../mine/token", "k/ctx/token")
    else:
        Path("k/ctx/token").write_text(Path("../mine/token").read_text())
    with pytest.raises(RefusedError, match=r"a: outside \(.*/k/ctx/"):
        dockerfiles(load_experiment("e.edf"), (), ())
    assert "image: srprov/a:" in dockerfiles(load_experiment("e.edf"), (), ("outside",))[0]


def test_a_record_beside_a_cdf_that_lies_elsewhere_is_named(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever allows a folder beside the CDF is told what it is; what git fetched there is no record of his."""
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, f"{here.parent}/home")
    word = "it is srprov's own record, or what it keeps secrets in"
    for folder in (here.parent / "mine", here.parent / "home/srprov/git/folders/0"):
        (folder / "out").mkdir(parents=True)
        (folder / "out/db").write_text("hunter2")
        (folder / "p.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: out, dest: /ws}]\n")
        Path("e.edf").write_text(EDF.replace("CDF", os.path.relpath(folder / "p.cdf")))
        named = []
        for kept in ("", KEPT_OUT):
            (folder / "out/.gitignore").write_text(kept)
            found = asked_for(load_experiment("e.edf", outside=True), Inventory(hosts={}, groups={})).experiment.outside
            named.append([what for _, what in found if word in what])
        assert named == [[], [f"{folder}/out/: {word}"] if folder.name == "mine" else []]
