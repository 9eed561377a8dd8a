"""What this machine remembers of a run is found by the run's own token alone."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.trial_images import ran, remember
from srprov.definitions import load_experiment
from tests.fakes import World
from tests.trial_folders import EDF, FILES, planned, write_experiment
from tests.worlds import inventory


def test_a_run_is_not_known_by_the_token_of_another_one(tmp_path: Path) -> None:
    """An archive may give it a second name; then a bundle of a stranger's run had images of the user's own."""
    token = 32 * "a"
    for folder in ("mine", "theirs"):
        (tmp_path / folder).mkdir()
    (tmp_path / "mine" / "token").write_text(f"{token}\n")
    assert ran(tmp_path / "mine").token == token
    os.link(tmp_path / "mine" / "token", tmp_path / "theirs" / "token")
    assert ran(tmp_path / "theirs").token == ""
    (tmp_path / "theirs" / "token").unlink()
    (tmp_path / "theirs" / "token").symlink_to(tmp_path / "mine" / "token")
    assert ran(tmp_path / "theirs").token == ""


def test_the_variables_that_a_run_was_given_are_remembered_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that a service takes, and those of secrets that one has; a bundle looks for the values of no others."""
    secrets = "secrets: {token: {env: TOKEN}, other: {env: OTHER}}\nservices:"
    text = EDF.replace("services:", secrets).replace(
        "env_file: referee.env", "environment: [PLAIN, A=b], secrets: [token]"
    )
    monkeypatch.setenv("PLAIN", "a value")
    world, edf = World().add("r1", "r2"), write_experiment(tmp_path / "race", FILES)
    plan = planned(world, edf)
    edf.write_text(text)
    plan = replace(plan, base=replace(plan.base, definitions=load_experiment(edf)))
    assert ran(tmp_path).variables() == frozenset()
    assert remember(tmp_path, plan, {}, {}, inventory(world)) == ""
    assert ran(tmp_path).variables() == {"PLAIN", "TOKEN"}
