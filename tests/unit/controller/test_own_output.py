"""What a run keeps is no part of what its experiment ships; what changed since the plan is told before robots act."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller import trial_run
from srprov.controller.own_output import Shipping, refuse_shipped, shipping
from srprov.controller.trial_plan import trial_plan
from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.definitions.trialsmodel import TrialSettings
from srprov.errors import UsageError
from srprov.execution import RunOptions
from tests.fakes import World
from tests.unit.controller.test_trial_runs import GIVEN
from tests.worlds import experiment, inventory, made, service

BUILT = "edf: 1\nname: x\nservices: {a: {cdf: a.cdf}}\ntrials: {timeout: 5s}\n"
MOUNTED = "edf: 1\nname: x\nservices: {a: {image: busybox, volumes: ['.:/x:ro']}}\ntrials: {timeout: 5s}\n"


def files(home: Path, edf: str, ignored: str = "") -> Definitions:
    (home / "x.edf").write_text(edf)
    (home / "a.cdf").write_text("cdf: 1\nname: a\ndockerfile: Dockerfile\n")
    (home / "Dockerfile").write_text("FROM busybox\nCOPY . /x\n")
    if ignored:
        (home / ".dockerignore").write_text(ignored)
    return load_experiment(str(home / "x.edf"))


def test_no_answer_depends_on_a_file_of_the_users_that_an_archive_called_dockerignore(tmp_path: Path) -> None:
    home, said = tmp_path / "home", set()
    home.mkdir()
    for words in ("res\n", "other\n"):
        (tmp_path / "mine").write_text(words)
        (home / ".dockerignore").unlink(missing_ok=True)
        (home / ".dockerignore").hardlink_to(tmp_path / "mine")
        said.add(shipping(files(home, BUILT), home / "res"))
    assert said == {None}


@pytest.mark.parametrize(
    ("edf", "ignored", "folder", "by"),
    [
        (BUILT, "", "res", "built"),
        (BUILT, "", "runs/one", "built"),
        (BUILT, "*.csv\n", "res", "built"),
        (BUILT, "res\n!res/trials.csv\n", "res", "built"),
        (BUILT, "/res\n", "res", ""),
        (BUILT, "runs\n", "runs/one", ""),
        (BUILT, "", "../res", ""),
        (BUILT, "", ".git/res", ""),
        (MOUNTED, "", "res", "mounted"),
        (MOUNTED, "res\n", "res", "mounted"),
        (MOUNTED, "", "../res", ""),
    ],
)
def test_a_folder_that_the_experiment_ships_is_known(
    tmp_path: Path, edf: str, ignored: str, folder: str, by: str
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    found = shipping(files(home, edf, ignored), home / folder)
    assert found == (Shipping(str(home), by == "built", folder) if by else None)


def test_a_link_is_no_way_around(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "way").symlink_to(home)
    assert shipping(files(home, BUILT), tmp_path / "way" / "res") is not None


def test_a_refusal_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the run would change its own experiment") as refused:
        refuse_shipped(files(tmp_path, BUILT), tmp_path / "res")
    assert refused.value.hint == (
        f"name a folder elsewhere with -o, or leave it out by a line '/res' in {tmp_path}/.dockerignore"
    )
    with pytest.raises(UsageError) as refused:
        refuse_shipped(files(tmp_path, MOUNTED), tmp_path / "res")
    assert refused.value.hint == "name a folder elsewhere with -o"


def test_what_was_changed_since_the_plan_is_told_before_robots_act_and_before_a_folder_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    what = experiment(service("racer", robot="r2", image="race:1"), trials=replace(GIVEN, settings=TrialSettings()))
    world, home = World().add("r2"), tmp_path / "home"
    plan = trial_plan(made(world, Definitions(experiment=what, containers={})), inventory(world), ())

    def changed(_: object) -> None:
        raise UsageError("changed", code=Code.NO_FILE)

    monkeypatch.setattr("srprov.controller.trial_record.shipped_files", changed)
    monkeypatch.setattr(trial_run, "LockSet", None)
    fleet: Any = SimpleNamespace(connected=lambda: {"r2": None}, inventory=inventory(world))
    request = trial_run.TrialsRequest(folder=home)
    with pytest.raises(UsageError, match="changed"):
        trial_run.run_trials(plan, fleet, request, RunOptions(), print, print, threading.Event(), lambda *_: None)
    assert not home.exists()
