"""`--data move` on robots in memory: each command of it fails, is half done, or is the last before contact is lost."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.controller.owners import Owner, keep
from srprov.controller.plan_proof import proved
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import RefusedError
from srprov.execution.outcome import Outcome
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from srprov.resource import Action
from srprov.wire import CopyVolume
from tests.fakes import Entry, Fault, World
from tests.worlds import experiment, fleet, made, plan_for, run, service

LOG = "srprov.hello.log"
OWNER = Owner(instance="hello", edf="/e/hello.edf", token="0123456789abcdef")
DATA = "all that was ever written"


def web(robot: str) -> Experiment:
    return experiment(service("web", robot=robot, mounts=(Mount(kind="volume", source="log", target="/log"),)))


def begun() -> World:
    """Give two robots, of which r1 runs the service and has data."""
    world = World().add("r1", "r2")
    assert run(world, plan_for(world, web("r1"), owner=OWNER)).exit_code == 0
    world.robots["r1"].engine.data[LOG] = DATA
    return world


def move(world: World) -> int:
    return run(world, plan_for(world, web("r2"), owner=OWNER, data="move")).exit_code


def holding(world: World) -> dict[str, str]:
    """Give robot -> its data, by the volume's real name."""
    return {name: robot.engine.data[LOG] for name, robot in world.robots.items() if robot.engine.data.get(LOG)}


def moved(world: World) -> None:
    assert world.running() == [("web", "r2")] and world.doubles == []
    assert {name: dict(robot.engine.volumes) for name, robot in world.robots.items()}["r1"] == {}
    assert list(world.robots["r2"].engine.volumes) == [LOG]
    assert holding(world) == {"r2": DATA}


def test_a_move_stops_the_service_copies_starts_it_and_removes_the_source_last() -> None:
    """In this order, and a second plan has nothing to do."""
    world = begun()
    plan = plan_for(world, web("r2"), owner=OWNER, data="move")
    kinds = ("container", "volume")
    order = [(step.host, step.module, step.change.action) for step in plan.steps if step.module in kinds]
    assert order == [
        ("r1", "container", Action.DELETE), ("r2", "volume", Action.RUN), ("r2", "container", Action.CREATE),
        ("r1", "volume", Action.DELETE),
    ]  # fmt: skip
    assert not any(step.change.destructive for step in plan.steps)
    assert run(world, plan).exit_code == 0
    moved(world)
    assert plan_for(world, web("r2"), owner=OWNER, data="move").empty
    assert plan_for(world, web("r2"), owner=OWNER).empty


@pytest.mark.parametrize("how", ["refuse", "half", "lost", "lost-after"])
def test_whatever_command_of_a_move_goes_wrong_the_data_is_whole_and_the_next_apply_ends_it(how: str) -> None:
    """Counted over both robots."""
    world = begun()
    before = world.commands
    assert move(world) == 0
    count = world.commands - before
    assert count > 12
    for at in range(1, count + 1):
        world = begun()
        world.fault = Fault(at=world.commands + at, how=how)
        code = move(world)
        assert code != 0 or how == "half", at
        assert DATA in holding(world).values(), at
        world.fault = None
        for robot in world.robots.values():
            robot.gone, robot.holder = False, None
        assert move(world) == 0, at
        moved(world)


@pytest.mark.parametrize("how", ["refuse", "half"])
def test_a_move_that_fails_again_blames_the_step_that_failed(how: str) -> None:
    """What the first one left is removed before; the second one leaves another half copy."""
    half, volume = "r2/volume:srprov-copy.hello.log", f"r2/volume:{LOG}"
    failed = list[set[str]]()
    for at in range(1, 9):
        world = begun()
        robot = world.robots["r2"]
        robot.fault = Fault(at=robot.commands + _copying())
        assert move(world) != 0
        robot.fault = Fault(at=robot.commands + at, how=how)
        plan = plan_for(world, web("r2"), owner=OWNER, data="move")
        assert [step.id for step in plan.steps][:2] == [half, volume]
        found = {one.step.id: one for one in run(world, plan).results}
        failed.append({name for name in (half, volume) if found[name].outcome is Outcome.FAILED})
        assert half not in failed[-1] or "did not converge" not in found[half].message
    assert {volume} in failed and {half, volume} not in failed


def test_a_move_from_a_plan_file_is_held_to_what_its_values_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where only the removal is left; another controller is refused."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for fault_at_removal in (False, True):
        world = begun()
        if fault_at_removal:
            world.fault = Fault(at=world.commands + _removal_of_data(), how="refuse")
            assert move(world) != 0
            world.fault = None
            assert holding(world) == {"r1": DATA, "r2": DATA}
        request = PlanRequest(owner=OWNER, data="move", adopt=True)
        planned = made(world, Definitions(experiment=web("r2"), containers={}), request)
        saved = plan_file(planned.__class__(plan=planned.plan, snapshot=planned.snapshot, desired=planned.desired))
        read = load(dump(proved(saved, OWNER)), "plan.json")
        check_file(read, "plan.json")
        with pytest.raises(RefusedError, match=LOG):
            check_plan(read, fleet(world), adopt=True)
        keep(Owner(instance="hello", edf="/e/hello.edf", token=OWNER.token, source=planned.plan.source))
        assert run(world, check_plan(read, fleet(world), adopt=True).plan).exit_code == 0
        moved(world)
        for one in (tmp_path / "srprov" / "owners").iterdir():
            one.unlink()


def test_a_plan_file_that_was_not_written_here_neither_reads_nor_removes_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It names the right source; its steps are what they claim. Neither --adopt nor a proof of another plan helps."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = begun()
    definitions = Definitions(experiment=web("r1"), containers={})
    mine = made(world, definitions, PlanRequest(owner=OWNER, adopt=True))
    keep(dataclasses.replace(OWNER, source=mine.plan.source))
    file = plan_file(replace(mine, definitions=None))
    read = load(dump(proved(file, OWNER)), "plan.json")
    assert check_plan(read, fleet(world), adopt=True).plan == mine.plan
    for one in (
        replace(read, proof=""),
        replace(read, proof="é"),
        replace(read, proof=proved(replace(file, made_by="another"), OWNER).proof),
        proved(file, dataclasses.replace(OWNER, token="guessed")),
    ):
        with pytest.raises(RefusedError, match=f"{LOG} on r1"):
            check_plan(load(dump(one), "plan.json"), fleet(world), adopt=True)
    assert holding(world) == {"r1": DATA}


def _removal_of_data() -> int:
    """Return which command of a move empties the source, right before it is removed."""
    sent = [entry.host == "r1" and getattr(entry.what, "method", "") == "DELETE" for entry in _sent()]
    return max(at for at, removes in enumerate(sent) if removes)


def _copying() -> int:
    """Return which command of a move on r2 copies the data."""
    sent = (entry for entry in _sent() if entry.host == "r2")
    return next(at for at, entry in enumerate(sent, 1) if isinstance(entry.what, CopyVolume))


def _sent() -> list[Entry]:
    world = begun()
    since = world.commands
    assert move(world) == 0
    return world.done()[since:]


def test_a_move_that_was_cut_off_anywhere_is_ended_from_a_plan_file_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A half copy is nobody's data."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = begun()
    before = world.commands
    assert move(world) == 0
    for at in range(1, world.commands - before + 1):
        world = begun()
        world.fault = Fault(at=world.commands + at)
        assert move(world) != 0, at
        world.fault = None
        request = PlanRequest(owner=OWNER, data="move", adopt=True)
        planned = made(world, Definitions(experiment=web("r2"), containers={}), request)
        keep(dataclasses.replace(OWNER, source=planned.plan.source))
        file = proved(plan_file(replace(planned, definitions=None)), OWNER)
        assert run(world, check_plan(load(dump(file), "plan.json"), fleet(world), adopt=True).plan).exit_code == 0, at
        moved(world)
