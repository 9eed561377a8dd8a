"""What `run` keeps comes into the folder that it made, whatever others put in its place."""

from __future__ import annotations

import os
import threading
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller import trial_run
from srprov.controller.trial_plan import trial_plan
from srprov.definitions.model import Definitions
from srprov.definitions.trialsmodel import TrialSettings
from srprov.execution import RunOptions
from tests.fakes import World
from tests.unit.controller.test_trial_runs import GIVEN
from tests.worlds import experiment, inventory, made, service


def test_a_link_that_is_put_in_the_folder_s_place_meanwhile_leads_nothing_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may write to the folder above: the user's own `trials.csv` elsewhere was replaced."""
    what = experiment(service("racer", robot="r2", image="race:1"), trials=replace(GIVEN, settings=TrialSettings()))
    world, own, home = World().add("r2"), tmp_path / "own", tmp_path / "home"
    plan = trial_plan(made(world, Definitions(experiment=what, containers={})), inventory(world), ())
    own.mkdir()
    every = trial_run._all

    def swapping(*given: Any) -> Any:
        home.rename(tmp_path / "moved")
        home.symlink_to(own)
        return every(*given)

    done = SimpleNamespace(result=SimpleNamespace(exit_code=0))
    trials = SimpleNamespace(
        settle_lost=list, tables=SimpleNamespace(write=list), ended_early="x", rows=(), discarded=()
    )
    monkeypatch.setattr(trial_run, "_all", swapping)
    monkeypatch.setattr(trial_run, "LockSet", lambda *_: SimpleNamespace(acquire=nullcontext))
    monkeypatch.setattr(trial_run, "LockedRobots", lambda *_: nullcontext())
    monkeypatch.setattr(trial_run, "run", lambda *_, **__: done)
    monkeypatch.setattr(trial_run, "_images", lambda *_: {})
    monkeypatch.setattr(trial_run, "refuse_others", lambda *_: None)
    monkeypatch.setattr(trial_run, "Trials", lambda *_: trials)
    sessions: Any = SimpleNamespace(prepare=lambda _: None)
    fleet: Any = SimpleNamespace(connected=lambda: {"r2": None}, sessions=sessions, inventory=inventory(world))
    request = trial_run.TrialsRequest(folder=home)
    trial_run.run_trials(plan, fleet, request, RunOptions(), print, print, threading.Event(), lambda *_: None)
    assert os.listdir(own) == []
    assert {"journal.jsonl", "sessions"} <= set(os.listdir(tmp_path / "moved"))
