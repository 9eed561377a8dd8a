"""The trials of a design: the same everywhere, and none moves when others are added."""

from __future__ import annotations

import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.trialsmodel import Parameter, TrialDefinitions, TrialSettings
from srprov.errors import UsageError
from srprov.trials import Design, design
from tests.bounded import bounded

PLANNERS, SPEEDS = Parameter(name="PLANNER", values=("dwb", "mppi")), Parameter(name="SPEED", values=("0.5", "1.0"))
RANDOM = TrialSettings(repetitions=3, order="random", seed=2026)


def values(made: Design) -> list[tuple[str, ...]]:
    return [tuple(point.values.values()) for point in made.points]


def make(*parameters: Parameter, settings: TrialSettings = RANDOM) -> Design:
    return design(TrialDefinitions(parameters=parameters, settings=settings))


def test_no_parameters_are_one_point() -> None:
    made = make(settings=TrialSettings(repetitions=2))
    assert [trial.id for trial in made.trials] == ["21b4c14ed7-r001", "21b4c14ed7-r002"]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (TrialSettings(), [("dwb", "0.5"), ("dwb", "1.0"), ("mppi", "0.5"), ("mppi", "1.0")]),
        (TrialSettings(design="zip"), [("dwb", "0.5"), ("mppi", "1.0")]),
        (TrialSettings(design="one-at-a-time"), [("dwb", "0.5"), ("mppi", "0.5"), ("dwb", "1.0")]),
        (TrialSettings(design="list", include=({"PLANNER": "x", "SPEED": "9"},)), [("x", "9")]),
        (TrialSettings(exclude=({"PLANNER": "mppi"},)), [("dwb", "0.5"), ("dwb", "1.0")]),
        (
            TrialSettings(design="zip", include=({"PLANNER": "dwb", "SPEED": "0.5"}, {"SPEED": "2.0", "PLANNER": "x"})),
            [("dwb", "0.5"), ("mppi", "1.0"), ("2.0", "x")],
        ),
    ],
)
def test_points_of_each_design(settings: TrialSettings, expected: list[tuple[str, ...]]) -> None:
    assert values(make(PLANNERS, SPEEDS, settings=settings)) == expected


def test_ids_seeds_and_order_are_those_of_any_other_program() -> None:
    """A shell with sha256sum and awk finds the same, from the docstring alone."""
    made = make(PLANNERS, SPEEDS)
    script = r"""
    hash() { printf '%s' "$1" | sha256sum | cut -c "1-$2"; }
    for rep in 1 2 3; do
        for planner in dwb mppi; do for speed in 0.5 1.0; do
            point=$(printf 'srprov-point/1\n{"PLANNER":"%s","SPEED":"%s"}' $planner $speed | sha256sum | cut -c 1-10)
            digits=$(hash "srprov-seed/1|2026|$point|$rep" 8)
            seed=$((0x$digits & 0x7fffffff))
            printf '%s %s-r%03d %d\n' "$(hash "srprov-order/1|2026|$rep|$point" 64)" "$point" "$rep" "$seed"
        done; done | sort | cut -d ' ' -f 2-
    done
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines() == [f"{trial.id} {trial.seed}" for trial in made.trials]


def test_order_is_mixed_within_each_repetition_and_differs_between_them() -> None:
    made = make(Parameter(name="A", values=tuple(map(str, range(20)))))
    blocks = [[trial.point.values["A"] for trial in made.trials[at : at + 20]] for at in (0, 20, 40)]
    assert all(sorted(block, key=int) == list(map(str, range(20))) for block in blocks)
    assert len({tuple(block) for block in blocks}) == 3


@given(
    st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=6, unique=True),
    st.text(min_size=1, max_size=8),
    st.integers(1, 4),
)
def test_a_further_value_or_repetition_changes_no_trial_that_is_there(some: list[str], more: str, count: int) -> None:
    settings = replace(RANDOM, repetitions=count)
    before = make(Parameter(name="A", values=tuple(some)), settings=settings)
    wider = Parameter(name="A", values=tuple(dict.fromkeys([*some, more])))
    after = make(wider, settings=replace(settings, repetitions=count + 2))
    known = {trial.id for trial in before.trials}
    assert [trial for trial in after.trials if trial.id in known] == list(before.trials)


@given(st.permutations(["A", "B", "C"]))
def test_the_order_of_parameters_in_the_file_changes_no_trial(names: list[str]) -> None:
    made = make(*(Parameter(name=name, values=("1", "2")) for name in names))
    usual = make(*(Parameter(name=name, values=("1", "2")) for name in "ABC"))
    assert [(one.id, one.seed) for one in made.trials] == [(one.id, one.seed) for one in usual.trials]


def test_paired_seeds_are_equal_within_a_repetition() -> None:
    made = make(PLANNERS, SPEEDS, settings=replace(RANDOM, paired_seeds=True))
    seeds = {repetition: {t.seed for t in made.trials if t.repetition == repetition} for repetition in (1, 2, 3)}
    assert all(len(some) == 1 for some in seeds.values())
    assert len(set.union(*seeds.values())) == 3


def test_too_many_trials_are_refused_before_they_are_made() -> None:
    many = [Parameter(name=f"P{n}", values=tuple(map(str, range(1000)))) for n in range(30)]
    with pytest.raises(UsageError, match="are more than 10000"):
        make(*many)


def test_no_trial_at_all_is_refused() -> None:
    with pytest.raises(UsageError, match="takes all points away"):
        make(PLANNERS, settings=TrialSettings(exclude=({"PLANNER": "dwb"}, {"PLANNER": "mppi"})))


CHOICES = st.dictionaries(st.sampled_from(["PLANNER", "SPEED"]), st.sampled_from(["dwb", "mppi", "0.5", "1.0", "x"]))


@given(st.lists(CHOICES, max_size=6))
def test_what_an_entry_of_exclude_is_part_of_is_left_out(exclude: list[dict[str, str]]) -> None:
    every = [{"PLANNER": planner, "SPEED": speed} for planner in PLANNERS.values for speed in SPEEDS.values]
    left = [tuple(one.values()) for one in every if not any(some.items() <= one.items() for some in exclude)]
    settings = TrialSettings(exclude=tuple(exclude))
    if left:
        assert values(make(PLANNERS, SPEEDS, settings=settings)) == left
    else:
        with pytest.raises(UsageError, match="takes all points away"):
            make(PLANNERS, SPEEDS, settings=settings)


def test_many_entries_of_exclude_are_no_work() -> None:
    parameters = [Parameter(name=f"P{n}", values=tuple(map(str, range(10)))) for n in range(4)]
    exclude = tuple({"P0": str(n % 9), "P1": str(n % 7), f"P{2 + n % 2}": str(n % 8)} for n in range(1000))
    made = bounded(lambda: make(*parameters, settings=TrialSettings(exclude=exclude)))
    assert 0 < len(made.points) < 10_000
