"""Placement records as robots hold them, each brought into the shape that srprov writes.

Takes a robot's reply; gives one JSON map per instance. A record is believed by nobody here: whose word counts is
decided in `network/belief.py`. What is not of the right shape is as good as not there.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping
from typing import Any

from msgspec.structs import replace

from srprov import names
from srprov.facts.model import MOST_SERIAL
from srprov.modules.module import STATE_ROOT
from srprov.robot_answers import TooManyError
from srprov.untrusted import LIST_LENGTH, integer, json_or_none, lines_of, mapping, string
from srprov.wire import Reply

RECORDS = f"{STATE_ROOT}/*/placement.json"
"""Where they are; `probes.py` asks for them, with other files."""
_RECORD = re.compile(rf"{STATE_ROOT}/[^/:]{{1,64}}/placement\.json:")
MOST_OF_RECORDS = 4 << 20
"""Characters of all records; one of a thousand services has some 130,000."""
_MOST_LINES = 8192
"""Of all files."""
_PARTS = {"services": ("ip", "mac", "network", "robot"), "robots": ("gateway", "vtep")}
_NUMBERS = ("mtu", "port", "vni")


def parse_placements(reply: Reply) -> dict[str, Mapping[str, Any]]:
    """Return instance -> its record, from the reply to `FILES` of `probes.py`; of two the newer.

    Raises:
        TooManyError: There is more than is read: one record that is very long would hide those of other instances.
    """
    lines = lines_of(reply.out, _MOST_LINES + 1)
    texts = [line[at.end() :] for line in lines if (at := _RECORD.match(line))]
    if len(lines) > _MOST_LINES or sum(map(len, texts)) > MOST_OF_RECORDS:
        largest = max((line for line in lines if _RECORD.match(line)), key=len, default="").partition(":")[0]
        raise TooManyError(f"its placement records are more than {MOST_OF_RECORDS >> 20} MiB; the longest is {largest}")
    return read_placements(texts)


def without_records(reply: Reply) -> Reply:
    """Return the reply without the records: who keeps what each robot said need not keep what names all robots."""
    lines = lines_of(reply.out, _MOST_LINES + 1)
    if len(lines) > _MOST_LINES:  # `parse_placements` refuses them
        return replace(reply, out="")
    kept = [line for line in lines if not _RECORD.match(line)]
    return reply if len(kept) == len(lines) else replace(reply, out="\n".join(kept))


def read_placements(texts: Iterable[str]) -> dict[str, Mapping[str, Any]]:
    """Return instance -> its record, from the texts of such files; of two the newer."""
    found: dict[str, Mapping[str, Any]] = {}
    for text in texts:
        if (shaped := _read(text)) is not None:
            before = found.get(shaped["instance"])
            if before is None or before["serial"] < shaped["serial"]:
                found[shaped["instance"]] = shaped
    return found


@functools.lru_cache(maxsize=64)
def _read(text: str) -> Mapping[str, Any] | None:
    """Return the record that a text is, if it is one: the same one for the same text, as all robots hold one.

    It names all robots and services. Read once for each robot it would take the square of time, and of memory.
    """
    record = mapping(json_or_none(text))
    if names.valid("instance", record.get("instance")) and isinstance(record.get("serial"), int):
        return _shaped(record)
    return None


def _shaped(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a record has, as texts and numbers; what srprov wrote stays as it is."""
    shaped: dict[str, Any] = {key: string(record[key]) for key in ("instance", "source", "subnet") if key in record}
    shaped |= {key: integer(record[key]) for key in _NUMBERS if key in record}
    shaped["serial"] = integer(record["serial"], low=1, high=MOST_SERIAL)
    for part, fields in _PARTS.items():
        if part in record:
            entries = list(mapping(record[part]).items())[: 8 * LIST_LENGTH]
            shaped[part] = {string(name): {key: string(mapping(e).get(key)) for key in fields} for name, e in entries}
    return shaped
