"""Every kind of permission: which values are known to be harmless, and that a plan warns of all others.

A kind that is added later stands in here with a decision about its values, or this fails.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from msgspec.structs import replace

from srprov.definitions.containermodel import ContainerDefinition, Logging, Mount
from srprov.definitions.model import NetworkSettings
from srprov.definitions.playbook import read
from srprov.definitions.playbookmodel import AFTER
from srprov.planning.markdown import plan_markdown
from srprov.planning.plan import Plan
from srprov.planning.policy import KINDS, Permission, permissions
from srprov.planning.text import plan_text
from srprov.report.html import whole
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

WARNS = re.compile(r"as good as root|root's programs|root may|as root|a key there may")
LONG = "x" * 3000


class Kind(NamedTuple):
    """What is decided of a kind, by fields of a service."""

    harmless: tuple[dict[str, Any], ...] = ()
    warned: tuple[dict[str, Any], ...] = ()


def bind(source: str, *, read_only: bool = False) -> dict[str, Any]:
    return {"mounts": (Mount(kind="bind", source=source, target="/in", read_only=read_only),)}


def device(path: str) -> dict[str, Any]:
    return {"devices": ((path, "/dev/x", "rw"),)}


def logs(driver: str, **options: str) -> dict[str, Any]:
    return {"logging": Logging(driver=driver, options={name.replace("_", "-"): one for name, one in options.items()})}


def each(name: str, *values: str) -> tuple[dict[str, Any], ...]:
    return tuple({name: (value,)} for value in values)


TABLE = {
    "privileged": Kind(warned=({"privileged": True}, device("/srv/x"), device("/dev/shm/x"))),
    "host-network": Kind(warned=({"network": "host"}, {"network": "both"})),
    "host-pid": Kind(warned=({"pid": "host"}, {"pid": "another"})),
    "host-ipc": Kind(harmless=({"ipc": "shareable"},), warned=({"ipc": "host"},)),
    "host-path": Kind(
        harmless=(bind("/opt/ros", read_only=True), bind("/usr/share", read_only=True)),
        warned=(
            bind("/srv/maps"),
            bind("/srv/maps", read_only=True),
            bind("/media"),
            bind("/opt/x"),
            bind(f"/{LONG}"),
            bind("/srv/.x"),
            bind("/etc", read_only=True),
            bind("~u/x"),
            bind("/srv/salt/x"),
        ),
    ),
    "docker-socket": Kind(warned=(bind("/run/docker.sock"), bind("/proc"), bind("/run/user/0/x"), bind("/"))),
    "device": Kind(
        harmless=(device("/dev/video0"), device("/dev/snd"), *each("device_cgroup_rules", "c 81:* rw")),
        warned=(
            device("/dev/lidar"),
            device("/dev/sda"),
            device("/dev/ttyTHS1"),
            device("/dev/i2c-1"),
            *each("device_cgroup_rules", "c 250:0 r", "c 180:0 r", "c 89:* rw", "b 1:1 r"),
        ),
    ),
    "capability": Kind(
        harmless=each("cap_add", "IPC_LOCK", "CAP_SYS_NICE"),
        warned=each(
            "cap_add",
            "SYS_ADMIN",
            "SYS_PTRACE",
            "CAP_SYS_PTRACE",
            "NET_ADMIN",
            "CAP_NET_ADMIN",
            "BPF",
            "SYS_TIME",
            "SYSLOG",
            "CAP_CAP_SYS_NICE",
            "sys_nice",
            "X",
        ),
    ),
    "sysctl": Kind(
        harmless=tuple(
            {"sysctls": {name: "1"}} for name in ("net.ipv4.ip_forward", "kernel.shmmax", "fs.mqueue.msg_max")
        ),
        warned=(
            *(
                {"sysctls": {name: LONG}}
                for name in ("kernel.core_pattern", "kernel/modprobe", "net/x", "net.", "vm.x")
            ),
            *({"sysctls": {name: "1"}} for name in (LONG, "net.../kernel/core_pattern", "kernel.shmmax\n")),
        ),
    ),
    "security-opt": Kind(
        harmless=each("security_opt", "no-new-privileges", "apparmor=unconfined", "label=disable"),
        warned=each("security_opt", "seccomp=unconfined", "seccomp={}", "systempaths=unconfined", f"x={LONG}", ""),
    ),
    "runtime": Kind(
        harmless=({"runtime": "runc"}, {"runtime": "runsc"}),
        warned=tuple({"runtime": name} for name in ("nvidia", "io.containerd.x.v2", "/usr/bin/x", "runc ", LONG)),
    ),
    "logging": Kind(
        harmless=(logs("json-file", tag=LONG), logs("local", max_size="1")),
        warned=(
            *(logs(driver, x="y") for driver in ("journald", "syslog", "gelf", "a/plugin:1")),
            *(logs("json-file", x=LONG), logs("", tag=LONG), logs("", max_size="1")),
        ),
    ),
    "engine-fetch": Kind(warned=({"image": "localhost:5000/x"}, {"image": "10.0.0.1/x"})),
}
"""Kinds of which a container's own fields ask, and which lend it something of the robot."""
NEVER = {
    "gpu": "the engine gives a card, and its driver's files",
    "realtime": "it takes time and memory of others",
    "low-port": "as ports from 1024 on, of which docs/trust.md says what is not stopped",
    "restart-always": "the same container starts again",
    "unit": "what the unit does is srprov's own",
    "built-image": "another experiment's files, which the plan names",
    "fetch": "of the controller: a download",
    "git": "of the controller: a download",
    "outside": "of the controller: files, which the plan names",
    "env": "of the controller: variables, which the plan names",
    "secret": "of the controller: values, which the plan names",
    "secret-command": "of the controller, all of which it lends: the kind says it",
}
"""Kinds no value of which makes anybody root on a robot, and why not."""
OF_THE_WHOLE = {"playbook"}
"""Kinds that are no service's: tested below."""


def asked(kind: str, fields: dict[str, Any]) -> list[Permission]:
    return [one for one in permissions(experiment(service("a", **fields))) if one.kind == kind]


CASES = [(kind, fields, bool(at)) for kind, has in TABLE.items() for at in (0, 1) for fields in has[at]]


def test_of_each_kind_it_is_decided_which_values_are_harmless() -> None:
    assert sorted([*TABLE, *NEVER, *OF_THE_WHOLE]) == sorted(KINDS)
    assert all(has.warned for has in TABLE.values()) and all(NEVER.values())


@pytest.mark.parametrize(("kind", "fields", "warned"), CASES)
def test_a_plan_warns_of_all_values_that_are_not_known_to_be_harmless(
    kind: str, fields: dict[str, Any], warned: bool
) -> None:
    """What is harmless is a closed list: whatever an engine or a kernel learns next is none of it."""
    found = asked(kind, fields)
    assert found and any(WARNS.search(one.what) for one in found) == warned, found


def test_what_is_harmless_in_a_namespace_of_its_own_is_none_in_the_robot_s() -> None:
    for fields in ({"network": "host"}, {"network": "both"}, {"ipc": "host"}):
        (found,) = asked("sysctl", {"sysctls": {"net.core.somaxconn": "1"}, **fields})
        assert WARNS.search(found.what)


def test_who_has_other_addresses_outside_than_in_the_overlay_may_be_a_registry() -> None:
    (found,) = permissions(replace(experiment(service("a")), network=NetworkSettings(subnet="192.168.50.0/28")))
    assert found.kind == "host-network" and WARNS.search(found.what)


def test_what_a_build_fetches_is_warned_of() -> None:
    cdf = ContainerDefinition(name="x", file="/e/x.cdf", folder="/e", fetches=(f"http://127.0.0.1/{LONG}",))
    (found,) = permissions(experiment(replace(service("a"), image="", cdf="/e/x.cdf")), {"/e/x.cdf": cdf})
    assert found.kind == "engine-fetch" and WARNS.search(found.what)


def test_a_playbook_is_warned_of(tmp_path: Path) -> None:
    file = tmp_path / "a.yml"
    file.write_text("- command: mark\n  shell: touch /opt/m\n  creates: /opt/m\n", encoding="utf-8")
    book = read(str(file), file.name, file.name, AFTER)
    first, *commands = permissions(experiment(service("a"), playbooks=(book,)))
    assert {one.kind for one in (first, *commands)} == OF_THE_WHOLE and WARNS.search(first.what)


@pytest.mark.parametrize(("kind", "fields"), [(kind, fields) for kind, fields, warned in CASES if warned])
def test_every_output_warns(kind: str, fields: dict[str, Any]) -> None:
    """In text, in JSON, in Markdown and on a page: no value is so long that its warning is cut off."""
    found = next(one for one in asked(kind, fields) if WARNS.search(one.what))
    plan: Plan = replace(
        plan_for(World().add("r1"), experiment(service("a"))), permissions=(found,), notes=(found.what,)
    )
    page = whole(found.what).markup.replace("&#x27;", "'")
    outputs = (
        plan_text(plan),
        msgspec.json.encode(plan.permissions).decode(),
        plan_markdown(plan).replace("\\", ""),
        page,
    )
    assert all(WARNS.search(one) for one in outputs)
