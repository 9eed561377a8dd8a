"""What makes a container another container, and what does not."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.containermodel import HealthCheck, Logging, Mount, Runtime
from srprov.modules import MODULES
from srprov.modules.container_body import parts_of
from srprov.modules.container_form import told
from srprov.modules.container_limits import changed_limits
from srprov.modules.container_params import NetworkPlace
from srprov.published import ranges
from srprov.resource import Action, Resource
from srprov.wire import EngineCall
from tests.conftest import examples
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

OTHER: dict[str, Any] = {
    "command": ("x",),
    "entrypoint": ("x",),
    "environment": {"A": "1"},
    "working_dir": "/x",
    "user": "x",
    "stop_signal": "SIGINT",
    "stop_grace_s": 3.0,
    "healthcheck": HealthCheck(test=("CMD", "x")),
    "mounts": (Mount(kind="tmpfs", source="", target="/x"),),
    "devices": (("/dev/x", "/dev/x", "rwm"),),
    "ports": (("", 1, 2, "tcp"),),
    "ulimits": (("nofile", 1, 2),),
    "cap_add": ("X",),
    "cap_drop": ("X",),
    "privileged": True,
    "sysctls": {"a": "1"},
    "group_add": ("x",),
    "security_opt": ("x",),
    "device_cgroup_rules": ("c 81:* rmw",),
    "tty": True,
    "stdin_open": True,
    "init": False,
    "read_only": True,
    "hostname": "x",
    "extra_hosts": (("x", "10.0.0.1"),),
    "labels": {"a": "1"},
    "logging": Logging(driver="none"),
    "mem_reservation": 1,
    "oom_score_adj": -1,
    "cpuset": "0",
    "runtime": "x",
    "expose": ((1, "tcp"),),
    "mem_limit": 1,
    "cpus": 0.5,
    "pids_limit": 1,
    "shm_size": 1,
    "ipc": "host",
    "pid": "host",
    "gpus": "all",
    "restart": "always",
}
NO_PART = {"pull_policy", "job"}
"""Not the container's: the first is about its image, the second about how its end is judged."""


def wanted(**fields: Any) -> Resource:
    """Return the container resource of an experiment with one service."""
    world = World().add("r1")
    world.robots["r1"].engine.images["busybox:latest"] = {}
    plan = plan_for(world, experiment(service("a", **fields)))
    return next(step.want for step in plan.steps if step.want is not None and step.module == "container")


WANT = wanted()


def labels(resource: Resource) -> dict[str, str]:
    """Return the labels that its container would carry."""
    import json

    change = MODULES["container"].check(resource.name, resource.params, None)
    assert change is not None
    body = json.loads(change.commands[0].body)  # type: ignore[union-attr]
    return dict(body["Labels"])


def test_no_image_makes_a_container_one_of_composes() -> None:
    """An image's labels are its container's: Compose would make that anew, with its volumes and a service's rights."""
    said = labels(WANT)
    assert said["com.docker.compose.oneoff"] == said["com.docker.compose.service"] == ""


def test_every_run_time_field_is_covered() -> None:
    """A new field of Runtime must be in the hash, or be named here as one that makes no difference."""
    assert set(Runtime.__struct_fields__) == set(OTHER) | NO_PART


@pytest.mark.parametrize("field", OTHER)
def test_every_field_makes_another_container(field: str) -> None:
    """Whatever run-time field differs, the hash differs and exactly one part of it."""
    before, after = labels(wanted()), labels(wanted(**{field: OTHER[field]}))
    assert before["srprov.config-hash"] != after["srprov.config-hash"]
    parts = [dict(part.split("=") for part in one["srprov.config-parts"].split(",")) for one in (before, after)]
    assert len([name for name in {*parts[0], *parts[1]} if parts[0].get(name) != parts[1].get(name)]) == 1


@pytest.mark.parametrize("fields", [{"job": True}, {"pull_policy": "never"}, {"cost": 50.0}, {"robot": "r1"}])
def test_what_is_not_the_containers_makes_no_difference(fields: dict[str, Any]) -> None:
    """How a service is placed and judged restarts nothing."""
    assert labels(wanted()) == labels(wanted(**fields))


@settings(max_examples=examples(50), derandomize=True, deadline=None)
@given(st.dictionaries(st.text(min_size=1), st.text(), max_size=5), st.randoms())
def test_the_order_of_maps_says_nothing(environment: dict[str, str], random: Any) -> None:
    """The order in which variables are written does not reach the hash."""
    from srprov.modules.container_body import parts_of

    items = list(environment.items())
    random.shuffle(items)
    run = WANT.params.run
    one, two = (replace(run, environment=dict(each)) for each in (environment.items(), items))
    assert parts_of(replace(WANT.params, run=one)) == parts_of(replace(WANT.params, run=two))


def test_another_instance_or_source_is_a_label_and_no_restart() -> None:
    """Taking an instance over from another source changes no container."""
    here = wanted()
    moved = replace(here, params=replace(here.params, source="elsewhere"))
    assert labels(here)["srprov.config-hash"] == labels(moved)["srprov.config-hash"]
    assert labels(moved)["srprov.source"] == "elsewhere"


def test_the_stop_waits_for_the_containers_own_grace() -> None:
    """The time to wait for a stop is the container's grace and a minute, also where the wish has changed since."""
    from srprov.resource import Observed

    state = {"stop_grace": 300}
    stop, _ = MODULES["container"].removal(Observed(module="container", name="x", instance="i", state=state))
    assert stop.timeout_s == 360
    change = MODULES["container"].check("x", WANT.params, {**state, "hash": "0", "parts": {}, "state": "running"})
    assert change is not None and change.action is Action.REPLACE
    assert change.commands[0].timeout_s == 360


AS_MADE = {
    "Memory": "67108864", "MemoryReservation": "1024", "CpuQuota": "50000", "NanoCpus": "0", "CpusetCpus": "0-1",
    "PidsLimit": "64", "RestartPolicy": "on-failure:3",
}  # fmt: skip
"""As an engine keeps them."""


@pytest.mark.parametrize(
    ("found", "changed"),
    [
        (AS_MADE, ""),
        ({}, ""),  # where they cannot be read
        ({"Memory": "0", "CpuQuota": "0", "CpusetCpus": ""}, ""),  # a kernel without them
        ({**AS_MADE, "Memory": "134217728"}, "mem_limit was changed on the robot"),
        ({**AS_MADE, "MemoryReservation": "1"}, "mem_reservation was changed on the robot"),
        ({**AS_MADE, "CpuQuota": "1", "CpusetCpus": "0"}, "cpus, cpuset were changed on the robot"),
        ({**AS_MADE, "NanoCpus": "1"}, "cpus was changed on the robot"),
        ({**AS_MADE, "PidsLimit": "-1"}, "pids_limit was changed on the robot"),
        ({**AS_MADE, "RestartPolicy": "on-failure:4"}, "restart was changed on the robot"),
    ],
)
def test_limits_that_somebody_changed_are_named(found: dict[str, str], changed: str) -> None:
    """And what an engine fills in, or could not do, is no change."""
    run = Runtime(
        mem_limit=64 << 20, mem_reservation=1024, cpus=0.5, cpuset="0-1", pids_limit=64, restart="on-failure:3"
    )
    assert changed_limits(replace(WANT.params, run=run), found) == changed


NETWORKS = {"overlay": WANT.params.network, "host": NetworkPlace(mode="host")}


@pytest.mark.parametrize(
    ("mode", "count", "said"),
    [
        ("overlay", 2, "; publishes 8000:80/tcp, 127.0.0.1:8001:80/tcp"),
        (
            "overlay",
            6,
            "; publishes 8000:80/tcp, 127.0.0.1:8001:80/tcp, 8002:80/tcp, 127.0.0.1:8003:80/tcp, 8004:80/tcp, "
            "127.0.0.1:8005:80/tcp",
        ),
        ("overlay", 0, ""),
        ("host", 2, ""),
    ],
)
def test_the_plan_says_which_ports_of_the_robot_a_new_container_takes(mode: Any, count: int, said: str) -> None:
    """All: the last may be the one that the robot's own programs ask. In its network a port is only declared."""
    ports = tuple(("127.0.0.1" if number % 2 else "", 8000 + number, 80, "tcp") for number in range(count))
    want = replace(WANT.params, run=Runtime(ports=ports), network=NETWORKS[mode])
    assert told(want) == f"image busybox:latest{said}"


def test_neighbours_among_published_ports_are_one_range() -> None:
    at = "127.0.0.1"
    ports = [("", 80, 80, "tcp"), ("", 81, 81, "tcp"), ("", 82, 83, "tcp"), (at, 83, 84, "tcp"), (at, 84, 85, "udp")]
    assert list(ranges(ports)) == ["80-81:80-81/tcp", "82:83/tcp", "127.0.0.1:83:84/tcp", "127.0.0.1:84:85/udp"]
    assert list(ranges(("", 9000 + one, 8000 + one, "udp") for one in range(1000))) == ["9000-9999:8000-8999/udp"]
    assert not list(ranges(()))


def test_an_image_fills_no_volume_that_its_container_reads_alone() -> None:
    """An engine fills an empty one, whoever may write there; which mounts that is makes no container another one."""
    own_one = Mount(kind="volume", source="own", target="/own")
    resource = wanted(mounts=(own_one, replace(own_one, source="ws", target="/ws", read_only=True)))
    change = MODULES["container"].check(resource.name, resource.params, None)
    assert change is not None
    bodies = [one.body for one in change.commands if isinstance(one, EngineCall) and one.path == "/containers/create"]
    made = json.loads(bodies[0] or "")
    own, alone = (one for one in made["HostConfig"]["Mounts"] if one["Type"] == "volume")
    assert "VolumeOptions" not in own and alone["VolumeOptions"] == {"NoCopy": True}
    stated = [dict(one) for one in resource.params.mounts if one["Type"] == "volume"]
    assert stated == [own, {key: value for key, value in alone.items() if key != "VolumeOptions"}]
    assert parts_of(resource.params)["volumes"] == list(resource.params.mounts)


def test_the_plan_says_what_a_new_container_mounts_but_not_what_each_has() -> None:
    instance = WANT.params.instance
    kept, memory = f"/var/lib/srprov/{instance}", f"/run/srprov/{instance}/secrets"
    mounts: tuple[dict[str, Any], ...] = (
        {"Type": "volume", "Source": f"srprov.{instance}.bag", "Target": "/bag", "ReadOnly": True},
        {"Type": "bind", "Source": f"{kept}/trees/{'a' * 24}/app, two.yml", "Target": "/etc/app.yml", "ReadOnly": True},
        {"Type": "bind", "Source": "/srv/maps", "Target": "/maps", "ReadOnly": False},
        {"Type": "bind", "Source": f"{memory}/token", "Target": "/run/secrets/token", "ReadOnly": True},
        {"Type": "bind", "Source": f"{kept}/hosts", "Target": "/etc/hosts", "ReadOnly": True},
        {"Type": "bind", "Source": f"{kept}/cyclonedds.xml", "Target": "/run/x.xml", "ReadOnly": True},
        {"Type": "tmpfs", "Target": "/tmp"},
    )
    assert told(replace(WANT.params, mounts=mounts)) == (
        'image busybox:latest; mounts volume bag at /bag (read-only), "app, two.yml" at /etc/app.yml, '
        "the robot's /srv/maps at /maps, secret token at /run/secrets/token"
    )


def test_the_plan_says_of_a_new_container_what_it_mounts_that_no_edf_leads_to() -> None:
    """As of a plan file: a volume of another instance, or one that its options have be any folder of the robot."""
    others: dict[str, Any] = {"Type": "volume", "Source": "srprov.other.keys", "Target": "/k", "ReadOnly": False}
    folder: dict[str, Any] = {**others, "Source": "srprov.hello.bag"}
    folder["VolumeOptions"] = {"DriverConfig": {"Name": "local"}}
    assert told(replace(WANT.params, mounts=(others, folder))) == (
        'image busybox:latest; mounts {"ReadOnly":false,"Source":"srprov.other.keys","Target":"/k","Type":"volume"}, '
        '{"ReadOnly":false,"Source":"srprov.hello.bag","Target":"/k","Type":"volume",'
        '"VolumeOptions":{"DriverConfig":{"Name":"local"}}}'
    )
