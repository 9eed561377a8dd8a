"""`status --wide`: what engines say of single containers, with fields; what they say wrongly stays out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.status_wide import wide_columns
from srprov.codes import Code
from srprov.controller.wide import wide_rows
from srprov.errors import TransportError
from srprov.wire import EngineQuery, Reply

GOOD = {
    "Name": "/srprov.hello.web",
    "RestartCount": 3,
    "State": {"Status": "exited", "ExitCode": 137, "StartedAt": "2026-11-23T20:00:00.123456789Z",
              "FinishedAt": "2026-11-23T20:05:00Z"},
    "NetworkSettings": {"Ports": {"80/tcp": [{"HostIp": "0.0.0.0", "HostPort": "8080"},
                                             {"HostIp": "::", "HostPort": "8080"}], "90/udp": None}},
    "Mounts": [{"Type": "volume", "Name": "srprov.hello.log", "Source": "/v/x", "Destination": "/log", "RW": True},
               {"Type": "bind", "Source": "/etc/hosts", "Destination": "/etc/hosts", "RW": False}],
}  # fmt: skip
HOSTILE = {
    "Name": ["x"],
    "RestartCount": "many",
    "State": {"Status": "running" * 100, "ExitCode": 2**64, "StartedAt": "x\n", "FinishedAt": None},
    "NetworkSettings": {"Ports": {"80": [{}], "http/tcp": [{}], "1/tcp": [7, {"HostPort": "\u0661"}, {"HostIp": {}}]}},
    "Mounts": {"a": 1},
}


class Robot:
    """A robot whose engine says these things, or nothing any more."""

    def __init__(self, *bodies: object) -> None:
        self.bodies, self.asked = list(bodies), 0

    def ask(self, queries: Sequence[EngineQuery]) -> list[Reply]:
        self.asked += 1
        if not self.bodies:
            raise TransportError("r1", "lost contact", code=Code.LOST)
        return [Reply(status=200, out=json.dumps(one)) for one in self.bodies]


def rows(robot: Robot, count: int = 1) -> list[dict[str, Any]]:
    """Return rows as `status --wide` has them, held to its schema."""
    given = [{"robot": "r1", "container": f"{number:012x}"} for number in range(count)]
    given.append({"robot": "r2", "container": ""})
    found = wide_rows(given, {"r1": "192.0.2.1", "r2": "192.0.2.2"}, {"r1": robot})  # type: ignore[dict-item]  # as much of a session as is used
    schema = data.schema("status")
    for row in found:
        Draft202012Validator({"$ref": "#/$defs/wide", "$defs": schema["$defs"]}).validate(row["wide"])
    return found


def test_an_engines_words_become_fields() -> None:
    (row, other) = rows(Robot(GOOD))
    assert row["wide"] == {
        "robot_address": "192.0.2.1",
        "container": "srprov.hello.web",
        "state": "exited",
        "exit_code": 137,
        "restarts": 3,
        "started": "2026-11-23T20:00:00Z",
        "ended": "2026-11-23T20:05:00Z",
        "ports": [
            {"port": 80, "protocol": "tcp", "robot_port": 8080, "robot_address": "0.0.0.0"},
            {"port": 80, "protocol": "tcp", "robot_port": 8080, "robot_address": "::"},
        ],
        "volumes": [
            {"kind": "bind", "source": "/etc/hosts", "target": "/etc/hosts", "read_only": True},
            {"kind": "volume", "source": "srprov.hello.log", "target": "/log", "read_only": False},
        ],
    }
    assert wide_columns(row) == {
        "robot address": "192.0.2.1",
        "container name": "srprov.hello.web",
        "exit": "137",
        "restarts": "3",
        "since": "2026-11-23T20:05:00Z",
        "ports": "0.0.0.0:8080->80/tcp [::]:8080->80/tcp",
        "volumes": "/etc/hosts:/etc/hosts:ro srprov.hello.log:/log",
    }
    assert other["wide"]["robot_address"] == "192.0.2.2" and other["wide"]["exit_code"] is None


def test_one_round_trip_for_all_of_a_robot() -> None:
    robot = Robot(GOOD, GOOD, GOOD)
    assert len(rows(robot, 3)) == 4 and robot.asked == 1


def test_garbage_is_no_fact() -> None:
    found = rows(Robot(HOSTILE))[0]["wide"]
    assert (found["container"], found["exit_code"], found["restarts"], found["started"]) == ("", None, 0, None)
    assert [port["robot_port"] for port in found["ports"]] == [None, None] and found["volumes"] == []
    many = {**GOOD, "Mounts": GOOD["Mounts"] * 5000}  # type: ignore[operator]  # a list
    assert len(rows(Robot(many))[0]["wide"]["volumes"]) == 200


def test_what_is_left_out_is_counted() -> None:
    """An engine lists mounts in any order: which were shown was chance, and that there are more was not told."""
    volumes = [{"Type": "volume", "Name": "v", "Source": "/v", "Destination": f"/v/{n}"} for n in range(300)]
    ports = {f"{port}/udp": [{"HostIp": "0.0.0.0", "HostPort": f"{port}"}] for port in range(1000, 1201)}
    bind = {"Type": "bind", "Source": "/srv/data", "Destination": "/out", "RW": True}
    (row, _) = rows(Robot({**GOOD, "Mounts": [*volumes, bind], "NetworkSettings": {"Ports": ports}}))
    wide, columns = row["wide"], wide_columns(row)
    assert (wide["ports_left_out"], wide["volumes_left_out"], len(wide["volumes"])) == (1, 101, 200)
    assert wide["volumes"][0]["target"] == "/out" and columns["volumes"].startswith("/srv/data:/out ")
    assert columns["volumes"].endswith(" and 101 more") and columns["ports"].endswith(" and 1 more")
    assert "volumes_left_out" not in rows(Robot(GOOD))[0]["wide"]


def test_a_robot_that_is_lost_meanwhile_leaves_its_fields_empty() -> None:
    assert rows(Robot())[0]["wide"]["state"] == ""


def test_the_name_that_an_engine_made_up_is_short() -> None:
    """Nobody knows such a volume by its 64 digits; with --json they are whole."""
    wide = {**rows(Robot(GOOD))[0]["wide"], "ports": []}
    volume = {"kind": "volume", "source": "0123456789abcdef" * 4, "target": "/out", "read_only": False}
    assert wide_columns({"wide": {**wide, "volumes": [volume]}})["volumes"] == "0123456789ab:/out"
