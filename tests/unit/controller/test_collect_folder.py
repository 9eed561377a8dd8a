"""The folder of a collect: one srprov at a time, and a clear end when nothing can be written there."""

from __future__ import annotations

import errno
import os
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.cli import inputs
from srprov.cli.collect import collect
from srprov.controller import collection
from srprov.controller.trial_folder import alone
from srprov.errors import UsageError


def test_a_second_srprov_in_a_folder_is_refused_until_the_first_has_ended(tmp_path: Path) -> None:
    with alone(tmp_path), pytest.raises(UsageError, match="another srprov works in"), alone(tmp_path):
        raise AssertionError("both work in it")
    with alone(tmp_path):
        assert not list(tmp_path.iterdir())


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_given: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "home/logs/robot1.web.log")

    monkeypatch.setattr(collection, "collect", full)
    monkeypatch.setattr(inputs, "load_inventory", lambda _paths: None)
    monkeypatch.setattr(inputs, "load_experiment", lambda _path: SimpleNamespace(experiment=None))
    monkeypatch.setattr(inputs, "named_instance", lambda *_given: ("hand", "hand.edf"))
    monkeypatch.setattr(inputs, "connect", lambda *_given: nullcontext())
    given = {"file": "hand.edf", "inventories": (), "as_json": False, "forks": 1, "timeout": 1.0, "instance": ""}
    run: Any = collect.callback
    with pytest.raises(UsageError, match=r"home/logs/robot1\.web\.log: No space left on device") as refused:
        run(**given, target=tmp_path / "home")
    assert refused.value.exit_code == 5 and "collect again" in refused.value.hint
