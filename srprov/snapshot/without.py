"""Services in which no secret stands once more, and which no other robot's word makes do something else.

Takes services and the values that became secrets; gives services, or none. Pure. A robot says what its secrets are: it
may say any words of another one's container. So what stands in their place there means nothing to a shell, as a `*`
would in `rm -rf /data/cache/*`, and a container that would lose a limit by it is left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from srprov.redaction import MASK
from srprov.snapshot.containers import Service
from srprov.snapshot.hider import Hider
from srprov.snapshot.notes import Notes
from srprov.snapshot.suspicion import masked

ANOTHERS = "HIDDEN"
"""In the place of what another robot says is a secret."""
_KEPT = ("secrets", "image")
_WORDS = ("command", "entrypoint", "healthcheck", "environment", "labels")
"""Fields that may lack a word, and still say the same of what a container may do."""


def without(service: Service, hider: Hider, own: Hider, notes: Notes) -> Service | None:
    """Return a service without values that became secrets, of any robot; None if another's would change what it is.

    Args:
        service: It, as its robot has it.
        hider: The values of all robots.
        own: Those of its own robot.
        notes: Takes what was hidden, and why it is left out.
    """
    subject = f"container {service.name}"
    found: dict[str, Any] = {}
    for name, value in service.fields.items():
        clean = value if name in _KEPT else _cleaned(value, hider)
        if clean != value and clean != _cleaned(value, own):
            clean = _texts(clean, lambda text: text.replace(MASK, ANOTHERS))
            if name not in _WORDS or _cleaned(clean, hider) != clean:
                notes.lost(subject, f"its {name} holds what is a secret of another robot: it is left out")
                return None
            notes.secret(subject, f"its {name} holds what is a secret of another robot: {ANOTHERS} stands there")
        elif clean != value:
            notes.secret(subject, f"its {name} holds what is a secret elsewhere: {MASK} stands there")
        found[name] = clean
    return dataclasses.replace(service, fields=found)


def _cleaned(value: Any, hider: Hider) -> Any:  # noqa: ANN401 - any field
    return _texts(value, lambda text: masked(hider.without(text)))


def _texts(value: Any, change: Callable[[str], str]) -> Any:  # noqa: ANN401 - any field
    """Return a field with every text in it changed, but for keys."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, list):
        return [_texts(one, change) for one in value]
    if isinstance(value, Mapping):
        return {key: _texts(one, change) for key, one in value.items()}
    return value
