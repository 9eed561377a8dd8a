"""Folders of runs of trials, as a run leaves them, made with the project's own code and robots in memory."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

from msgspec.structs import replace

from srprov import __version__
from srprov.controller.request import PlanRequest
from srprov.controller.trial_plan import TrialPlan, trial_plan
from srprov.controller.trial_record import keep_session, session_files
from srprov.controller.trial_run import _robots
from srprov.controller.trial_sameness import sameness
from srprov.definitions import load_experiment
from srprov.facts.model import Snapshot
from srprov.planning.policy import ASKED_FIRST
from srprov.record import journal
from srprov.record.journal import Journal
from srprov.record.tables import Tables
from srprov.trials import Trial, design
from srprov.trials.clock import Offset
from srprov.trials.judge import End
from srprov.trials.reading import read
from srprov.trials.row import Seen, clocks, row
from tests.fakes import World
from tests.worlds import inventory, made

EDF = """\
edf: 1
name: race
description: A runner and a referee.
authors: [Ada Lovelace]
license: CC-BY-4.0
services:
  runner: {cdf: runner.cdf, volumes: ["./tracks:/tracks"], robot: r1}
  referee: {image: judge, env_file: referee.env}
parameters:
  SPEED: {values: [0.5, 1], unit: m/s}
trials:
  repetitions: 2
  seed: 7
  until: {any: [{completed: runner}]}
  timeout: 30s
  success: {all: [{exit: {service: runner, code: 0}}, {metric: {steps: {below: 150}}}]}
results:
  runner: [{path: /out/result.json, required: true}]
metrics:
  steps: {service: runner, json: /out/result.json#/steps}
  ticks: {service: referee, log: '^tick', reduce: count}
"""
FILES = {
    "race.edf": EDF,
    "runner.cdf": "cdf: 1\nextends: common.cdf\ncommand: [run]\n",
    "common.cdf": "cdf: 1\nimage: runner:1\n",
    "referee.env": "# whom it favours\nFAVOURS=nobody\n",
    "tracks/oval.txt": "round\n",
}
MACHINE = "0f1e2d3c4b5a69788796a5b4c3d2e1f0"
STEPS = {"0.5": 100, "1": 200}
_BEGUN = 1795338000.0


def write_experiment(folder: Path, files: Mapping[str, str] = FILES) -> Path:
    """Write the experiment's files and return its EDF."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "race.edf"


def planned(world: World, edf: Path) -> TrialPlan:
    """Return what is planned for the experiment's trials."""
    definitions = load_experiment(edf, outside=True)
    return trial_plan(made(world, definitions, PlanRequest(allowed=frozenset(ASKED_FIRST))), inventory(world), ())


class Clock:
    """The controller's clock and monotonic time: a second passes each time that the journal asks."""

    def __init__(self, start: float = _BEGUN) -> None:
        self.now = start

    def time(self) -> float:
        """Return the time."""
        self.now += 0.5
        return self.now

    def monotonic(self) -> float:
        """Return the time since this machine began."""
        return self.now - _BEGUN + 100.0

    def patched(self) -> Any:
        """Let the journal take its times from here."""
        times = SimpleNamespace(
            time=self.time, monotonic=self.monotonic, gmtime=__import__("time").gmtime,
            strftime=__import__("time").strftime,
        )  # fmt: skip
        return mock.patch.object(journal, "time", times)


def run_folder(folder: Path, edf: Path, *, failed: int = 1, log: Sequence[str] = ("tick", "tick")) -> Path:
    """Write the folder of a run whose trials all ended.

    Args:
        folder: Where it is made.
        edf: The experiment.
        failed: How many attempts of the first trial ended by a failure of the equipment.
        log: What the referee prints.
    """
    world = World().add("r1", "r2")
    plan = planned(world, edf)
    assert plan.base.snapshot is not None
    plan = replace(plan, base=replace(plan.base, snapshot=_with_serials(plan.base.snapshot)))
    assert plan.base.snapshot is not None
    facts = _robots(plan.base.snapshot)
    (folder / "trials").mkdir(parents=True)
    robots = {one.service: one.host for one in plan.services}
    whole = design(plan.given)
    rows: list[dict[str, object]] = []
    with Clock().patched(), Journal(folder) as log_of_run:
        keep_session(folder, 1, plan, inventory(world), session_files(plan))
        same = sameness(plan, facts, {})
        log_of_run.add("run", version=__version__, run="20261122T090000Z-race-abcdef01", same=same, trials=4)
        for order, trial in enumerate(whole.trials, start=1):
            for attempt in range(1, (failed if order == 1 else 0) + 2):
                bad = order == 1 and attempt <= failed
                rows.append(_attempt(folder, log_of_run, trial, attempt, order, robots, bad=bad, log=log))
        log_of_run.add("ended", reason="")
    Tables(folder, plan.given, robots, rows).write()
    return folder


def _with_serials(snapshot: Snapshot) -> Snapshot:
    """Give the first robot an id and a camera."""
    told = replace(
        snapshot.facts["r1"], machine_id=MACHINE, usb=("046d:0825 Webcam",), serials=("046d:0825 B1DA5A20",),
        hosts=("10.77.5.4 printer.home",), homes=("pilot:/home/pilot",),
    )  # fmt: skip
    return replace(snapshot, facts={**snapshot.facts, "r1": told})


def _attempt(
    folder: Path, events: Journal, trial: Trial, attempt: int, order: int, robots: Mapping[str, str], *, bad: bool,
    log: Sequence[str],
) -> dict[str, object]:  # fmt: skip
    """Write what one attempt leaves, and return its row."""
    about = {"trial": trial.id, "attempt": attempt}
    home = folder / "trials" / (trial.id if attempt == 1 else f"{trial.id}.{attempt}")
    events.add("begin", **about, order=order)
    home.mkdir()
    offset = Offset(offset_s=0.001, error_s=0.002, rtt_s=0.004, samples=16, measured=_BEGUN)
    before = dict.fromkeys(robots.values(), offset)
    if bad:
        seen = Seen(end=End("infrastructure", "r2: away"), before=before)
        found: dict[str, object] = {**row(trial, attempt, order, seen), "segment": 1, "clocks": clocks([before])}
    else:
        for moment in ("created", "started", "ready", "until", "stopped"):
            events.add(moment, **about)
        found = _whole(home, trial, attempt, order, robots, before, log)
        events.add("collected", **about, row=found)
    events.add("end", **about, row=found)
    (home / "trial.json").write_text(json.dumps(found, indent=2) + "\n")
    return found


def _whole(
    home: Path, trial: Trial, attempt: int, order: int, robots: Mapping[str, str], before: Mapping[str, Offset],
    log: Sequence[str],
) -> dict[str, object]:  # fmt: skip
    state = {"Status": "exited", "ExitCode": 0, "StartedAt": "2026-11-22T09:00:00.5Z",
             "FinishedAt": "2026-11-22T09:00:02.5Z"}  # fmt: skip
    inspected = {
        name: {"Image": f"sha256:{hashlib.sha256(name.encode()).hexdigest()}", "State": state, "RestartCount": 0}
        for name in robots
    }
    (home / "containers.json").write_text(json.dumps(inspected, indent=2) + "\n")
    steps = STEPS[trial.point.values["SPEED"]]
    content = json.dumps({"steps": steps}).encode()
    (home / "results" / "runner" / "out").mkdir(parents=True)
    (home / "results" / "runner" / "out" / "result.json").write_bytes(content)
    (home / "logs").mkdir()
    stamp = "2026-11-22T09:00:01.000000000Z"
    (home / "logs" / f"{robots['runner']}.runner.log").write_text(f"{stamp} arrived\n")
    lines = "".join(f"{stamp} {line}\n" for line in log)
    (home / "logs" / f"{robots['referee']}.referee.log").write_text(lines)
    listed = {"path": "result.json", "name": "result.json", "size": len(content),
              "sha256": hashlib.sha256(content).hexdigest()}  # fmt: skip
    collected = {"results": {"runner/out/result.json": [listed]}, "missing": []}
    (home / "collected.json").write_text(json.dumps(collected, indent=2) + "\n")
    seen = Seen(
        end=End("ok", "runner completed", ("runner",)), readings={name: read(one) for name, one in inspected.items()},
        robots=robots, before=before, after=before, began=_BEGUN, ready_s=0.5, duration_s=2.0, stop_s=0.1,
    )  # fmt: skip
    return {
        **row(trial, attempt, order, seen), "segment": 1, "verdict": "success" if steps < 150 else "failure",
        "m_steps": float(steps), "m_ticks": float(sum(line.startswith("tick") for line in log)), "files": 1,
        "bytes": len(content), "unclosed": 0, "collect_s": 0.1, "controller_gap_s": 0.0,
        "clocks": clocks([before, before]),
    }  # fmt: skip
