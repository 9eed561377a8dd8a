"""What a plan says of robots that are not ready for new containers, and when it asks."""

from __future__ import annotations

from typing import Any

import pytest

from srprov.definitions.containermodel import Mount
from srprov.definitions.model import NetworkSettings
from srprov.errors import NoAssignment, UsageError
from tests.bounded import bounded
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service

MISSING = "/var/lib/srprov/nowhere"
"""The fake robot has every path but those below here."""
ALLOWED = {"allowed": frozenset({"host-path"})}
LISTENER = 'tcp LISTEN 0 128 0.0.0.0:2222 0.0.0.0:* users:(("sshd",pid=1,fd=3))'


def bind(**fields: Any) -> dict[str, Any]:
    return {"mounts": (Mount(kind="bind", source=MISSING, target="/x", **fields),)}


def test_a_folder_that_is_not_on_the_robot_is_seen_by_the_plan() -> None:
    with pytest.raises(UsageError, match=f"r1: {MISSING}, which 'a' mounts, does not exist") as caught:
        plan_for(World().add("r1"), experiment(service("a", **bind())))
    assert "create_host_path" in caught.value.hint


def test_a_folder_that_shall_be_made_is_made_before_the_container() -> None:
    plan = plan_for(World().add("r1"), experiment(service("a", **bind(create_host_path=True))))
    (step,) = [step for step in plan.steps if step.module == "container"]
    assert step.commands[0].text() == f"mkdir -p -- {MISSING}"
    assert plan.permissions[0].kind == "docker-socket"  # the fake robot misses only paths of srprov's own folder
    assert (
        plan.permissions[0].what
        == f"{MISSING} (made where it is not there; as good as root on the robot: what an engine or srprov keeps)"
    )


def test_a_port_that_a_program_of_the_robot_has_is_known_with_its_name() -> None:
    world = World().add("r1")
    world.robots["r1"].listening = [LISTENER]
    with pytest.raises(NoAssignment) as caught:
        plan_for(world, experiment(service("a", ports=(("", 2222, 80, "tcp"),))))
    assert caught.value.misses == {"a": {"r1": "port 2222/tcp is taken by sshd"}}


def test_a_port_that_is_added_to_a_running_service_is_looked_for_too() -> None:
    """The placement is settled then, so nobody asked before."""
    world = World().add("r1")
    assert apply(world, experiment(service("a"))).exit_code == 0
    world.robots["r1"].listening = [LISTENER]
    with pytest.raises(UsageError, match="r1: port 2222/tcp is taken by sshd, and 'a' would have it"):
        plan_for(world, experiment(service("a", ports=(("", 2222, 80, "tcp"),))))


def test_the_ports_of_the_own_containers_are_not_somebody_elses() -> None:
    """Neither when nothing changes, nor when the container is replaced, nor when another service joins."""
    world = World().add("r1")
    one = service("a", ports=(("", 8080, 80, "tcp"),))
    assert apply(world, experiment(one)).exit_code == 0
    assert plan_for(world, experiment(one)).empty
    other = service("a", ports=(("", 8080, 81, "tcp"),))
    assert not plan_for(world, experiment(other, service("b"))).empty


def test_the_ports_of_another_instance_are() -> None:
    world = World().add("r1")
    assert apply(world, experiment(service("a", ports=(("", 8080, 80, "tcp"),)))).exit_code == 0
    with pytest.raises(NoAssignment) as caught:
        plan_for(world, experiment(service("b", ports=(("", 8080, 80, "tcp"),)), name="other"))
    assert caught.value.misses == {"b": {"r1": "port 8080/tcp is taken by container srprov.hello.a"}}


def test_the_port_of_an_overlay_is_taken_also_while_its_link_is_not_there() -> None:
    """As since the robot booted: members send to it, and the engine would hand it to whoever publishes the port."""
    world = World().add("r1")
    assert apply(world, experiment(service("a"), network=NetworkSettings(port=5001))).exit_code == 0
    with pytest.raises(NoAssignment) as caught:
        plan_for(world, experiment(service("b", ports=(("", 5001, 80, "udp"),)), name="other"))
    assert caught.value.misses == {"b": {"r1": "port 5001/udp is taken by the overlay of instance 'hello'"}}
    assert not plan_for(world, experiment(service("b", ports=(("", 5001, 80, "tcp"),)), name="other")).empty


def test_where_nothing_is_new_nobody_is_asked() -> None:
    """Neither for folders nor for ports: it costs no round trip."""
    world = World().add("r1")
    what = experiment(
        service("a", ports=(("", 8080, 80, "tcp"),), mounts=(Mount(kind="bind", source="/s", target="/t"),))
    )
    assert apply(world, what).exit_code == 0
    before = world.robots["r1"].traffic.round_trips
    assert plan_for(world, what).empty
    assert world.robots["r1"].traffic.round_trips == before + 1


def led(world: World, where: str) -> World:
    """Let a robot have a link to somewhere at every path that it is asked of."""
    world.robots["r1"].leads = where
    return world


BIND = {"mounts": (Mount(kind="bind", source="/srv/log", target="/x"),)}


def test_where_a_link_leads_is_said_in_the_plan() -> None:
    plan = plan_for(led(World().add("r1"), "/etc\x1b[2J"), experiment(service("a", **BIND)))
    led_to = "r1: /srv/log, which 'a' mounts, leads to /etc[2J (root may run or believe what is written there)"
    assert led_to in plan.notes
    plan = plan_for(led(World().add("r1"), "/mnt/ssd/log"), experiment(service("a", **BIND)))
    assert "r1: /srv/log, which 'a' mounts, leads to /mnt/ssd/log" in plan.notes


def test_a_link_to_the_engine_is_no_ordinary_path() -> None:
    """Whoever is allowed `host-path` is not by that allowed the engine."""
    for where in ("/run/docker.sock", "/", "/var/lib/docker/volumes"):
        with pytest.raises(UsageError, match=f"/srv/log, which 'a' mounts, leads to {where}: mount that, which asks"):
            plan_for(led(World().add("r1"), where), experiment(service("a", **BIND)))


def test_thousands_of_folders_that_are_not_there_are_named_in_time() -> None:
    mounts = tuple(Mount(kind="bind", source=f"{MISSING}/{number}", target=f"/{number}") for number in range(3000))
    what = experiment(service("a", mounts=mounts))

    def refused() -> int:
        with pytest.raises(UsageError) as caught:
            plan_for(World().add("r1"), what)
        return caught.value.message.count("does not exist")

    assert bounded(refused, 5.0) == 3000


def test_a_robot_that_says_anything_of_links_is_heard_as_text() -> None:
    plan = plan_for(led(World().add("r1"), "relative"), experiment(service("a", **BIND)))
    assert plan.notes == ()


DISK = "41 23 0:38 / /srv/log/a\\040disk {0},relatime shared:1 - tmpfs tmpfs {0},size=1k\n"


@pytest.mark.parametrize(
    ("api", "way", "said"), [("1.43", "rw", True), ("1.41", "ro", False), ("1.44", "rw", False)]
)  # fmt: skip
def test_what_stays_writable_below_a_path_that_is_mounted_read_only_is_said_in_the_plan(
    api: str, way: str, said: bool
) -> None:
    """`/boot` may be read-only, and `/boot/firmware` in it not: root on the robot when it boots."""
    world = World().add("r1", api=api)
    world.robots["r1"].mounts = DISK.format(way) + "garbage\n42 23 0:39 / /srv/logs rw - tmpfs tmpfs rw\n"
    mounts = (Mount(kind="bind", source="/srv/log", target="/x", read_only=True),)
    notes = plan_for(world, experiment(service("a", mounts=mounts))).notes
    told = "r1: /srv/log is read-only for 'a', but what is mounted below it is not: /srv/log/a disk"
    assert (told in notes) == said and bool(notes) == said
    assert not plan_for(
        world, experiment(service("a", mounts=(Mount(kind="bind", source="/srv/log", target="/x"),)))
    ).notes


def test_what_stays_writable_and_is_believed_by_root_is_said_to_be() -> None:
    """Such as groups of processes below `/sys`: by their files a container leaves the rules for its devices."""
    world = World().add("r1", api="1.41")
    world.robots["r1"].mounts = "41 23 0:40 / /sys/fs/cgroup/devices rw - cgroup cgroup rw,devices\n"
    mounts = (Mount(kind="bind", source="/sys", target="/x", read_only=True),)
    (note,) = plan_for(world, experiment(service("a", mounts=mounts))).notes
    assert "is not: /sys/fs/cgroup/devices (root may run or believe what is written there)" in note
