"""A run of trials and its bundle, made once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.evidence.make import bundle
from srprov.secret import forget
from tests.trial_folders import run_folder, write_experiment
from tests.unit.evidence.bundles import Content, unpacked


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run."""
    home = tmp_path_factory.mktemp("race")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        return run_folder(home / "run", write_experiment(home / "experiment"))


@pytest.fixture(scope="module")
def bundled(run: Path) -> Path:
    """Its bundle."""
    target = run.parent / "race.zip"
    bundle(run, target)
    return target


@pytest.fixture
def content(bundled: Path) -> Content:
    """What is in it."""
    return unpacked(bundled)


@pytest.fixture(autouse=True)
def _none_left(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another, nor writes into the user's folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    forget()
    yield
    forget()
