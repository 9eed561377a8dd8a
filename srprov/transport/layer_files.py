"""A layer is put together from the files of the engine that has it; nothing but that layer is read.

The engine's tar-split file has the layer's headers and padding, and says which file's content goes between; the robot's
tar gives these contents. What comes of it is compared with the layer's hash, so whatever the robot, or the image, says
cannot make it another layer. Where it does not fit, the image is saved by the engine (`image_source.py`).

Source: github.com/vbatts/tar-split, "tar/storage"; moby's `layer/filestore.go`.
"""

from __future__ import annotations

import binascii
import json
import re
import zlib
from binascii import a2b_base64
from collections.abc import Callable, Iterator

from srprov.engine_files import DRIVER, config_script, layer_script
from srprov.layers import Image, chain_ids, has_classic_store
from srprov.pace import Pace
from srprov.session import Session
from srprov.spool import LARGE
from srprov.transport.blob import Blob, WrongBlob, inflated
from srprov.transport.blobs import Blobs
from srprov.transport.image_progress import Meter
from srprov.transport.image_shell import answer, output, send
from srprov.transport.image_there import INFO
from srprov.transport.tar_stream import TarError, TarStream
from srprov.untrusted import folder, integer, mapping, string

_BETWEEN = b'{"type":2,"payload":"'
_FILE = re.compile(
    rb'\{"type":1(?:,"name":"(.*)"|,"name_raw":"(.*)")?(?:,"size":([0-9]{1,15}))?,"payload":(?:"[^"]{0,20}"|null)'
    rb',"position":[0-9]{1,15}\}'
)
"""Lines of a tar-split file: base64 of what is between files, and a file. They are JSON, always written alike: to
read any JSON would cost a hundred times more than the worst of this, and the layer's hash tells what came of it."""
_ANSWER_S = 60.0
_MOST_PACKED = 64 << 20
_MOST_UNPACKED = 96 << 20
"""Bytes of a tar-split file: a layer of about 100,000 files."""
_LONGEST_LINE = 1 << 20
_MOST_ENTRIES = 200_000
"""Of a tar-split file, two for each file: more than most layers of robots' images, and a second of work."""
_LONGEST_NAME = 4096
_MOST_NAMES = 32 << 20
"""Bytes of all names."""
_MOST_AFTER = 1 << 20
"""Bytes that are read behind the last file."""
_PIECE = 256 << 10


class NotInFiles(Exception):
    """It cannot be read from the engine's files; the text says why."""


class LayerFiles:
    """What an engine's own files have of one image."""

    def __init__(self, session: Session, image: Image, blobs: Blobs) -> None:
        """Take the robot, the image and the cache."""
        self._session, self._blobs = session, blobs
        self._chains = dict(zip(image.diff_ids, chain_ids(image.diff_ids), strict=True))
        self._root: str | None = None

    def get(self, digest: str, meter: Meter, fast: Callable[[], bool]) -> Blob:
        """Return a layer, or the image's configuration.

        Args:
            digest: Its own.
            meter: Counts what comes.
            fast: Asked of a large one: it need not be compressed.

        Raises:
            NotInFiles: They do not have it, or not as it should be.
            TransportError: The robot cannot be talked to any more.
            OSError: The cache cannot be written.
        """
        root = self._root_folder()
        try:
            if digest not in self._chains:
                config = self._session.open_shell(config_script(root, digest))
                return self._blobs.add_content(digest, meter.count(output(self._session.host, config)))
            return self._layer(root, digest, meter, fast)
        except (WrongBlob, TarError, UnicodeError, zlib.error) as error:
            raise NotInFiles(f"the engine's files give something else: {error}") from error

    def _root_folder(self) -> str:
        """Return where the engine keeps everything."""
        if self._root is None:
            info = self._session.ask([INFO])[0].json()
            said = mapping(info)
            known = has_classic_store(info) and said.get("Driver") == DRIVER
            self._root = folder(said.get("DockerRootDir")) if known else ""
        if not self._root:
            raise NotInFiles("the engine keeps layers otherwise")
        return self._root

    def _layer(self, root: str, digest: str, meter: Meter, fast: Callable[[], bool]) -> Blob:
        host, streams = self._session.host, self._session.open_shell(layer_script(root, self._chains[digest], digest))
        try:
            said = answer(host, streams, b"\n", _ANSWER_S)
            size = integer(said.removeprefix("has "))
            if not said.startswith("has ") or not 0 < size <= _MOST_PACKED:
                raise NotInFiles(said[:400] if said.startswith("no ") else "its list of files is too long")
            send(host, streams, b"go\n", pace := Pace())
            pieces = meter.count(output(host, streams))
            split = _exactly(pieces, size)
            names, whole = _names(split)
            raw = whole > LARGE and fast()
            if names:
                send(host, streams, b"%d %s\n" % (len(names), b"raw" if raw else b"gzip"), pace)
                send(host, streams, names, pace)
            contents = TarStream(pieces if raw else inflated(pieces), most_members=names.count(b"\0"))
            blob = self._blobs.add_content(digest, _joined(_tar(split, contents)), raw=raw)
            if names:
                _end(pieces)  # of the script, which tidies up
            return blob
        finally:
            streams.close()


def _exactly(pieces: Iterator[bytes], size: int) -> bytes:
    """Return the next so many bytes, after which nothing comes unasked."""
    got = bytearray()
    while len(got) < size and (piece := next(pieces, b"")):
        got += piece
    if len(got) != size:
        raise NotInFiles("its list of files is cut off, or goes on")
    return bytes(got)


def _end(pieces: Iterator[bytes]) -> None:
    """Read what fills tar's last record, and nothing that has no end."""
    left = _MOST_AFTER
    while left > 0 and (piece := next(pieces, b"")):
        left -= len(piece)


def _names(split: bytes) -> tuple[bytes, int]:
    """Return the names of all files with content, each ended by NUL, and about the bytes of the layer."""
    names, whole = bytearray(), 0
    for between, name, raw, size in _entries(split):
        whole += size + len(between) * 3 // 4
        if size:
            plain = _name(name, raw)
            if b".." in plain.split(b"/") or b"\0" in plain:
                raise NotInFiles("a file in it has a name that leads elsewhere")
            names += b"./" + plain.lstrip(b"/") + b"\0"
            if len(plain) > _LONGEST_NAME or len(names) > _MOST_NAMES:
                raise NotInFiles("names of files in it are too long")
    return bytes(names), whole


def _name(quoted: bytes, raw: bytes) -> bytes:
    """Return the name of a file, from the text of JSON or the base64 that it is."""
    try:
        if raw or b"\\" not in quoted:
            return a2b_base64(raw) if raw else quoted
        return string(json.loads(b'"%b"' % quoted)).encode()
    except (binascii.Error, json.JSONDecodeError) as error:
        raise NotInFiles("its list of files has a name that is none") from error


def _tar(split: bytes, contents: TarStream) -> Iterator[bytes]:
    """Yield the layer."""
    members = iter(contents)
    for between, _, _, size in _entries(split):
        try:
            yield a2b_base64(between)
        except binascii.Error as error:
            raise NotInFiles("its list of files cannot be read") from error
        if size:
            member = next(members, None)
            if member is None or not member.isreg() or member.size != size:
                raise NotInFiles("a file in it is not what it was")
            yield from contents.content()


def _entries(split: bytes) -> Iterator[tuple[bytes, bytes, bytes, int]]:
    """Yield (base64 of what is between files, a file's name as JSON has it, or in base64, bytes of its content)."""
    for number, line in enumerate(_lines(split)):
        if number > _MOST_ENTRIES:
            raise NotInFiles("its list of files has too many entries")
        if line.startswith(_BETWEEN):
            yield line[len(_BETWEEN) : line.find(b'"', len(_BETWEEN))], b"", b"", 0
        elif file := _FILE.fullmatch(line):
            name, raw, size = file.groups(b"")
            yield b"", name, raw, int(size or 0)
        else:
            raise NotInFiles("its list of files has an entry of an unknown kind")


def _lines(split: bytes) -> Iterator[bytes]:
    rest, unpacked = b"", 0
    for piece in inflated([split]):
        unpacked += len(piece)
        if unpacked > _MOST_UNPACKED:
            raise NotInFiles("its list of files is too long")
        *lines, rest = (rest + piece).split(b"\n")
        if len(rest) > _LONGEST_LINE:
            raise NotInFiles("its list of files has a line that is too long")
        yield from lines
    if rest:
        yield rest


def _joined(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Put small pieces together: headers have 512 bytes, and most files few."""
    together = bytearray()
    for piece in pieces:
        together += piece
        if len(together) >= _PIECE:
            yield bytes(together)
            together.clear()
    yield bytes(together)
