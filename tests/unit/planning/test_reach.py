"""What needs what is followed in bounded time, whatever a plan file says."""

from __future__ import annotations

import pytest

from srprov.errors import PlanError
from srprov.modules.image import ImageParams
from srprov.planning.diff import diff
from srprov.resource import Need, Observed, Resource
from tests.bounded import within


def image(name: str, *needs: str) -> Resource:
    """Return an image that is pulled on `r`."""
    every = tuple(Need(f"r/image:{one}") for one in needs)
    return Resource(host="r", module="image", name=name, params=ImageParams(source="pull"), written={}, needs=every)


def test_many_that_need_one_that_needs_many_are_refused_in_time() -> None:
    hub = image("hub:1", *(f"n{one}" for one in range(40_000)))
    wants = [hub, *(image(f"a{one}:1", "hub:1") for one in range(4_000))]
    there = Observed(module="image", name="hub:1", instance="", state={})
    with within(8), pytest.raises(PlanError, match="need each other in too many ways"):
        diff(wants, {"r": [there]}, "x")


def test_as_many_as_an_experiment_has_are_followed_through_what_is_right() -> None:
    wants = [image("deep:1"), image("hub:1", "deep:1"), *(image(f"a{one}:1", "hub:1") for one in range(1_000))]
    there = Observed(module="image", name="hub:1", instance="", state={})
    steps, unchanged = diff(wants, {"r": [there]}, "x")
    assert (len(steps), unchanged) == (1_001, 1)
    first = next(one.number for one in steps if one.name == "deep:1")
    assert all(one.needs == (first,) for one in steps if one.number != first)
