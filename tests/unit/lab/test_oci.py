"""Images as the mirror's registry stores them: one name for several architectures."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from srprov.lab.oci import Image, Storage, architecture

TOP = Path("docker/registry/v2")


def image(folder: Path, content: bytes, arch: str = "") -> Image:
    layer = folder / f"{content.decode()}.tar"
    layer.write_bytes(content)
    return Image("library/box", "latest", [layer], ["sh"], architecture=arch)


def blob(folder: Path, digest: str) -> Any:
    """Give a document by its digest, which must be its hash."""
    content = (folder / TOP / "blobs/sha256" / digest[:2] / digest / "data").read_bytes()
    assert hashlib.sha256(content).hexdigest() == digest
    return json.loads(content)


def links(folder: Path, place: str) -> set[str]:
    found = (folder / TOP / "repositories/library/box/_manifests" / place).rglob("link")
    return {one.read_text(encoding="utf-8").removeprefix("sha256:") for one in found}


def test_one_image_is_what_its_tag_leads_to(tmp_path: Path) -> None:
    digest = Storage(tmp_path).add(image(tmp_path, b"one"))
    assert links(tmp_path, "tags/latest") == links(tmp_path, "revisions") == {digest}
    config = blob(tmp_path, blob(tmp_path, digest)["config"]["digest"].removeprefix("sha256:"))
    assert config["architecture"] == architecture()


def test_the_tag_of_several_leads_to_a_list_and_each_can_be_had_by_its_digest(tmp_path: Path) -> None:
    digest = Storage(tmp_path).add(image(tmp_path, b"one"), image(tmp_path, b"two", "arm64"))
    listed = blob(tmp_path, digest)["manifests"]
    assert [one["platform"] for one in listed] == [
        {"architecture": arch, "os": "linux"} for arch in (architecture(), "arm64")
    ]
    digests = [one["digest"].removeprefix("sha256:") for one in listed]
    assert links(tmp_path, "tags/latest") == {digest} and links(tmp_path, "revisions") == {digest, *digests}
    for one, name in zip(listed, (architecture(), "arm64"), strict=True):
        manifest = blob(tmp_path, one["digest"].removeprefix("sha256:"))
        assert one["size"] == len(json.dumps(manifest, indent=3))
        assert blob(tmp_path, manifest["config"]["digest"].removeprefix("sha256:"))["architecture"] == name
