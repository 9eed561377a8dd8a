"""What services keep apart, as few groups: the answer is the same, and what is too much is refused before a search."""

from __future__ import annotations

import time
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.assignment import apart, arrays, conflict, explain, ports, problem, solve, solve_arrays, solve_pools
from srprov.assignment.model import Problem
from srprov.codes import Code
from srprov.definitions.containermodel import Runtime
from srprov.definitions.model import Pool, Service
from srprov.errors import NoAssignment, UsageError
from tests.conftest import examples
from tests.unit.assignment.test_time import hard
from tests.unit.assignment.worlds import assign, experiment, found, robot, service

groups_of_six = st.lists(st.lists(st.integers(0, 5), min_size=2, unique=True).map(lambda one: tuple(sorted(one))))


def ranged(count: int, width: int, step: int = 1) -> dict[str, Service]:
    """Return services that publish so many ports each, every range a step further than the one before."""
    made = {}
    for number in range(count):
        first = 1024 + number * step
        runtime = Runtime(ports=tuple(("", port, port, "tcp") for port in range(first, first + width)))
        made[f"s{number:03}"] = service(f"s{number:03}", runtime=runtime)
    return made


def decided(services: dict[str, Service], robots: int, slots: int) -> Problem:
    names = [f"r{number}" for number in range(robots)]
    what = experiment(*services.values())
    return problem.build(what, {}, found(*map(robot, names)), {}, slots=dict.fromkeys(names, slots))


@given(groups_of_six)
def test_a_group_is_left_out_only_where_another_one_holds_it(given: list[tuple[int, ...]]) -> None:
    kept = apart.maximal(given)
    expected = [one for one in dict.fromkeys(given) if not any(set(one) < set(other) for other in given)]
    assert kept == expected


@given(groups_of_six)
def test_no_robot_can_take_more_at_once_than_is_said(groups: list[tuple[int, ...]]) -> None:
    most = max(
        bits.bit_count() for bits in range(64) if all(sum(bits >> one & 1 for one in group) <= 1 for group in groups)
    )
    assert most <= apart.at_once(6, groups) <= 6


@settings(max_examples=examples(60), deadline=None)
@given(
    groups_of_six,
    st.lists(st.sampled_from([0.0, 0.7, 1.5, 3.0]), min_size=1, max_size=4),
    st.lists(st.floats(1, 90), min_size=6, max_size=6),
    st.dictionaries(st.sampled_from("abcdef"), st.sampled_from(["r0", "r1"])),
    st.booleans(),
)
def test_slots_that_no_robot_can_use_change_no_answer(
    groups: list[tuple[int, ...]], loads: list[float], costs: list[float], before: dict[str, str], pooled: bool
) -> None:
    """With the same rows, and with all slots and all groups as they were given."""
    what = experiment(
        *(service(name, cost=cost) for name, cost in zip("abcdef", costs, strict=True)),
        different_robot=tuple(tuple("abcdef"[one] for one in group) for group in groups),
        pools=(Pool(name="p", services=("a", "b"), discount=0.5),) if pooled else (),
    )
    where = found(*(robot(f"r{number}", load1=load) for number, load in enumerate(loads)))
    asked = problem.build(what, {}, where, before, slots={f"r{number}": 6 for number in range(len(loads))})

    def answer() -> tuple[float, int] | None:
        if solve_arrays.decide(asked) is None:
            return None
        made = solve.solve(asked)
        return round(made.cost, 6), len(made.moves)

    few = answer()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "at_once", lambda nodes, _groups: nodes)
        patch.setattr(arrays, "maximal", tuple)
        assert answer() == few


def test_hundreds_of_ranges_that_overlap_are_one_group() -> None:
    """One for each port that a different set of services has would be 1978."""
    services = ranged(990, 1000)
    assert list(ports.exclusive(services)) == [tuple(services)]


def test_what_is_on_each_robot_anyway_is_in_no_group() -> None:
    """Its ports are held on its robot; a thousand robots would be a thousand members."""
    one = replace(ranged(1, 1)["s000"], per_robot=(), robot="r0")
    what = experiment(replace(one, name="a-r0"), replace(one, name="a-r1", robot="r1"))
    made = problem.build(what, {}, found(robot("r0"), robot("r1")), {})
    assert (made.anti_affinity, made.ports) == ((), {})


def test_a_robot_is_given_no_more_slots_than_it_can_use() -> None:
    """Of sixty services with twenty ports each, three can share a robot."""
    laid = arrays.arrays(decided(ranged(60, 20), robots=2, slots=60))
    assert len(laid.places) == 6
    assert arrays.arrays(decided(ranged(20, 20), robots=30, slots=20)).anti_affinity == (), "one slot each"


@pytest.mark.parametrize(
    ("count", "width", "said"), [(900, 300, "for ports that they have in common"), (400, 399, "both publish|publish")]
)
def test_what_is_too_much_is_refused_at_once(count: int, width: int, said: str) -> None:
    begin = time.process_time()
    with pytest.raises((UsageError, NoAssignment), match=said):
        solve.solve(decided(ranged(count, width), robots=2, slots=1000))
    assert time.process_time() - begin < 15


def test_groups_are_counted_for_every_robot_and_places_for_every_service(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = decided(ranged(60, 20), robots=30, slots=8)
    for limit in ("MOST_MEMBERS", "MOST_ON_ROBOTS", "MOST_PAIRS"):
        with monkeypatch.context() as patch, pytest.raises(UsageError) as refused:
            patch.setattr(apart, limit, 500)
            solve.solve(asked)
        assert refused.value.code is Code.TOO_HARD
        assert "make experiments of parts of it" in refused.value.hint


def test_a_search_whose_time_is_over_gives_the_solver_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first rows alone can take longer than there was time for all."""
    laid = arrays.arrays(hard(slots=60))
    monkeypatch.setattr(solve_pools.Growing, "add", None)
    assert solve_pools.solve_table(laid.table(laid.cost), 0.0) is None


def test_a_relaxation_that_is_not_solved_in_time_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float | None] = []

    def solved(_: object, seconds: float | None = None) -> None:
        given.append(seconds)

    monkeypatch.setattr(solve_pools.Growing, "solve", solved)
    laid = arrays.arrays(hard(slots=60))
    assert solve_pools.solve_table(laid.table(laid.cost), 3.0) is None
    assert len(given) == 1
    assert given[0] is not None
    assert 0 < given[0] <= 3


def test_why_there_is_no_placement_begins_no_flow_that_takes_longer_than_there_is_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(conflict, "_PAIRS_A_SECOND", 1)
    monkeypatch.setattr(conflict, "solve_table", None)
    with conflict.time_limit(60), pytest.raises(conflict.OutOfTimeError):
        conflict.feasible(hard(slots=60))


def _web(name: str, *published: int) -> Service:
    return service(name, runtime=Runtime(ports=tuple(("", port, 80, "tcp") for port in published)))


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ([_web("a", 8080, 8081), _web("b", 8080, 8081)], "publish 8080/tcp and 8081/tcp of 'a' and 'b' once at most"),
        ([_web("a", 1, 2), _web("b", 1, 2), _web("c", 1)], "publish 1/tcp and 2/tcp of 'a' and 'b' once at most"),
    ],
)
def test_a_remedy_names_every_port_that_they_have_in_common(given: Sequence[Service], hint: str) -> None:
    """What is told must help, also where one port's services are among another's."""
    slots = {"r1": 3} if len(given) == 2 else {"r1": 3, "r2": 3}
    pinned = [replace(one, robot="r1") if one.name != "c" else one for one in given]
    with pytest.raises(NoAssignment) as refused:
        assign(experiment(*pinned), found(*map(robot, slots)), slots=slots)
    assert hint in refused.value.hint


def test_of_ports_that_the_same_services_have_a_refusal_tells_one() -> None:
    with pytest.raises(NoAssignment) as refused:
        solve.solve(decided(ranged(12, 8), robots=2, slots=12))
    assert refused.value.message.count(" publish ") == 1


def test_remedies_end_with_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def late() -> None:
        raise conflict.OutOfTimeError

    monkeypatch.setattr(explain.remedies, "check_time", late)
    with pytest.raises(NoAssignment) as refused:
        assign(experiment(_web("a", 1), _web("b", 1)), found(robot("r1")), slots={"r1": 2})
    assert "once at most" not in refused.value.hint
