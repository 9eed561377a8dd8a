"""Services in which no secret stands once more, and which no other robot's word makes do something else.

Takes services and the values that became secrets; gives services, or none. Pure. A robot says what its secrets are: it
may say any words of another one's container, such as the name of the variable that has it ask for a password. So a
container that would lack any of them is left out; without the robot that says them, it has them all.
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

FREE_KEYS = ("labels", "sysctls", "options")
"""Fields whose keys are words of the robot."""
_KEPT = ("secrets", "image")


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
        clean = value if name in _KEPT else _cleaned(name, value, hider)
        if clean != value and clean != _cleaned(name, value, own):
            why = f"its {name} holds what is a secret of another robot: it is left out"
            notes.lost(subject, f"{why}; look at its own robot alone to have it")
            return None
        if clean != value:
            notes.secret(subject, f"its {name} holds what is a secret elsewhere: {MASK} stands there")
        found[name] = clean
    return dataclasses.replace(service, fields=found)


def _cleaned(name: str, value: Any, hider: Hider) -> Any:  # noqa: ANN401 - any field
    return _texts(value, lambda text: masked(hider.without(text)), free=name in FREE_KEYS)


def _texts(value: Any, change: Callable[[str], str], *, free: bool) -> Any:  # noqa: ANN401 - any field
    """Return a field with every text in it changed; `free` says that its keys are texts, too."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, list):
        return [_texts(one, change, free=False) for one in value]
    if isinstance(value, Mapping):
        return {change(key) if free else key: _texts(one, change, free=key in FREE_KEYS) for key, one in value.items()}
    return value
