"""A plan as Markdown: complete, and deaf to markup in names and causes."""

from __future__ import annotations

import re

from hypothesis import given

from srprov.planning.markdown import escaped, plan_markdown
from srprov.planning.plan import Plan, Step
from srprov.planning.policy import Permission
from srprov.resource import Action, Change
from tests.hostile import texts, unprintable


def step(number: int, name: str, cause: str, *, destructive: bool = False) -> Step:
    """Return a step without commands."""
    change = Change(action=Action.DELETE if destructive else Action.CREATE, cause=cause, destructive=destructive)
    return Step(number=number, host="r1", module="volume", name=name, change=change)


def test_every_step_permission_and_note_is_there() -> None:
    """What a reviewer must see stands in the text: counts, danger, permissions, steps with causes."""
    plan = Plan(
        instance="exp",
        source="here",
        steps=(step(1, "a", "not there"), step(2, "b", "destroy", destructive=True)),
        unchanged=3,
        assignment={"talker": "r1"},
        costs={"talker": 0.25},
        permissions=(Permission(kind="device", service="talker", what="/dev/video0 (rwm)"),),
        notes=("a note",),
        unreachable={"r9": "no route"},
    )

    text = plan_markdown(plan)

    for expected in (
        "**Plan: 1 to add, 1 to remove; 3 unchanged.**",
        "**1 steps destroy data.**",
        "asks for **device**: talker: /dev/video0 \\(rwm\\)",
        "- unreachable: r9: no route",
        "- a note",
        "| talker | r1 | 0.2500 |",
        "| 1 | r1 | `+` | volume a | not there |  |",
        "| 2 | r1 | `-` | volume b | destroy **data is lost** |  |",
    ):
        assert expected in text


def test_markup_in_names_stays_text() -> None:
    """A name can neither end a cell, nor begin a link, nor mention anybody, nor add a line."""
    hostile = "a|b\n[x](http://evil) <img> @all `c` **d**"

    shown = escaped(hostile)

    assert "\n" not in shown
    assert shown.replace("\\|", "").count("|") == 0
    assert all(f"\\{mark}" in shown for mark in "|[](<>@`*")


def test_an_empty_plan_says_so() -> None:
    """Nothing to do needs no table of steps."""
    text = plan_markdown(Plan(instance="exp", source="here", steps=(), unchanged=5))

    assert "Nothing to do: 5 resources are right already." in text
    assert "<details>" not in text


@given(name=texts, cause=texts, robot=texts)
def test_no_word_breaks_out(name: str, cause: str, robot: str) -> None:
    """Whatever stands in names, causes and reasons: the same lines and cells, no HTML, no markup, nothing unseen."""

    def lines(one: str, two: str, three: str) -> list[str]:
        plan = Plan(
            instance=one, source="here", steps=(step(1, one, two),), assignment={one: three}, notes=(two,),
            unreachable={three: two}, permissions=(Permission(kind="device", service=one, what=two),),
        )  # fmt: skip
        return plan_markdown(plan).split("\n")

    plain, hostile = lines("a", "b", "c"), lines(name, cause, robot)
    bare = [re.sub(r"\\[\\`*_{}\[\]()<>#+\-!|~@&$^]", "", line) for line in hostile]
    assert len(hostile) == len(plain)
    assert [line.count("|") for line in bare] == [line.count("|") for line in plain]
    for mark in "<>`*#[]&$":
        assert sum(line.count(mark) for line in bare) == sum(line.count(mark) for line in plain), mark
    assert unprintable("\n".join(hostile)) == []
