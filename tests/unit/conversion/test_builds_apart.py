"""Builds of which several Compose files say something: whoever decides what they take may name their context."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run

CANARY = "nobodys-business"
DOCKERFILE = "FROM x\nARG A=lab\nARG B\nCOPY ${A} /all\n"
INLINE = r'dockerfile_inline: "FROM x\nARG B\nCOPY . /all\n"'
EXTENDED = "extends: {file: stranger/compose.yml, service: own}"


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a project of the user's, with a file of his own in it and a stranger's project, and go there."""
    monkeypatch.chdir(tmp_path)
    for name in ("project/lab", "project/stranger/maps"):
        Path(name).mkdir(parents=True)
    monkeypatch.chdir("project")
    Path("lab/notes.txt").write_text(CANARY)
    for folder in (Path(), Path("stranger")):
        (folder / "Dockerfile").write_text(DOCKERFILE)


def refused(files: list[str], capsys: pytest.CaptureFixture[str], *options: str) -> None:
    """Import files, and look that it is refused for what lies outside."""
    assert run(["import", "compose", *files, *options, "-o", "new"]) == 5
    assert "lies outside of the folder" in "".join(capsys.readouterr()) and not Path("new").exists()


@pytest.mark.parametrize(
    ("strangers", "own"),
    [
        (INLINE, "args: {B: c}"),
        (INLINE, "platforms: [linux/amd64]"),
        (INLINE, "context: ."),
        ("dockerfile: stranger/Dockerfile", "context: ."),
        ("dockerfile: stranger/Dockerfile", "args: {B: c}"),
        ("args: {A: .}", "context: ."),
        ("args: [A=.]", "args: [B=c]"),
        ("target: all", "context: ."),
    ],
)
def test_who_decides_what_a_build_takes_may_name_its_context(
    capsys: pytest.CaptureFixture[str], strangers: str, own: str
) -> None:
    """It is the whole folder of the user's own file, where he says it, or says anything else of the build."""
    Path("stranger/compose.yml").write_text(f"services: {{own: {{build: {{{strangers}}}}}}}\n")
    Path("mine.yml").write_text(f"services: {{own: {{{EXTENDED}, build: {{{own}}}}}}}\n")
    refused(["mine.yml"], capsys)


@pytest.mark.parametrize("strangers", [INLINE, "dockerfile: stranger/Dockerfile"])
def test_a_service_that_is_joined_is_built_by_no_dockerfile_of_a_file_apart(
    capsys: pytest.CaptureFixture[str], strangers: str
) -> None:
    """The user says that files have the service together, and not that one has what lies beside the other."""
    Path("stranger/compose.yml").write_text(f"services: {{own: {{build: {{{strangers}}}}}}}\n")
    Path("mine.yml").write_text("services: {own: {build: {context: ., args: {B: c}}}}\n")
    refused(["mine.yml", "stranger/compose.yml"], capsys, "--join", "services.own")


def test_who_may_name_the_context_decides_what_a_build_takes(capsys: pytest.CaptureFixture[str]) -> None:
    """The user's own file may name what lies in a folder below; one that is joined may say arguments."""
    Path("stranger/compose.yml").write_text("services: {own: {build: {context: .}}}\n")
    Path("mine.yml").write_text(f"services: {{own: {{{EXTENDED}, build: {{args: {{A: maps}}}}}}}}\n")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) == 0, capsys.readouterr().err
    assert "context: files/stranger" in Path("new/own.cdf").read_text() and not Path("new/files/lab").exists()
    Path("stranger/compose.yml").write_text("services: {own: {build: {args: {A: lab}}}}\n")
    Path("mine.yml").write_text("services: {own: {build: {context: ., dockerfile: Dockerfile}}}\n")
    files = ["mine.yml", "stranger/compose.yml"]
    assert run(["import", "compose", *files, "--join", "services.own", "-o", "joined"]) == 0, capsys.readouterr().err
    Path("mine.yml").write_text(f"services: {{own: {{{EXTENDED}, build: {{context: .}}}}}}\n")
    assert run(["import", "compose", "mine.yml", "--root", ".", "-o", "whole"]) == 0, capsys.readouterr().err
