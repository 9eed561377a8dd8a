"""Compose files in folders apart are imported together as one project of the user's alone, whose folder he names."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions import homes
from srprov.importing.compose.folders import apart
from srprov.importing.position import Position

CANARY = "nobodys-business"
MINE = "services: {own: {image: x}}\n"
THEIRS = "services: {theirs: {image: y}}\n"
EXTENDING = "services: {own: {extends: {file: vendor/compose.yml, service: theirs}}}\n"
VENDOR = {"mine.yml": MINE, "vendor/compose.yml": THEIRS}


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a project, whose name a shell must have quoted, and go there."""
    folder = tmp_path / "my project"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def written(files: dict[str, str]) -> None:
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)


def including(said: str) -> dict[str, str]:
    return {**VENDOR, "mine.yml": f"{MINE}include: [{said}]\n"}


APART = {
    "below": (VENDOR, "mine.yml vendor/compose.yml", "vendor/compose.yml:1:1"),
    "below, first": (VENDOR, "vendor/compose.yml mine.yml", "mine.yml:1:1"),
    "beside": ({"lab/mine.yml": MINE, "c/compose.yml": THEIRS}, "lab/mine.yml c/compose.yml", "c/compose.yml:1:1"),
    "third": (
        {"lab/mine.yml": MINE, "lab/more.yml": MINE, "a/b/compose.yml": THEIRS, "c.yml": THEIRS},
        "lab/mine.yml lab/more.yml a/b/compose.yml c.yml",
        "a/b/compose.yml:1:1",
    ),
    "robots": (
        {**VENDOR, "robots.yml": "mine.yml: r1\nvendor/compose.yml: r2\n"},
        "mine.yml vendor/compose.yml --robot-map robots.yml",
        "vendor/compose.yml:1:1",
    ),
    "a robot's": (
        {**including("vendor/compose.yml"), "other.yml": MINE, "robots.yml": "other.yml: r1\nmine.yml: r2\n"},
        "other.yml mine.yml --robot-map robots.yml",
        "mine.yml:2:11",
    ),
    "included": (including("vendor/compose.yml"), "mine.yml", "mine.yml:2:11"),
    "included by its path": (including("{path: vendor/compose.yml}"), "mine.yml", "mine.yml:2:18"),
    "included with one beside": (
        {**including("{path: [more.yml, vendor/compose.yml]}"), "more.yml": MINE.replace("own", "more")},
        "mine.yml",
        "mine.yml:2:29",
    ),
    "included with its folder": (
        including("{path: vendor/compose.yml, project_directory: vendor}"),
        "mine.yml",
        "mine.yml:2:18",
    ),
    "included as if it lay here": (
        including("{path: vendor/compose.yml, project_directory: .}"),
        "mine.yml",
        "mine.yml:2:18",
    ),
    "included with another's folder": (
        {**including("{path: more.yml, project_directory: vendor}"), "more.yml": MINE.replace("own", "more")},
        "mine.yml",
        "mine.yml:2:47",
    ),
    "included with variables": (
        {**including("{path: vendor/compose.yml, env_file: own.env}"), "own.env": "A=1\n"},
        "mine.yml",
        "mine.yml:2:18",
    ),
    "included by one beside": (
        {**including("more.yml"), "more.yml": "include: [vendor/compose.yml]\n"},
        "mine.yml",
        "more.yml:1:11",
    ),
    "extended": ({**VENDOR, "mine.yml": EXTENDING}, "mine.yml", "mine.yml:1:34"),
    "extended by one beside": (
        {
            **VENDOR,
            "base.yml": EXTENDING,
            "mine.yml": "services: {own: {extends: {file: base.yml, service: own}}}\n",
        },
        "mine.yml",
        "base.yml:1:34",
    ),
}


@pytest.mark.parametrize("case", APART)
def test_a_file_in_a_folder_apart_is_refused_once_and_imported_as_one_project_of_the_users(
    project: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    files, words, place = APART[case]
    written(files)
    command = ["import", "compose", *words.split(), "-o", "new"]
    assert run(command) == 5 and not Path("new").exists()
    said = "".join(capsys.readouterr())
    assert said.count("apart from") == 1 and f"{place}: error[SRP-113]: " in said, said
    assert "may be a stranger's" in said and "a stranger's import by itself" in said
    (root,) = re.findall(r"--root (.*), which lets", said)
    assert shlex.split(root) == [str(project)]
    assert run([*command, "--root", *shlex.split(root)]) == 0, capsys.readouterr()
    assert Path("new/experiment.edf").exists()


@pytest.mark.parametrize("said", [including("vendor/compose.yml")["mine.yml"], EXTENDING])
def test_no_word_of_what_lies_there_is_read(capsys: pytest.CaptureFixture[str], said: str) -> None:
    """What is wrong with a file is shown with its lines."""
    written({"mine.yml": said, "vendor/compose.yml": f"{CANARY}: [", "vendor/.env": f"{CANARY}\n= 1\n"})
    for files in (["mine.yml"], ["mine.yml", "vendor/compose.yml"]):
        assert run(["import", "compose", *files, "-o", "new"]) == 5
        told = "".join(capsys.readouterr())
        assert "apart from mine.yml" in told and CANARY not in told


SIDE_BY_SIDE = {
    "laid over": "mine.yml more.yml",
    "a map": "mine.yml more.yml --robot-map robots.yml",
    "by another name": "mine.yml ../link/more.yml",
    "included": "including.yml",
    "included with its folder": "whole.yml",
    "extended": "extending.yml",
    "variables apart": "mine.yml more.yml --env-file vendor/own.env",
}


@pytest.mark.parametrize("case", SIDE_BY_SIDE)
def test_files_side_by_side_are_imported(project: Path, capsys: pytest.CaptureFixture[str], case: str) -> None:
    project.with_name("link").symlink_to(project)
    written(
        {
            "mine.yml": MINE,
            "more.yml": THEIRS,
            "including.yml": f"{MINE}include: [more.yml]\n",
            "whole.yml": f"{MINE}include: [{{path: ./more.yml, project_directory: .}}]\n",
            "extending.yml": EXTENDING.replace("vendor/compose", "more"),
            "robots.yml": "mine.yml: r1\nmore.yml: r2\n",
            "vendor/own.env": "A=1\n",
        }
    )
    words = [str(project.parent / "link/more.yml") if "link" in one else one for one in SIDE_BY_SIDE[case].split()]
    assert run(["import", "compose", *words, "-o", "new"]) == 0, capsys.readouterr()


def test_a_file_lies_where_its_link_leads(capsys: pytest.CaptureFixture[str]) -> None:
    """By its name it lay beside the user's own."""
    written({**including("linked.yml"), "other.yml": MINE})
    Path("linked.yml").symlink_to("vendor/compose.yml")
    for files in (["mine.yml"], ["other.yml", "linked.yml"]):
        assert run(["import", "compose", *files, "-o", "new"]) == 5
        assert "linked.yml lies in a folder apart" in "".join(capsys.readouterr()) and not Path("new").exists()


def test_no_folder_that_holds_a_home_is_proposed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    written({"lab/mine.yml": MINE, "c/compose.yml": THEIRS})
    monkeypatch.setattr(homes, "_home", lambda _: "")
    monkeypatch.setenv("HOME", str(tmp_path / "my project" / "ada"))
    assert run(["import", "compose", "lab/mine.yml", "c/compose.yml", "-o", "new"]) == 5
    told = "".join(capsys.readouterr())
    assert "copy it beside that one; a stranger's import by itself" in told and "--root" not in told
    monkeypatch.setenv("HOME", "none")
    hint = apart("/b/c.yml", "/a/c.yml", ("/a", "/b"), Position("/b/c.yml")).problems[0].hint
    assert "copy it beside" in hint and "--root" not in hint


@pytest.mark.parametrize(
    ("files", "root"),
    [(("lab/mine.yml", "c/compose.yml"), "lab"), (("lab/mine.yml",), "c"), (("lab/mine.yml",), "lab/conf")],
)
def test_a_whole_project_s_folder_is_around_all_files(
    capsys: pytest.CaptureFixture[str], files: tuple[str, ...], root: str
) -> None:
    """Also one below them: what they include there is apart from them."""
    written({"lab/mine.yml": MINE, "c/compose.yml": THEIRS, "lab/conf/compose.yml": THEIRS})
    assert run(["import", "compose", *files, "--root", root, "-o", "new"]) == 5
    assert f"{files[-1]} does not lie in it" in "".join(capsys.readouterr()) and not Path("new").exists()


@pytest.mark.parametrize("said", ["../away/more.yml", "{path: mine.yml, project_directory: ../away}", "linked.yml"])
def test_nothing_around_a_whole_project_is_included(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], said: str
) -> None:
    (tmp_path / "away").mkdir()
    (tmp_path / "away/more.yml").write_text(f"services: {{a: {{image: {CANARY}}}}}\n")
    written({"lab/compose.yml": f"include: [{said.replace('../', '../../')}]\n", "lab/mine.yml": MINE})
    Path("lab/linked.yml").symlink_to(tmp_path / "away/more.yml")
    assert run(["import", "compose", "lab/compose.yml", "--root", ".", "-o", "new"]) == 5
    told = "".join(capsys.readouterr())
    assert "lies outside" in told and CANARY not in told and not Path("new").exists()


def test_a_link_of_variables_leads_an_included_project_no_further_than_the_whole_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody names `.env`, so it may lead to any file of the user's that reads like one."""
    (tmp_path / "private.env").write_text(f"A={CANARY}\n")
    written({**including("vendor/compose.yml"), "vendor/compose.yml": THEIRS.replace("y}", "'y:${A}'}")})
    Path("vendor/.env").symlink_to(tmp_path / "private.env")
    assert run(["import", "compose", "mine.yml", "--root", ".", "-o", "new"]) == 5
    told = "".join(capsys.readouterr())
    assert "lies outside" in told and CANARY not in told and not Path("new").exists()
    Path("vendor/.env").unlink()
    Path("vendor/.env").write_text("A=7\n")
    assert run(["import", "compose", "mine.yml", "--root", ".", "-o", "new"]) == 0, capsys.readouterr()
    assert "y:7" in Path("new/experiment.edf").read_text()


@pytest.mark.parametrize(
    "use", ["volumes: ['./vendor/conf:/c:ro']", "volumes: ['./vendor/conf:/c']", "build: vendor/conf"]
)
def test_no_link_beside_a_file_of_a_whole_project_leads_out_of_its_folder(
    capsys: pytest.CaptureFixture[str], use: str
) -> None:
    """The one file may name what lies beside the other; where a link there leads is that one's word."""
    for place in ("private", "vendor/real"):
        written({f"{place}/Dockerfile": "FROM x\n"})
    written({**VENDOR, "mine.yml": f"services: {{own: {{image: x, {use}}}}}\n"})
    words = ["import", "compose", "mine.yml", "vendor/compose.yml", "--root", ".", "-o", "new"]
    Path("vendor/conf").symlink_to("../private")
    assert run(words) == 5
    assert "lies outside" in capsys.readouterr().out and not Path("new").exists()
    Path("vendor/conf").unlink()
    Path("vendor/conf").symlink_to("real")
    assert run(words) == 0, capsys.readouterr()


@pytest.mark.parametrize("target", ["../../lab/maps/hall", "l/../../../lab/maps"])
def test_no_link_beside_a_dockerfile_leads_to_what_another_one_has_copied(
    capsys: pytest.CaptureFixture[str], target: str
) -> None:
    """Who copied the experiment, or an export, by scp or zip had the one file in what the other one builds with."""
    written({"lab/Dockerfile": "FROM x\n", "lab/maps/hall": CANARY, "nav/Dockerfile": "FROM x\n"})
    written({"swarm.yml": "version: '1'\nservices: {a: {image: lab}, b: {image: nav}}\n", "nav/ctx/x": ""})
    Path("nav/ctx/l").symlink_to(".")
    Path("nav/ctx/floor").symlink_to(target)
    words = ["import", "swarmrob", "swarm.yml", "lab/Dockerfile", "nav/Dockerfile", "-o", "new"]
    assert run(words) != 0
    told = capsys.readouterr().err
    assert "leads out of the folder" in told and "copy what it leads to there" in told and not Path("new").exists()
    Path("nav/ctx/floor").unlink()
    Path("nav/ctx/floor").symlink_to("l/../Dockerfile")
    assert run(words) == 0, capsys.readouterr()


@pytest.mark.parametrize("form", ["text", "json", "sarif"])
def test_the_refusal_is_in_every_form(capsys: pytest.CaptureFixture[str], form: str) -> None:
    written(VENDOR)
    assert run(["import", "compose", "mine.yml", "vendor/compose.yml", "-o", "new", "--format", form]) == 5
    told = capsys.readouterr()
    assert "lies in a folder apart from mine.yml" in (told.err if form == "text" else told.out)
    assert sorted(os.listdir()) == ["mine.yml", "vendor"]
