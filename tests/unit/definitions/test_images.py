"""Image references of user files: what is wrong with one, and a suggestion that is right."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.definitions.images import fault, hint
from srprov.image_reference import parse_reference

PIECES = st.lists(
    st.sampled_from(
        ["ros", "Ros", ":", "/", "@", "sha256:", "0" * 64, "$", "{", "humble", ".", "_", "-", "5000", " ", "é"]
    )
)


@given(PIECES.map("".join) | st.text())
def test_whatever_is_written_there_is_a_reference_or_has_a_hint(text: str) -> None:
    if not fault(text):
        parse_reference(text)
        return
    words = hint(text)
    assert words
    if suggested := re.fullmatch(r"did you mean '(.*)'\?", words, re.DOTALL):
        parse_reference(suggested[1])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Registry.example:5000/Team/App:V1", "did you mean 'registry.example:5000/team/app:V1'?"),
        ("busybox@sha256:12", "leave the digest out, or write all of it: `docker image inspect busybox` shows it"),
        ("ros:{{ distro }}", "no variables are substituted here: write the name out"),
        ("my image", "for example ros:humble, or registry.example:5000/team/image:1.2"),
    ],
)
def test_the_hint_is_what_to_write_instead(text: str, words: str) -> None:
    assert fault(text)
    assert hint(text) == words


def test_a_very_long_name_is_cut_in_the_message() -> None:
    assert len(fault("A" * 100_000)) < 200
