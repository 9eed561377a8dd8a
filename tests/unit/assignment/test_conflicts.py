"""Experiments that cannot be: which services are in each other's way, in words, and what would really help."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from srprov.assignment import conflict, problem
from srprov.assignment.explain import no_assignment
from srprov.assignment.model import Problem
from srprov.definitions.containermodel import Mount, Runtime
from srprov.definitions.model import Experiment, Placement, Pool
from srprov.facts.model import HostFacts
from tests.unit.assignment.worlds import experiment, found, robot, service


@dataclass(frozen=True)
class Case:
    """An experiment, its robots, and what the user should read."""

    what: Experiment
    robots: tuple[HostFacts, ...]
    conflict: set[str]
    message: str
    hints: tuple[str, ...]
    slots: dict[str, int] = field(default_factory=dict)

    def problem(self) -> Problem:
        return problem.build(self.what, {}, found(*self.robots), {}, slots=self.slots)


def many(letters: str, **fields: object) -> tuple[object, ...]:
    return tuple(service(name, **fields) for name in letters)


LIDARS = (robot("r1", tags=("lidar",)), robot("r2", tags=("lidar",)), robot("r3"), robot("r4"))
EACH_TWO = tuple(Pool(name="".join(pair), services=pair) for pair in (("a", "b"), ("a", "c"), ("b", "c")))
SHARING = Runtime(mounts=(Mount(kind="volume", source="logs", target="/logs"),))
CASES = {
    "three lidar services on two lidar robots": Case(
        experiment(*many("abc", tags=("lidar",)), service("d")),
        LIDARS,
        {"a", "b", "c"},
        "'a', 'b' and 'c' can run only on r1 (1 slot) and r2 (1 slot): 3 places needed, 2 there",
        ("give r1 or r2 one more slot", "give r3 the tag 'lidar'", "pool a and b"),
    ),
    "each two may be pooled, but not all three": Case(
        experiment(
            *many("abc"), service("d", robot="r2"),
            pools=EACH_TWO,
        ),
        (robot("r1"), robot("r2", tags=("small",), docker=None)),
        {"d"},
        "no robot can run 'd'",
        ("remove 'robot: r2' from service 'd'",),
    ),
    "pools are not enough": Case(
        experiment(*many("abc"), pools=(Pool(name="p", services=("a", "b")), Pool(name="q", services=("b", "c")))),
        (robot("r1"),),
        {"a", "c"},
        "2 places needed, 1 there",
        ("give r1 one more slot", "pool a and c"),
    ),
    "three pools of two are no pool of three": Case(
        experiment(
            *many("abc"),
            pools=EACH_TWO,
        ),
        (robot("r1"),),
        {"a", "b", "c"},
        "can run only on r1 (1 slot): 2 places needed even with pools together, 1 there",
        ("give r1 one more slot",),
    ),
    "a pool that no robot can run whole": Case(
        experiment(
            service("a", tags=("arm",)), service("b", tags=("eye",)), service("c", robot="r1"),
            pools=(Pool(name="p", services=("a", "b"), discount=0.8),),
        ),
        (robot("r1", tags=("arm",)), robot("r2", tags=("eye",))),
        {"a", "c"},
        "'a' and 'c' can run only on r1 (1 slot): 2 places needed, 1 there",
        ("give r1 one more slot", "pool a and c"),
    ),
    "replicas that must be apart": Case(
        experiment(*many("abc"), different_robot=(("a", "b", "c"),), placement=Placement(slots_per_robot=3)),
        (robot("r1"), robot("r2")),
        {"a", "b", "c"},
        "and not all of them at once: 'a', 'b' and 'c' must run on different robots",
        ("take 'a', 'b' and 'c' out of relations.different_robot",),
    ),
    "more that must be apart than there are robots": Case(
        experiment(*many("abc"), different_robot=(("a", "b", "c"),)),
        (robot("r1"), robot("r2")),
        {"a", "b", "c"},
        "3 places needed, 2 there; and 'a', 'b' and 'c' must run on different robots",
        ("add one more robot that can run 'a', 'b' and 'c'",),
    ),
    "two that must be apart where only a slot is missing": Case(
        experiment(*many("abc"), different_robot=(("a", "b"),)),
        (robot("r1"), robot("r2")),
        {"a", "b", "c"},
        "3 places needed, 2 there",
        ("give r1 or r2 one more slot", "add one more robot"),
    ),
    "two that must be apart and are pinned together": Case(
        experiment(
            service("a", robot="r1"), service("b", robot="r1"), service("c"),
            different_robot=(("a", "b"),), placement=Placement(slots_per_robot=2),
        ),
        (robot("r1"), robot("r2")),
        {"a", "b"},
        "'a' and 'b' must run on different robots",
        ("remove 'robot: r1' from service", "out of relations.different_robot"),
    ),
    "a pin elsewhere than the data of a service that shares it": Case(
        experiment(
            service("a", robot="r2", runtime=SHARING), service("b", data_on="r1", runtime=SHARING),
            same_robot=(("a", "b"),),
        ),
        (robot("r1"), robot("r2")),
        {"a", "b"},
        "no robot can run 'a' and 'b' together",
        (
            "copy the data of 'b' with --data move, or start without it with --data leave, so that r2 can run",
            "give each of 'a' and 'b' a volume of its own, they share 'logs'",
        ),
    ),
    "a group that asks for two robots' tags": Case(
        experiment(
            service("a", tags=("arm",)), service("b", tags=("eye",)), service("c"), same_robot=(("a", "b", "c"),)
        ),
        (robot("r1", tags=("arm",)), robot("r2", tags=("eye",))),
        {"a", "b"},
        "no robot can run 'a' and 'b' together",
        ("give r1 the tag 'eye'", "take 'a' and 'b' out of relations.same_robot"),
    ),
    "one tag on another robot is enough": Case(
        experiment(service("a", tags=("arm", "eye")), service("b")),
        (robot("r1"), robot("r2", tags=("arm",))),
        {"a"},
        "no robot can run 'a'",
        ("give r2 the tag 'eye'",),
    ),
    "a device that nobody has": Case(
        experiment(
            service("cam", runtime=Runtime(devices=(("/dev/video0", "/dev/video0", "rwm"),))), service("other")
        ),
        (robot("r1"), robot("r2")),
        {"cam"},
        "no robot can run 'cam'",
        ("attach /dev/video0 to r1",),
    ),
    "a GPU that nobody has": Case(
        experiment(service("net", runtime=Runtime(gpus="all"))),
        (robot("r1"),),
        {"net"},
        "no robot can run 'net'",
        ("give r1 the tag 'gpu'",),
    ),
    "two groups for one strong robot": Case(
        experiment(
            *many("ab", tags=("arm",)), *many("cd", tags=("arm",)), service("e"), same_robot=(("a", "b"), ("c", "d"))
        ),
        (robot("r1", tags=("arm",)), robot("r2")),
        {"a", "c"},
        "can run only on r1 (1 slot): 2 places needed, 1 there",
        ("give r1 one more slot", "give r2 the tag 'arm'"),
    ),
    "what runs on each camera robot cannot run on one": Case(
        experiment(service("cam-r1", robot="r1", per_robot=("camera",), tags=("arm",), instance_of="cam")),
        (robot("r1", tags=("camera",)),),
        {"cam-r1"},
        "r1 cannot run 'cam-r1', which 'per_robot' puts there",
        ("give r1 the tag 'arm'", "narrow the tags of 'per_robot'"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_conflict_is_named_in_words(case: Case) -> None:
    """The services, the reason, and every hint that is expected."""
    error = no_assignment(case.problem())
    assert set(error.misses) == case.conflict
    assert case.message in error.message
    for hint in case.hints:
        assert hint in error.hint
    assert error.exit_code == 8


@pytest.mark.parametrize("case", [case for case in CASES.values() if "per_robot" not in case.message])
def test_none_of_it_is_named_in_vain(case: Case) -> None:
    """What is named cannot be placed, and can as soon as any one of it is left out."""
    task = case.problem()
    assert not conflict.feasible(conflict.cut(task, case.conflict))
    for name in case.conflict:
        assert conflict.feasible(conflict.cut(task, case.conflict - {name}))
