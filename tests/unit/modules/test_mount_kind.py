"""Links of a robot that lead to what is graver to mount than it looks, in a real shell of this machine."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.definitions.containermodel import Mount
from srprov.modules.mount_kind import GRAVE, links_refused, mount_kind
from srprov.wire import Run
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))


def tried(shell: tuple[str, ...], *paths: Path) -> tuple[int, str]:
    try:
        done = subprocess.run([*shell, links_refused(map(str, paths))], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"there is no {shell[0]} here")
    return done.returncode, done.stderr


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    "target",
    [
        *("/var/run/docker.sock", "/run/docker.sock", "/", "/run", "/var", "/var/lib", "/var/lib/docker", "/run/user"),
        *("/var/lib/srprov", "../../../../../../../../../../../../run", "/proc/1", "loop"),
    ],
)
def test_a_link_to_the_engine_is_not_mounted(tmp_path: Path, shell: tuple[str, ...], target: str) -> None:
    (tmp_path / "loop").symlink_to(target)
    (tmp_path / "on").symlink_to("loop")
    for path in (tmp_path / "loop", tmp_path / "on", tmp_path / "on" / ""):
        code, said = tried(shell, path)
        assert code == 1 and str(path) in said, said


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_what_is_not_there_counts_as_what_is_there_of_it(tmp_path: Path, shell: tuple[str, ...]) -> None:
    (tmp_path / "root").symlink_to("/")
    assert tried(shell, tmp_path / "root/run/docker/plugins/none")[0] == 1
    assert tried(shell, tmp_path / "root/var/lib/srprov/none")[0] == 1
    assert tried(shell, tmp_path / "none/below", Path("/not-there/at/all"), Path("/var/lib/not-there")) == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_other_links_are_mounted_as_ever(tmp_path: Path, shell: tuple[str, ...]) -> None:
    (tmp_path / "it's").mkdir()
    (tmp_path / "maps").symlink_to("it's")
    (tmp_path / "zone").symlink_to("/etc/hostname")
    assert tried(shell, tmp_path / "maps", tmp_path / "maps/none", tmp_path / "it's", tmp_path / "zone") == (0, "")


def test_what_is_grave_as_it_is_written_was_asked_for_as_that() -> None:
    assert links_refused(["/", "/var/run/docker.sock", "/proc"]) == ""
    assert mount_kind("/var/run/docker.sock")[0] == GRAVE


def test_a_container_is_made_only_after_its_paths_were_looked_at() -> None:
    """Also before a folder is made: `mkdir -p` follows links as the engine does."""
    mounts = (Mount(kind="bind", source="/srv/x", target="/x", create_host_path=True),)
    plan = plan_for(World().add("r1"), experiment(service("a", mounts=mounts)))
    (step,) = [step for step in plan.steps if step.module == "container"]
    first, second, *_ = step.commands
    assert isinstance(first, Run) and first.script == links_refused(["/srv/x"])
    assert second.text() == "mkdir -p -- /srv/x"


def test_a_container_that_has_ended_is_started_only_after_its_paths_were_looked_at() -> None:
    """The engine follows links again."""
    what = experiment(service("a", mounts=(Mount(kind="bind", source="/srv/x", target="/x"),)))
    world = World().add("r1")
    assert apply(world, what).exit_code == 0
    world.robots["r1"].engine.containers["srprov.hello.a"].state = "exited"
    (step,) = plan_for(world, what).steps
    assert [one.text() for one in step.commands[:1]] == [links_refused(["/srv/x"])]
