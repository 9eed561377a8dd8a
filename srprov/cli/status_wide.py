"""The columns of `status --wide`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

WIDE_COLUMNS = (
    *("instance", "service", "robot", "robot address", "state", "exit", "restarts", "since", "health", "address"),
    *("container name", "ports", "volumes", "image", "problem"),
)
_NAMELESS = re.compile("[0-9a-f]{64}")
"""A volume that an engine named, since nobody did: it is shown as short as a container's id."""


def wide_columns(row: Mapping[str, Any]) -> dict[str, str]:
    """Return the cells of a row that only `--wide` has. Since: when it started or, of one that has ended, ended."""
    wide = row["wide"]
    return {
        "robot address": wide["robot_address"],
        "container name": wide["container"],
        "exit": "" if wide["exit_code"] is None else str(wide["exit_code"]),
        "restarts": str(wide["restarts"] or ""),
        "since": wide["ended"] or wide["started"] or "",
        "ports": " ".join([*map(_port, wide["ports"]), *_more(wide, "ports")]),
        "volumes": " ".join([*map(_volume, wide["volumes"]), *_more(wide, "volumes")]),
    }


def _more(wide: Mapping[str, Any], what: str) -> list[str]:
    return [f"and {wide[f'{what}_left_out']} more"] if f"{what}_left_out" in wide else []


def _port(port: Mapping[str, Any]) -> str:
    address = f"[{port['robot_address']}]" if ":" in port["robot_address"] else port["robot_address"]
    return f"{address}:{port['robot_port']}->{port['port']}/{port['protocol']}"


def _volume(volume: Mapping[str, Any]) -> str:
    source = volume["source"] or volume["kind"]
    short = source[:12] if _NAMELESS.fullmatch(source) else source
    return f"{short}:{volume['target']}{':ro' if volume['read_only'] else ''}"
