"""What a plan may make a robot say: no more than is read of it, or no verb would see it any more."""

from __future__ import annotations

from typing import Any
from unittest import mock

import pytest

from srprov.controller import plan as planning
from srprov.controller.robot_room import check_room
from srprov.controller.saved import check_plan, plan_file
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.resource import Observed, Resource
from tests.fakes import World
from tests.resources import resource
from tests.unit.controller.test_saved import _alone, planned
from tests.worlds import Experiment, Mount, experiment, fleet, plan_for, service

__all__ = ["_alone"]

NOBODY = Snapshot(facts={}, observed={})
LABELLED = experiment(
    *(service(f"s{one}", robot="r1", network="none", labels={"note": "x" * 126_000}) for one in range(36)), slots=99
)
MOUNTING = experiment(
    service(
        "one",
        robot="r1",
        network="none",
        mounts=tuple(Mount(kind="volume", source=f"v{one}", target=f"/m/{one}") for one in range(949)),
    )
)


@pytest.fixture
def world() -> World:
    """Return one robot that has nothing yet."""
    return World().add("r1")


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (LABELLED, r"r1: containers take 4\.4.* MiB of its engine's list, which is more than 4 MiB"),
        (MOUNTING, r"r1: 95[0-9] things of the instance hello, which are more than 950"),
    ],
)
def test_a_plan_makes_no_robot_say_more_than_is_read(world: World, what: Experiment, says: str) -> None:
    """An experiment needed no permission for it, and all instances of the robot could be seen no more."""
    with pytest.raises(UsageError, match=says) as told:
        plan_for(world, what)
    assert "use more robots" in told.value.hint
    with mock.patch.object(planning, "check_room"):
        saved = plan_file(planned(world, what))
    with pytest.raises(UsageError, match=says):
        check_plan(saved, fleet(world), adopt=True, signed=True)


def test_a_plan_with_a_little_less_is_made(world: World) -> None:
    fewer = list(LABELLED.services.values())[:32]
    assert plan_for(world, experiment(*fewer, slots=99)).steps


def trees(count: int) -> list[Resource]:
    given = {"blob": "a"}
    return [resource("tree", f"/var/lib/srprov/new/trees/{one:024}", given, blobs={"a": b""}) for one in range(count)]


def seen(*ours: tuple[str, str, int]) -> Snapshot:
    """Return a robot with so many things of a kind and an instance."""
    every = [
        Observed(module=kind, name=f"/var/lib/srprov/{instance}/trees/{one:024}", instance=instance, state={})
        for kind, instance, count in ours
        for one in range(count)
    ]
    return Snapshot(facts={}, observed={"r1": tuple(every)})


def test_what_is_there_counts_of_all_instances_and_each_thing_once() -> None:
    check_room(trees(950), NOBODY, "new")
    check_room(trees(950), seen(("tree", "new", 950)), "new")
    with pytest.raises(UsageError, match="r1: 951 things of the kind tree, which are more than 950"):
        check_room(trees(951), NOBODY, "new")
    with pytest.raises(UsageError, match="r1: 951 things of the kind tree"):
        check_room(trees(1), seen(("tree", "old", 950)), "new")
    with pytest.raises(UsageError, match="r1: 951 things of the instance new"):
        check_room(trees(1), seen(("data", "new", 950)), "new")


def test_of_what_is_there_already_no_plan_is_refused() -> None:
    """Whoever has more than may be planned can still change it, or remove it."""
    check_room(trees(990), seen(("tree", "new", 990)), "new")
    check_room([], seen(("tree", "new", 999)), "new")


@pytest.mark.parametrize(
    "said",
    [
        {"labels": {"note": "x" * 5000}},
        {"command": ["\1" * 900]},
        {"expose": [[1 + one, "tcp"] for one in range(150)]},
        {"ports": [["", 2000 + one, 80, "tcp"] for one in range(30)]},
    ],
)
def test_what_an_engine_lists_of_containers_is_counted(said: dict[str, Any]) -> None:
    """Of each of 700; also what is short in a plan, and long in the list of an engine."""
    given = {
        "instance": "new", "source": "s", "image": "i", "hostname": "h", "job": False, "mounts": [], "run": {},
        "network": {"mode": "none"}, "api": "1.41", "service": "s",
    }  # fmt: skip
    few = [resource("container", f"srprov.new.s{one}", given) for one in range(700)]
    check_room(few, NOBODY, "new")
    many = [resource("container", f"srprov.new.s{one}", {**given, "run": said}) for one in range(700)]
    with pytest.raises(UsageError, match=r"containers take .* MiB of its engine's list"):
        check_room(many, NOBODY, "new")


def test_what_an_engine_lists_of_volumes_is_counted() -> None:
    """Each names all services that mount it."""
    services = [f"{'s' * 55}{one}" for one in range(100)]
    given = {"instance": "new", "source": "s", "services": services}
    with pytest.raises(UsageError, match=r"volumes take .* MiB of its engine's list"):
        check_room([resource("volume", f"srprov.new.v{one}", given) for one in range(700)], NOBODY, "new")


def test_records_have_a_length_by_themselves_and_together() -> None:
    def record(length: int) -> list[Resource]:
        said = {"content": "x" * length, "mode": "0644"}
        return [resource("file", "/var/lib/srprov/new/placement.json", said)]

    mib = 1 << 20
    held = {"old": {"source": "x" * 3 * mib}}
    check_room(record(mib), NOBODY, "new")
    with pytest.raises(UsageError, match=r"r1: a record of 2 MiB, which is more than 1 MiB"):
        check_room(record(2 * mib), NOBODY, "new")
    check_room(record(mib - 100), Snapshot(facts={}, observed={}, records={"r1": held, "r2": {"old": held}}), "new")
    check_room(record(mib), Snapshot(facts={}, observed={}, records={"r1": {"new": held}}), "new")
    with pytest.raises(UsageError, match=r"r1: 4.* MiB of records of instances, which is more than 4 MiB"):
        check_room(record(mib), Snapshot(facts={}, observed={}, records={"r1": held}), "new")
