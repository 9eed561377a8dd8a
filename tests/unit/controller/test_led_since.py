"""A container gets of its robot's paths what the plan showed, whatever another one did to the way there since.

A container that may write above a path is there when the next one is planned, and is asked to end right before that is
made: by then it may have put a link there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace as replaced
from pathlib import Path
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller.owners import keep, read_owner
from srprov.controller.request import PlanRequest
from srprov.controller.robot_mounts import MOUNTS
from srprov.controller.saved import check_plan, kept_plan
from srprov.controller.trial_plan import containers, in_words, trial_plan
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Definitions
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import StalePlan
from srprov.execution.outcome import Outcome
from srprov.facts.gather import Gathering
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planhash import plan_hash
from srprov.planning.planread import load
from srprov.trials import design
from srprov.wire import AnyQuery, Reply, Run
from tests.fakes import World
from tests.worlds import apply, experiment, fleet, inventory, made, plan, plan_for, run, service

ELSEWHERE = "/root"
MAPS = Mount(kind="bind", source="/srv/data/maps", target="/m")
WHAT = experiment(service("reader", mounts=(MAPS,)), trials=TrialDefinitions())
SAID = f"{MAPS.source} leads to {ELSEWHERE}"
NOTE = f"r1: {MAPS.source}, which 'reader' mounts, leads to {ELSEWHERE} (root may run or believe what is written there)"


def test_a_container_is_not_made_where_its_path_leads_elsewhere_than_was_shown() -> None:
    world = World().add("r1")
    recorder = service("recorder", mounts=(Mount(kind="bind", source="/srv/data", target="/d"),))
    assert apply(world, experiment(recorder)).exit_code == 0
    shown = plan_for(world, WHAT)  # the next version of the same EDF, or another profile of it
    assert not [note for note in shown.notes if ELSEWHERE in note]
    world.robots["r1"].leads = ELSEWHERE
    done = run(world, shown)
    (one,) = [one for one in done.results if one.step.module == "container" and one.step.want]
    assert one.outcome is Outcome.FAILED and SAID in one.message
    assert not world.robots["r1"].engine.containers
    again = plan_for(world, WHAT)
    assert NOTE in again.notes
    assert run(world, again).exit_code == 0  # that was shown


def test_a_container_that_has_ended_is_not_started_where_its_path_leads_elsewhere() -> None:
    world = World().add("r1")
    assert apply(world, WHAT).exit_code == 0
    (container,) = world.robots["r1"].engine.containers.values()
    container.state, container.code = "exited", 1
    shown = plan_for(world, WHAT)
    world.robots["r1"].leads = ELSEWHERE
    assert NOTE in plan_for(world, WHAT).notes
    (one,) = run(world, shown).results
    assert one.outcome is Outcome.FAILED and SAID in one.message
    assert container.state == "exited"


def test_a_trial_makes_no_container_where_its_path_leads_elsewhere() -> None:
    world = World().add("r1")
    trials = trial_plan(made(world, Definitions(experiment=WHAT, containers={})), inventory(world), ())
    (one,) = containers(trials, design(trials.given).trials[0], 1, "run")
    looks = next(command for command in one.create if isinstance(command, Run))
    session = world.sessions()["r1"]
    assert session.execute(looks).ok
    world.robots["r1"].leads = ELSEWHERE
    assert SAID in session.execute(looks).err


def test_a_run_looks_at_the_paths_of_what_is_up_already_as_each_trial_makes_it_anew() -> None:
    world = World().add("r1")
    assert apply(world, WHAT).exit_code == 0
    world.robots["r1"].leads = ELSEWHERE
    with mock.patch.object(plan, "source_of", return_value=f"lab@desk:{WHAT.file}"):
        planned = made(world, Definitions(experiment=WHAT, containers={}), PlanRequest(trials=True))
    trials = trial_plan(planned, inventory(world), ())
    assert NOTE in trials.base.plan.notes
    assert "reader" in in_words(trials)
    assert trials.base.plan.leads == {"r1": {MAPS.source: ELSEWHERE}}


def saved_here(world: World) -> PlanFile:
    """Return a plan file as this controller writes it, who owns the instance."""
    owner = replaced(read_owner("hello", WHAT.file), source=f"lab@desk:{WHAT.file}")
    with mock.patch.object(plan, "source_of", return_value=owner.source):
        planned = made(world, Definitions(experiment=WHAT, containers={}), PlanRequest(exact=True, owner=owner))
    keep(owner)
    return load(dump(kept_plan(replace(planned, definitions=None))), "plan.json")


def test_a_plan_file_that_was_written_here_is_refused_where_a_path_leads_elsewhere_by_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = World().add("r1")
    saved = saved_here(world)
    assert check_plan(saved, fleet(world)).plan.leads == {"r1": {MAPS.source: MAPS.source}}
    world.robots["r1"].leads = ELSEWHERE
    with pytest.raises(StalePlan, match="leads to /root") as refused:
        check_plan(saved, fleet(world))
    assert refused.value.exit_code == 6


def test_the_hash_of_a_plan_tells_where_links_lead() -> None:
    world = World().add("r1")
    before = plan_for(world, WHAT)
    world.robots["r1"].leads = ELSEWHERE
    assert plan_hash(plan_for(world, WHAT)) != plan_hash(before)
    world.robots["r1"].leads = MAPS.source
    assert plan_hash(plan_for(world, WHAT)) == plan_hash(before)


def test_what_a_robot_does_not_tell_is_noted_and_nothing_is_made_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its connection was lost while it was asked, or it took longer than it has."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = World().add("r1")
    saved = saved_here(world)

    def lost(self: Gathering, questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        return {} if MOUNTS in questions.get("r1", ()) else asked(self, questions)

    asked = Gathering.ask_each
    with mock.patch.object(Gathering, "ask_each", lost):
        shown = plan_for(world, WHAT)
        with pytest.raises(StalePlan, match="r1: it does not say what the folders and devices of its new containers"):
            check_plan(saved, fleet(world))
    assert "r1: it does not say what the folders and devices of its new containers are" in shown.notes
    (one,) = [one for one in run(world, shown).results if one.step.module == "container" and one.step.want]
    assert one.outcome is Outcome.FAILED
    assert f"{MAPS.source} leads to {MAPS.source}" in one.message
    assert not world.robots["r1"].engine.containers
