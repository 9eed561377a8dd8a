"""Assignments of small worlds whose answer one sees at a glance."""

import pytest

from srprov.assignment import explain
from srprov.assignment.model import Move, RunnerUp
from srprov.definitions.model import Placement, Weights
from srprov.errors import NoAssignment
from srprov.facts.model import HostFacts
from tests.unit.assignment.worlds import assign, experiment, found, robot, service

CPU = Weights(cpu=1.0, memory=0.0, swap=0.0, bandwidth=0.0)
FREE = Placement(sticky=False)


def three_robots() -> tuple[HostFacts, ...]:
    return robot("r1", load1=3.0), robot("r2", load1=1.0), robot("r3", load1=2.0)


def test_each_robot_runs_one_service_and_the_dearest_gets_the_idlest() -> None:
    """Each robot runs one service and the dearest gets the idlest."""
    what = experiment(service("a", cost=10), service("b", cost=90), weights=CPU)
    answer = assign(what, found(*three_robots()))
    assert answer.placed == {"a": "r3", "b": "r2"}
    # 10 * 0.5^4 + 90 * 0.25^4
    assert answer.cost == pytest.approx(0.625 + 0.3515625)
    assert answer.optimal
    assert answer.least == answer.cost
    assert answer.matrix["a"] == pytest.approx({"r1": 3.1640625, "r2": 0.0390625, "r3": 0.625})
    assert answer.jain == pytest.approx((0.625 + 0.3515625) ** 2 / (3 * (0.625**2 + 0.3515625**2)))


def test_runner_up_is_the_best_other_robot() -> None:
    """Runner up is the best other robot."""
    what = experiment(service("a", cost=10), service("b", cost=90), weights=CPU)
    answer = assign(what, found(*three_robots()))
    assert answer.runner_up["b"] == RunnerUp(robot="r3", cost=5.625, difference=5.625 - 0.3515625, full=True)
    assert answer.runner_up["a"].robot == "r2"
    assert answer.runner_up["a"].difference < 0


def test_a_single_service_alone_has_no_runner_up() -> None:
    """A single service alone has no runner up."""
    answer = assign(experiment(service("a", tags=("x",))), found(robot("r1", tags=("x",)), robot("r2")))
    assert answer.runner_up == {}
    assert answer.matrix["a"]["r2"] is None
    assert answer.why_not == {"a": {"r2": "needs tag 'x' (has: none)"}}


def test_slots_fill_while_they_are_cheaper() -> None:
    """Slots fill while they are cheaper."""
    what = experiment(*(service(name, cost=10) for name in "abc"), weights=CPU, placement=Placement(slots_per_robot=2))
    answer = assign(what, found(robot("r1"), robot("r2", load1=3.6)))
    # r1: 0 and 10 * 0.5^4 in its second slot; r2: 10 * 0.9^4
    assert sorted(answer.placed.values()) == ["r1", "r1", "r2"]
    assert answer.cost == pytest.approx(0.625 + 6.561)


def test_the_inventorys_slots_win_over_the_experiments() -> None:
    """The inventorys slots win over the experiments."""
    what = experiment(*(service(name) for name in "abc"), placement=Placement(slots_per_robot=2))
    answer = assign(what, found(robot("r1"), robot("r2", load1=4.0)), slots={"r1": 3})
    assert set(answer.placed.values()) == {"r1"}
    with pytest.raises(NoAssignment):
        assign(what, found(robot("r1"), robot("r2")), slots={"r1": 1, "r2": 1})


def test_same_robot_takes_one_slot_and_costs_the_sum() -> None:
    """Same robot takes one slot and costs the sum."""
    what = experiment(*(service(name, cost=10) for name in "abcd"), weights=CPU, same_robot=(("a", "b"), ("b", "c")))
    answer = assign(what, found(robot("r1", load1=2.0), robot("r2", load1=1.0)))
    assert answer.placed == {"a": "r2", "b": "r2", "c": "r2", "d": "r1"}
    assert answer.cost == pytest.approx(3 * 0.0390625 + 0.625)
    assert answer.runner_up["a"].cost == pytest.approx(3 * 0.625)


def test_a_group_needs_what_its_members_need() -> None:
    """A group needs what its members need."""
    what = experiment(service("a", tags=("arm",)), service("b", tags=("eye",)), same_robot=(("a", "b"),))
    where = found(robot("r1", tags=("arm",)), robot("r2", tags=("eye",)), robot("r3", tags=("arm", "eye")))
    answer = assign(what, where)
    assert answer.placed == {"a": "r3", "b": "r3"}
    assert answer.why_not["a"] == {
        "r1": "must run with 'b': needs tag 'eye' (has: arm)",
        "r2": "needs tag 'arm' (has: eye)",
    }


def test_a_pin_is_kept_whatever_it_costs() -> None:
    """A pin is kept whatever it costs."""
    answer = assign(experiment(service("a", robot="r1"), weights=CPU), found(*three_robots()))
    assert answer.placed == {"a": "r1"}


def test_sticky_services_stay_and_the_gain_of_moving_is_known() -> None:
    """Sticky services stay and the gain of moving is known."""
    what = experiment(service("a", cost=10), weights=CPU)
    answer = assign(what, found(*three_robots()), {"a": "r1"})
    assert answer.placed == {"a": "r1"}
    assert not answer.optimal
    assert answer.least == pytest.approx(0.0390625)
    assert answer.moves == ()
    assert "--reassign) would make it 0.039" in "\n".join(explain.describe(answer))


def test_reassign_moves_to_the_cheapest() -> None:
    """Reassign moves to the cheapest."""
    answer = assign(experiment(service("a"), weights=CPU), found(*three_robots()), {"a": "r1"}, reassign=True)
    assert answer.placed == {"a": "r2"}
    assert answer.moves == (Move(service="a", source="r1", target="r2"),)
    assert answer.optimal


def test_what_is_not_sticky_still_does_not_move_for_nothing() -> None:
    """What is not sticky still does not move for nothing."""
    what = experiment(service("a"), service("b"), placement=FREE)
    where = found(robot("r1"), robot("r2"), robot("r3"))
    for previous in ({"a": "r3", "b": "r1"}, {"a": "r2", "b": "r3"}):
        assert assign(what, where, previous).placed == previous


def test_a_running_service_moves_when_its_robot_can_no_longer_run_it() -> None:
    """A running service moves when its robot can no longer run it."""
    answer = assign(experiment(service("a", tags=("x",))), found(robot("r1"), robot("r2", tags=("x",))), {"a": "r1"})
    assert answer.moves == (Move(service="a", source="r1", target="r2"),)
    assert answer.optimal


def test_as_few_as_possible_move_for_a_service_that_needs_their_place() -> None:
    # New `c` can run only on r1; either a leaves for r3 (one move), or a and b change round (two).
    """As few as possible move for a service that needs their place."""
    what = experiment(service("a"), service("b"), service("c", robot="r1"), weights=CPU)
    where = found(robot("r1"), robot("r2"), robot("r3", load1=4.0))
    answer = assign(what, where, {"a": "r1", "b": "r2"})
    assert answer.placed == {"a": "r3", "b": "r2", "c": "r1"}


def test_no_saving_is_worth_a_move_not_even_of_several_services() -> None:
    """While `s` stays, both `n1` and `n3` cost the most there is; would it leave, neither would cost anything."""
    ways = {"s": "ae", "n1": "ab", "n2": "bc", "n3": "cd"}
    what = experiment(
        *(service(name, cost=0 if name in ("s", "n2") else 100, tags=("+".join(way),)) for name, way in ways.items()),
        weights=CPU,
    )
    robots = [
        robot(one, load1=4.0 if one in "bd" else 0.0, tags=tuple("+".join(way) for way in ways.values() if one in way))
        for one in "abcde"
    ]
    answer = assign(what, found(*robots), {"s": "a"})
    assert answer.placed == {"n1": "b", "n2": "c", "n3": "d", "s": "a"}
    assert (answer.cost, answer.least) == (200, 0)


def test_what_is_not_sticky_moves_whatever_it_takes_for_a_millionth() -> None:
    """Three services move for the smallest gain that counts."""
    what = experiment(
        service("a1", cost=5.0),
        service("a2", cost=5.0),
        service("b", cost=9.9),
        weights=CPU,
        placement=FREE,
        same_robot=(("a1", "a2"),),
    )
    # (0.225 / 4)^4 is 0.00001: on r1 the group costs 100 millionths, b costs 99
    where = found(robot("r1", load1=0.225), robot("r2"))
    answer = assign(what, where, {"a1": "r1", "a2": "r1", "b": "r2"})
    assert answer.placed == {"a1": "r2", "a2": "r2", "b": "r1"}


def test_when_slots_shrink_one_service_leaves() -> None:
    """When slots shrink one service leaves."""
    what = experiment(service("a", cost=90), service("b", cost=10), weights=CPU)
    where = found(robot("r1", load1=1.0), robot("r2", load1=3.0))
    answer = assign(what, where, {"a": "r1", "b": "r1"})
    assert answer.placed == {"a": "r1", "b": "r2"}


def test_a_new_group_meets_where_most_of_it_runs() -> None:
    """A new group meets where most of it runs."""
    what = experiment(*(service(name) for name in "abc"), same_robot=(("a", "b", "c"),), weights=CPU)
    where = found(robot("r1"), robot("r2", load1=4.0))
    assert assign(what, where, {"a": "r1", "b": "r2", "c": "r2"}).placed == {"a": "r2", "b": "r2", "c": "r2"}


def test_services_of_an_unreachable_robot_stay_and_are_not_counted() -> None:
    """Services of an unreachable robot stay and are not counted."""
    what = experiment(service("a"), service("b", cost=10), weights=CPU)
    where = found(robot("r1", load1=2.0), unreachable={"r2": "no route to host"})
    answer = assign(what, where, {"a": "r2"})
    assert answer.placed == {"a": "r2", "b": "r1"}
    assert answer.frozen == ("a",)
    assert answer.cost == pytest.approx(0.625)
    assert "a" not in answer.terms
    assert answer.matrix["b"] == {"r1": pytest.approx(0.625), "r2": None}
    assert answer.why_not["b"] == {"r2": "unreachable: no route to host"}
    assert explain.describe(answer)[0] == "a -> r2  stays: its robot cannot be reached"


def test_even_reassign_leaves_them_but_reassign_unreachable_does_not() -> None:
    """Even reassign leaves them but reassign unreachable does not."""
    what, where = experiment(service("a")), found(robot("r1"), unreachable={"r2": ""})
    assert assign(what, where, {"a": "r2"}, reassign=True).placed == {"a": "r2"}
    answer = assign(what, where, {"a": "r2"}, reassign_unreachable=True)
    assert answer.placed == {"a": "r1"}
    assert answer.moves == (Move(service="a", source="r2", target="r1"),)


def test_nothing_of_a_group_with_a_frozen_member_moves() -> None:
    """Nothing of a group with a frozen member moves."""
    what = experiment(*(service(name) for name in "abcd"), same_robot=(("a", "b", "c"),))
    where = found(robot("r1"), robot("r3"), unreachable={"r2": ""})
    answer = assign(what, where, {"a": "r2", "b": "r1"})
    assert answer.placed == {"a": "r2", "b": "r1", "c": "r2", "d": "r3"}
    assert answer.frozen == ("a", "b", "c")


def test_a_service_whose_robot_left_the_inventory_is_placed_anew() -> None:
    """A service whose robot left the inventory is placed anew."""
    answer = assign(experiment(service("a")), found(robot("r1")), {"a": "gone", "old": "r1"})
    assert answer.placed == {"a": "r1"}
    assert answer.moves == (Move(service="a", source="gone", target="r1"),)


def test_costs_that_differ_by_less_than_a_millionth_are_equal() -> None:
    """Costs that differ by less than a millionth are equal."""
    what = experiment(service("a", cost=1), weights=CPU, placement=FREE)
    where = found(robot("r1", load1=0.01), robot("r2", load1=0.0))
    assert assign(what, where, {"a": "r1"}).placed == {"a": "r1"}


def test_nothing_to_place() -> None:
    """Nothing to place."""
    answer = assign(experiment(), found(robot("r1")))
    assert answer.placed == {}
    assert answer.cost == 0
    assert answer.optimal


def test_a_hundred_slots_are_no_trouble() -> None:
    """A hundred slots are no trouble."""
    what = experiment(*(service(f"s{i:02}") for i in range(30)), placement=Placement(slots_per_robot=1_000_000))
    assert len(assign(what, found(robot("r1"))).placed) == 30
