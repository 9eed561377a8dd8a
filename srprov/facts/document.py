"""HostFacts as JSON: what `facts --json` prints for each robot; `schemas/facts.schema.json` describes the document.

Takes HostFacts; gives JSON values in a fixed order. Pure. Names are the model's; numbers are native (bytes, seconds,
Mbit/s), and 0 stands for an unknown speed as it does in the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.facts.model import HostFacts


def facts_json(facts: HostFacts) -> dict[str, Any]:
    """Return one robot's facts as JSON values: tuples become lists, a missing engine is null.

    What an engine was not asked is left out: every engine has a storage driver, so one without was not.
    """
    values: dict[str, Any] = _plain(msgspec.to_builtins(facts))
    if facts.docker and not facts.docker.storage_driver:
        values["docker"] = {key: values["docker"][key] for key in ("version", "api_version")}
    return values


def facts_document(robots: Mapping[str, HostFacts], unreachable: Mapping[str, str]) -> dict[str, Any]:
    """Return the whole document: `{"robots": {name: facts}, "unreachable": {name: reason}}`, in name order."""
    return {
        "robots": {name: facts_json(robots[name]) for name in sorted(robots)},
        "unreachable": {name: unreachable[name] for name in sorted(unreachable)},
    }


def _plain(value: Any) -> Any:  # noqa: ANN401 - JSON is any
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value
