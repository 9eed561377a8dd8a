"""What one robot saves is written anew before another loads it: one image, one tag, nothing beside it."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from collections.abc import Collection, Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.transport.image_archive import ForeignImage, only
from tests.unit.transport.archives import image_id, loadable, saved

WANTED = {"srprov/x:1": b"layer" * 1000}
GOOD = b'{"of": "what was built"}'


def pieces(data: bytes, size: int) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def passed(data: bytes, image: str = "srprov/x:1", size: int = 700, known: Collection[str] = ()) -> bytes:
    return b"".join(only(pieces(data, size), image, known))


@given(st.integers(1, 9000))
def test_an_image_comes_through_in_any_pieces(size: int) -> None:
    assert loadable(passed(saved(WANTED), size=size)) == WANTED


def test_further_tags_and_images_stay_behind() -> None:
    more = {**WANTED, "busybox:latest": b"evil"}
    assert loadable(passed(saved(more))) == WANTED
    assert loadable(passed(saved(WANTED, tags=["busybox:latest", "srprov/x:1"]))) == WANTED


def test_an_image_of_another_id_is_refused() -> None:
    """Before its list is given, without which an engine loads nothing."""
    assert loadable(passed(saved(WANTED), known=[image_id("srprov/x:1")])) == WANTED
    given: list[bytes] = []
    with pytest.raises(ForeignImage, match="another image under srprov/x:1"):
        given += only(pieces(saved(WANTED), 700), "srprov/x:1", [image_id("other")])
    assert b"RepoTags" not in b"".join(given)


def test_a_digest_in_a_label_of_the_image_that_was_built_makes_no_other_image_it() -> None:
    """Whoever writes the definition can put it there; root on a robot that has the image then gives the other one."""
    evil = image_id("srprov/x:1")
    honest = json.dumps({"config": {"Labels": {"base": evil}}, "rootfs": {}}).encode()
    known = "sha256:" + hashlib.sha256(honest).hexdigest()
    with pytest.raises(ForeignImage, match="another image under srprov/x:1"):
        passed(saved(WANTED, [(sized("honest.json", honest), honest)]), known=[known])
    manifest = json.dumps({"config": {"digest": evil}}).encode()
    leads = "sha256:" + hashlib.sha256(manifest).hexdigest()
    assert passed(saved(WANTED, [(sized("blobs/m", manifest), manifest)]), known=[leads])


def test_a_configuration_that_is_a_link_is_that_of_no_id() -> None:
    """It was compared as if it was empty."""
    listed = json.dumps([{"Config": "c", "RepoTags": ["srprov/x:1"], "Layers": []}]).encode()
    naming = json.dumps({"config": {"digest": "sha256:" + hashlib.sha256(b"").hexdigest()}}).encode()
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w") as archive:
        for name, content in (("real", b"{}"), ("m", naming), ("manifest.json", listed)):
            archive.addfile(sized(name, content), io.BytesIO(content))
        archive.addfile(member("c", tarfile.SYMTYPE, "real"))
    with pytest.raises(ForeignImage, match="another image"):
        passed(made.getvalue(), known=["sha256:" + hashlib.sha256(naming).hexdigest()])


def sized(name: str, content: bytes) -> tarfile.TarInfo:
    found = member(name)
    found.size = len(content)
    return found


def member(name: str, kind: bytes = tarfile.REGTYPE, link: str = "") -> tarfile.TarInfo:
    found = tarfile.TarInfo(name)
    found.type, found.linkname = kind, link
    return found


@pytest.mark.parametrize(
    "odd",
    [
        member("../../etc/passwd"), member("/etc/passwd"), member("a", tarfile.SYMTYPE, "../../etc"),
        member("a", tarfile.SYMTYPE, "/etc/passwd"), member("a", tarfile.SYMTYPE, "manifest.json"),
        member("./manifest.json", tarfile.SYMTYPE, "b"), member("a", tarfile.LNKTYPE, "b"),
        member("a", tarfile.CHRTYPE), member("a", tarfile.FIFOTYPE),
    ],
    ids=lambda one: f"{one.name} {one.type!r} {one.linkname}",
)  # fmt: skip
def test_what_no_engine_writes_is_refused(odd: tarfile.TarInfo) -> None:
    with pytest.raises(ForeignImage):
        passed(saved(WANTED, [(odd, b"")]))


def test_a_layer_that_is_a_link_to_another_comes_through() -> None:
    """Docker writes a layer that comes twice as a link."""
    link = member("b/layer.tar", tarfile.SYMTYPE, "../a/layer.tar")
    assert loadable(passed(saved(WANTED, [(member("a/layer.tar"), b"x"), (link, b"")]))) == WANTED


@pytest.mark.parametrize(
    "order",
    [
        (("b", "a"), ("a/c.json", GOOD), ("b/c.json", b"evil")),
        (("a/c.json", GOOD), ("b/c.json", b"evil"), ("a", "b")),
        (("a/c.json", GOOD), ("b/c.json", b"evil"), ("a", b"")),
        (("a", b""), ("a/c.json", GOOD)),
        ((".", "a"), ("a/c.json", GOOD)),
        (("a/" * 20 + "x", b""), ("a/c.json", GOOD)),
        # where the first one leads, the way back ends above the archive
        (("d/e/f", "../.."), ("a/l", "../d/e/f/../../../../../x"), ("a/c.json", GOOD)),
        (("a/l", "../d/e/f/x"), ("d/e/f", "../.."), ("a/c.json", GOOD)),
        (("d/e/f", "../.."), ("a/l", "../d/e/f/x"), ("a/c.json", GOOD)),
        (("a/l", "./.x/./../x"), ("a/c.json", GOOD)),
    ],
    ids=[
        "below a link",
        "a link comes later",
        "a file comes later",
        "below a file",
        "all is a link",
        "too deep",
        "back from a link",
        "through a later link",
        "through a link",
        "back from a name",
    ],
)
def test_no_file_is_read_under_another_name_than_it_was_compared_under(
    order: Sequence[tuple[str, str | bytes]],
) -> None:
    """An engine that unpacks it would follow a link to a configuration that nobody compared with the id."""
    listed = json.dumps([{"Config": "a/c.json", "RepoTags": ["srprov/x:1"], "Layers": ["l/layer.tar"]}]).encode()
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w") as archive:
        for name, what in (*order, ("l/layer.tar", b"layer"), ("manifest.json", listed)):
            one = member(name, tarfile.SYMTYPE if isinstance(what, str) else tarfile.REGTYPE)
            one.linkname, one.size = (what, 0) if isinstance(what, str) else ("", len(what))
            archive.addfile(one, io.BytesIO(b"" if isinstance(what, str) else what))
    with pytest.raises(ForeignImage):
        passed(made.getvalue(), known=[f"sha256:{hashlib.sha256(GOOD).hexdigest()}"])


@pytest.mark.parametrize("data", [b"", b"x" * 2000, saved(WANTED)[:3000], saved({"other:1": b"x"}), b"\0" * 4096])
def test_what_is_no_archive_of_the_image_is_refused(data: bytes) -> None:
    with pytest.raises(ForeignImage):
        passed(data)


@given(st.binary(max_size=2000), st.integers(0, 2000))
def test_whatever_comes_is_passed_on_or_refused(noise: bytes, at: int) -> None:
    whole = saved(WANTED)
    try:
        passed(whole[:at] + noise + whole[at + len(noise) :])
    except ForeignImage:
        return


def test_an_id_that_is_a_manifest_s_leads_to_its_image() -> None:
    """Docker's newer store names an image by its manifest, or by an index of manifests."""
    manifest = json.dumps({"config": {"digest": image_id("srprov/x:1")}}).encode()
    index = json.dumps({"manifests": [{"digest": f"sha256:{hashlib.sha256(manifest).hexdigest()}"}]}).encode()
    blobs = [(member(f"blobs/sha256/{hashlib.sha256(one).hexdigest()}"), one) for one in (manifest, index)]
    for one in (manifest, index):
        known = [f"sha256:{hashlib.sha256(one).hexdigest()}"]
        assert loadable(passed(saved(WANTED, blobs), known=known)) == WANTED
        with pytest.raises(ForeignImage):
            passed(saved(WANTED), known=known)
