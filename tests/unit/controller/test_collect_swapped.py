"""What `collect` brings comes into the folder that it looked at, whatever others put in its place."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from srprov.controller import collection
from tests.unit.controller.test_collect_folder import PAIR, pair
from tests.worlds import fleet


def test_a_link_that_is_put_in_the_folder_s_place_meanwhile_leads_nothing_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may write to the folder above: the user's own `facts.json` elsewhere was replaced."""
    own, every = tmp_path / "own", collection._all
    own.mkdir()
    (own / "facts.json").write_text("mine")

    def swapping(*given: Any) -> Any:
        (tmp_path / "home").rename(tmp_path / "moved")
        (tmp_path / "home").symlink_to(own)
        return every(*given)

    monkeypatch.setattr(collection, "_all", swapping)
    source = f"lab@desk:{PAIR.file}"
    collection.collect(fleet(pair()), PAIR, "hello", tmp_path / "home", lambda _said: None, source=source)
    assert os.listdir(own) == ["facts.json"] and (own / "facts.json").read_text() == "mine"
    assert {"facts.json", "collected.json", "logs"} <= set(os.listdir(tmp_path / "moved"))
