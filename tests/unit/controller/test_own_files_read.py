"""What a build reads of the user's own files, shipped or not: somebody is asked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.controller.own_files import asked_for, permit_copies
from srprov.definitions import load_experiment
from srprov.definitions.model import Inventory
from srprov.errors import RefusedError

EDF = "edf: 1\nname: nav\nservices: {a: {cdf: CDF}}\n"


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
    made = asked_for(load_experiment("e.edf"), Inventory(hosts={}, groups={}))
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
