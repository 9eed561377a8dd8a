"""How much is said of a container beside its image: an engine tells it with the container, some of it twice. Pure."""

from __future__ import annotations

import json
from collections.abc import Mapping

from srprov.definitions.containermodel import Runtime

_MOST = 128 << 10
ADDED = 64 << 10
"""Of what srprov itself adds to a service's environment: the addresses of all its peers."""


def lengths(run: Runtime) -> dict[str, int]:
    """Return field -> characters that an engine writes for it, of the fields that may hold text of any length."""
    said = {
        "command": run.command, "entrypoint": run.entrypoint,
        "healthcheck": run.healthcheck.test if run.healthcheck else (),
        "environment": dict(run.environment), "labels": dict(run.labels),
    }  # fmt: skip
    return {key: len(json.dumps(value)) for key, value in said.items()}


def too_much(said: Mapping[str, int], added: int = 0) -> str:
    """Return that such fields are longer than an answer of an engine may be, in words, or nothing.

    `added` characters are beside what a definition says.
    """
    if sum(said.values()) <= _MOST + added:
        return ""
    return f"{', '.join(said)} take more than {(_MOST + added) >> 10} KiB together, as an engine writes them"
