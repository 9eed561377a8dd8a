"""Folders of pip's records that a robot did not read: each is a note."""

from __future__ import annotations

import pytest

from srprov.snapshot.notes import Notes
from srprov.snapshot.python import parse_installed

PLACE = "/home/a/.local/lib/python3.11/site-packages"


@pytest.mark.parametrize(
    ("status", "words"),
    [("48", "a link is in"), ("47", "cannot be closed off"), ("44", "cannot be read"), ("x", "be read")],
)
def test_a_folder_that_is_not_read_is_noted(status: str, words: str) -> None:
    notes = Notes()
    said = f"dist {PLACE}\0\0{status}\0dist {PLACE}/a-1.dist-info\0Name: a\nVersion: 1\n\0\0"
    assert [one.name for one in parse_installed(said, notes)] == ["a"]
    assert notes.all()[0].subject == f"pip packages in {PLACE}" and words in notes.all()[0].words
