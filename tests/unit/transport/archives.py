"""Archives of images as `docker save` writes them, and what `docker load` would find in one."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from collections.abc import Mapping, Sequence

Extra = Sequence[tuple[tarfile.TarInfo, bytes]]


def saved(images: Mapping[str, bytes], extra: Extra = (), tags: object = None) -> bytes:
    """Return an archive with an image of one layer per tag, then other files, and the list of images last."""
    target = io.BytesIO()
    entries = []
    with tarfile.open(fileobj=target, mode="w") as archive:
        for tag, layer in images.items():
            config = json.dumps({"of": tag}).encode()
            digest = hashlib.sha256(config).hexdigest()
            folder = hashlib.sha256(layer).hexdigest()
            for name, content in ((f"{digest}.json", config), (f"{folder}/layer.tar", layer)):
                _add(archive, tarfile.TarInfo(name), content)
            entries.append({"Config": f"{digest}.json", "RepoTags": tags or [tag], "Layers": [f"{folder}/layer.tar"]})
        for member, content in extra:
            _add(archive, member, content)
        _add(archive, tarfile.TarInfo("manifest.json"), json.dumps(entries).encode())
        _add(archive, tarfile.TarInfo("repositories"), b'{"evil": {"latest": "0"}}')
    return target.getvalue()


def image_id(tag: str) -> str:
    """Return the id of an image of `saved`."""
    return "sha256:" + hashlib.sha256(json.dumps({"of": tag}).encode()).hexdigest()


def loadable(archive: bytes) -> dict[str, bytes]:
    """Return tag -> layer, as an engine would load it."""
    with tarfile.open(fileobj=io.BytesIO(archive)) as read:
        names = read.getnames()
        assert "repositories" not in names and len(names) == len(set(names))
        found = {name: file.read() for name in names if (file := read.extractfile(name)) is not None}
    entries = json.loads(found["manifest.json"])
    return {tag: found[one["Layers"][0]] for one in entries for tag in one["RepoTags"]}


def _add(archive: tarfile.TarFile, member: tarfile.TarInfo, content: bytes) -> None:
    member.size = len(content)
    archive.addfile(member, io.BytesIO(content))
