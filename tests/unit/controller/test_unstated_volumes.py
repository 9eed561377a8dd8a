"""Volumes that an engine made for a container, with no word of whose they are: no plan file has any made, and who comes
next is asked.
"""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.controller.owners import Owner
from srprov.definitions.containermodel import Mount
from srprov.errors import RefusedError, UsageError
from srprov.modules.module import INSTANCE
from srprov.modules.volume import OWNER
from srprov.resource import Resource
from tests.fakes import World
from tests.unit.controller.test_saved import planned, reread
from tests.worlds import Experiment, experiment, plan_for, removal_for, run, service

LOG = "srprov.hello.log"
MINE = Owner(instance="hello", edf="/e/hello.edf", token="0123456789abcdef")


def web() -> Experiment:
    """Return an experiment whose service has data."""
    return experiment(service("web", mounts=(Mount(kind="volume", source="log", target="/l"),)))


def test_who_mounts_a_volume_in_a_plan_file_states_it() -> None:
    """The engine made it, which no plan said; and an instance of that name ran what a stranger had left there."""
    saved = reread(planned(World().add("r1"), web()))
    check_file(saved, "plan.json")
    steps = tuple(step for step in saved.plan.steps if step.module != "volume")
    assert len(steps) < len(saved.plan.steps)
    with pytest.raises(UsageError, match=r"r1/container:srprov\.hello\.web asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps)), "plan.json")


def test_who_mounts_a_volume_in_a_plan_file_needs_it() -> None:
    """Else the container is made also where the volume is not."""
    saved = reread(planned(World().add("r1"), web()))
    steps = tuple(replace(step, want=_without_needs(step.want)) for step in saved.plan.steps)
    with pytest.raises(UsageError, match=r"r1/container:srprov\.hello\.web asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps)), "plan.json")


def _without_needs(want: Resource | None) -> Resource | None:
    return want and replace(want, needs=tuple(need for need in want.needs if "/volume:" not in need.id))


@pytest.mark.parametrize("labels", [{}, {INSTANCE: "other"}, {INSTANCE: "other", OWNER: "0" * 64}])
def test_a_volume_of_an_instances_name_without_its_owner_s_label_is_taken_by_nobody_unasked(
    labels: dict[str, str],
) -> None:
    """An engine that is told to make it takes it as it is, and the service ran with what lay in it."""
    world = World().add("r1")
    world.robots["r1"].engine.volumes[LOG] = labels
    with pytest.raises(RefusedError, match=rf"not made from this file on this controller: {LOG} on r1") as refused:
        plan_for(world, web(), owner=MINE)
    assert refused.value.exit_code == 9
    taken = plan_for(world, web(), owner=MINE, adopt=True)
    assert "volume" not in {step.module for step in taken.steps}
    assert run(world, taken).exit_code == 0
    assert LOG not in {step.name for step in removal_for(world).steps}
    assert run(world, removal_for(world, volumes=True)).exit_code == 0
    assert not world.robots["r1"].engine.volumes
    assert run(world, plan_for(world, web(), owner=MINE)).exit_code == 0
    assert world.robots["r1"].engine.volumes[LOG][OWNER] == MINE.label("r1", LOG)
