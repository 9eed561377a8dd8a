"""A plan as Markdown: complete, and deaf to markup in names and causes."""

from __future__ import annotations

import re

from hypothesis import given
from msgspec.structs import replace

from srprov.planning.markdown import escaped, plan_markdown
from srprov.planning.plan import Plan, Step
from srprov.planning.policy import Permission
from srprov.resource import Action, Change, Difference
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
        chosen=True,
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
        "| 1 | r1 | `+` | volume a | not there |",
        "| 2 | r1 | `-` | volume b | destroy **data is lost** |",
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


def changed(host: str, *differences: Difference, number: int = 1, cause: str = "environment differs") -> Step:
    """Return a step that replaces a container."""
    change = Change(action=Action.REPLACE, cause=cause)
    name = "srprov.exp.talker"
    return Step(number=number, host=host, module="container", name=name, change=change, differences=differences)


def test_equal_steps_share_a_row_and_their_values() -> None:
    """Forty robots with the same change are one row and one block; one with another value has its own."""
    rate = Difference(field="environment.RATE", old="2", new="4")
    steps = [changed(f"r{number:02}", rate, number=number) for number in range(1, 41)]
    other = changed("r41", replace(rate, old=None), number=41)

    text = plan_markdown(Plan(instance="exp", source="here", steps=(*steps, other)))

    assert text.count("- environment.RATE: 2\n+ environment.RATE: 4\n") == 1
    assert text.count("+ environment.RATE: 4") == 2
    assert "| 1-40 | r01, r02, r03, r04, r05, r06, r07, r08, r09, r10, r11, r12 and 28 more | `±` |" in text
    assert "| 41 | r41 | `±` |" in text


def test_a_value_cannot_end_its_block() -> None:
    """A file of Markdown stands in a fence that is longer than all of its own."""
    text = plan_markdown(
        Plan(
            instance="e", source="s", steps=(changed("r1", Difference(field="content", diff=("+````", "+</details>"))),)
        )
    )

    block = text.split("`````")
    assert len(block) == 3
    assert block[1] == "diff\n! content:\n+````\n+</details>\n"


def test_a_comment_is_never_too_long() -> None:
    """Ten thousand different steps with values: below the limit, and what is missing is counted."""
    steps = tuple(
        changed(f"robot{n}", Difference(field="environment.X", old="a" * 300, new=str(n)), number=n, cause=f"c{n}" * 20)
        for n in range(1, 10_001)
    )
    notes = tuple(f"note {n}" * 10 for n in range(3000))

    for plan in (Plan(instance="e", source="s", steps=steps), Plan(instance="e", source="s", steps=steps, notes=notes)):
        text = plan_markdown(plan)
        assert len(text) < 60_000
        assert " more changed values: `srprov plan` shows them.*" in text
        assert text.count("<details>") == text.count("</details>") == 1
    assert "and 3000 more" not in text  # as many as fit are there


def test_plumbing_is_counted_unless_it_is_asked_for() -> None:
    """What srprov makes for itself is one line; with commands each has its row."""
    steps = tuple(
        Step(
            number=n, host=f"r{n}", module="vxlan", name="srpv1", change=Change(action=Action.CREATE, cause="not there")
        )
        for n in (1, 2)
    )
    plan = Plan(instance="exp", source="here", steps=steps)

    assert "On 2 robots, srprov's own vxlan: 2 to add" in plan_markdown(plan)
    assert "| 1, 2 | r1, r2 | `+` | vxlan srpv1 | not there |" in plan_markdown(plan, commands=True)


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
