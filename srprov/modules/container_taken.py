"""What engines say of containers, without the values that these have of a controller's environment.

Takes what was said, which may be of any form; gives the same with masks. Pure. Whoever made a container was allowed
those values; the EDF by which it is looked at now need not name them, so that nobody knows them for secrets.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from srprov.modules.module import TAKEN
from srprov.secret import MASK
from srprov.untrusted import mapping, string_map


def without_taken(inspected: Mapping[str, Any]) -> dict[str, Any]:
    """Return service -> what its engine says of its container, with masks for values that were the controller's."""
    return {name: _masked(about) for name, about in inspected.items()}


def _masked(about: object) -> object:
    config = mapping(mapping(about).get("Config"))
    taken, variables = string_map(config.get("Labels")).get(TAKEN, "").split(), config.get("Env")
    if not taken or not isinstance(variables, list):
        return about
    return {**mapping(about), "Config": {**config, "Env": [_variable(one, taken) for one in variables]}}


def _variable(one: object, taken: Collection[str]) -> object:
    name, sign, _ = one.partition("=") if isinstance(one, str) else ("", "", "")
    return f"{name}={MASK}" if sign and name in taken else one
