"""Folders that verbs fill: a link of a stranger's, in a project that was cloned, leads nothing elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run

INVENTORY = ("-i", "inv.yml")


@pytest.mark.parametrize("written", ["out", "out/", "out/.", "./out", "sub/../out", "out/new", "sub/up/new"])
@pytest.mark.parametrize(
    "words",
    [
        ("export", "compose", "e.edf", "-o"),
        ("export", "swarm", "e.edf", *INVENTORY, "-o"),
        ("export", "kubernetes", "e.edf", *INVENTORY, "-o"),
        ("import", "compose", "compose.yml", "-o"),
        ("import", "swarmrob", "swarm.yml", "-o"),
        ("init",),
        ("replay", "b.zip", *INVENTORY, "-o"),
        ("snapshot", "r1", *INVENTORY, "-o"),
    ],
)
def test_a_link_in_the_place_of_a_new_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...], written: str,
) -> None:  # fmt: skip
    """It led to a folder of the user's that was empty, and the files were written there."""
    project, away = tmp_path / "project", tmp_path / "away"
    for folder in (project / "sub", away):
        folder.mkdir(parents=True)
    (project / "e.edf").write_text("edf: 1\nname: x\nservices: {a: {image: busybox}}\n")
    (project / "compose.yml").write_text("services: {a: {image: busybox}}\n")
    (project / "swarm.yml").write_text("version: '1'\nservices: {a: {image: busybox}}\n")
    (project / "inv.yml").write_text("all: {hosts: {r1: {}}}\n")
    (project / "b.zip").write_text("")
    (project / "out").symlink_to(away)
    (project / "sub/up").symlink_to(away)
    monkeypatch.chdir(project)
    assert run([*words, written]) == 5
    assert "is a link" in capsys.readouterr().err
    assert list(away.iterdir()) == []


def test_no_file_of_an_example_is_written_by_way_of_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`init --example` in a project fills folders that may be there, and a link was taken for one."""
    away, project = tmp_path / "away", tmp_path / "project"
    for folder in (away, project):
        folder.mkdir()
    (project / "www").symlink_to(away)
    monkeypatch.chdir(project)
    assert run(["init", "--example", "hello"]) == 5
    assert "already there: www" in capsys.readouterr().err
    assert list(away.iterdir()) == [] and [one.name for one in project.iterdir()] == ["www"]


@pytest.mark.parametrize("written", ["runs", "./runs/", "runs/new", "sub/../runs"])
def test_no_run_is_recorded_by_way_of_a_link_that_leads_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], written: str
) -> None:
    """A project that was cloned has a link `runs`: the record of an `apply` was written where it leads."""
    project, away = tmp_path / "project", tmp_path / "away"
    for folder in (project / "sub", project / "kept", away):
        folder.mkdir(parents=True)
    (project / "e.edf").write_text("edf: 1\nname: x\nservices: {a: {image: busybox}}\n")
    (project / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    (project / "runs").symlink_to(away)
    monkeypatch.chdir(project)
    apply = ["apply", "e.edf", *INVENTORY, "--yes", "--runs"]
    assert run([*apply, written]) == 5
    assert "is a link that leads out of its folder" in capsys.readouterr().err
    assert run([*apply, str(project / "runs")]) == 4, "a whole path is the user's own"
    monkeypatch.setenv("SRPROV_RUNS", written)
    assert run(["runs"]) == 5
    (project / "runs").unlink()
    (project / "runs").symlink_to("kept")
    monkeypatch.setenv("SRPROV_RUNS", "runs")
    assert run(["runs"]) == 0


@pytest.mark.parametrize(
    "words",
    [
        ("apply", "e.edf", "--yes", "--events"),
        ("destroy", "e.edf", "--yes", "--events"),
        ("assign", "e.edf", "--svg"),
        ("assign", "e.edf", "--png"),
        ("runs", "show", "kept", "--svg"),
    ],
)
def test_no_events_and_no_picture_are_written_by_way_of_a_link_that_leads_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """A project has a link `out`, and a file of the user's with that name lies where it leads: it was replaced."""
    project, away = tmp_path / "project", tmp_path / "away"
    for folder in (project, away):
        folder.mkdir()
    (project / "e.edf").write_text("edf: 1\nname: x\nservices: {a: {image: busybox}}\n")
    (project / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    (project / "out").symlink_to(away)
    (away / "kept").write_text("the user's")
    monkeypatch.chdir(project)
    where = [] if words[0] == "runs" else INVENTORY
    assert run([*words, "out/kept", *where]) == 5
    assert "out is a link that leads out of its folder" in capsys.readouterr().err
    assert [one.read_text() for one in away.iterdir()] == ["the user's"]
    codes = (5,) if words[0] == "runs" else (4, 8)
    assert run([*words, str(project / "out" / "new"), *where]) in codes
    assert "is a link" not in capsys.readouterr().err, "a whole path is the user's own"


def test_links_of_a_whole_path_are_the_user_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """He may keep what is large on another disk, and his temporary folder may be a link."""
    (tmp_path / "away").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "away")
    monkeypatch.chdir(tmp_path / "away")
    assert run(["init", str(tmp_path / "out" / "new")]) == 0
    assert run(["init", "below/new"]) == 0
    assert {one.name for one in (tmp_path / "away").iterdir()} == {"new", "below"}


@pytest.mark.parametrize(
    "words",
    [
        ("bundle", "out/kept", "-o", "b.zip"),
        ("report", "out/kept", "-o", "r.html"),
        ("report", "mine", "-o", "r.html"),
        ("export", "compose", "out/kept", "-o", "made"),
        ("export", "swarm", "out/kept", *INVENTORY, "-o", "made"),
        ("export", "kubernetes", "out/kept", *INVENTORY, "-o", "made"),
        ("replay", "mine", *INVENTORY, "-o", "made"),
        ("plan", "out/kept", *INVENTORY),
        ("apply", "out/kept", "--yes", *INVENTORY),
        ("run", "out/kept", "--yes", *INVENTORY),
    ],
)
def test_nothing_is_passed_on_that_a_link_leads_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """`bundle latest` packed a run of the user's that lies beside the project; an export had what his EDF ships."""
    project, away = tmp_path / "project", tmp_path / "away"
    for folder in (project, away):
        folder.mkdir()
    (away / "kept").write_text("edf: 1\nname: x\nservices: {a: {image: busybox}}\n")
    (project / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    (project / "out").symlink_to(away)
    (project / "mine").symlink_to(away / "kept")
    monkeypatch.chdir(project)
    assert run(words) == 5
    told = capsys.readouterr().err
    assert "is a link that leads out of its folder" in told and f"name that: {away}" in told
    assert {one.name for one in project.iterdir()} == {"inv.yml", "out", "mine"}


def test_nothing_is_passed_on_that_is_a_second_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An archive that is unpacked beside the user's own plan gives it one."""
    (tmp_path / "mine.json").write_text('{"plan": 1, "instance": "mine", "steps": []}')
    (tmp_path / "mine.zip").write_bytes(b"PK")
    monkeypatch.chdir(tmp_path)
    for name in ("plan.json", "run.zip"):
        Path(name).hardlink_to(Path("mine").with_suffix(Path(name).suffix))
    for words in (("report", "plan.json"), ("report", "run.zip"), ("export", "compose", "plan.json")):
        assert run([*words, "-o", "made"]) == 5
        assert "has another name" in capsys.readouterr().err and not Path("made").exists()


@pytest.mark.parametrize(
    "words", [("bundle", "latest", "-o", "b.zip"), ("report", "latest", "-o", "r.html"), ("runs", "show", "latest"),
              ("replay", "latest", *INVENTORY, "-o", "made"), ("bundle", "latest/run", "-o", "b.zip")],
)  # fmt: skip
def test_what_may_be_published_is_named_without_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """An archive that is unpacked in the user's home has one to a run of his, which stays in that folder."""
    (tmp_path / "mine/run").mkdir(parents=True)
    if words[0] == "replay":
        (tmp_path / "run.zip").write_bytes(b"PK")
    (tmp_path / "latest").symlink_to("run.zip" if words[0] == "replay" else "mine")
    monkeypatch.chdir(tmp_path)
    assert run(words) == 5
    told = capsys.readouterr().err
    assert "latest is a link, which a project may have brought" in told and f"name that: {tmp_path}/" in told
