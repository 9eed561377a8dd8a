"""Values of secrets in bytes, gigabytes of them."""

from __future__ import annotations

import base64
import random
from collections.abc import Iterator

import pytest

from srprov.redaction_bytes import search
from srprov.secret import Secret, forget, holds

NOISE = random.Random(1).randbytes(200_000)


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    forget()
    yield
    forget()


@pytest.mark.parametrize(
    "value", ["plain words", "a\\Eb\\Qc.*[x", "gr\u00fc\u00dfe aus", "\udcff\udcfe raw", "x" * 5000]
)
def test_a_value_is_found_in_whatever_stands_around_it(value: str) -> None:
    assert not holds(NOISE)
    Secret(value)
    raw = value.encode("utf-8", "surrogateescape")
    for form in (raw, base64.b64encode(raw), raw.hex().encode()):
        assert holds(NOISE + form + NOISE), form
    assert not holds(NOISE)


def test_very_many_texts_are_all_found() -> None:
    texts = [f"line {number} of a key" for number in range(3000)]
    found = search(texts)
    assert not found(NOISE)
    for one in (texts[0], texts[1234], texts[-1]):
        assert found(NOISE + one.encode() + NOISE)
    assert not search([])(NOISE)
