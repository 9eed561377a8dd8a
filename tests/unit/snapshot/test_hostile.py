"""Robots that lie when they are looked at: no answer takes long, costs much memory, or ends what others said."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from srprov.controller import snapshot, snapshot_check, snapshot_look
from srprov.controller.snapshot_check import Checker
from srprov.controller.snapshot_look import Seen, look
from srprov.snapshot.containers import service_of
from srprov.snapshot.debian import parse_packages
from srprov.snapshot.folder import Robot
from srprov.snapshot.hider import Hider
from srprov.snapshot.host import Host, read_host
from srprov.snapshot.notes import MOST, Notes
from srprov.snapshot.questions import END, QUESTIONS
from srprov.snapshot.repositories import CLONES, fetchable
from srprov.snapshot.secret_names import Give, SecretNames
from srprov.snapshot.sources import is_distributions, parse_keys, parse_sources
from srprov.wire import AnyQuery, EngineQuery, Reply
from tests.bounded import bounded

IDS = [f"{number:064x}" for number in range(200)]


def give() -> Give:
    """Return what names the secrets of a robot."""
    return SecretNames().of("r1")


class Engine:
    """A robot whose engine has 200 containers, of each of which it says one text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.asked = 0

    def ask(self, queries: Sequence[AnyQuery]) -> list[Reply]:
        return [self._answer(one) for one in queries]

    def _answer(self, query: AnyQuery) -> Reply:
        if not isinstance(query, EngineQuery):
            return Reply(status=0, out="")
        if query.path == "/containers/json":
            listed = [{"Id": one, "ImageID": f"sha256:{one}", "State": "running"} for one in IDS]
            return Reply(status=200, out=json.dumps(listed))
        self.asked += query.path.endswith("/json")
        return Reply(status=200, out=self.text if query.path.endswith("/json") else "[]")


def lost(notes: Notes) -> str:
    return "; ".join(f"{one.subject}: {one.words}" for one in notes.all())


@pytest.mark.parametrize("text", ["a" * 404 + "!", "a/" * 4000 + "!", "a" * 8000])
def test_where_keys_are_is_read_in_time(text: str) -> None:
    lines = "\n".join(f"/etc/apt/sources.list:deb [signed-by=/etc/apt/{text[:900]}] https://h/x y" for _ in range(100))
    assert bounded(lambda: parse_sources(lines, Notes())) == ()
    assert bounded(lambda: parse_keys("\n".join(f"/etc/apt/{text} eA==" for _ in range(80)))) == {}


@pytest.mark.parametrize(
    "url", ["https://[a.example/", "https://[a.example]/debian", "https://u:p@[/x", "https://[1::2::3]/"]
)
def test_brackets_around_no_address_are_told(url: str) -> None:
    notes = Notes()
    assert parse_sources(f"/etc/apt/sources.list:deb {url} stable main", notes) == ()
    assert len(notes.found) == 1 and not is_distributions(url)


def test_dependencies_of_blanks_are_read_in_time() -> None:
    blank = " " * 2_000_000
    assert bounded(lambda: parse_packages(f"ii \tcurl\tamd64\t1\tno\toptional\t\ta{blank}!, b{blank}|c", Notes()))


@pytest.mark.parametrize("groups", [5, "gpu", {"a": 1}, [5], [["gpu"], 5], True])
def test_groups_of_devices_are_lists_or_none(groups: object) -> None:
    box = {"HostConfig": {"DeviceRequests": [{"Count": 1, "Capabilities": groups}]}}
    assert service_of("cam", box, {}, "runc", Notes(), give()).name == "cam"


def test_a_container_that_cannot_be_read_costs_the_others_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(name: str, box: Any, *_more: Any) -> Any:
        if box.get("odd"):
            raise TypeError("a mistake of ours")
        return service_of(name, box, {}, "runc", Notes(), give())

    monkeypatch.setattr(snapshot, "service_of", read)
    seen = Seen(name="robot1", host=Host(), containers=(({"odd": 1, "Name": "/a"}, {}), ({"Name": "/b"}, {})))
    assert [one.name for one in snapshot._robots([seen])[0].services] == ["b"]
    assert "container a" in lost(seen.notes) and "TypeError" in lost(seen.notes)


def test_what_an_engine_says_of_containers_has_a_length_in_all() -> None:
    """Of 200 containers an engine could send gigabytes, each answer within its own limit."""
    robot = Engine(json.dumps({"Id": IDS[0], "x": "y" * 400_000}))
    seen = bounded(lambda: look(robot, "robot1"), cpu_s=5)  # type: ignore[arg-type]  # it asks, and does nothing else
    assert len(seen.containers) < 40 and "too long" in lost(seen.notes)
    for text in ("[" * 30_000, json.dumps({"Id": IDS[0], "x": [[]] * 30_000}), json.dumps({"x": "y" * 600_000})):
        odd = look(Engine(text), "robot1")  # type: ignore[arg-type]  # as above
        assert odd.containers == () and "longer than any container needs" in lost(odd.notes)


def test_an_engine_that_takes_its_time_for_each_answer_is_not_asked_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshot_look, "LONGEST_S", -1.0)
    robot = Engine(json.dumps({"Id": IDS[0]}))
    seen = look(robot, "robot1")  # type: ignore[arg-type]  # as above
    assert robot.asked < 60 and "takes too long" in lost(seen.notes)


def test_thousands_of_odd_values_are_not_tried_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshot_check, "LONGEST_S", 2.0)
    odd = {"HostConfig": {"CapAdd": [f"odd {n}" for n in range(200)], "ExtraHosts": [f"o{n}" for n in range(200)],
                          "GroupAdd": ["?"] * 200}, "Config": {"Image": "a:1"}}  # fmt: skip
    robot = Robot(name="robot1", short="robot1", host=Host())
    services = tuple(service_of(f"s{n}", odd, {"RepoTags": ["a:1"]}, "runc", robot.notes, give()) for n in range(100))
    begin = time.monotonic()
    Checker(tmp_path, [Robot(name="robot1", short="robot1", host=Host(), services=services, notes=robot.notes)], {},
            Hider(())).checked("x")  # fmt: skip
    assert time.monotonic() - begin < 20
    assert "so much is wrong" in lost(robot.notes) and (tmp_path / "experiment.edf").exists()


def test_of_many_services_the_few_that_do_not_go_together_are_left_out(tmp_path: Path) -> None:
    services = [
        service_of(f"s{n}", {"Config": {"Image": "a:1"}}, {"RepoTags": ["a:1"]}, "runc", Notes(), give())
        for n in range(40)
    ]
    services[7] = service_of("S!", {"Config": {"Image": "a:1"}}, {"RepoTags": ["a:1"]}, "runc", Notes(), give())
    robot = Robot(name="robot1", short="robot1", host=Host(), services=tuple(services))
    robots, _ = Checker(tmp_path, [robot], {}, Hider(())).checked("x")
    assert {one.name for one in robots[0].services} == {one.name for one in services} - {"S!"}
    assert "container S!: does not go together" in lost(robot.notes)


@pytest.mark.parametrize("path", ["/git/aaaa'$(touch$IFS/ran)", "/git/a;b", "/git/nav.git"])
def test_a_command_that_a_note_has_needs_no_quotes(path: str) -> None:
    """What a robot calls a secret is taken out of a note as a whole: quotes of the command would go with it."""
    notes = Notes(robot="r1")
    is_plain = path == "/git/nav.git"
    assert fetchable(path, "repository x", notes) == (f"file://{CLONES}/r1{path}" if is_plain else "")
    said = " ".join(note.words for note in notes.found)
    assert ("git clone" in said) == is_plain and said.count("folder of the robot") == 1


def test_a_robot_s_folder_is_no_other_robot_s() -> None:
    """Who knows a commit of another one's repository would be given what is in it, from the clone of that one."""
    for odd in ("//opt/git/nav", "file:////opt/git/nav", "///opt/git/nav", "file:///opt//git/nav"):
        assert fetchable(odd, "repository x", Notes(robot="robot1")) == f"file://{CLONES}/robot1/opt/git/nav"
    clones = {fetchable("/opt/git/nav", "repository x", Notes(robot=robot)) for robot in ("robot1", "robot2")}
    assert clones == {f"file://{CLONES}/robot1/opt/git/nav", f"file://{CLONES}/robot2/opt/git/nav"}


@pytest.mark.parametrize("times", [1, 8])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("repositories", "0 l /a\0"),
        ("metadata", "dist /a\0\x0048\0"),
        ("metadata", "dist /a-1.dist-info\0Name: a\nVersion: 1\0\0"),
        ("packages", "ii \ta\tarm64\t1\tno\toptional\t\t\n"),
    ],
)
def test_a_robot_that_says_more_than_it_was_asked_for_takes_no_time(name: str, said: str, times: int) -> None:
    """Questions bound their answers on the robot; one that lies may send sixteen megabytes."""
    whole = (said * ((1 << 20) // len(said))).encode()
    out = (base64.b64encode(whole + END.encode()) if name != "packages" else whole).decode() * times
    replies = [Reply(status=0, out=out if one.name == name else "") for one in QUESTIONS]
    notes = Notes()
    bounded(lambda: read_host(replies, notes))
    assert len(notes.all()) <= 3 * MOST + 1
