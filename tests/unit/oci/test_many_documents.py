"""Layouts whose small documents are looked at again and again: for each image, and for each id that an engine gave."""

from __future__ import annotations

import json

import pytest

from srprov.oci.layout import PackedLayer, Stored, blob, documents, sha256
from srprov.oci.layout_read import Source, read
from tests.bounded import bounded

LAYER = PackedLayer(f"sha256:{'1' * 64}", f"sha256:{'2' * 64}", 5)


def config(number: int, blanks: int = 0) -> bytes:
    about = {"architecture": "amd64", "os": "linux", "number": number, "rootfs": {"diff_ids": [LAYER.diff_id]}}
    return json.dumps(about).encode() + b" " * blanks


def image(about: bytes, *leading: bytes, times: int = 1) -> Stored:
    """Return an image that an engine knows by its first document, or by its configuration."""
    first = sha256(leading[0] if leading else about)
    return Stored(
        id=sha256(about), engine_ids=(first,) * times, names=("x:1",), config=about, layers=(LAYER,),
        documents=tuple(sorted(leading, key=sha256)), architecture="amd64",
    )  # fmt: skip


def source(*images: Stored) -> Source:
    content = {**documents(images), blob(LAYER.digest): b"layer"}
    return Source({name: len(data) for name, data in content.items()}, content.__getitem__)


def answer(made: Source) -> str:
    """Return why a layout is none, or nothing."""
    try:
        read(made)
    except ValueError as error:
        return str(error)
    return ""


def test_an_image_is_found_by_what_leads_to_it() -> None:
    one = config(1)
    manifest = json.dumps({"config": sha256(one)}).encode()
    index = json.dumps({"manifests": [sha256(b"another"), sha256(manifest)]}).encode()
    made = image(one, index, manifest, times=2)
    assert read(source(made)) == (made,)


@pytest.mark.parametrize("size", [50_000, 2_000])
def test_many_digests_on_the_way_to_many_images(size: int) -> None:
    """The last one leads on; each is looked up for each image, as often as its engine's id is said."""
    every = [config(number) for number in range(100)]
    last = "".join(map(sha256, every)).encode()
    first = "".join([*(f"sha256:{number:064x}" for number in range(size)), sha256(last)]).encode()
    made = source(*(image(one, first, last, times=8) for one in every))
    assert bounded(lambda: answer(made)).startswith("nothing leads from the id")


def test_documents_that_lead_to_each_other(size: int = 1000) -> None:
    """None of them is long, and all of them have to be looked through for each of hundreds of images."""
    every = [config(number) for number in range(150)]
    chain = ["".join(map(sha256, every)).encode()]
    for number in range(14):
        fill = "".join(f"sha256:{number:032x}{at:032x}" for at in range(size - 1))
        chain.append((sha256(chain[-1]) + fill).encode())
    made = source(*(image(one, *reversed(chain)) for one in every))
    assert "too many documents" in bounded(lambda: answer(made))


def test_documents_have_a_most_together() -> None:
    """They are held in memory."""
    made = source(*(image(config(number, blanks=3 << 20)) for number in range(25)))
    assert bounded(lambda: answer(made)) == "its documents have more than 64 MiB"
