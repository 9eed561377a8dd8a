"""What this machine remembers of a run is found by the run's own token alone."""

from __future__ import annotations

import os
from pathlib import Path

from srprov.controller.trial_images import ran


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
