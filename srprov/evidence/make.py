"""The folder of a run of trials -> a bundle: one archive with all of it, redacted, described, hashed, and signed.

Takes the folder, the secrets that are known, and who signs; writes one file, or none. Equal folders give equal bytes,
whoever makes them and when.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from srprov.codes import Code
from srprov.definitions.repository_names import WHY, repository_among
from srprov.errors import RefusedError, UsageError
from srprov.evidence import descriptions, make_images, secrets, stored_zip, story
from srprov.evidence.files import ABOUT, MANIFEST, SIGNATURE, Files, Folder, archive, json_of, of_run, sessions
from srprov.evidence.images import SBOMS
from srprov.evidence.private_words import Replacer, Words, collect
from srprov.evidence.public_words import PublicWords
from srprov.evidence.redacted import HARDWARE, is_as_it_came, redacted
from srprov.record.runs import trials_run
from srprov.untrusted import mapping, mappings, string

FORMAT = 1
_SPOOLED = 1 << 20
_MOST_SHOWN = 10
Sign = Callable[[bytes], bytes]


class Made(msgspec.Struct, frozen=True, kw_only=True):
    """What a bundle came to."""

    files: int
    size: int
    signed: bool
    images: int = 0
    """How many images it holds."""


def bundle(
    folder: Path, target: Path, *, sign: Sign | None = None, no_secret: Collection[str] = (),
    images: make_images.Wish | None = None,
) -> Made:  # fmt: skip
    """Write the bundle of a run.

    Args:
        folder: The run's.
        target: The file; what is there is replaced.
        sign: Gives the signature of the manifest.
        no_secret: Names of files that a person looked at: what looks like a secret in them is none.
        images: Which images it is to hold; None: none.

    Raises:
        UsageError: The folder holds no run that has ended, or the target lies in it; or an image is nowhere.
        RefusedError: A secret is in it.
        OSError: Something cannot be read or written.
    """
    _check(folder, target)
    files = of_run(folder)
    try:
        if made_here := repository_among(sorted({*files.sizes, *_shipped(files)})):
            hint = "run it without that among what the EDF ships: an image may have it, or a file of another name"
            why = f"it has {made_here[:200]}: {WHY}"
            raise UsageError(f"{folder} cannot be bundled: {why}", hint=hint, code=Code.RECORD)
        for name in files.sizes:
            stored_zip.Names().add(name)
        there = make_images.found(images, files, target.absolute().parent)
        with tempfile.NamedTemporaryFile(dir=target.absolute().parent, prefix=".srprov-", delete=False) as stream:
            try:
                made = _Making(files, stored_zip.Writer(stream), no_secret, there).all(sign)  # type: ignore[arg-type]  # its type is a wrapper's
                stream.flush()
                os.replace(stream.name, target)
            except BaseException:
                os.unlink(stream.name)
                raise
    except ValueError as error:
        raise UsageError(
            f"{folder} cannot be bundled: {error}", hint="run it with this srprov", code=Code.RECORD
        ) from error
    return made


def _shipped(files: Files) -> Iterator[str]:
    """Yield where a replay would need each file of the experiment; a record has what makes a repository elsewhere."""
    for home in sessions(files):
        for one in mappings(json_of(files, f"{home}/inputs.json").get("files"), most=stored_zip.MOST_ENTRIES):
            yield f"{home}/inputs/{string(one.get('path'))}"


def _check(folder: Path, target: Path) -> None:
    if trials_run(folder, whole=False).killed:
        hint = "wait for it, or end it properly: srprov run --resume"
        raise UsageError(f"{folder}: the run is under way, or was killed", hint=hint, code=Code.LOCKED)
    if Path(os.path.realpath(folder)) in Path(os.path.realpath(target)).parents:
        raise UsageError(
            f"{target} lies in the run's folder: it would hold itself",
            hint="name another file with -o",
            code=Code.OPTIONS,
        )


@dataclass(slots=True)
class _Making:
    """A bundle that is being made."""

    files: Folder
    writer: stored_zip.Writer
    no_secret: Collection[str]
    images: make_images.Found
    hashes: dict[str, tuple[int, str]] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)

    def all(self, sign: Sign | None) -> Made:
        """Write all files, then what describes them, then their manifest.

        Raises:
            RefusedError: Something looks like a secret; all that does is named.
        """
        words = _words(self.files)
        replacer = Replacer(words)
        for name in self.files.sizes:
            if not name.endswith(f"/{HARDWARE}") or is_as_it_came(name):
                self._copy(name, replacer)
        self._refuse_secrets()
        self._add_images()
        counts = {"replaced": replacer.count, "words": dict(sorted(words.kinds.items()))}
        about = {"redaction": counts, "images": self.images.about}
        for name, content in _described(self._written(), self.hashes, about):
            self._add(name, content)
        self._refuse_secrets()
        manifest = "".join(f"{self.hashes[name][1]}  {name}\n" for name in sorted(self.hashes)).encode()
        self.writer.add(MANIFEST, len(manifest), [manifest])
        if sign is not None:
            signature = sign(manifest)
            self.writer.add(SIGNATURE, len(signature), [signature])
        self.writer.finish()
        return Made(
            files=len(self.writer.entries), size=self.writer.stream.tell(), signed=sign is not None,
            images=sum(name.startswith(SBOMS) for name in self.hashes),
        )  # fmt: skip

    def _add_images(self) -> None:
        packing = make_images.Packing(self._add_blob, self.images)
        for name, content in packing.all().items():
            self._add(name, content)
        self.bad += [f"{name}: {why}" for name, why in packing.secret.items() if name not in self.no_secret]
        self._refuse_secrets()

    def _add_blob(self, name: str, size: int, sha256: str, pieces: Iterable[bytes]) -> None:
        self.writer.add(name, size, pieces)
        self.hashes[name] = (size, sha256)

    def _written(self) -> Files:
        return archive(self.writer.stream, self.writer.entries)

    def _copy(self, name: str, replacer: Replacer) -> None:
        if is_as_it_came(name):
            self._stream(name, self.files.sizes[name], self.files)
            return
        with tempfile.SpooledTemporaryFile(_SPOOLED) as spool:
            for piece in redacted(self.files, name, replacer):
                spool.write(piece)
            size = spool.tell()
            self._stream(name, size, _One(spool, name, size))  # type: ignore[arg-type]  # a spool is a stream

    def _add(self, name: str, content: bytes) -> None:
        with tempfile.SpooledTemporaryFile(len(content) + 1) as spool:
            spool.write(content)
            self._stream(name, len(content), _One(spool, name, len(content)))  # type: ignore[arg-type]  # as above

    def _stream(self, name: str, size: int, source: Files) -> None:
        if name not in self.no_secret and (why := secrets.found(source.pieces(name))):
            self.bad.append(f"{name}: {why}")
        made = hashlib.sha256()

        def hashed() -> Iterator[bytes]:
            for piece in source.pieces(name):
                made.update(piece)
                yield piece

        self.writer.add(name, size, hashed())
        self.hashes[name] = (size, made.hexdigest())

    def _refuse_secrets(self) -> None:
        if self.bad:
            more = [f"and {len(self.bad) - _MOST_SHOWN} more"] * (len(self.bad) > _MOST_SHOWN)
            lines = "\n".join(f"  {one}" for one in (*self.bad[:_MOST_SHOWN], *more))
            hint = "take it out, and change the secret; --no-secret NAME for a file in which it is none"
            raise RefusedError(
                f"there are secrets in the run, so nothing was written:\n{lines}", hint=hint, code=Code.SECRET_SHOWN
            )


class _One(msgspec.Struct, frozen=True):
    """A single file that is held open."""

    stream: BinaryIO
    name: str
    size: int

    @property
    def sizes(self) -> Mapping[str, int]:
        """Return its name and size."""
        return {self.name: self.size}

    def pieces(self, _name: str) -> Iterator[bytes]:
        """Return its content."""
        self.stream.seek(0)
        while piece := self.stream.read(stored_zip.PIECE):
            yield piece


def _words(files: Files) -> Words:
    public = PublicWords(files)
    words = Words(public.stays)
    for home in sessions(files):
        names = ("facts.json", "inputs/inventory.yml", "environment.json", HARDWARE, "inputs.json")
        found = (json_of(files, f"{home}/{name}") for name in names)
        collect(words, public.may_hide, *found)
    return words


def _described(
    files: Files, hashes: Mapping[str, tuple[int, str]], more: Mapping[str, Any]
) -> Iterator[tuple[str, bytes]]:
    """Return what a bundle has beside the files of the run."""
    with story.read(files) as found:
        told = descriptions.told_of(files, found, hashes)
        about = {
            "format": FORMAT,
            "run": found.run,
            "srprov": told.environment.get("srprov"),
            "descriptions": descriptions.RULES,
            **more,
        }
        yield ABOUT, (json.dumps(mapping(about), indent=2) + "\n").encode()
        yield from descriptions.written(told)
