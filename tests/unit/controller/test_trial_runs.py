"""What the user agrees to before trials are run, and what a journal says of attempts that never ended."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.trial_history import read_history
from srprov.controller.trial_plan import in_words, trial_plan
from srprov.controller.trial_run import TrialsRequest, _resumed, chosen, run_trials
from srprov.controller.trial_sameness import Sameness, as_far_as_known, differences, sameness
from srprov.controller.trials import TrialRun, Trials
from srprov.definitions import playbook
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Definitions
from srprov.definitions.playbookmodel import BEFORE
from srprov.definitions.trialsmodel import Parameter, TrialDefinitions, TrialSettings
from srprov.errors import TransportError, UsageError
from srprov.execution import RunOptions
from srprov.record.journal import Journal, read
from srprov.resource import Action, Need, Observed
from srprov.trials import Design, design
from tests.fakes import World
from tests.worlds import AS_IT_IS, apply, experiment, inventory, made, service

GIVEN = TrialDefinitions(
    parameters=(Parameter(name="SPEED", values=("1", "2")),), settings=TrialSettings(keep=("cam",))
)


def test_the_shown_plan_names_what_each_trial_creates() -> None:
    bag = Mount(kind="volume", source="bag", target="/bag")
    what = experiment(
        service("racer", robot="r2", image="race:1", privileged=True),
        service("referee", robot="r1", image="judge:2", ports=(("", 8080, 80, "tcp"),), mounts=(bag,)),
        service("cam", robot="r1"),
        trials=GIVEN,
    )
    world = World().add("r1", "r2")
    planned = made(world, Definitions(experiment=what, containers={}))
    shown = in_words(trial_plan(planned, inventory(world), ()))
    assert shown.splitlines() == [
        "Each trial makes these anew, and removes them:",
        "",
        "r1",
        "  + container srprov.hello.referee: image judge:2; publishes 8080:80/tcp; mounts volume bag at /bag",
        "",
        "r2",
        "  + container srprov.hello.racer: image race:1; asks for privileged",
    ]


def test_the_shown_plan_is_in_the_words_of_who_runs_all_trials() -> None:
    """What `apply` brought up goes because trials make their own: the experiment still has it."""
    what = experiment(service("racer", robot="r1"), service("cam", robot="r1"), trials=GIVEN)
    world = World().add("r1")
    assert apply(world, what).exit_code == 0
    planned = made(world, Definitions(experiment=what, containers={}), replace(AS_IT_IS, adopt=True))
    assert any("`srprov run` runs them; here with SPEED=1" in note for note in planned.plan.notes)
    plan = trial_plan(planned, inventory(world), ()).base.plan
    gone = {one.name: one.change.cause for one in plan.steps if one.change.action is Action.DELETE}
    assert gone == {"srprov.hello.racer": "each trial makes its own"}
    assert any("2 trials" in note for note in plan.notes)
    assert not any("srprov run" in note for note in plan.notes)


def test_what_a_playbook_states_is_the_same_in_all_trials(tmp_path: Path) -> None:
    """Commands, and files of its own; what srprov writes for itself is said by services, robots and addresses."""

    def same(level: int) -> Sameness:
        text = (
            f"- file: {{{{ folder ~ '/level' }}}}\n  content: '{level}'\n"
            f"- command: level {level} is set\n  argv: [touch, /l{level}]\n  creates: /l{level}\n"
        )
        (tmp_path / "p.yml").write_text(text)
        mine = playbook.read(str(tmp_path / "p.yml"), "p.yml", "p.yml", BEFORE)
        what = experiment(service("cam", robot="r1"), trials=GIVEN, playbooks=(mine,))
        world = World().add("r1")
        request = replace(AS_IT_IS, allowed=frozenset({"playbook"}))
        planned = made(world, Definitions(experiment=what, containers={}), request)
        return sameness(trial_plan(planned, inventory(world), ()), {}, {})

    assert differences(same(1), same(1)) == []
    told = differences(same(1), same(2))
    assert [line.partition(": ")[2].partition(": ")[0] for line in told] == [
        "command level 1 is set",
        "command level 2 is set",
        "file /var/lib/srprov/hello/level",
    ]


def test_an_image_that_an_earlier_run_built_stands_in_nobodys_way() -> None:
    """What is there is wanted as a copy of itself, so it must not count as missing."""
    what = experiment(service("racer", robot="r2", image="race:1"))
    world = World().add("r2")
    assert apply(world, what).exit_code == 0
    planned = made(world, Definitions(experiment=what, containers={}), replace(AS_IT_IS, adopt=True))
    copied = tuple(replace(one, needs=(Need(id=one.id),)) if one.module == "image" else one for one in planned.desired)
    plan = trial_plan(replace(planned, desired=copied), inventory(world), ())
    assert [one.service for one in plan.services] == ["racer"]


def test_an_image_whose_tag_leads_elsewhere_by_now_is_another_experiment() -> None:
    """Of services that are kept, too. One that is on no robot any more counts as the same until it is pulled again."""
    what = experiment(
        service("racer", robot="r2", image="race:1"), service("cam", robot="r1", image="race:1"), trials=GIVEN
    )
    world = World().add("r1", "r2")
    plan = trial_plan(made(world, Definitions(experiment=what, containers={})), inventory(world), ())

    def same(**ids: str) -> Sameness:
        there = {
            robot: [Observed(module="image", name="race:1", instance="", state={"id": id_})]
            for robot, id_ in ids.items()
        }
        return sameness(plan, {}, there)

    before = same(r1="sha256:aa", r2="sha256:bb")
    assert differences(before, same(r1="sha256:aa", r2="sha256:bb")) == []
    assert differences(before, same(r1="sha256:cc", r2="sha256:dd")) == [
        "cam: image id: sha256:aa -> sha256:cc",
        "racer: image id: sha256:bb -> sha256:dd",
    ]
    assert differences(before, as_far_as_known(same(r1="sha256:aa"), before)) == []
    assert differences(before, as_far_as_known(same(r1="sha256:cc"), before)) == [
        "cam: image id: sha256:aa -> sha256:cc"
    ]


def test_a_robot_that_is_out_of_reach_is_named_before_it_is_compared(tmp_path: Path) -> None:
    """Nothing is known of it, which is no change of the experiment."""
    what = experiment(service("racer", robot="r2", image="race:1"), trials=replace(GIVEN, settings=TrialSettings()))
    world = World().add("r2")
    plan = trial_plan(made(world, Definitions(experiment=what, containers={})), inventory(world), ())
    with Journal(tmp_path) as journal:
        journal.add("run", run="r", same={"r2: kernel": "6.1"})
    fleet: Any = SimpleNamespace(connected=dict)
    request = TrialsRequest(folder=tmp_path, resume=True)
    with pytest.raises(UsageError, match="r2 cannot be reached, and trials run there"):
        run_trials(plan, fleet, request, RunOptions(), print, print, threading.Event(), lambda *_: None)


def test_trials_are_not_run_without_a_service_whose_robot_is_away() -> None:
    """It stays where it was, so that the plan has nothing of it."""
    what = experiment(service("racer", robot="r1"), service("referee", robot="r2"), trials=GIVEN)
    what = replace(what, trials=replace(GIVEN, settings=TrialSettings()))
    world = World().add("r1", "r2")
    assert apply(world, what).exit_code == 0
    world.robots["r2"].gone = True
    away = made(world, Definitions(experiment=what, containers={}), replace(AS_IT_IS, adopt=True))
    assert not [one for one in away.desired if one.service == "referee"]
    with pytest.raises(TransportError, match="referee runs there in each trial, and it cannot be reached"):
        trial_plan(away, inventory(world), ())


def gone_on_with(folder: Path, whole: Design, only: Design) -> list[tuple[object, ...]]:
    """Go on with a run whose journal is in a folder, as far as its lost attempts; return the rows."""
    earlier = read_history(folder)
    plan: Any = SimpleNamespace(given=GIVEN, services=(), robots={}, disks={})
    about = TrialRun(
        plan=plan, whole=whole, design=only, folder=folder, name=earlier.name, rows=earlier.rows, begun=earlier.begun,
        lost=earlier.lost,
    )  # fmt: skip
    with Journal(folder, earlier.events + 1) as journal:
        trials = Trials(about, SimpleNamespace(renew=None), journal, lambda _news: None)  # type: ignore[arg-type]  # no robot is asked
        trials.settle_lost()
        trials.tables.write()
    return [(one["trial"], one["attempt"], one["status"]) for one in trials.rows]


def test_lost_attempts_are_noted_whatever_is_run_now(tmp_path: Path) -> None:
    """Also one that another trial was run after, and one whose trial the design does not have any more."""
    whole = design(GIVEN)
    first, second = (trial.id for trial in whole.trials)
    with Journal(tmp_path) as journal:
        journal.add("run", run="r", same={})
        journal.add("begin", trial=first, attempt=1)
        journal.add("begin", trial="feedfeedfe-r001", attempt=2)
        journal.add("begin", trial=second, attempt=1)
        journal.add("end", trial=second, attempt=1, row={"trial": second, "attempt": 1, "status": "ok"})
        journal.add("begin", trial=second, attempt=2)
    rows = gone_on_with(tmp_path, whole, chosen(whole, (second,)))
    lost = [(first, 1), ("feedfeedfe-r001", 2), (second, 2)]
    assert rows == [(second, 1, "ok"), *((*one, "interrupted") for one in lost)]
    assert [event["event"] for event in read(tmp_path)[0]][-3:] == ["end"] * 3
    assert f"{first},{first[:10]},1,1,1,1,interrupted" in (tmp_path / "trials.csv").read_text()
    assert gone_on_with(tmp_path, whole, whole) == rows, "they are noted once"


@pytest.mark.parametrize("event", [{}, {"trial": 3}, {"trial": "x", "attempt": "9" * 5000}, {"attempt": [1]}])
def test_an_odd_event_of_a_journal_ends_nothing(tmp_path: Path, event: dict[str, Any]) -> None:
    lines = [{"seq": 1, "event": "run", "run": "r", "same": {}}, {"seq": 2, "event": "begin", **event}]
    (tmp_path / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    whole = design(GIVEN)
    assert [row[2] for row in gone_on_with(tmp_path, whole, whole)] == ["interrupted"]


@pytest.mark.parametrize("row", [{}, {"trial": ["x"], "status": "ok"}, {"trial": "x", "status": {}}, [1]])
def test_rows_that_are_none_are_refused(tmp_path: Path, row: object) -> None:
    events = [{"event": "run", "run": "r"}, {"event": "discard", "trial": ["x"]}, {"event": "accept", "same": 3},
              {"event": "end", "row": row}]  # fmt: skip
    lines = [json.dumps({"seq": number, **event}) + "\n" for number, event in enumerate(events, start=1)]
    (tmp_path / "journal.jsonl").write_text("".join(lines))
    with pytest.raises(UsageError, match="rows that are none"):
        read_history(tmp_path)
    (tmp_path / "journal.jsonl").write_text("".join(lines[:-1]))
    assert (read_history(tmp_path).segment, read_history(tmp_path).same) == (2, {})


@pytest.mark.parametrize(
    "name", ["", "r", "20261130T090000Z-race-0123abcd; id", "20261130T090000Z-a\nb-0123abcd", None]
)
def test_a_run_of_a_colleague_s_has_a_name_as_runs_have(tmp_path: Path, name: str | None) -> None:
    """Each container of the next trials is told it, in a variable."""
    (tmp_path / "trials").mkdir()
    tmp_path.chmod(0o700)
    request = TrialsRequest(folder=tmp_path, resume=True)
    for given in ("20261130T090000Z-race-0123abcd", name):
        line = json.dumps({"seq": 1, "event": "run", "run": given, "same": {}})
        (tmp_path / "journal.jsonl").write_text(f"{line}\n")
        if given != name:
            assert _resumed(request)[1].name == given
    with pytest.raises(UsageError, match="its run has a name that none has"):
        _resumed(request)
