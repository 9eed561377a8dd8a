"""Profiles: which services a user wants this time, and what may name one that he does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller.source import read_definitions
from srprov.definitions import check_files, load_experiment
from srprov.definitions.model import Definitions
from srprov.definitions.profiles import chosen
from srprov.errors import DefinitionError, UsageError
from srprov.resource import Action
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service

EDF = """\
edf: 1
name: a
services:
  core: {image: x}
  sim: {image: x, profiles: [sim, debug], depends_on: [core]}
  view: {cdf: view.cdf, profiles: [debug], depends_on: {sim: {condition: started}}}
relations: {same_robot: [[core, sim, view]]}
pools: [{services: [core, sim, view]}]
results: {view: [/out], core: [/log]}
metrics: {frames: {service: view, json: /out/f.json#/n}}
"""


@pytest.fixture
def edf(tmp_path: Path) -> Path:
    (tmp_path / "view.cdf").write_text("cdf: 1\nbase: debian:bookworm\n")
    path = tmp_path / "e.edf"
    path.write_text(EDF)
    return path


def services(definitions: Definitions) -> list[str]:
    return sorted(definitions.experiment.services)


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ((), ["core"]),
        (("sim",), ["core", "sim"]),
        (("debug",), ["core", "sim", "view"]),
        (("sim", "debug"), ["core", "sim", "view"]),
        (("*",), ["core", "sim", "view"]),
    ],
)
def test_services_are_wanted_by_name_of_a_profile_and_those_without_always(
    edf: Path, wanted: tuple[str, ...], names: list[str]
) -> None:
    assert services(chosen(load_experiment(edf), wanted)) == names


def test_what_names_a_service_that_is_not_wanted_is_without_it(edf: Path) -> None:
    """Groups of one are none, and nothing is built or brought home for it; the plan says who is not wanted."""
    left = chosen(load_experiment(edf), ["sim"])
    experiment = left.experiment
    assert experiment.same_robot == (("core", "sim"),)
    assert [pool.services for pool in experiment.pools] == [("core", "sim")]
    assert experiment.trials is not None
    assert (list(experiment.trials.results), experiment.trials.metrics) == (["core"], ())
    assert left.containers == {}
    assert left.notes == ("not wanted, as their profiles are off: view (debug)",)


def test_a_profile_that_no_service_has_is_refused(edf: Path) -> None:
    """Compose would start nothing of it, in silence."""
    with pytest.raises(UsageError, match="no service has the profile 'debgu'") as refused:
        chosen(load_experiment(edf), ["debgu"])
    assert refused.value.hint == "did you mean 'debug'?"


@pytest.mark.parametrize(
    ("edf_text", "place"),
    [
        ("  b: {image: x, depends_on: [a]}\n", "5:30"),
        ("  b: {image: x, depends_on: {a: {condition: healthy}}}\n", "5:33"),
        ("  b: {image: x}\nnetwork: {discovery: zenoh, discovery_servers: [a]}\n", "6:49"),
        ("  b: {image: x}\nresults: {b: [/o]}\ntrials: {until: {any: [{completed: a}]}, timeout: 9s}\n", "7:17"),
    ],
)
def test_what_is_wanted_cannot_need_what_is_not(tmp_path: Path, edf_text: str, place: str) -> None:
    """As in Compose, and with the place: also of what trials end by, and of discovery servers."""
    path = tmp_path / "e.edf"
    health = "{test: [CMD, 'true']}"
    path.write_text(f"edf: 1\nname: a\nservices:\n  a: {{image: x, profiles: [p], healthcheck: {health}}}\n{edf_text}")
    (problem,) = check_files([path])
    assert str(problem.location).removeprefix(f"{path}:") == place
    assert problem.message == "'a' is not wanted: its profile p is off"
    assert problem.hint == "--profile p, or leave it out here"
    assert check_files([path], ["p"]) == []
    with pytest.raises(DefinitionError):
        read_definitions(str(path), ())


def test_an_experiment_of_which_nothing_is_wanted_is_refused(tmp_path: Path) -> None:
    """It would remove all that runs."""
    path = tmp_path / "e.edf"
    path.write_text("edf: 1\nname: a\nservices:\n  a: {image: x, profiles: [p]}\n")
    assert check_files([path]) == []
    with pytest.raises(UsageError, match="no service is wanted"):
        read_definitions(str(path), ())


def test_what_was_read_elsewhere_is_asked_for_also_where_the_profile_is_off(tmp_path: Path) -> None:
    """A record has it, and then a bundle. What would only be shipped goes nowhere."""
    (tmp_path / "e").mkdir()
    (tmp_path / "Dockerfile").write_text("FROM busybox\nENV TOKEN=mine\n")
    (tmp_path / "base.cdf").write_text("cdf: 1\nimage: busybox\n")
    services = "{a: {image: x}, b: {cdf: ../Dockerfile, profiles: [p]}, c: {cdf: ../base.cdf, profiles: [p]}}"
    path = tmp_path / "e/e.edf"
    path.write_text(f"edf: 1\nname: a\nservices: {services}\n")
    read = {("b", str(tmp_path / "Dockerfile")), ("c", str(tmp_path / "base.cdf"))}
    off = read_definitions(str(path), ("outside",)).experiment
    assert set(off.outside) == read
    assert {one for one in off.contents if not one.startswith(str(path.parent))} == {one for _, one in read}
    assert set(read_definitions(str(path), ("outside",), ("p",)).experiment.outside) == {*read, ("b", f"{tmp_path}/")}


def test_what_an_unwanted_service_takes_is_known_for_who_reads_the_edf_again(tmp_path: Path) -> None:
    """Without its variables a record of a run could not be read, and the run not be bundled."""
    path = tmp_path / "e.edf"
    path.write_text("edf: 1\nname: a\nservices: {a: {image: x}, b: {image: x, profiles: [p], environment: [TOKEN]}}\n")
    off = chosen(load_experiment(path, {"TOKEN": "mine"}), ()).experiment
    assert (off.environment, off.variables) == ((), ("TOKEN",))


def test_a_service_whose_profile_is_off_is_removed_where_it_runs() -> None:
    """It is a `-` step like that of any service that the EDF has no more, and nothing else changes."""
    world = World().add("r1")
    every = experiment(service("a"), service("b", profiles=("debug",)))
    apply(world, every)
    left = chosen(Definitions(experiment=every, containers={}), ()).experiment
    steps = [(one.module, one.name, one.change.action) for one in plan_for(world, left).steps]
    assert ("container", "srprov.hello.b", Action.DELETE) in steps
    assert not [name for kind, name, _ in steps if kind == "container" and name != "srprov.hello.b"]
    apply(world, left)
    assert not plan_for(world, left).steps
