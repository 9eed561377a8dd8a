"""Cutting a plan into batches: one table."""

from __future__ import annotations

import random

import pytest

from srprov.execution.batches import Order, cut
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Need

CREATE = Change(action=Action.CREATE, cause="not there")


def steps(text: str) -> list[Step]:
    """Read `1:a 2:b<1 3:b~` as steps: number, robot, what it needs, and `~` where it waits for a condition."""
    made = []
    for word in text.split():
        head, _, needs = word.partition("<")
        number, _, host = head.partition(":")
        waits = (Need("x/container:y", "healthy"),) if host.endswith("~") else ()
        made.append(
            Step(
                number=int(number),
                host=host.rstrip("~"),
                module="volume",
                name=number,
                change=CREATE,
                needs=tuple(int(one) for one in needs.split(",") if one),
                waits=waits,
            )
        )
    return made


def shown(text: str) -> list[str]:
    """Return batches as `robot: steps < batches`."""
    return [
        f"{part.host}: {' '.join(str(s.number) for s in part.steps)}"
        + (f" < {' '.join(map(str, sorted(part.needs)))}" if part.needs else "")
        for part in cut(steps(text))
    ]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", []),
        ("1:a", ["a: 1"]),
        ("1:a 2:a<1 3:a<2", ["a: 1 2 3"]),
        ("1:a 2:b", ["a: 1", "b: 2"]),
        ("1:a 2:b 3:a 4:b", ["a: 1 3", "b: 2 4"]),
        ("1:a 2:b<1", ["a: 1", "b: 2 < 0"]),
        ("1:a 2:a 3:b<1", ["a: 1", "a: 2 < 0", "b: 3 < 0"]),
        ("1:a 2:a 3:b<2 4:a", ["a: 1 2", "b: 3 < 0", "a: 4 < 0"]),
        ("1:a 2:b 3:b<1 4:b", ["a: 1", "b: 2", "b: 3 4 < 0 1"]),
        ("1:a 2:a~ 3:a", ["a: 1", "a: 2 3 < 0"]),
        ("1:a~ 2:a~", ["a: 1", "a: 2 < 0"]),
        ("1:a 2:b<1 3:a<2", ["a: 1", "b: 2 < 0", "a: 3 < 0 1"]),
    ],
)
def test_batches(text: str, parts: list[str]) -> None:
    """A batch ends behind a step that another robot needs and before one that needs another robot or waits."""
    assert shown(text) == parts


def test_any_plan_can_be_walked() -> None:
    """Batches of any plan hold every step once, keep each robot's order, and need only what stands before them."""
    dice = random.Random(1)
    for _ in range(300):
        count = dice.randint(1, 14)
        text = " ".join(
            f"{n}:{dice.choice('abc')}{dice.choice(['', '', '~'])}<"
            + ",".join(str(m) for m in range(1, n) if dice.random() < 0.2)
            for n in range(1, count + 1)
        )
        made, parts = steps(text), cut(steps(text))
        home = {step.number: part.index for part in parts for step in part.steps}
        assert sorted(home) == list(range(1, count + 1))
        for part in parts:
            assert all(need < part.index for need in part.needs), text
            for step in part.steps:
                assert step.host == part.host
                assert all(home[n] == part.index or home[n] in part.needs for n in step.needs), text
        for host in "abc":
            walked = [s.number for part in parts for s in part.steps if part.host == host]
            assert walked == [s.number for s in made if s.host == host]


def test_each_batch_begins_once_when_the_last_that_it_needs_has_ended() -> None:
    """Whatever the order in which those end."""
    batches = cut(steps("1:a 2:b<1 3:c<1 4:d<2,3 5:e"))
    for seed in range(20):
        order, choose = Order(batches), random.Random(seed)
        begun, running = list(order.first), list(order.first)
        over: set[int] = set()
        while running:
            over.add(one := running.pop(choose.randrange(len(running))))
            ready = order.ended(one)
            assert all(batches[index].needs <= over for index in ready)
            begun += ready
            running += ready
        assert sorted(begun) == [batch.index for batch in batches]
