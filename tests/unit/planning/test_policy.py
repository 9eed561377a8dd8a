"""What an experiment asks for beyond its own containers."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from srprov.definitions.containermodel import Mount
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.planning.policy import KINDS, permissions, refused
from tests.worlds import experiment, service

SOCKET = "/run/docker.sock"
ASKS: list[tuple[dict[str, Any], list[tuple[str, str]]]] = [
    ({}, []),
    ({"network": "none"}, []),
    ({"network": "host"}, [("host-network", "the robot's network")]),
    ({"network": "both"}, [("host-network", "the robot's network")]),
    ({"privileged": True}, [("privileged", "all devices and capabilities of the robot")]),
    ({"pid": "host"}, [("host-pid", "pid: host")]),
    ({"pid": "container:other"}, [("host-pid", "pid: container:other")]),
    ({"ipc": "host"}, [("host-ipc", "ipc: host")]),
    ({"ipc": "shareable"}, [("host-ipc", "ipc: shareable")]),
    ({"ipc": "private"}, []),
    ({"ipc": "none"}, []),
    ({"cap_add": ("SYS_ADMIN", "NET_ADMIN")}, [("capability", "NET_ADMIN"), ("capability", "SYS_ADMIN")]),
    ({"sysctls": {"net.x": "1"}}, [("sysctl", "net.x=1")]),
    ({"security_opt": ("apparmor=unconfined",)}, [("security-opt", "apparmor=unconfined")]),
    ({"devices": (("/dev/a", "/dev/b", "rwm"),)}, [("device", "/dev/a (rwm)")]),
    ({"device_cgroup_rules": ("c 81:* rmw",)}, [("device", "cgroup rule c 81:* rmw")]),
    ({"gpus": "all"}, [("gpu", "gpus: all")]),
    ({"mounts": (Mount(kind="bind", source="/", target="/r"),)}, [("host-path", "/")]),
    ({"mounts": (Mount(kind="bind", source="/a", target="/r", read_only=True),)}, [("host-path", "/a (read-only)")]),
    ({"mounts": (Mount(kind="bind", source=SOCKET, target="/r"),)}, [("docker-socket", SOCKET)]),
    ({"mounts": (Mount(kind="bind", source="/var" + SOCKET, target="/r"),)}, [("docker-socket", "/var" + SOCKET)]),
    ({"mounts": (Mount(kind="volume", source="v", target="/v"), Mount(kind="tmpfs", source="", target="/t"))}, []),
    ({"mounts": (Mount(kind="tree", source="/e/www", target="/v"),)}, []),
    ({"restart": "always", "tty": True, "shm_size": 1, "ports": (("", 80, 80, "tcp"),), "user": "0"}, []),
]  # fmt: skip


@pytest.mark.parametrize(("fields", "asked"), ASKS)
def test_what_is_asked(fields: dict[str, Any], asked: list[tuple[str, str]]) -> None:
    """Each thing that reaches the robot itself is one permission, and an ordinary container asks for none."""
    found = permissions(experiment(service("a", **fields)))
    assert [(one.kind, one.what) for one in found] == asked
    assert all(one.service == "a" for one in found)


def test_every_kind_is_asked_by_something() -> None:
    """The list of kinds that a user can allow holds nothing that is never asked."""
    assert {kind for _, asked in ASKS for kind, _ in asked} | {"secret", "playbook", "env", "outside"} == set(KINDS)


def test_reading_a_secret_of_the_controller_is_asked() -> None:
    """Whoever writes an EDF could name any variable, file or program: each service that gets one asks for it."""
    use = SecretUse(source="token", target="/run/secrets/token")
    found = permissions(
        experiment(
            dataclasses.replace(service("a"), secrets=(use,)), secrets={"token": SecretSource(name="token", env="HOME")}
        )
    )
    assert [(one.kind, one.service, one.what) for one in found] == [("secret", "a", "token, from the variable HOME")]


def test_permissions_are_sorted_by_gravity_then_service() -> None:
    """The order is that of the kinds, then of services, whatever the order in the file."""
    found = permissions(
        experiment(service("b", gpus="all", privileged=True), service("a", network="host", privileged=True))
    )
    assert [(one.kind, one.service) for one in found] == [
        ("privileged", "a"),
        ("privileged", "b"),
        ("host-network", "a"),
        ("gpu", "b"),
    ]


@pytest.mark.parametrize(
    ("allowed", "left"),
    [
        ((), ["privileged", "host-network"]),
        (("privileged",), ["host-network"]),
        (("all",), []),
        (("gpu",), ["privileged", "host-network"]),
    ],
)
def test_only_what_is_allowed_passes(allowed: tuple[str, ...], left: list[str]) -> None:
    """A kind that the user names passes, `all` passes all, and another kind helps nobody."""
    asked = permissions(experiment(service("a", privileged=True, network="host")))
    assert [one.kind for one in refused(asked, allowed)] == left
