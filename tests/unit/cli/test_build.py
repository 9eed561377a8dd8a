"""`srprov build` brings what `apply` would bring, and makes nothing else; --show prints it and asks nobody."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.definitions.lockfile import Lock, dump
from srprov.record.memory import recall
from tests.fakes import World
from tests.unit.cli.conftest import CDF


def images(world: World) -> dict[str, list[str]]:
    return {name: sorted(one.partition(":")[0] for one in robot.engine.images) for name, robot in world.robots.items()}


ALLOWED = ("-i", "inv.yml", "--allow", "secret")
BUILT = {"r1": ["alpine", "srprov/a"], "r2": ["srprov/a"]}


def test_only_images_come_to_robots_and_apply_needs_none_then(
    world: World, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The value of a secret is not needed. A second build changes nothing. The last run is what a record says."""
    assert run(["build", "e.edf", *ALLOWED, "--yes", "--json"]) == 0
    done = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("run")).iter_errors(done)) == []
    assert [step["id"].partition(":")[0] for step in done["steps"]] == ["r1/image", "r1/image", "r2/image"]
    assert images(world) == BUILT
    for robot in world.state().values():
        assert not any(robot[kind] for kind in ("containers", "networks", "volumes", "links", "files")), robot
    record = json.loads((Path(done["run"]) / "environment.json").read_text())
    assert record["verb"] == "build"
    assert json.loads((Path(done["run"]) / "assignment.json").read_text())["costs"] == {}, "nobody carries anything yet"

    assert run(["build", "e.edf", *ALLOWED, "--yes", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changed"] == 0

    monkeypatch.setenv("NOT_SET", "a value of some length")
    assert run(["plan", "e.edf", *ALLOWED, "--json"]) == 0
    planned = json.loads(capsys.readouterr().out)
    assert "image" not in {step["module"] for step in planned["steps"]} and planned["steps"]


def test_a_build_beside_a_running_experiment_touches_nothing_of_it(
    world: World, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Containers run on, and this machine remembers which record robots have."""
    monkeypatch.setenv("NOT_SET", "a value of some length")
    assert run(["apply", "e.edf", *ALLOWED, "--yes", "--settle", "0"]) == 0
    before, memory = world.state(), recall("demo")
    assert memory.robots == {"r1", "r2"}
    Path("a.cdf").write_text(CDF.format(word="two"))
    assert run(["build", "e.edf", *ALLOWED, "--yes"]) == 0
    assert world.state() == before and recall("demo") == memory
    assert images(world) == {"r1": ["alpine", "srprov/a", "srprov/a"], "r2": ["srprov/a", "srprov/a"]}
    capsys.readouterr()


def test_what_apply_would_refuse_is_refused_and_asked_about(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["build", "e.edf", "-i", "inv.yml", "--yes"]) == 9
    assert "--allow secret" in capsys.readouterr().err
    assert run(["build", "e.edf", *ALLOWED]) == 9
    assert "add --yes" in capsys.readouterr().err
    assert run(["build", "e.edf", *ALLOWED, "--yes", "--locked"]) == 5
    assert run(["build", "e.edf", "--yes"]) == 5
    assert "-i" in capsys.readouterr().err
    assert run(["build", "e.edf", "x", *ALLOWED, "--yes"]) == 5
    assert "no service 'x'" in capsys.readouterr().err
    assert not any(robot.engine.images for robot in world.robots.values())


def test_the_images_of_some_services_come_alone(world: World) -> None:
    """With where they are built; the placement is that of the whole experiment."""
    assert run(["build", "e.edf", "c", *ALLOWED, "--yes"]) == 0
    assert images(world) == {"r1": ["alpine"], "r2": []}
    assert run(["build", "e.edf", "b", *ALLOWED, "--yes"]) == 0
    assert images(world) == {"r1": ["alpine", "srprov/a"], "r2": ["srprov/a"]}, "r1 builds for r2"
    assert run(["build", "e.edf", *ALLOWED, "--yes"]) == 0
    assert images(world) == BUILT


def show(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert run(["build", "e.edf", "--show", *words]) == 0
    return capsys.readouterr().out


def test_show_prints_each_dockerfile_once_with_its_services_and_tag(
    world: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tag is the one that is built. No robot is known, none is asked."""
    text = show(capsys)
    assert not world.robots
    assert "# services: a, b\n# definition: a.cdf\n# image: srprov/a:" in text
    assert "FROM busybox:latest\n" in text and text.count("FROM") == 1
    assert "# c: the ready image alpine:3; nothing is built" in text
    assert "srprov/a" not in show(capsys, "c") and "alpine" not in show(capsys, "b")
    tag = text.partition("# image: ")[2].partition("\n")[0]
    assert run(["build", "e.edf", *ALLOWED, "--yes"]) == 0
    assert tag in world.robots["r2"].engine.images
    capsys.readouterr()
    assert run(["build", "e.edf", "--show", "x"]) == 5
    assert "there are: a, b, c" in capsys.readouterr().err
    assert run(["build", "e.edf", "--show", "--json"]) == 5


def test_show_looks_no_branch_up_and_says_what_it_does_not_know(
    world: World, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a whole commit it is known which one; with --allow git it is looked up, here in vain."""
    (tmp_path / "git").write_text(f"#!/bin/sh\ntouch {tmp_path}/ran\nexit 1\n")
    (tmp_path / "git").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    commit = "0123456789abcdef0123456789abcdef01234567"
    Path("a.cdf").write_text(
        f"cdf: 1\nbase: busybox\nrepositories: [{{git: https://h/x.git, path: /x}},"
        f" {{git: https://h/y.git, ref: {commit}, path: /y}}]\n"
    )
    text = show(capsys)
    assert "# image: known when its code repositories are fetched, here with --allow git" in text
    assert "# commit (what the default branch is by then) of https://h/x.git" in text
    assert f"# commit {commit} of https://h/y.git" in text
    assert not (tmp_path / "ran").exists()
    assert run(["build", "e.edf", "--show", "--allow", "git"]) == 5
    assert (tmp_path / "ran").exists()


def test_show_moves_no_cursor_whatever_a_dockerfile_says(
    world: World, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """What turns the writing around, or is not to be seen, is shown by number; tabs stay. Others are refused."""
    Path("image").mkdir()
    Path("image/Dockerfile").write_text("FROM busybox\nRUN echo\t'\u202egnp.exe' \u200b\n# \U000e0041\n")
    Path("a.cdf").write_text("cdf: 1\ndockerfile: image/Dockerfile\n")
    text = show(capsys)
    assert "RUN echo\t'\\u202egnp.exe' \\u200b\n# \\U000e0041\n" in text
    Path("a.cdf").write_text('cdf: 1\nbase: busybox\nrun: ["echo \\e[2J"]\n')
    text = show(capsys)
    assert 'RUN ["/bin/sh", "-ec", "echo \\u001b[2J"]' in text
    assert all(char.isprintable() or char in "\n\t" for char in text)


def test_show_reads_files_of_others_only_with_permission(
    world: World, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {cdf: ../a.cdf}}\n")
    assert run(["build", str(inner / "e.edf"), "--show"]) == 9
    assert "--allow outside" in capsys.readouterr().err
    assert run(["build", str(inner / "e.edf"), "--show", "--allow", "outside"]) == 0


def test_show_asks_for_a_key_that_an_inventory_names(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    """By what is in it nobody knows it for one."""
    Path("parts").mkdir()
    Path("parts/k").write_text("1234")
    Path("a.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: parts, dest: /p}]\n")
    Path("inv.yml").write_text("all: {hosts: {r1: {ansible_ssh_private_key_file: parts/k}}}\n")
    assert run(["build", "e.edf", "--show", "-i", "inv.yml"]) == 9
    assert "parts/k" in capsys.readouterr().err
    assert run(["build", "e.edf", "--show", "-i", "inv.yml", "--allow", "outside"]) == 0
    assert run(["build", "e.edf", "--show"]) == 0


def test_show_has_the_digests_of_a_lock_and_says_what_is_asked_for_each_plan(
    world: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """A base that nothing pins is told; one that a registry is asked for has no tag before."""
    assert "# its base is not pinned" in show(capsys)
    text = Path("e.edf").read_text()
    Path("e.edf").write_text(text.replace("robot: r1, volumes", "pull_policy: always, robot: r1, volumes"))
    asked = show(capsys, "a")
    assert "# image: known when it is planned, with the digest" in asked and "srprov/a:" not in asked
    digest = f"sha256:{'0' * 64}"
    Path("e.lock").write_text(dump(Lock(digests={"docker.io/library/busybox:latest": digest})))
    locked = show(capsys, "a")
    assert f"FROM busybox@{digest}\n" in locked and "# image: srprov/a:" in locked and "not pinned" not in locked
