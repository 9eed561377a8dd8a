"""The packages of an image: what is run for them, what is believed of the answer, and what is left behind."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution import packages
from srprov.execution.packages import NoListing, packages_in, parsed, remove_left
from srprov.modules.container import ContainerModule
from srprov.modules.container_commands import NOT_OF_COMPOSE
from srprov.wire import EngineCall, Reply
from tests.bounded import within

SAID = [
    "apt ii  curl 7.88.1-10+deb12u12",
    "apt rc  gone 1.0",
    'pip [{"name": "numpy", "version": "1.26.4", "installer": "pip"}, {"name": "apt-made", "version": "1"}]',
    'npm {"dependencies": {"@scope/ws": {"version": "8.18.0"}}}',
]


class Robot:
    """A robot whose engine does as it is told, but for one call."""

    host = "robot1"

    def __init__(self, refuses: str = "", log: list[str] | None = None) -> None:
        self.refuses, self.log, self.calls = refuses, SAID if log is None else log, list[EngineCall]()

    def execute(self, call: EngineCall) -> Reply:
        self.calls.append(call)
        bad = bool(self.refuses) and call.path.endswith(self.refuses)
        return Reply(status=500 if bad else 200, ok=not bad, err="no such thing" if bad else "")

    def container_log(self, _name: str, *, tail: int, follow: bool) -> Iterator[str]:
        assert tail > 0 and not follow
        if self.refuses == "log":
            raise TransportError(self.host, "the log broke", code=Code.LOST)
        yield from self.log


def listed(robot: Any) -> dict[str, list[str]]:
    return {kind: sorted(names) for kind, names in packages_in(robot, "sha256:1").items()}


def test_packages_are_named_as_a_cdf_names_them() -> None:
    """Of what is installed, and of pip's only what pip installed."""
    found = {"apt": ["curl=7.88.1-10+deb12u12"], "pip": ["numpy==1.26.4"], "npm": ["@scope/ws@8.18.0"]}
    assert listed(Robot()) == found
    assert listed(Robot(log=[])) == {"apt": [], "pip": [], "npm": []}


def test_the_container_has_no_network_no_rights_and_nothing_of_the_robot() -> None:
    robot = Robot()
    listed(robot)
    body = json.loads(robot.calls[0].body)
    host = body["HostConfig"]
    assert (host["NetworkMode"], host["CapDrop"], host["ReadonlyRootfs"]) == ("none", ["ALL"], True)
    assert not host.keys() & {"Binds", "Mounts", "Devices", "Privileged"} and host["PidsLimit"] and host["Memory"]
    marked = {"srprov.instance": ".build", **NOT_OF_COMPOSE}
    assert body["Labels"] == marked, "what a kill leaves is found by the next apply"
    assert [call.path.rpartition("/")[2] for call in robot.calls[:3]] == ["create", "start", "wait"]


def test_what_a_lock_that_was_killed_left_is_removed_by_the_next_one_and_is_nobodys_for_an_apply() -> None:
    """Also while it runs: what is in an image may run for ever. Builds under way, and others' containers, stay."""
    labels = {"srprov.instance": ".build"}
    there = [
        {"Id": "a" * 64, "Names": ["/srprov..packages-0123456789ab"], "State": "running", "Labels": labels},
        {"Id": "b" * 64, "Names": ["/srprov..packages-ba9876543210"], "State": "exited", "Labels": labels},
        {"Id": "c" * 64, "Names": ["/eager_turing"], "State": "running", "Labels": labels},
        {"Id": "d" * 64, "Names": ["/srprov..packages-mine"], "State": "running", "Labels": {}},
    ]
    robot: Any = Robot()
    robot.ask = lambda queries: [Reply(status=200, ok=True, out=json.dumps(there)) for _ in queries]
    remove_left(robot)
    gone = ["/containers/srprov..packages-0123456789ab", "/containers/srprov..packages-ba9876543210"]
    assert [(call.method, call.path) for call in robot.calls] == [("DELETE", path) for path in gone]
    found = ContainerModule().parse(robot.ask(ContainerModule().queries()))
    assert [(one.name, one.state["leftover"]) for one in found] == [
        ("srprov..packages-0123456789ab", "left by a lock that was cut off"),
        ("srprov..packages-ba9876543210", "left by a lock that was cut off"),
    ]


@pytest.mark.parametrize("fails", ["create", "start", "wait", "log"])
def test_it_is_removed_whatever_happens(fails: str) -> None:
    robot = Robot(fails)
    with pytest.raises(NoListing, match="the log broke" if fails == "log" else "no such thing"):
        listed(robot)
    assert robot.calls[-1].method == "DELETE" and ("force", "true") in robot.calls[-1].params


def test_an_image_that_takes_too_long_is_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "_LISTING_S", 0.0)
    with pytest.raises(NoListing, match="it takes longer than 0 s"):
        listed(Robot("wait"))


@pytest.mark.parametrize(
    "line",
    [
        "apt ii  a;reboot 1", "apt ii  curl $(reboot)", "apt ii  curl", "apt ii  curl 1 2", "apt ii  \x1b[31m 1",
        "apt", "apt ii  " + "a" * 200 + " 1", "rpm curl 1", "pip", "pip {}", "pip [1, {}]", "pip " + "[" * 9000,
        'pip [{"name": ["x"], "version": "1", "installer": "pip"}]', "npm []", 'npm {"dependencies": [1]}',
        'npm {"dependencies": {"x": 1, "y\\n": {"version": "1"}}}',
    ],
)  # fmt: skip
def test_whatever_is_no_package_is_left_out(line: str) -> None:
    assert not any(parsed(iter([line])).values())


def test_an_image_that_never_stops_to_talk_is_not_listened_to() -> None:
    def endless() -> Iterator[str]:
        number = 0
        while True:
            number += 1
            yield f"apt ii  package-{number} 1"

    with within(4):
        assert 1000 < len(parsed(endless())["apt"]) <= 50_000

    def wide() -> Iterator[str]:
        while True:
            yield "npm " + "x" * (1 << 20)

    assert parsed(wide())["npm"] == frozenset()
