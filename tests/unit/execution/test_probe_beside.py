"""After which changes of a run the overlay is tried."""

from __future__ import annotations

import threading
from unittest import mock

import pytest

from srprov.controller.probe import probing_of
from srprov.definitions.model import Definitions
from srprov.execution import Outcome, RunResult
from srprov.execution.probe_beside import probing_beside
from srprov.modules import MODULES
from tests.fakes import World
from tests.worlds import apply, experiment, made, service

ALONE = experiment(service("a", robot="r1"), service("b", robot="r2"), service("host", robot="r1", network="host"))


@pytest.fixture(scope="module")
def fresh() -> RunResult:
    """Return a run that made everything."""
    return apply(World().add("r1", "r2"), ALONE)


def is_tried(result: RunResult, *kinds: str, name: str = "") -> bool:
    """Return whether the overlay is tried when only resources of some kinds, or with a name, were changed."""
    probing = probing_of(made(World().add("r1", "r2"), Definitions(experiment=ALONE, containers={})))
    some = [one for one in result.results if one.step.module in kinds and one.step.name.endswith(name)]
    assert some and {one.outcome for one in some} == {Outcome.CHANGED}
    with mock.patch("srprov.execution.probing.probe") as probe:
        with probing_beside(probing, some, {}, threading.Event(), lambda _event: None) as tried:
            pass
        tried()
    return probe.called


@pytest.mark.parametrize("kind", ["network", "vxlan", "vxlan_filter"])
def test_it_is_tried_after_a_part_of_it_was_changed(fresh: RunResult, kind: str) -> None:
    assert is_tried(fresh, kind)


def test_it_is_tried_after_a_container_on_it_was_changed(fresh: RunResult) -> None:
    """One on the robot's own network is nothing to it."""
    assert is_tried(fresh, "container", name=".a")
    assert not is_tried(fresh, "container", name=".host")


def test_files_and_images_are_no_part_of_it(fresh: RunResult) -> None:
    assert not is_tried(fresh, "file", "image")


def test_the_kinds_that_packets_meet() -> None:
    """Whatever is added is none, until its module says so."""
    overlay = {"network", "vxlan", "vxlan_filter", "wireguard", "wireguard_peers", "wireguard_routes"}
    assert {kind for kind, module in MODULES.items() if module.on_overlay} == {*overlay, "container"}
