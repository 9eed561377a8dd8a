"""Exports, judged by the real Docker Compose: it takes each, and reads out of it what the experiment says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from srprov.controller import compose
from srprov.definitions import load_experiment
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment
from srprov.exporting.folder import write as put
from srprov.exporting.model import Export
from tests import compose_oracle
from tests.compose_values import of_compose, of_service
from tests.property.edfs import experiments, write
from tests.real_compose import config

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(str(one.relative_to(ROOT)) for one in (ROOT / "examples").glob("*/*.edf"))


def exported(edf: Path, folder: Path) -> Export:
    """Write the twin of an experiment into a folder, with a secret where one is to be given."""
    made = compose.twin(compose.read(str(edf), frozenset({"host-path"})))
    put(str(folder), made.files)
    for need in made.needs:
        if need.kind == "file" and not (folder / need.name).exists():
            (folder / need.name).write_text("given")
    return made


def same_for_both(folder: Path) -> None:
    """Compare what Compose reads with what srprov's own reader of Compose files does."""
    theirs = compose_oracle.compose(folder, ["compose.yml"], profiles=["*"], project=None)
    mine, _ = compose_oracle.ours(folder, ["compose.yml"], profiles=["*"], project=None)
    assert (mine.refusal, theirs.refusal) == ("", "")
    assert compose_oracle.comparable(mine.document) == compose_oracle.comparable(theirs.document)


def differences(experiment: Experiment, found: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return `service.field` -> what is wanted and what Compose reads, but for names of services in hosts files."""
    ours = {
        name
        for one in experiment.services.values()
        for name in (one.name, one.instance_of, one.runtime.hostname)
    }  # fmt: skip
    assert set(found["services"]) == set(experiment.services)
    wrong = {}
    for name, service in experiment.services.items():
        want, got = of_service(service), of_compose(found["services"][name], str(folder))
        got["extra_hosts"] = {host for host in got["extra_hosts"] or () if host[0] not in ours} or None
        wrong |= {f"{name}.{key}": (want[key], got[key]) for key in want if want[key] != got[key]}
    return wrong


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_is_read_by_compose_as_it_is_meant(tmp_path: Path, example: str) -> None:
    exported(ROOT / example, tmp_path / "out")
    found, said = config(tmp_path / "out")
    assert said == ""
    same_for_both(tmp_path / "out")
    experiment = compose.read(str(ROOT / example), frozenset()).definitions.experiment  # at the first point
    wrong = differences(expand(experiment, {}), found, tmp_path / "out")
    # what discovery tells is no part of the EDF
    if experiment.network.discovery != "multicast":
        told = {field: pair for field, pair in wrong.items() if field.endswith((".environment", ".volumes"))}
        assert all(set((want or {}).items()) <= set(got.items()) for want, got in told.values())
        wrong = {field: pair for field, pair in wrong.items() if field not in told}
    assert wrong == {}


@settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=experiments())
def test_compose_reads_out_of_any_export_what_the_experiment_says(
    tmp_path_factory: pytest.TempPathFactory, document: dict[str, Any]
) -> None:
    read_by_compose(tmp_path_factory.mktemp("generated"), document)


@pytest.mark.soak
@settings(max_examples=500, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=experiments())
def test_compose_reads_out_of_many_exports_what_the_experiment_says(
    tmp_path_factory: pytest.TempPathFactory, document: dict[str, Any]
) -> None:
    read_by_compose(tmp_path_factory.mktemp("generated"), document)


def read_by_compose(folder: Path, document: dict[str, Any]) -> None:
    """Export an experiment, and compare what Compose reads with what the definitions say."""
    edf = write(folder / "in", document)
    exported(edf, folder / "out")
    found, _ = config(folder / "out", API_KEY="given")
    same_for_both(folder / "out")
    assert differences(expand(load_experiment(edf).experiment, {}), found, folder / "out") == {}
