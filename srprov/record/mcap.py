"""An MCAP recording whose recorder was killed -> the same with an end, beside it.

Takes a file of somebody else's; copies its whole records, in order, and writes what closes it. A chunk that was cut off
is left out. No summary is made: readers go through the file.

Source: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from srprov.record.results import open_part, put

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _CHUNK, _DATA_END = 0x01, 0x06, 0x0F
_COPIED = frozenset({_HEADER, 0x03, 0x04, 0x05, _CHUNK, 0x07, 0x09, 0x0C})
"""Header, schemas, channels, messages, chunks and their indexes, attachments, metadata."""
_END = struct.pack("<BQI", _DATA_END, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + MAGIC
_PREFIX = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_PIECE = 1 << 20
_MOST_SHORT, _SHORT = 1_000_000, 32
"""Records that may have fewer bytes each, on average: a message of no data has 31, and each takes a turn here."""


class TooManyRecordsError(Exception):
    """It has too many records that are too short to be of a recording."""


def recover(path: Path, target: Path, part: Path) -> bool:
    """Write what can be read of a recording to a target, by way of a part; return whether there is anything.

    Raises:
        OSError: It cannot be written.
        TooManyRecordsError: It would take long.
    """
    with path.open("rb") as source:
        if source.read(len(MAGIC)) != MAGIC:
            return False
        stream, _ = open_part(part)
        with stream:
            stream.write(MAGIC)
            copied = _copy(source, stream, path.stat().st_size)
            stream.write(_END)
    if copied:
        put(part, target)
    else:
        part.unlink()
    return copied


def _copy(source: BinaryIO, target: BinaryIO, size: int) -> bool:
    """Copy whole records up to the end of the data; return whether there was a header."""
    began, records = False, 0
    while len(prefix := source.read(_PREFIX.size)) == _PREFIX.size:
        kind, length = _PREFIX.unpack(prefix)
        at = source.tell()
        cut = at + length > size or (kind == _CHUNK and not _is_chunk(source, length))
        if kind in (0, _DATA_END) or cut or (not began and kind != _HEADER):
            break
        began = True
        records += 1
        if records > _MOST_SHORT and at < records * _SHORT:
            raise TooManyRecordsError
        if kind in _COPIED:
            source.seek(at)
            target.write(prefix)
            while length and (piece := source.read(min(length, _PIECE))):
                target.write(piece)
                length -= len(piece)
        else:
            source.seek(at + length)
    return began


def _is_chunk(source: BinaryIO, length: int) -> bool:
    """Tell whether the lengths in a chunk are those of its record: a disk that lost power may have zeros there."""
    head = source.read(_CHUNK_HEAD.size)
    if len(head) < _CHUNK_HEAD.size:
        return False
    name = _CHUNK_HEAD.unpack(head)[4]
    if name > 32:
        return False
    rest = source.read(name + 8)
    whole = len(rest) == name + 8
    return whole and _CHUNK_HEAD.size + len(rest) + int.from_bytes(rest[name:], "little") == length
