"""Lines of steps: numbers as ranges, values that cannot be misread, plumbing in one line."""

from __future__ import annotations

import pytest
from hypothesis import given
from msgspec.structs import replace

from srprov.planning.plan import Plan, Step
from srprov.planning.steptext import difference_lines, numbers, value
from srprov.planning.text import plan_text
from srprov.resource import Action, Change, Difference
from tests.hostile import texts, unprintable


@pytest.mark.parametrize(
    ("found", "shown"),
    [([], ""), ([3], "#3"), ([4, 3], "#3, #4"), ([1, 2, 3, 7, 9, 10, 11], "#1-#3, #7, #9-#11")],
)
def test_numbers_are_ranges(found: list[int], shown: str) -> None:
    """Three and more in a row are one."""
    assert numbers(found) == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (None, "(not set)"), ("(not set)", '"(not set)"'), ("a b", "a b"), (" a", '" a"'), ("", '""'),
        ("1 -> 2", '"1 -> 2"'), ("a\nb", '"a\\nb"'), ("é", '"é"'), ("x" * 200, "x" * 159 + "…"),
    ],
)  # fmt: skip
def test_a_value_cannot_be_misread(text: str | None, shown: str) -> None:
    """What looks like something else is in quotes; what is long is cut."""
    assert value(text) == shown


@given(field=texts, old=texts, new=texts)
def test_no_value_writes_a_line_of_its_own(field: str, old: str, new: str) -> None:
    """Whatever a robot says: one line each, or one per line of a value, with a mark; and nothing unseen in it."""
    lines = list(difference_lines(Difference(field=field, old=old, new=new)))
    assert len(lines) == 1 or "\n" in old + new
    assert all(line.startswith(("  @@ ", "  +", "  -", "   ", "  \\ and ")) for line in lines[1:])
    assert len(list(difference_lines(Difference(field=field, diff=(old or "-", new or "+"))))) == 3
    assert unprintable("\n".join(lines)) == []


def test_a_script_in_a_command_is_compared_line_by_line() -> None:
    """One line has the same words on both sides; a value that was not there, or differs beyond its cut, has no diff."""
    old, new = "sh -c 'cd /a\nrun it\n'", "sh -c 'cd /b\nrun it\n'"
    assert list(difference_lines(Difference(field="command", old=old, new=new))) == [
        "command:", "  @@ -1,3 +1,3 @@", "  -sh -c 'cd /a", "  +sh -c 'cd /b", "   run it", "   '",
    ]  # fmt: skip
    assert list(difference_lines(Difference(field="command", old=None, new="a\nb"))) == [
        'command: (not set) -> "a\\nb"'
    ]
    assert len(list(difference_lines(Difference(field="command", old="a\nb", new="a\nb")))) == 1


def test_a_plan_says_what_it_knows() -> None:
    """An order has no source; what is out of reach was not looked at, so nothing is said of it."""
    plan = Plan(instance="hello", source="", steps=(), unchanged=1)
    assert plan_text(plan) == "Instance hello\n\nNothing to do: 1 resource is right already.\n"
    away = Plan(instance="hello", source="s", steps=(), unchanged=3, unreachable={"r2": "gone"})
    assert plan_text(away).endswith("\nNothing to do on the robots in reach: 3 resources are right already.\n")
    assert plan_text(replace(away, unchanged=0)).endswith("\nNothing to do on the robots in reach.\n")


def made(number: int, module: str, name: str, *, destructive: bool = False) -> Step:
    change = Change(action=Action.CREATE, cause="not there", destructive=destructive)
    return Step(number=number, host="r1", module=module, name=name, change=change)


def test_plumbing_is_one_line_of_its_robot_unless_commands_are_shown() -> None:
    """A file of a user's playbook is none; what destroys data is never folded."""
    steps = (
        made(1, "file", "/var/lib/srprov/e/hosts-web"), made(2, "file", "/var/lib/srprov/e/mine.conf"),
        made(3, "vxlan", "srpv1"), made(4, "vxlan", "srpv2", destructive=True),
    )  # fmt: skip
    plan = Plan(instance="e", source="s", steps=steps)

    lines = plan_text(plan).splitlines()
    assert "  + #1, #3 srprov's own file, vxlan: 2 to add" in lines
    assert "  + #2 file /var/lib/srprov/e/mine.conf: not there" in lines
    assert "  + #4 vxlan srpv2: not there  DATA IS LOST" in lines
    assert "  + #3 vxlan srpv1: not there" in plan_text(plan, commands=True).splitlines()
