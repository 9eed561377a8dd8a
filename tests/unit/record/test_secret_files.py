"""Files of secrets are known for good: no list of others makes srprov forget one that is there."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov import secret_files
from srprov.errors import UsageError
from srprov.record.memory import note_secret_files


def test_none_that_is_there_is_forgotten_for_others(tmp_path: Path) -> None:
    """An EDF names a thousand, and its next version a thousand others, and so on."""
    own = tmp_path / "token"
    own.touch()
    note_secret_files([str(own)])
    for version in range(4):
        note_secret_files([f"/nowhere/{version}/{number}" for number in range(1000)])
    known = secret_files.known()
    assert str(own) in known and "/nowhere/3/999" in known
    assert len(known) == 2001  # of those that are gone only the newest


def test_a_list_that_is_full_stays_as_it_is(tmp_path: Path) -> None:
    """Long names would make a list that is too large to be read, and so none at all."""
    own = tmp_path / "token"
    own.touch()
    note_secret_files([str(own)])
    with pytest.raises(UsageError, match="too many files"):
        note_secret_files([f"/nowhere/{number}/{'e' * 4000}" for number in range(1100)])
    assert secret_files.known() == {str(own)}


def test_a_name_that_is_no_text_stays_what_it_is(tmp_path: Path) -> None:
    """A folder in the project has such a name, and a link to it a plain one."""
    name = f"{tmp_path}/\udcff/token"
    note_secret_files([name])
    note_secret_files([f"{tmp_path}/other"])
    assert secret_files.known() == {name, f"{tmp_path}/other"}


def test_a_name_that_no_file_can_have_takes_no_place() -> None:
    """A few of them filled the list, and no experiment's secrets were read any more."""
    note_secret_files([f"/{'e' * 900_000}/{number}" for number in range(20)])
    assert secret_files.known() == frozenset()


def test_a_list_that_cannot_be_written_is_an_error_and_no_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing would keep the next version of an EDF from mounting the file."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file/below"))
    with pytest.raises(UsageError, match="which files are secrets' cannot be kept") as refused:
        note_secret_files([str(tmp_path / "token")])
    assert "XDG_STATE_HOME" in refused.value.hint
