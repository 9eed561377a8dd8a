"""What a robot itself calls things: the names of its own /etc/hosts, and the homes of its users."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions.containermodel import Mount
from srprov.errors import NoAssignment
from srprov.facts.spelled import MOST_LINES
from srprov.planning.graver import WRITTEN
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def hosts_of(world: World, robot: str, service: str) -> list[str]:
    """Return the lines of the hosts file that a service's container has."""
    body = world.robots[robot].engine.containers[f"srprov.hello.{service}"].body
    (path,) = [one["Source"] for one in body["HostConfig"]["Mounts"] if one["Target"] == "/etc/hosts"]
    return world.robots[robot].disk.files[path].decode().splitlines()


@pytest.mark.parametrize("mode", ["host", "both"])
def test_a_service_with_its_robots_network_knows_the_robots_names_and_one_on_the_overlay_does_not(mode: str) -> None:
    """Names of the experiment come first and win."""
    world = World().add("r1", "r2")
    world.robots["r1"].spelled = "/etc/hosts:10.0.0.9 camera.lab\n/etc/hosts:10.6.6.6 a b\n"
    what = experiment(
        service("a", robot="r1", network=mode), service("b", robot="r1"),
        service("c", robot="r1", network=mode, extra_hosts=(("more", "10.0.0.8"),)),
        service("d", robot="r2", network=mode),
    )  # fmt: skip
    apply(world, what)
    for name in ("a", "c"):
        assert "10.0.0.9\tcamera.lab" in hosts_of(world, "r1", name)
        assert not [line for line in hosts_of(world, "r1", name) if "10.6.6.6" in line]
    assert "10.0.0.8\tmore" in hosts_of(world, "r1", "c")
    assert not [line for line in (*hosts_of(world, "r1", "b"), *hosts_of(world, "r2", "d")) if "camera" in line]
    assert not plan_for(world, what).steps


def test_a_changed_hosts_file_of_the_robot_is_followed_without_a_restart() -> None:
    """It is rewritten where it is mounted."""
    world = World().add("r1")
    what = experiment(service("a", network="host"))
    apply(world, what)
    made = world.robots["r1"].engine.containers["srprov.hello.a"]
    world.robots["r1"].spelled = "/etc/hosts:10.0.0.9 camera.lab\n"
    (step,) = plan_for(world, what).steps
    assert (step.module, step.change.cause) == ("file", "content differs")
    apply(world, what)
    assert "10.0.0.9\tcamera.lab" in hosts_of(world, "r1", "a")
    assert world.robots["r1"].engine.containers["srprov.hello.a"] is made


def test_lines_that_are_not_read_are_said() -> None:
    """A robot with thousands of names: those that count are the first."""
    world = World().add("r1")
    world.robots["r1"].spelled = "/etc/hosts:10.0.0.9 camera.lab\n" + "/etc/hosts:\n" * MOST_LINES
    (note,) = [one for one in plan_for(world, experiment(service("a", network="host"))).notes if "/etc/hosts" in one]
    assert note == "r1: its /etc/hosts is long; of its names containers have those of the first 512 lines"
    assert not [one for one in plan_for(world, experiment(service("a"))).notes if "/etc/hosts" in one]


def home(user: str, rest: str = "/data") -> Mount:
    return Mount(kind="bind", source=f"~{user}{rest}", target="/data")


def test_a_home_is_that_of_the_robot_and_the_plan_shows_it() -> None:
    """In the container, in the permission, and in the record of what is asked for."""
    world = World().add("r1", "r2")
    world.robots["r1"].spelled = "/etc/passwd:robot:x:1000:1000::/home/robot:/bin/sh\n"
    world.robots["r2"].spelled = "/etc/passwd:robot:x:1000:1000::/srv/people/robot:/bin/sh\n"
    what = experiment(
        service("a", robot="r1", mounts=(home("robot"),)), service("b", robot="r2", mounts=(home("robot", ""),))
    )
    for name, path in (("r1", "/home/robot/data"), ("r2", "/srv/people/robot")):
        world.robots[name].disk.files[path] = b""
    plan = plan_for(world, what)
    asked = {(one.service, one.kind, one.what) for one in plan.permissions if one.service in ("a", "b")}
    written = "/home/robot/data (root may run or believe what is written there)"
    assert asked == {("a", "host-path", written), ("b", "host-path", f"/srv/people/robot ({WRITTEN})")}
    apply(world, what)
    mounts = world.robots["r1"].engine.containers["srprov.hello.a"].body["HostConfig"]["Mounts"]
    assert "/home/robot/data" in {one["Source"] for one in mounts}
    assert not plan_for(world, what).steps


def test_a_home_that_leads_to_the_engine_is_asked_for_as_that() -> None:
    """A robot may say anything of its users."""
    world = World().add("r1")
    world.robots["r1"].spelled = "/etc/passwd:robot:x:1000:1000::/run:/bin/sh\n"
    world.robots["r1"].disk.files["/run/docker.sock"] = b""
    plan = plan_for(world, experiment(service("a", mounts=(home("robot", "/docker.sock"),))))
    assert [(one.kind, one.what) for one in plan.permissions] == [
        ("docker-socket", "/run/docker.sock (as good as root on the robot)")
    ]


def test_a_service_runs_where_the_user_is_whose_home_it_mounts() -> None:
    """Where there is none, the refusal says so of each robot."""
    world = World().add("r1", "r2")
    world.robots["r2"].spelled = "/etc/passwd:robot:x:1000:1000::/home/robot:/bin/sh\n"
    world.robots["r2"].disk.files["/home/robot/data"] = b""
    what = experiment(service("a", mounts=(home("robot"),)))
    assert plan_for(world, what).assignment == {"a": "r2"}
    world.robots["r2"].spelled = ""
    with pytest.raises(NoAssignment) as refused:
        plan_for(world, what)
    assert set(refused.value.misses["a"].values()) == {"mounts the home of user 'robot' (not there)"}
