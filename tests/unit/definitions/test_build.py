"""What a CDF says of its image: the long form of `dockerfile`, and code repositories; nothing is fetched to know it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from srprov.definitions import check_files, load_container, load_experiment
from srprov.definitions.containermodel import Repository
from srprov.errors import DefinitionError
from srprov.planning.policy import permissions

STAGES = "ARG DISTRO=humble\nFROM busybox AS build\nARG WHO\nRUN x\nFROM scratch AS Run\nARG WHO=me\nFROM alpine\n"


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "docker").mkdir()
    (tmp_path / "docker" / "Dockerfile").write_text(STAGES)
    (tmp_path / "Dockerfile").write_text("FROM busybox\n")
    return tmp_path


def _cdf(here: Path, fields: str) -> Path:
    (here / "t.cdf").write_text(f"cdf: 1\n{fields}\n")
    return here / "t.cdf"


@pytest.mark.parametrize(
    ("written", "path", "context"),
    [
        ("docker/Dockerfile", "docker/Dockerfile", None),
        ("{}", "Dockerfile", "."),
        ("{context: docker}", "docker/Dockerfile", "docker"),
        ("{dockerfile: docker/Dockerfile}", "docker/Dockerfile", "."),
        ("{context: docker, dockerfile: ../Dockerfile}", "Dockerfile", "docker"),
    ],
)
def test_a_context_is_composes(here: Path, written: str, path: str, context: str | None) -> None:
    """In the short form it is the Dockerfile's own folder; in the long one the Dockerfile's path starts from it."""
    found = load_container(_cdf(here, f"dockerfile: {written}"))
    assert found.dockerfile == str(here / path)
    assert found.context == ("" if context is None else str((here / context).resolve()))


@pytest.mark.parametrize("args", ["{WHO: you, DISTRO: 1.10}", "[WHO=you, DISTRO=1.10]"])
def test_args_and_target_are_read(here: Path, args: str) -> None:
    found = load_container(_cdf(here, f"dockerfile: {{context: docker, args: {args}, target: run}}"))
    assert (dict(found.build_args), found.target) == ({"WHO": "you", "DISTRO": "1.10"}, "run")
    assert found.images == ("busybox",), "of the stages up to the target"


@pytest.mark.parametrize("name", ["BUILDKIT_SYNTAX", "BUILDKIT_CONTEXT_KEEP_GIT_DIR", "buildkit_syntax"])
def test_a_setting_of_the_builder_is_no_arg_also_where_the_dockerfile_declares_it(here: Path, name: str) -> None:
    (here / "docker" / "Dockerfile").write_text(f"ARG {name}\nFROM busybox\n")
    with pytest.raises(DefinitionError) as error:
        load_container(_cdf(here, f"dockerfile: {{context: docker, args: {{{name}: evil.example/frontend}}}}"))
    assert f"'{name}' is a setting of the builder itself" in error.value.problems[0].message


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("dockerfile: {context: docker, args: {WH0: x}}", "no ARG .* declares 'WH0'; did you mean 'WHO'?"),
        ("dockerfile: {args: {https_proxy: x}}", "no ARG .*; a proxy is a setting of the robot's engine"),
        ("dockerfile: {context: docker, args: [WHO]}", "'WHO' has no value; write WHO=value"),
        ("dockerfile: {context: docker, args: [WHO=a, WHO=b]}", "'WHO' is given twice; "),
        ("dockerfile: {context: docker, target: deploy}", r"has no stage 'deploy' \(build, run\)"),
        ("dockerfile: {context: docker, target: 3}", "has no stage '3'"),
        ("dockerfile: {context: nothing}", "'nothing/Dockerfile' does not exist"),
        ("dockerfile: {context: Dockerfile, dockerfile: ../Dockerfile}", "'Dockerfile' is no folder"),
        ("dockerfile: {context: ..}", r"'\.\./Dockerfile' leaves the folder"),
        ("dockerfile: {contxt: docker}", "contxt"),
        ("base: x\nrepositories: [{git: 'ext::sh -c x', path: /x}]", "is no address that srprov fetches from"),
        ("base: x\nrepositories: [{git: 'https://u:p@h/x', path: /x}]", "no user or password belongs into an address"),
        ("base: x\nrepositories: [{git: ../x, path: /x}]", r"'\.\./x' is no address"),
        ("base: x\nrepositories: [{git: https://h/x, ref: --x, path: /x}]", "'--x' is no name of a branch"),
        ("base: x\nrepositories: [{git: https://h/x, path: /}]", "'/' is no folder to put a repository in"),
        ("base: x\nrepositories: [{git: https://h/x, path: /a/../..}]", "is no folder to put a repository in"),
        ("base: x\nrepositories: [{git: https://h/x, path: /a}, {git: https://h/y, path: /a/}]", "'/a' has a"),
        ("image: x\nrepositories: [{git: https://h/x, path: /a}]", "'repositories' would be built into the image"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_at_its_line(here: Path, fields: str, message: str) -> None:
    with pytest.raises(DefinitionError, match=r"1 problem in") as refused:
        load_container(_cdf(here, fields))
    (problem,) = refused.value.problems
    assert problem.location.line > 1
    assert re.search(message, f"{problem.message}; {problem.hint}"), problem


def test_repositories_are_read_and_asked_for(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that lies on this machine outside of the experiment's folder is asked for as such, too."""
    monkeypatch.setenv("PATH", "/nonexistent")  # no git: nothing asks it
    monkeypatch.chdir(here)
    elsewhere = here.parent / "elsewhere.git"
    _cdf(
        here,
        f"""base: busybox
repositories:
- {{git: https://h/driver.git, ref: v2, path: /ws/driver/, run: make}}
- {{git: git@h:lab/msgs, path: /ws/msgs, run: [a, b]}}
- {{git: file://{here}/own.git, path: /own}}
- {{git: file://{elsewhere}, path: /other}}""",
    )
    (here / "e.edf").write_text("edf: 1\nname: a\nservices: {s: {cdf: t.cdf}}\n")
    assert check_files(["e.edf", "t.cdf"]) == []
    read = load_experiment("e.edf", {})
    (container,) = read.containers.values()
    assert container.repositories[:2] == (
        Repository(url="https://h/driver.git", ref="v2", path="/ws/driver", run=("make",)),
        Repository(url="git@h:lab/msgs", ref="", path="/ws/msgs", run=("a", "b")),
    )
    asked = permissions(read.experiment, read.containers)
    assert [(one.kind, one.service, one.what) for one in asked] == [
        ("git", "s", f"file://{elsewhere}, its default branch: fetched here, its files go into the image"),
        ("git", "s", f"file://{here}/own.git, its default branch: fetched here, its files go into the image"),
        (
            "git",
            "s",
            "git@h:lab/msgs, its default branch: fetched here, its files go into the image; git takes your SSH keys, "
            "so what only these open is given away, your own and other robots' too",
        ),
        ("git", "s", "https://h/driver.git, v2: fetched here, its files go into the image"),
        *sorted(("outside", "s", str(path)) for path in (elsewhere, here / "own.git")),
    ]
