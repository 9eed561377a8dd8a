"""Serial numbers become tokens: the same ones for one user, others for another, and never a reason to run nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller.hardware_tokens import tokens
from srprov.facts.model import HostFacts

MACHINE = "0f1e2d3c4b5a69788796a5b4c3d2e1f0"
FACTS = {"r1": HostFacts(name="r1", arch="amd64", machine_id=MACHINE, serials=("046d:0825 B1DA",))}


def test_a_machine_has_one_token_for_one_user_and_another_for_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "ada"))
    first = tokens(FACTS)
    assert set(first) == {MACHINE, "B1DA"} and first == tokens(FACTS)
    assert (tmp_path / "ada/srprov/hardware.key").stat().st_mode & 0o777 == 0o600
    assert all(word not in token for word in first for token in first.values())
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "eve"))
    assert not set(tokens(FACTS).values()) & set(first.values())


def test_a_machine_without_serial_numbers_needs_no_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert tokens({"r1": HostFacts(name="r1", arch="amd64")}) == {}
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["a folder in its place", "no folder can be made", "nothing in it"])
def test_a_key_that_cannot_be_kept_or_is_none_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """An empty key would make tokens that can be guessed."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    home = tmp_path / "state" / "srprov"
    if kind == "no folder can be made":
        (tmp_path / "state").write_text("a file")
    else:
        home.mkdir(parents=True)
    if kind == "a folder in its place":
        (home / "hardware.key").mkdir()
    if kind == "nothing in it":
        (home / "hardware.key").write_text("\n")
    assert set(tokens(FACTS)) == {MACHINE, "B1DA"}
    if kind == "nothing in it":
        assert len((home / "hardware.key").read_text().strip()) == 64
