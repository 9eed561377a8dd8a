"""Live progress on a terminal: whatever is drawn meanwhile, every finished line stays, whole and once."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.cli.output import printed_by
from srprov.cli.progress import progress
from srprov.controller.report import summary
from srprov.execution import Event, Outcome, RunResult
from srprov.execution.outcome import StepResult
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Observed
from tests.unit.cli import player
from tests.unit.cli.terminal import Terminal

PLAYER = (sys.executable, "-m", "tests.unit.cli.player")
RUNS = (1, 2, 3, 5, 8, 12, 19, 30)
INTERRUPTED = "interrupted: running steps have 10 s to end, no new one begins; once more to leave at once"


def told(robots: int) -> list[str]:
    """Return what is said of each finished step, without its count: in which order they end is open."""
    return [
        f"{robot}: + container {player.step(robots, robot, number).name}: changed"
        for robot in (f"robot{n:02}" for n in range(robots))
        for number in range(player.STEPS)
    ]


def check(terminal: Terminal, runs: Sequence[int], columns: int) -> None:
    """Hold the screen to what these runs say."""
    seen = terminal.rows()
    beginnings = Counter(row.partition(" ")[0] for row in seen.rows)
    for robots in runs:
        total = robots * player.STEPS
        for line in told(robots):
            times = sum(seen.count(f"[{n}/{total}] {line}", columns) for n in range(1, total + 1))
            assert times == 1, f"{line} stands there {times} times:\n" + "\n".join(seen.rows)
        for number in range(1, total + 1):
            assert beginnings[f"[{number}/{total}]"] == 1
        assert seen.count(f"run of {robots} done", columns) == 1


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_every_finished_line_stays_whole_and_once(columns: int) -> None:
    """With 1 to 30 robots; nothing of the status line is left."""
    terminal = Terminal(*PLAYER, *map(str, RUNS), columns=columns)
    terminal.read_until()
    assert terminal.close() == 0
    check(terminal, RUNS, columns)
    rest = [row for row in terminal.rows().rows if re.search(r"Step 3/9|stay up|starting", row)]
    assert rest == []


@pytest.fixture
def experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """Return the words that apply an experiment to robots in memory, in its folder."""
    (tmp_path / "e.edf").write_text("edf: 1\nname: hello\nservices:\n  a: {image: busybox}\n")
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 10.0.0.1}}}\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    monkeypatch.setenv("FAKED_STATE", "running.json")
    return (sys.executable, "-m", "tests.unit.cli.faked", "apply", "e.edf", "-i", "inv.yml", "--settle", "0")


def test_an_apply_goes_on_when_its_terminal_is_closed(experiment: tuple[str, ...]) -> None:
    """And its user has seen to it that this sends no SIGHUP, e.g. by `disown`."""
    terminal = Terminal(*experiment, columns=80)
    terminal.read_until("Do this?")
    terminal.type("y\n")
    terminal.read_until("[1/")
    terminal.hang_up()
    assert terminal.close() == 0
    assert json.loads(Path("running.json").read_text()) == [["a", "r1"]]


@pytest.mark.parametrize("quiet", [False, True])
def test_a_whole_apply_on_a_terminal(experiment: tuple[str, ...], quiet: bool) -> None:
    """With a question: the plan is shown even when little else is wanted."""
    terminal = Terminal(*experiment, *(["--quiet"] if quiet else []), columns=80)
    terminal.read_until("Do this?")
    terminal.type("y\n")
    terminal.read_until()
    assert terminal.close() == 0
    rows = terminal.rows().rows
    at = rows.index("Do this? [y/N]: y")
    (total,) = (int(row.split()[1]) for row in rows[:at] if row.startswith("Plan: "))  # all of them to add
    finished = [] if quiet else [f"[{n}/{total}]" for n in range(1, total + 1)]
    assert total >= 5 and [row.partition(" ")[0] for row in rows[at + 1 : at + 1 + len(finished)]] == finished
    last = rows[at + 1 + len(finished) :]
    assert last[0].startswith("hello: done in ") and not any(last[1:])


@pytest.mark.parametrize(("before", "after"), [(120, 40), (40, 120), (80, 79)])
def test_lines_stay_when_the_terminal_gets_another_size(before: int, after: int) -> None:
    """In the middle of a run, under a status line of the old width."""
    terminal = Terminal(*PLAYER, "hold", "12", columns=before)
    terminal.read_until(player.HELD)
    terminal.read_for(0.4)
    held = terminal.rows()
    below = [row for row in held.rows[held.places[player.HELD][0] + 1 :] if row]
    assert len(below) == 1 and " 12/24 robot00: " in below[0], "the status line takes one row"
    terminal.resize(after)
    terminal.read_for(0.4)
    terminal.type("\n")
    terminal.read_until()
    assert terminal.close() == 0
    seen, total = terminal.rows(), 12 * player.STEPS
    for at, line in enumerate(told(12)):
        rows, columns = (seen, after) if at % player.STEPS else (held, before)
        assert sum(rows.count(f"[{n}/{total}] {line}", columns) for n in range(1, total + 1)) == 1
    beginnings = Counter(row.partition(" ")[0] for row in seen.rows)
    assert all(beginnings[f"[{number}/{total}]"] == 1 for number in range(1, total + 1))


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_the_word_of_an_interrupt_in_the_middle_stays_too(columns: int) -> None:
    """A signal's handler writes past rich, wherever the cursor is."""
    terminal = Terminal(*PLAYER, "interrupt", "12", columns=columns)
    terminal.read_until()
    assert terminal.close() == 0
    check(terminal, [12], columns)
    assert terminal.rows().count(INTERRUPTED, columns) == 1


def test_everything_that_a_whole_run_waits_for_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """Also when two waits begin at once; what one robot says comes a line every few seconds."""
    plan: Any = SimpleNamespace(steps=())
    with progress(plan, events=None, color=False, lines_only=True) as listener:
        for host, text in (("", "trying"), ("", "checking"), ("r1", "layer 1"), ("r1", "layer 2")):
            listener(Event(kind="progress" if host else "waiting", host=host, text=text))
    assert capsys.readouterr().err.splitlines() == ["  … trying", "  … checking", "  … r1: layer 1"]


def test_what_is_taken_away_is_called_removed_and_what_was_not_reached_is_told_once() -> None:
    """The report at the end lists what was not reached, with the reason; the last line counts it."""
    found = Observed(module="volume", name="v", instance="x", state={})
    change = Change(action=Action.DELETE, cause="destroy")
    step = Step(number=1, host="r1", module="volume", name="v", change=change, found=found)
    later = replace(step, number=2, name="w")
    said: list[str] = []
    plan: Any = SimpleNamespace(steps=(step, later))
    printed = printed_by(lambda text, _: said.append(text))
    with printed, progress(plan, events=None, color=False, lines_only=True) as listener:
        listener(Event(kind="end", host="r1", step=step, outcome=Outcome.CHANGED))
        listener(Event(kind="end", host="r1", step=later, outcome=Outcome.NOT_REACHED, text="interrupted"))
    assert said == ["[1/2] r1: - volume v: removed"]
    results = (
        StepResult(step=step, outcome=Outcome.CHANGED),
        StepResult(step=later, outcome=Outcome.NOT_REACHED, message="interrupted"),
    )
    result = RunResult(results=results, unchanged=3, interrupted=True)
    document = {"instance": "x", "changed": 1, "unchanged": 3, "failed": 0, "skipped": 0, "not_reached": 1,
                "duration_s": 1.0}  # fmt: skip
    counts = "0 changed, 1 removed, 3 unchanged, 0 failed, 0 skipped, 1 not reached"
    assert summary(document, result) == f"x: interrupted in 1.0 s: {counts}"


def _of_many(robots: int, how: str = "changed") -> tuple[Any, list[Event]]:
    """Return a plan of two steps on each robot, and what is told of them."""
    change = Change(action=Action.CREATE, cause="not there")
    steps = [
        Step(number=2 * robot + at, host=f"r{robot:04}", module="volume", name=f"v{at}", change=change)
        for robot in range(robots)
        for at in (1, 2)
    ]
    events = [
        event
        for step in steps
        for event in (
            Event(kind="start", host=step.host, step=step),
            Event(kind="progress", host=step.host, step=step, text="layer 1"),
            Event(kind="end", host=step.host, step=step, outcome=Outcome(how), text="why"),
        )
    ]
    return SimpleNamespace(steps=tuple(steps)), events


def test_progress_of_a_thousand_robots_is_a_summary(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line every few seconds that says how far all of them are."""
    clock = iter(range(100_000))
    monkeypatch.setattr("srprov.cli.progress.time", SimpleNamespace(monotonic=lambda: next(clock) / 400))
    plan, events = _of_many(1000)
    with progress(plan, events=None, color=False, lines_only=True) as listener:
        for event in events:
            listener(event)
    lines = capsys.readouterr().err.splitlines()
    assert 1 <= len(lines) <= 5
    assert re.fullmatch(r"  … \d+/2000 steps, \d+/1000 robots done(; r\d{4}: .*)?", lines[0]), lines[0]


def test_of_many_robots_the_first_failures_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    """The others are counted: the report at the end lists all."""
    plan, events = _of_many(1000, "failed")
    with progress(plan, events=None, color=False, lines_only=True) as listener:
        for event in events:
            listener(event)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "[1/2000] r0000: + volume v1: failed: why"
    assert len(lines) == 21 and lines[20].startswith("  … further steps")


def test_the_status_line_of_many_robots_counts_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """And names one that is at work."""
    shown: list[Any] = []
    monkeypatch.setattr("srprov.cli.progress.is_terminal", lambda _stream: True)
    monkeypatch.setattr("srprov.cli.status_line.status_line", lambda status, **_: shown.append(status) or nullcontext())
    plan, events = _of_many(1000)
    printed: list[str] = []
    with printed_by(lambda text, _: printed.append(text)), progress(plan, events=None, color=False) as listener:
        for event in [*events[:-3], Event(kind="start", host="r0999", step=events[-1].step)]:
            listener(event)
        listener(Event(kind="start", host="r0001", step=events[0].step))
        assert shown[0]() == "1999/2000 steps, 999/1000 robots done; r0001: volume v1 and 1 more"
    assert printed == []
