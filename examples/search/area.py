"""The area to be searched, and how a robot chooses where to go. Pure: no clock, no message, no chance of its own.

A square of SIZE by SIZE cells of a metre. A robot moves one cell a second, and sees the cells around its own.
"""

import random
from collections.abc import Iterable, Mapping

SIZE = 24
SIGHT = 1
"""A robot at x, y sees what is at most so many columns and rows away."""

Cell = tuple[int, int]
CELLS = frozenset((x, y) for x in range(SIZE) for y in range(SIZE))


def target(seed: int) -> Cell:
    """Return where the target is in a trial, by the trial's seed: nowhere where it is seen at the start."""
    at_once = {cell for robot in range(1, 5) for cell in seen_from(start(robot))}
    return random.Random(seed).choice(sorted(CELLS - at_once))  # noqa: S311 - the same in each trial with this seed


def start(robot: int) -> Cell:
    """Return where a robot begins: all in the middle, side by side. Robots are counted from 1."""
    return SIZE // 2 - 1 + (robot - 1) % 2, SIZE // 2 - 1 + (robot - 1) // 2 % 2


def seen_from(place: Cell) -> set[Cell]:
    """Return the cells that a robot sees from a place."""
    near = range(-SIGHT, SIGHT + 1)
    return {(place[0] + right, place[1] + down) for right in near for down in near} & CELLS


def distance(one: Cell, other: Cell) -> int:
    """Return the seconds from one cell to another."""
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def goal(me: int, places: Mapping[int, Cell], unseen: Iterable[Cell]) -> Cell | None:
    """Return the cell that a robot goes to: the nearest one that nobody has seen, of those that no other is nearer to.

    Args:
        me: The robot.
        places: Robot -> where it is, or is going to, as far as is known.
        unseen: Cells that nobody has seen, as far as is known.
    """
    left = sorted(unseen, key=lambda cell: (distance(places[me], cell), cell))
    mine = (cell for cell in left if me == min(places, key=lambda robot: (distance(places[robot], cell), robot)))
    return next(mine, left[0] if left else None)


def step(place: Cell, to: Cell) -> Cell:
    """Return the next cell on the way, along the longer side first."""
    right, down = to[0] - place[0], to[1] - place[1]
    if abs(right) >= abs(down):
        return place[0] + (right > 0) - (right < 0), place[1]
    return place[0], place[1] + (down > 0) - (down < 0)
