"""What a plan file or a playbook says of a container is held to what an EDF may say."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from srprov.data import schema
from srprov.definitions.containermodel import HealthCheck, Logging, Runtime
from srprov.modules.run_limits import _ULIMITS, broken

NEVER = HealthCheck(test=("CMD", "true"), interval_s=1e9)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("restart", "always:0"), ("restart", "always:3"), ("restart", "Always"), ("restart", ""),
        ("ulimits", (("RTPRIO", 99, 99),)), ("ulimits", (("MEMLOCK", -1, -1),)), ("ulimits", (("nofile", -2, 1),)),
        ("stop_grace_s", 1e9), ("stop_grace_s", -1.0), ("healthcheck", NEVER),
        ("healthcheck", HealthCheck(test=("SHELL", "true"))), ("healthcheck", HealthCheck(test=("CMD",), retries=1001)),
        ("healthcheck", HealthCheck(test=("CMD", "x"), retries=0)),
        ("ipc", "container:other"), ("pid", "container:other"), ("pid", "Host"), ("gpus", "-1"),
        ("pull_policy", "never!"),
        ("cap_add", ("net_admin",)), ("devices", (("dev/x", "/dev/x", "rwm"),)), ("device_cgroup_rules", ("x",)),
        ("ports", (("", 0, 80, "tcp"),)), ("ports", (("", 80, 80, "TCP"),)), ("expose", ((70_000, "tcp"),)),
        ("ports", (("", 768, 80, "udp"),)), ("ports", (("127.0.0.1", 1023, 80, "udp"),)),
        ("ports", (("", 4789, 80, "udp"),)), ("ports", (("::1", 5000, 80, "tcp"),)),
        ("ports", (("::", 5000, 80, "tcp"),)), ("ports", (("224.0.0.1", 53, 53, "udp"),)),
        ("ports", (("0.0.0.1", 53, 53, "udp"),)), ("ports", (("255.255.255.255", 53, 53, "udp"),)),
        ("ports", (("1.2.3.256", 53, 53, "udp"),)),
        ("ports", (("localhost", 5000, 80, "tcp"),)),
        ("ports", tuple(("", port, port, "tcp") for port in range(1, 1002))),
        ("expose", tuple((port, "udp") for port in range(1, 1002))), ("mem_limit", -1), ("cpus", -1.0),
        ("working_dir", "etc"), ("cpuset", "0-"), ("cpuset", "0,"), ("cpuset", "a"), ("runtime", "-x"),
        ("runtime", "a/b"), ("hostname", "a b"), ("hostname", "-"), ("cap_drop", ("all",)), ("mem_reservation", -1),
        ("oom_score_adj", -1001), ("labels", {"srprov.instance": "other"}), ("labels", {"srprov": ""}),
        ("labels", {"com.docker.compose.service": "x"}),
        ("labels", {"": "x"}), ("extra_hosts", (("a\n", "10.0.0.1"),)), ("logging", Logging(driver="GELF ")),
        ("cpus", 1e-6),
    ],
)  # fmt: skip
def test_what_no_edf_could_say_is_refused(field: str, value: Any) -> None:
    """Spelt in another way, a value would pass the question for its permission; or hold a robot for ever."""
    (wrong,) = broken(replace(Runtime(), **{field: value}))
    assert wrong.startswith(field)


def test_what_an_edf_says_is_taken() -> None:
    """And the names of limits are those of the schema."""
    check = HealthCheck(test=("CMD-SHELL", "true"), retries=1000)
    many = Runtime(
        restart="on-failure:3", ulimits=(("rtprio", 99, 99), ("memlock", -1, -1)), stop_grace_s=86_400.0, ipc="host",
        pid="host", gpus="all", cap_add=("NET_ADMIN",), devices=(("/dev/x", "/dev/y", "rw"),), healthcheck=check,
        device_cgroup_rules=("c 81:* rmw",),
        ports=(("127.0.0.1", 65_535, 1, "udp"), ("", 767, 800, "udp"), ("", 800, 1, "tcp"), ("", 4789, 1, "tcp")),
        expose=((1, "tcp"),), cpus=0.5,
        cpuset="0-2,5", runtime="io.containerd.runc.v2", hostname="a.b", cap_drop=("ALL",), mem_reservation=1,
        oom_score_adj=-1000, labels={"srprovider": "x"}, logging=Logging(driver="local"), init=False,
    )  # fmt: skip
    assert list(broken(Runtime())) == list(broken(many)) == []
    assert list(broken(Runtime(healthcheck=HealthCheck(test=(), interval_s=0, timeout_s=0, retries=0)))) == []
    assert set(schema("edf")["$defs"]["ulimits"]["propertyNames"]["enum"]) == _ULIMITS
