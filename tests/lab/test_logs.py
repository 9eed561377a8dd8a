"""`srprov logs` on real robots: in the order of time, for a person and for programs, and how it ends."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin
from tests.unit.cli.terminal import Terminal

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")
ESCAPES = "\\033[31mred\\033]0;title\\007\\033[2J\\rover\\n"
LONG = f"head -c 40000 /dev/zero | tr '\\0' x; echo; printf '{ESCAPES}'"
SERVICES = {
    "talker": busybox("sh", "-c", "n=0; while :; do n=$((n+1)); echo tick $n; sleep 0.1; done", robot="robot1"),
    "quiet": busybox(robot="robot2"),
    "long": busybox("sh", "-c", f"{LONG}; exit 3", robot="robot2", job=True),
    "rep": busybox("sh", "-c", "for n in 1 2 3; do echo rep $n; sleep 0.2; done", replicas=2, job=True),
}


class Talk:
    """An experiment that was applied once for all tests of this file."""

    def __init__(self, lab: Lab, words: tuple[str, ...]) -> None:
        self.lab, self.words = lab, words

    def logs(self, *more: str) -> Done:
        return self.lab.srprov("logs", *self.words, *more)

    def documents(self, *more: str) -> list[dict[str, Any]]:
        done = self.logs("--json", *more)
        assert done.code == 0 and not done.err, done
        return [json.loads(line) for line in done.out.splitlines()]


@pytest.fixture(scope="module")
def talk(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Talk]:
    lab, folder = lab_of_module, tmp_path_factory.mktemp("talk")
    path = folder / "talk.edf"
    path.write_text(edf("talk", SERVICES), encoding="utf-8")
    inventory = part_of_lab(lab, ROBOTS, folder / "lab.yml", **{robot: {"srprov_slots": 4} for robot in ROBOTS})
    words = (str(path), "-i", inventory)
    lab.srprov("apply", *words, "--yes", "--settle", "0")  # `long` fails, as it is meant to
    for robot in ROBOTS:  # what is compared has been printed
        lab.shell(robot, "sh", "-c", "docker ps -aq --filter name=[.]rep- | xargs -r docker wait")
    yield Talk(lab, words)
    assert lab.srprov("destroy", *words, "--yes").code == 0


def test_lines_of_all_robots_come_in_the_order_of_time(talk: Talk) -> None:
    """Each as its engine has it: compared with what `docker logs` says on the robots."""
    lines = talk.documents("-n", "20", "rep", "talker")
    assert [list(Draft202012Validator(data.schema("logs")).iter_errors(line)) for line in lines] == [[]] * len(lines)
    assert {line["service"] for line in lines} == {"talker", "rep-1", "rep-2"}
    assert [line["time"] for line in lines] == sorted(line["time"] for line in lines)
    one = next(line for line in lines if line["service"] == "rep-2")
    said = talk.lab.shell(one["robot"], "docker", "logs", "-t", one["container"]).out.splitlines()
    assert said == [f"{line['time']} {line['text']}" for line in lines if line["service"] == "rep-2"]
    shown = talk.logs("-t", f"rep-2@{one['robot']}").out.splitlines()
    assert shown == [f"rep-2 | {line}" for line in said]


def test_a_long_line_is_one_line_and_what_is_printed_moves_no_cursor(talk: Talk) -> None:
    """An engine cuts it into pieces of 16 KiB, each with a time."""
    assert [line["text"] for line in talk.documents("long")] == [
        "x" * 40_000,
        "\x1b[31mred\x1b]0;title\x07\x1b[2J\rover",
    ]
    assert talk.logs("long", "-n", "1").out == "long | redover\n"


def test_since_leaves_out_what_is_older(talk: Talk) -> None:
    before = talk.documents("-n", "3", "talker")[0]["time"]
    found = talk.documents("--since", before, "talker")
    assert found[0]["time"] == before and len(found) > 2, "all of them, from that line on"
    assert talk.documents("--since", "2099-01-01T00:00:00Z") == []


def test_following_ends_when_all_have_ended_or_nobody_reads(talk: Talk) -> None:
    """With 0, 0 and 130, and no word but that it was interrupted."""
    follow = ("logs", *talk.words, "-f", "-n", "1")
    ended = begin(talk.lab, *follow, "rep", "long")
    left, interrupted = (begin(talk.lab, *follow, "quiet", "talker") for _ in range(2))
    assert left.stdout is not None and left.stderr is not None and interrupted.stdout is not None
    assert left.stdout.readline().startswith("talker | tick ")
    left.stdout.close()
    assert interrupted.stdout.readline().startswith("talker | tick ")
    interrupted.send_signal(signal.SIGINT)
    out, err = interrupted.communicate(timeout=120)
    assert (interrupted.returncode, err.strip()) == (130, "interrupted")
    assert all(line.startswith("talker | tick ") for line in out.splitlines())
    assert (left.wait(20), left.stderr.read()) == (0, "")
    out, err = ended.communicate(timeout=120)
    assert (ended.returncode, err, len(out.splitlines())) == (0, "", 3)


def test_on_a_terminal_each_service_has_its_colour_and_none_has_a_say(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(talk.lab.folder)
    program = (sys.executable, "-m", "srprov", "logs", *talk.words, "-n", "1", "rep", "long")
    terminal = Terminal(*program, columns=80)
    terminal.read_until()
    assert terminal.close() == 0
    shown = [line.rstrip() for line in terminal.screen.display if line.rstrip()]
    assert sorted(shown) == ["long  | redover", "rep-1 | rep 3", "rep-2 | rep 3"]
    rows = [terminal.screen.buffer[row] for row in range(3)]
    assert len({row[0].fg for row in rows} - {"default"}) == 3, "a colour for each"
    assert {row[column].fg for row in rows for column in range(8, 20)} == {"default"}
    assert terminal.screen.title == ""
