"""What the user reads: why there is no assignment, and why this one."""

import pytest

from srprov.assignment import explain
from srprov.definitions.containermodel import Requirements
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment, Placement, Weights
from srprov.errors import NoAssignment
from srprov.facts.model import Docker, Snapshot
from tests.unit.assignment.worlds import GIB, assign, experiment, found, robot, service


def refusal(
    what: Experiment, where: Snapshot, previous: dict[str, str] | None = None, slots: dict[str, int] | None = None
) -> NoAssignment:
    with pytest.raises(NoAssignment) as caught:
        assign(what, where, previous, slots=slots)
    return caught.value


def test_one_service_that_no_robot_can_run() -> None:
    """One service that no robot can run."""
    needs = Requirements(tags=("lidar",), memory=16 * GIB)
    what = experiment(service("a", requires=needs), service("b"))
    error = refusal(what, found(robot("r1", tags=("arm", "lidar")), robot("r2"), robot("r3")))
    assert error.message == "no robot can run 'a'"
    assert error.misses == {
        "a": {
            "r1": "needs 16 GiB of memory (has 8 GiB)",
            "r2": "needs tag 'lidar' (has: none); needs 16 GiB of memory (has 8 GiB)",
            "r3": "needs tag 'lidar' (has: none); needs 16 GiB of memory (has 8 GiB)",
        }
    }
    assert error.hint == "lower requires.memory, so that r1 can run 'a'"
    assert error.exit_code == 8


def test_two_services_compete_for_one_robot_and_the_rest_is_not_named() -> None:
    """Two services compete for one robot and the rest is not named."""
    what = experiment(service("a", tags=("x",)), service("b", tags=("x",)), service("c"))
    error = refusal(what, found(robot("r1", tags=("x",)), robot("r2", tags=("y",)), robot("r3")))
    assert error.message == "'a' and 'b' can run only on r1 (1 slot): 2 places needed, 1 there"
    assert error.hint == (
        "give r1 one more slot (srprov_slots in the inventory); "
        "or give r2 the tag 'x' (srprov_tags in the inventory), so that r2 can run 'a'; "
        "or pool a and b (pools in the EDF), they then share one slot"
    )
    assert error.misses["b"] == {"r2": "needs tag 'x' (has: y)", "r3": "needs tag 'x' (has: none)"}


def test_the_conflict_of_few_is_told_before_that_of_many() -> None:
    """The conflict of few is told before that of many."""
    many = [service(name) for name in "abcd"]
    few = [service(name, tags=("x",)) for name in "yz"]
    error = refusal(experiment(*many, *few), found(robot("r1", tags=("x",)), robot("r2"), robot("r3")))
    assert error.message.startswith("'y' and 'z' can run only on r1 ")


def test_more_services_than_robots() -> None:
    """More services than robots."""
    error = refusal(experiment(*(service(name) for name in "abc")), found(robot("r1"), robot("r2")))
    assert error.message == "'a', 'b' and 'c' can run only on r1 (1 slot) and r2 (1 slot): 3 places needed, 2 there"
    assert error.hint.startswith("give r1 or r2 one more slot")


def test_a_long_list_is_cut() -> None:
    """A long list is cut."""
    error = refusal(experiment(*(service(f"s{i:02}") for i in range(40))), found(robot("r1")))
    assert error.message.startswith("'s00' and 's01' can run only on r1")
    many = found(*(robot(f"r{i:02}") for i in range(20)))
    error = refusal(experiment(*(service(f"s{i:02}") for i in range(21))), many)
    assert "'s07' and 13 more can run only on r00 (1 slot), " in error.message
    assert "r07 (1 slot) and 12 more: 21 places needed, 20 there" in error.message
    assert len(error.misses) == 21


def test_a_group_that_no_robot_can_run() -> None:
    """A group that no robot can run."""
    what = experiment(service("a", tags=("x",)), service("b", tags=("y",)), same_robot=(("a", "b"),))
    error = refusal(what, found(robot("r1", tags=("x",)), robot("r2", tags=("y",))))
    assert error.message == "no robot can run 'a' and 'b' together"
    assert error.misses["a"]["r1"] == "must run with 'b': needs tag 'y' (has: x)"
    assert error.hint == (
        "give r1 the tag 'y' (srprov_tags in the inventory), so that r1 can run 'a' and 'b'; "
        "or take 'a' and 'b' out of relations.same_robot"
    )


def test_a_pin_to_a_robot_that_cannot() -> None:
    """A pin to a robot that cannot."""
    error = refusal(experiment(service("a", robot="r1", tags=("x",))), found(robot("r1"), robot("r2", tags=("x",))))
    assert error.misses == {"a": {"r1": "needs tag 'x' (has: none)", "r2": "pinned to r1"}}


def test_a_pin_to_a_robot_nobody_knows() -> None:
    """A pin to a robot nobody knows."""
    error = refusal(experiment(service("a", robot="r9")), found(robot("r1")))
    assert error.misses == {"a": {"r1": "pinned to r9"}}
    assert error.hint == "remove 'robot: r9' from service 'a', so that r1 can run 'a'"


def test_only_unreachable_robots() -> None:
    """Only unreachable robots."""
    error = refusal(experiment(service("a")), found(unreachable={"r1": "timed out"}))
    assert error.message == "no robot can run 'a'"
    assert error.misses == {"a": {"r1": "unreachable: timed out"}}
    assert error.hint == "make r1 reachable, so that r1 can run 'a'"


def test_no_robot_at_all() -> None:
    """No robot at all."""
    error = refusal(experiment(service("a")), found())
    assert error.message == "there is no robot to place anything on"
    assert error.hint


def test_a_slot_that_a_frozen_service_holds() -> None:
    """A slot that a frozen service holds."""
    what = experiment(service("a"), service("b"), service("c", robot="r1"), same_robot=(("a", "b"),))
    error = refusal(what, found(robot("r1"), unreachable={"r2": ""}), {"a": "r2", "b": "r1"})
    assert error.message == "'c' can run only on r1, where no slot is left"


def test_reasons_as_lines() -> None:
    """Reasons as lines."""
    lines = explain.reasons({"b": {"r2": "pinned to r1"}, "a": {"r3": "no Docker", "r1": "unreachable"}})
    assert lines == ["a not on r1: unreachable", "a not on r3: no Docker", "b not on r2: pinned to r1"]


def test_the_plans_lines() -> None:
    """The plans lines."""
    cpu = Weights(cpu=1.0, memory=0.0, swap=0.0, bandwidth=0.0)
    what = experiment(service("talker"), service("map"), weights=cpu, placement=Placement(sticky=False))
    where = found(robot("r1", load1=2.0), robot("robot2", load1=1.0, speed_mbit=0.0), robot("r3", speed_mbit=0.0))
    rest = "memory 0.000, swap 0.000, bandwidth 0.000"
    assert explain.describe(assign(what, where, {"map": "r1", "talker": "r3"})) == [
        f"map    -> robot2  cost 0.039 (cpu 0.039, {rest}); next r3 -0.039 but is full",
        f"talker -> r3      cost 0.000 (cpu 0.000, {rest}); next robot2 +0.039 but is full",
        "cost 0.039, the least possible",
        "map moves from r1 to robot2",
        "r3, robot2: link speed unknown: counted as the reference, no cost for bandwidth (set srprov_bandwidth_mbit)",
    ]


def test_a_pin_counts_for_robots_out_of_reach() -> None:
    """Making a robot reachable does not help a service that is pinned to another."""
    needs = Requirements(tags=("lidar",))
    what = experiment(service("a", robot="r1", requires=needs))
    error = refusal(what, found(robot("r1"), unreachable={"r2": "no route"}))
    assert error.misses["a"]["r2"] == "unreachable: no route; pinned to r1"
    assert "reachable" not in error.hint
    assert "give r1 the tag 'lidar'" in error.hint
    error = refusal(what, found(robot("r2"), unreachable={"r1": "no route"}))
    assert "make r1 reachable, so that r1 can run 'a'" in error.hint


def test_a_pin_of_the_group_counts_for_robots_out_of_reach() -> None:
    """What must share its robot is pinned with it."""
    what = experiment(service("a", tags=("lidar",)), service("b", robot="r1"), same_robot=(("a", "b"),))
    assert "reachable" not in refusal(what, found(robot("r1"), unreachable={"r2": ""})).hint


def test_a_rootless_engine_is_a_reason_in_both_explanations() -> None:
    """A service goes elsewhere and `why_not` has the reason; with nowhere else to go, the refusal has it."""
    rootless = robot("r1", docker=Docker(version="24.0.5", api_version="1.43", rootless=True))
    placed = assign(experiment(service("a")), found(rootless, robot("r2")))
    assert dict(placed.placed) == {"a": "r2"}
    assert placed.why_not["a"]["r1"].startswith("its Docker is rootless: its bridges are in a network namespace")
    error = refusal(experiment(service("a", network="host")), found(rootless))
    assert error.message == "no robot can run 'a'"
    assert "rootless: the network of the host is to it a namespace of its own" in error.misses["a"]["r1"]
    assert error.hint == "run a rootful Docker on r1, so that r1 can run 'a'"


@pytest.mark.parametrize(
    ("number", "shown"), [(-0.0, "0.000"), (-0.0004, "0.000"), (0.0004, "0.000"), (-0.0006, "-0.001"), (0.5, "+0.500")]
)
def test_a_difference_that_rounds_to_nothing_has_no_sign(number: float, shown: str) -> None:
    assert explain.signed(number, 3) == shown


def test_hints_name_what_the_edf_names() -> None:
    """Nobody can write `a-1` in an EDF: hints name the service, and tell to lower its replicas."""
    alone = expand(experiment(service("a", replicas=3)), {})
    assert (
        refusal(alone, found(robot("r1"), robot("r2"))).hint
        == "give r1 or r2 one more slot (srprov_slots in the inventory)"
    )
    pinned = expand(experiment(service("a", replicas=2, robot="r9")), {})
    assert refusal(pinned, found(robot("r1"))).hint == "remove 'robot: r9' from service 'a', so that r1 can run 'a'"
    anti_affinity = expand(experiment(service("a", replicas=2), different_robot=(("a",),)), {})
    hint = refusal(anti_affinity, found(robot("r1")), slots={"r1": 2}).hint
    assert hint == "take 'a' out of relations.different_robot; or add one more robot that can run 'a'"
    stuck = experiment(service("a", replicas=2, robot="r1"), different_robot=(("a",),))
    assert refusal(expand(stuck, {}), found(robot("r1"))).hint == "lower 'replicas' of 'a'"


def test_a_pool_is_advised_only_as_an_edf_can_have_it() -> None:
    """A pool of `a` holds every replica of it; two replicas alone are no pool."""
    two = expand(experiment(service("a", replicas=2, tags=("x",))), {})
    assert "pool" not in refusal(two, found(robot("r1", tags=("x",)))).hint
    three = expand(experiment(service("a", replicas=2, tags=("x",)), service("b", tags=("x",))), {})
    hint = refusal(three, found(robot("r1", tags=("x",)), robot("r2"))).hint
    assert "a-1" not in hint
