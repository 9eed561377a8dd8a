"""The combinations of values that parameters take, by their `design` and without what `exclude` takes away. Pure.

What `include` adds is not among them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping

from srprov.definitions.trialsmodel import Parameter, TrialDefinitions

MOST_TRIALS = 10_000


def most_points(given: TrialDefinitions) -> int:
    """Return how many points there may be at most, those of `include` too, without making them."""
    count = len(given.settings.include)
    if given.settings.design == "product":
        product = 1
        for one in given.parameters:
            product *= len(one.values)
        return count + product
    return count + sum(len(one.values) for one in given.parameters)


def combinations(given: TrialDefinitions) -> list[dict[str, str]]:
    """Return the values of each point, parameters in the order of the file."""
    names = [one.name for one in given.parameters]
    excluded = _excluded(given)
    every = (dict(zip(names, values, strict=True)) for values in _combined(given))
    return [values for values in every if not excluded(values)]


def _excluded(given: TrialDefinitions) -> Callable[[Mapping[str, str]], bool]:
    """Return what tells whether a point has all values of some entry of `exclude`, in one step for each parameter.

    An entry is a bit; a parameter's value has the bits of all entries that it does not speak against.
    """
    names = {one.name for one in given.parameters}
    entries = [one for one in given.settings.exclude if one.keys() <= names]
    every = (1 << len(entries)) - 1
    others = dict.fromkeys(names, every)
    agree: dict[tuple[str, str], int] = {}
    for index, entry in enumerate(entries):
        for name, value in entry.items():
            others[name] &= ~(1 << index)
            agree[name, value] = agree.get((name, value), 0) | 1 << index

    def excluded(values: Mapping[str, str]) -> bool:
        left = every
        for name, value in values.items():
            left &= others[name] | agree.get((name, value), 0)
        return bool(left)

    return excluded


def _combined(given: TrialDefinitions) -> Iterable[tuple[str, ...]]:
    """Return the values of each point, in the order of the parameters."""
    values = [one.values for one in given.parameters]
    kind = given.settings.design
    if kind == "list":
        return ()
    if kind == "zip":
        return zip(*values, strict=True) if values else [()]
    return itertools.product(*values) if kind == "product" else _one_at_a_time(given.parameters)


def _one_at_a_time(parameters: tuple[Parameter, ...]) -> list[tuple[str, ...]]:
    """Return the first value of each, and then the others one at a time."""
    base = tuple(one.values[0] for one in parameters)
    return [
        base,
        *((*base[:at], value, *base[at + 1 :]) for at, one in enumerate(parameters) for value in one.values[1:]),
    ]
