"""An experiment at one point of its parameters, and with every instance of its services."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.trial_instances import with_instances
from srprov.controller.trial_run import chosen
from srprov.controller.trial_sameness import differences
from srprov.controller.trial_values import at_first_point, design_notes, size_note
from srprov.definitions import load_experiment
from srprov.definitions.expand import expand
from srprov.definitions.model import Definitions
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import UsageError
from srprov.trials import design

EDF = """\
edf: 1
name: race
services:
  racer: {image: x, replicas: 2, environment: {OWN: 1}}
  referee: {image: x}
  camera: {image: x}
parameters: {SPEED: {values: [0.5, 1.0], apply_to: [racer]}, CODE: [3, 4]}
trials:
  repetitions: 2
  seed: 1
  timeout: 20s
  keep: camera
  until: {all: [{completed: racer}, {log: {service: racer, matches: x}}]}
  stop: {first: [racer]}
"""


@pytest.fixture
def definitions(tmp_path: Path) -> Definitions:
    (tmp_path / "race.edf").write_text(EDF)
    return load_experiment(tmp_path / "race.edf", {})


def test_apply_brings_up_the_first_point(definitions: Definitions) -> None:
    """A service gets the parameters that are for it; one that is kept gets none."""
    services = at_first_point(definitions).experiment.services
    assert {name: dict(one.runtime.environment) for name, one in services.items()} == {
        "racer": {"OWN": "1", "SPEED": "0.5", "CODE": "3"},
        "referee": {"CODE": "3"},
        "camera": {},
    }


def test_a_plan_says_how_many_trials_there_are_and_how_long_they_may_take(definitions: Definitions) -> None:
    assert design_notes(definitions.experiment.trials) == (
        "4 points x 2 repetitions = 8 trials, in random order (seed 1), at most 12 min 0 s; `srprov run` runs them; "
        "here with SPEED=0.5, CODE=3",
    )
    assert design_notes(None) == ()
    assert definitions.experiment.trials and size_note(definitions.experiment.trials) == ""


def test_who_runs_an_edf_without_trials_is_told_how_long_it_takes() -> None:
    """Its services may never end, and then it takes as long as it may."""
    assert size_note(TrialDefinitions()) == "1 point x 1 repetition = 1 trial, as listed, at most 11 min 10 s"


def test_conditions_name_every_instance_of_a_service(definitions: Definitions) -> None:
    experiment = expand(definitions.experiment, {})
    settings = with_instances(experiment).settings
    assert settings.until is not None
    assert [one.services for one in settings.until.items] == [("racer-1", "racer-2")] * 2
    assert (settings.stop_first, settings.keep) == (("racer-1", "racer-2"), ("camera",))


def test_a_metric_of_several_services_is_refused(tmp_path: Path) -> None:
    (tmp_path / "race.edf").write_text(EDF + "metrics: {goal: {service: racer, log: '(1)'}}\n")
    experiment = expand(load_experiment(tmp_path / "race.edf", {}).experiment, {})
    with pytest.raises(UsageError, match="is of 'racer', of which there are 2"):
        with_instances(experiment)


def test_a_part_of_a_design_is_chosen_by_trial_or_point(definitions: Definitions) -> None:
    assert definitions.experiment.trials is not None
    made = design(definitions.experiment.trials)
    point = made.points[1].id
    assert [one.id for one in chosen(made, [point]).trials] == [f"{point}-r001", f"{point}-r002"]
    assert [one.id for one in chosen(made, [f"{point}-r002"]).trials] == [f"{point}-r002"]
    with pytest.raises(UsageError, match="there is no trial or point 'nix'"):
        chosen(made, ["nix"])


def test_each_difference_is_named_with_both_values() -> None:
    before, now = {"a": "1", "b": "2", "c": "3"}, {"a": "1", "b": "4", "d": "5"}
    assert list(differences(before, now)) == ["b: 2 -> 4", "c: 3 -> nothing", "d: nothing -> 5"]


def test_without_parameters_apply_changes_nothing(definitions: Definitions) -> None:
    plain = replace(definitions, experiment=replace(definitions.experiment, trials=None))
    assert at_first_point(plain) is plain
