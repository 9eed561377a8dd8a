"""Bundles as dictionaries, to change them and write them again, with hashes made anew or not."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from srprov.evidence import descriptions, files, stored_zip, story
from srprov.evidence.files import ABOUT, MANIFEST, Archive
from srprov.evidence.verified import Bundle
from srprov.record.tables import Tables

Content = dict[str, bytes]


def unpacked(path: Path) -> Content:
    """Return name -> content."""
    with path.open("rb") as stream:
        return {one.name: b"".join(stored_zip.content(stream, one)) for one in stored_zip.read(stream)}


def packed(content: Mapping[str, bytes], target: Path) -> Path:
    """Write files as a bundle."""
    with target.open("w+b") as stream:
        writer = stored_zip.Writer(stream)
        for name, data in content.items():
            writer.add(name, len(data), [data])
        writer.finish()
    return target


def as_it_is(path: Path) -> Bundle:
    """Return a bundle as one that was verified, whatever is in it."""
    every = unpacked(path)
    return Bundle(str(path), {name: hashlib.sha256(every[name]).hexdigest() for name in every
                              if not name.startswith(MANIFEST)})  # fmt: skip


def archive(content: Mapping[str, bytes]) -> Archive:
    """Return files as a bundle in memory."""
    stream = io.BytesIO()
    writer = stored_zip.Writer(stream)
    for name, data in content.items():
        writer.add(name, len(data), [data])
    return files.archive(stream, writer.entries)


def with_manifest(content: Mapping[str, bytes]) -> Content:
    """Return files with a manifest that fits them."""
    rest = {name: data for name, data in content.items() if not name.startswith(MANIFEST)}
    lines = [f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(rest.items())]
    return {**rest, MANIFEST: "".join(lines).encode()}


def forged(content: Mapping[str, bytes], *, tables: bool = True) -> Content:
    """Return files as a careful forger leaves them: tables, papers, crate and manifest follow from the others."""
    kept = {name: data for name, data in content.items() if name not in (*descriptions.GENERATED, MANIFEST)}
    try:
        with story.read(archive(kept)) as told:
            if tables:
                texts = Tables(Path(), told.given, told.services, told.rows).texts()
                kept |= {name: text.encode() for name, text in texts.items()}
            hashes = {name: (len(data), hashlib.sha256(data).hexdigest()) for name, data in kept.items()}
            for name, data in descriptions.written(descriptions.told_of(archive(kept), told, hashes)):
                kept[name] = data
                hashes[name] = (len(data), hashlib.sha256(data).hexdigest())
    except ValueError:  # what was changed can't be read any more: the old ones stay
        kept |= {name: content[name] for name in descriptions.GENERATED}
    return with_manifest(kept)


def events(content: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Return the journal."""
    return [json.loads(line) for line in content["journal.jsonl"].splitlines()]


def journal(found: list[dict[str, Any]]) -> bytes:
    """Return it as it is written."""
    return b"".join(json.dumps(one).encode() + b"\n" for one in found)


__all__ = [
    "ABOUT", "Content", "archive", "as_it_is", "events", "forged", "journal", "packed", "unpacked", "with_manifest",
]  # fmt: skip
