"""After which changes of a run the overlay is tried."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any
from unittest import mock

import pytest

from srprov.controller.probe import probing_of
from srprov.definitions.model import Definitions
from srprov.execution import Outcome, RunResult, StepResult
from srprov.execution.probe_beside import bringing_ahead, probing_beside
from srprov.execution.probing import Brought
from srprov.modules import MODULES
from srprov.planning.plan import Step
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
        with probing_beside(probing, some, {}, threading.Event(), lambda _event: None, None) as tried:
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


def brought_for(steps: Sequence[Step], stop: threading.Event, results: Sequence[StepResult]) -> tuple[mock.Mock, ...]:
    """Return what was called of `bring` and `probe` in a run of some steps."""
    probing = probing_of(made(World().add("r1", "r2"), Definitions(experiment=ALONE, containers={})))
    sessions: Any = {"r1": mock.Mock(), "r2": mock.Mock(), "other": mock.Mock()}
    there = Brought(magic="0a1b2c3d", robots=frozenset({"r1", "r2"}))
    names = ("bring", "probe")
    with ExitStack() as stack:
        called = [stack.enter_context(mock.patch(f"srprov.execution.probing.{name}")) for name in names]
        called[0].return_value = there
        with bringing_ahead(probing, steps, sessions) as brought:
            pass
        with probing_beside(probing, results, sessions, stop, lambda _event: None, brought):
            pass
    if called[0].called:
        assert set(called[0].call_args.args[1]) == {"r1", "r2"}, "not to robots that are not changed"
    return tuple(called)


def test_the_program_is_brought_while_the_overlay_is_made(fresh: RunResult) -> None:
    """It is not run when that fails, or after an interrupt."""
    steps = [one.step for one in fresh.results]
    bring, probe = brought_for(steps, threading.Event(), fresh.results)
    assert probe.call_args.args[2] == bring.return_value

    failed = [StepResult(step=one, outcome=Outcome.FAILED) for one in steps]
    stop = threading.Event()
    stop.set()
    for happened, results in ((threading.Event(), failed), (stop, fresh.results)):
        bring, probe = brought_for(steps, happened, results)
        assert bring.called and not probe.called


def test_no_program_is_brought_for_steps_that_packets_do_not_meet(fresh: RunResult) -> None:
    files = [one for one in fresh.results if one.step.module == "file"]
    assert files
    called = brought_for([one.step for one in files], threading.Event(), files)
    assert not any(one.called for one in called)


def test_the_kinds_that_packets_meet() -> None:
    """Whatever is added is none, until its module says so."""
    overlay = {"network", "vxlan", "vxlan_filter", "wireguard", "wireguard_peers", "wireguard_routes"}
    assert {kind for kind, module in MODULES.items() if module.on_overlay} == {*overlay, "container"}
