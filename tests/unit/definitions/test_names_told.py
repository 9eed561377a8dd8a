"""A hint at a line of an EDF or a CDF quotes no name out of a file or folder that is not the experiment's own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions import load_container, load_experiment
from srprov.errors import DefinitionError

SECRET = "acme-merger"
DOCKERFILE = f"FROM debian:12 AS {SECRET}-stage\nARG {SECRET}-NAME=1\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    project = tmp_path / "project"
    for folder in ("victim/.ssh", "project/.git/refs", "project/run"):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("events.jsonl", "environment.json", f"{SECRET}-2026.txt"):
        (project / "run" / name).write_text("")
    for name in (f"victim/{SECRET}-2026", f"victim/.ssh/{SECRET}-2026", f"project/.git/refs/{SECRET}-2026"):
        (tmp_path / name).write_text("")
    (tmp_path / "victim/Dockerfile").write_text(DOCKERFILE)
    (project / "away").symlink_to("../victim")
    monkeypatch.chdir(project)
    return project


def problems(text: str) -> str:
    Path("e.edf").write_text(f"edf: 1\nname: a\n{text}\n")
    with pytest.raises(DefinitionError) as wrong:
        load_experiment("e.edf", {}, outside=True)
    return "\n".join(str(one) for one in wrong.value.problems)


@pytest.mark.parametrize(
    "folder", ["../victim", "../victim/.ssh", ".git/refs", "away", "{top}/victim", "run/../../victim"]
)
def test_no_name_in_a_folder_elsewhere_is_suggested(here: Path, folder: str) -> None:
    named = f"{folder.format(top=here.parent)}/acme-merge-2026"
    assert SECRET not in problems(f"services: {{x: {{cdf: {named}}}}}")


def test_no_name_in_a_record_or_a_home_is_suggested(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert SECRET not in problems("services: {x: {cdf: run/acme-merge-2026.txt}}")
    (here / f"{SECRET}.cdf").write_text("")
    assert f"did you mean '{SECRET}.cdf'?" in problems("services: {x: {cdf: acme-merge.cdf}}")
    monkeypatch.setenv("HOME", str(here))
    assert SECRET not in problems("services: {x: {cdf: acme-merge.cdf}}")


@pytest.mark.parametrize("place", ["Dockerfile", ".git/Dockerfile"])
@pytest.mark.parametrize("more", ["target: acme-merge-stage", "args: {acme-merge-NAME: x}"])
def test_no_stage_and_no_arg_of_a_users_dockerfile_is_named(here: Path, place: str, more: str) -> None:
    if place == "Dockerfile":
        os.link(here.parent / "victim/Dockerfile", here / place)
    else:
        (here / place).write_text(DOCKERFILE)
    (here / "c.cdf").write_text(f"cdf: 1\ndockerfile: {{context: ., dockerfile: {place}, {more}}}\n")
    assert SECRET not in problems("services: {x: {cdf: c.cdf}}")
    with pytest.raises(DefinitionError) as wrong:
        load_container("c.cdf", {})
    assert SECRET not in str(wrong.value.problems)
    Path(here / "Own").mkdir()
    (here / "Own/Dockerfile").write_text(DOCKERFILE)
    (here / "c.cdf").write_text(f"cdf: 1\ndockerfile: {{context: Own, {more}}}\n")
    assert SECRET in problems("services: {x: {cdf: c.cdf}}")


@pytest.mark.parametrize("place", ["c.cdf", ".git/c.cdf"])
def test_no_volume_of_a_users_cdf_is_named(here: Path, place: str) -> None:
    """What is wrong with an EDF and a CDF together is told at the EDF's line."""
    theirs = here.parent / "victim/c.cdf"
    theirs.write_text(f"cdf: 1\nimage: busybox\nvolumes: ['{SECRET}:/v']\n")
    os.link(theirs, here / "c.cdf") if place == "c.cdf" else (here / place).write_text(theirs.read_text())
    (here / "seed").write_text("")
    assert SECRET not in problems(f"services: {{x: {{cdf: {place}}}}}\nvolumes: {{acme-merge: {{seed: seed}}}}")


def test_what_the_user_names_himself_is_told_with_what_he_may_mean(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending in ("edf", "cdf"):
        (here / f"{SECRET}.{ending}").write_text("")
        assert run(["validate", f"acme-merge.{ending}"]) != 0
        assert f"did you mean '{SECRET}.{ending}'?" in "".join(capsys.readouterr())
