"""The folder that `snapshot` fills is the one that it made, whatever others put in its place."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

import pytest

from srprov import private
from srprov.errors import SrprovError
from tests.unit.controller.test_snapshot import Robot, box, taken


def test_a_link_that_is_put_in_the_folder_s_place_meanwhile_leads_nothing_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may write to the folder above: files of the user's with the names of a snapshot's were replaced."""
    own, write_file = tmp_path / "own", private.write_file
    own.mkdir()
    (own / "experiment.edf").write_text("mine")

    def swapping(*given: Any) -> None:
        for one in tmp_path.glob(".out.*") if not (tmp_path / "moved").exists() else ():
            one.rename(tmp_path / "moved")
            one.symlink_to(own)
        write_file(*given)

    monkeypatch.setattr(private, "write_file", swapping)
    with contextlib.suppress(OSError, SrprovError):  # what is read of the other folder afterwards is no snapshot
        taken(tmp_path / "out", r1=Robot(boxes=[box(1, "a")]))
    assert os.listdir(own) == ["experiment.edf"] and (own / "experiment.edf").read_text() == "mine"
    assert (tmp_path / "moved" / "experiment.edf").exists()
