"""`@failed`: the newest record of an instance, and which robots it did not finish."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.inputs import failed_robots, selected
from srprov.definitions.model import Host, Inventory
from srprov.errors import UsageError
from srprov.record import last_run, last_verb, named_images


def record(root: Path, name: str, **files: Any) -> Path:
    """Write a record as a run leaves it."""
    path = root / name
    path.mkdir(parents=True)
    (path / "environment.json").write_text("{}")
    for key, value in files.items():
        text = "".join(json.dumps(one) + "\n" for one in value) if key == "events" else json.dumps(value)
        (path / (f"{key}.jsonl" if key == "events" else f"{key}.json")).write_text(text)
    return path


def result(outcomes: dict[str, str], unreachable: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return what `apply --json` prints, as far as it matters."""
    steps = [{"number": 1, "id": f"{robot}/container:srprov.x.y", "outcome": word} for robot, word in outcomes.items()]
    return {"unreachable": list(unreachable), "steps": steps}


ALL = {"r1": "changed", "r2": "failed", "r3": "skipped", "r4": "not reached", "r5": "unreachable", "r6": "unchanged"}


def test_whoever_has_a_step_that_was_not_done_or_was_away_has_failed(tmp_path: Path) -> None:
    record(tmp_path, "20261121T090507Z-hello-4f1c09aa", result=result(ALL, ("r7",)))
    last = last_run(tmp_path, "hello")
    assert last is not None and last.failed == {"r2", "r3", "r4", "r5", "r7"}


def test_only_the_newest_record_of_the_instance_counts(tmp_path: Path) -> None:
    """Names may begin or end alike; in one second the order of writing decides, not the hash."""
    record(tmp_path, "20261121T090000Z-hello-ffffffff", result=result({"old": "failed"}))
    early = record(tmp_path, "20261121T090507Z-hello-bbbbbbbb", result=result({"early": "failed"}))
    os.utime(early / "environment.json", (1, 1))
    record(tmp_path, "20261121T090507Z-hello-aaaaaaaa-2", result=result({"late": "failed"}))
    record(tmp_path, "20261121T100000Z-hello-2-aaaaaaaa", result=result({"other": "failed"}))
    record(tmp_path, "20261121T100000Z-my-hello-aaaaaaaa", result=result({"mine": "failed"}))
    (tmp_path / "notes").write_text("")
    last = last_run(tmp_path, "hello")
    assert last is not None and last.failed == {"late"}
    assert last_run(tmp_path, "nobody") is None
    assert last_run(tmp_path / "none", "hello") is None


def test_a_record_of_stop_start_or_restart_hides_neither_failures_nor_images(tmp_path: Path) -> None:
    """Their plans want nothing, so what `build` and `apply` recorded before them still counts."""
    step = {"number": 1, "robot": "r1", "module": "image", "name": "srprov/a:1", "want": {"tag": "1"}}
    built = {"unreachable": {}, "steps": [step], "contexts": {}}
    record(tmp_path, "20261121T090000Z-hello-aaaaaaaa", plan=built, result=result({"r1": "failed"}))
    for second, verb in enumerate(("stop", "start", "restart")):
        later = record(tmp_path, f"20261121T09010{second}Z-hello-bbbbbbbb", plan={"steps": []}, result=result({}))
        (later / "environment.json").write_text(json.dumps({"verb": verb}))
    last = last_run(tmp_path, "hello")
    assert last is not None and last.failed == {"r1"}
    assert named_images(tmp_path) == {"srprov/a:1": frozenset({"hello"})}


def test_of_a_killed_run_events_tell_how_far_it_came(tmp_path: Path) -> None:
    """Without result.json: done is what the events say was done; a torn last line is passed over."""
    plan = {"unreachable": {"r9": "no answer"}, "steps": [{"number": n, "robot": f"r{n}"} for n in (1, 2, 3, 4)]}
    ends = [("end", 1, "changed"), ("end", 2, "failed"), ("start", 3, None), ("waiting", None, None)]
    events = [{"event": kind, "step": number, "outcome": outcome} for kind, number, outcome in ends]
    path = record(tmp_path, "20261121T090507Z-hello-4f1c09aa", plan=plan, events=events)
    with open(path / "events.jsonl", "a", encoding="utf-8") as stream:
        stream.write('{"event": "end", "step": 4, "outc')
    last = last_run(tmp_path, "hello")
    assert last is not None and last.failed == {"r2", "r3", "r4", "r9"}


@pytest.mark.parametrize("text", ["", "[]", '{"steps": 3}', '{"unreachable": [], "steps": [{}]}'])
def test_a_broken_record_is_an_error_that_names_it(tmp_path: Path, text: str) -> None:
    path = record(tmp_path, "20261121T090507Z-hello-4f1c09aa")
    (path / "result.json").write_text(text)
    with pytest.raises(UsageError, match="is no record that can be read") as error:
        last_run(tmp_path, "hello")
    assert path.name in error.value.message


LAB = Inventory(
    hosts={name: Host(name=name, address=name) for name in ("r1", "r2", "r3")},
    groups={"all": ("r1", "r2", "r3"), "fast": ("r3",)},
)


def test_limit_and_exclude_know_it(tmp_path: Path) -> None:
    record(tmp_path, "20261121T090507Z-hello-4f1c09aa", result=result(ALL, ("r9",)))
    failed = failed_robots("hello", tmp_path)
    assert selected(LAB, "@failed", "", failed) == {"r2", "r3"}
    assert selected(LAB, "@failed:&fast", "", failed) == {"r3"}
    assert selected(LAB, "", "@failed", failed) == {"r1"}


def test_no_record_and_no_failure_are_told_apart(tmp_path: Path) -> None:
    """Both are usage errors (5), as any pattern that matches nothing."""
    with pytest.raises(UsageError, match="no run of hello is recorded in ") as error:
        selected(LAB, "@failed", "", failed_robots("hello", tmp_path))
    assert "--runs" in error.value.hint
    record(tmp_path, "20261121T090507Z-hello-4f1c09aa", result=result({"r1": "changed"}))
    with pytest.raises(UsageError, match=r"nothing failed in the last run of hello \(20261121T090507Z") as error:
        selected(LAB, "", "@failed", failed_robots("hello", tmp_path))
    assert error.value.exit_code == 5


def test_what_an_instance_was_last_wanted_for_is_in_its_newest_record(tmp_path: Path) -> None:
    """`stop` and the like say nothing of that."""
    assert last_verb(tmp_path, "hello") == ""
    for second, verb in enumerate(("apply", "run", "stop")):
        record(tmp_path, f"20260101T00000{second}Z-hello-0000000{second}", environment={"verb": verb})
    assert last_verb(tmp_path, "hello") == "run"
    assert last_verb(tmp_path, "other") == ""
