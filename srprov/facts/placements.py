"""Placement records as robots hold them, each brought into the shape that srprov writes.

Takes a robot's reply; gives one JSON map per instance. A record is believed by nobody here: whose word counts is
decided in `network/belief.py`. What is not of the right shape is as good as not there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov import names
from srprov.modules.module import STATE_ROOT
from srprov.untrusted import LIST_LENGTH, integer, json_or_none, lines_of, mapping, string
from srprov.wire import Query, Reply

PLACEMENTS = Query(
    command=f'for f in {STATE_ROOT}/*/placement.json; do test -f "$f" && cat "$f" && echo; done; :', in_place=True
)
_SIZE_LIMIT = 1_000_000
_PARTS = {"services": ("ip", "mac", "network", "robot"), "robots": ("gateway", "vtep")}
_NUMBERS = ("mtu", "port", "vni", "serial")


def parse_placements(reply: Reply) -> dict[str, Mapping[str, Any]]:
    """Return instance -> its record; of two the newer."""
    found: dict[str, Mapping[str, Any]] = {}
    for line in lines_of(reply.out[:_SIZE_LIMIT], LIST_LENGTH):
        record = mapping(json_or_none(line))
        if names.valid("instance", record.get("instance")) and isinstance(record.get("serial"), int):
            shaped = _shaped(record)
            before = found.get(shaped["instance"])
            if before is None or before["serial"] < shaped["serial"]:
                found[shaped["instance"]] = shaped
    return found


def _shaped(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a record has, as texts and numbers; what srprov wrote stays as it is."""
    shaped: dict[str, Any] = {key: string(record[key]) for key in ("instance", "source", "subnet") if key in record}
    shaped |= {key: integer(record[key]) for key in _NUMBERS if key in record}
    for part, fields in _PARTS.items():
        if part in record:
            entries = list(mapping(record[part]).items())[: 8 * LIST_LENGTH]
            shaped[part] = {string(name): {key: string(mapping(e).get(key)) for key in fields} for name, e in entries}
    return shaped
