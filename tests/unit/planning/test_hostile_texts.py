"""Texts of a plan file that are shown, or become an engine's words, do neither harm."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.errors import UsageError
from srprov.modules.container_body import _version
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.planning.text import plan_text

PLAN = Plan(instance="x", source="s", steps=(), unchanged=3, unreachable={})


def test_why_a_robot_is_out_of_reach_writes_no_lines_of_its_own() -> None:
    why = "no route\n\nrobot4\n  + #99 file /x: not there\n\nPlan: 1 to add; 12 unchanged."
    lines = plan_text(replace(PLAN, unreachable={"robot9": why})).splitlines()
    assert [line for line in lines if "robot9" in line or "#99" in line or "robot4" in line] == [
        "unreachable: robot9: no route",
        "  hint: robot4 + #99 file /x: not there Plan: 1 to add; 12 unchanged.",
    ]
    assert not any(line.startswith(("Plan:", "  +", "robot")) for line in lines)


def test_only_a_robot_can_be_out_of_reach() -> None:
    saved = PlanFile(plan=PLAN, fingerprints={}, also_wanted=(), contexts={}, limit=(), inputs={}, made_by="1")
    assert load(dump(saved), "plan.json") == saved
    forged = replace(saved, plan=replace(PLAN, unreachable={"r1\n  + #1 x": "away"}))
    with pytest.raises(UsageError, match="cannot be the name of a robot"):
        load(dump(forged), "plan.json")


@pytest.mark.parametrize(("said", "means"), [("1.44", (1, 44)), ("²", (0,)), ("1.²", (1, 0)), ("", (0,))])
def test_any_text_is_a_version(said: str, means: tuple[int, ...]) -> None:
    assert _version(said) == means
