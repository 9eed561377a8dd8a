"""Whoever can write to an experiment's folder changes it after its definitions were read: none is read twice."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller import compose
from srprov.controller.compose_files import env_files
from srprov.controller.input_files import definition_files, reader_files
from srprov.definitions import load_experiment
from srprov.errors import DefinitionError
from srprov.yamldoc import loader

_DECOY = "DECOY=of-somebody-else\n"


@pytest.fixture(name="folder")
def an_experiment(tmp_path: Path) -> Path:
    folder, victim = tmp_path / "exp", tmp_path / "victim"
    (folder / "sub").mkdir(parents=True)
    victim.mkdir()
    (folder / "sub" / "own.env").write_text("OWN=1\n")
    (folder / "sub" / "base.cdf").write_text("cdf: 1\nname: base\nimage: busybox\n")
    (folder / "a.cdf").write_text("cdf: 1\nname: a\nextends: sub/base.cdf\n")
    (folder / "e.edf").write_text(
        "edf: 1\nname: swapped\nservices:\n  a: {cdf: a.cdf, network: none, env_file: sub/own.env}\n"
    )
    for name in ("own.env", "base.cdf", "e.lock", "LICENSE"):
        (victim / name).write_text(_DECOY)
    return folder


def _replaced(place: Path, target: Path) -> None:
    place.rename(place.with_name("moved"))
    place.symlink_to(target)


def _recorded(definitions: Any) -> dict[str, bytes]:
    planned: Any = SimpleNamespace(definitions=definitions, playbooks=())
    return {name: one.content for name, one in {**reader_files(planned), **definition_files(planned)}.items()}


@pytest.mark.parametrize("place", ["sub", ".", "sub/own.env", "sub/base.cdf"])
def test_a_record_has_the_definitions_that_were_read(folder: Path, place: str) -> None:
    """A folder of the experiment, or the experiment's own, became a link while the user was asked."""
    definitions = load_experiment(folder / "e.edf")
    before = _recorded(definitions)
    assert before["sub/own.env"] == b"OWN=1\n" and b"name: base" in before["sub/base.cdf"]
    victim = folder.parent / "victim"
    _replaced(folder / place, victim / os.path.basename(place) if "/" in place else victim)
    assert _recorded(definitions) == before


def test_an_export_has_the_variables_that_were_read(folder: Path) -> None:
    source = compose.read(str(folder / "e.edf"), frozenset())
    _replaced(folder / "sub", folder.parent / "victim")
    assert env_files(source.definitions, source.open) == {"a": {"OWN": "1"}}


def test_a_link_that_took_the_place_of_an_env_file_is_not_followed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is put there between the look at the path and the reading."""
    read = loader.read_text

    def swapping(path: Any, *rest: Any, **more: Any) -> str:
        if str(path).endswith("own.env"):
            _replaced(folder / "sub", folder.parent / "victim")
        return read(path, *rest, **more)

    monkeypatch.setattr(loader, "read_text", swapping)
    with pytest.raises(DefinitionError) as caught:
        load_experiment(folder / "e.edf")
    assert not any("DECOY" in one.message for one in caught.value.problems)
