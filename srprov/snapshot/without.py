"""Services in which no secret stands once more, and which no other robot's word makes do something else.

Takes services and the values that became secrets; gives services, or none. Pure. A robot says what its secrets are: it
may say any words of another one's container, such as the name of the variable that has it ask for a password. So a
container that would lack any of them is left out; without the robot that says them, it has them all.

Nor does a robot learn another one's secret by its own containers: each may hold thousands of guesses, and whoever sees
which of them come back knows the right one. So with one all of its robot's are left out, and a short value, which may
be a usual word, is hidden in its own robot's containers alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from typing import Any

from srprov.redaction import MASK
from srprov.snapshot.containers import Service
from srprov.snapshot.hider import Hider
from srprov.snapshot.notes import Notes
from srprov.snapshot.suspicion import masked

FREE_KEYS = ("labels", "sysctls", "options")
"""Fields whose keys are words of the robot."""
_KEPT = ("secrets", "image")


def all_without(services: Collection[Service], hider: Hider, own: Hider, notes: Notes) -> tuple[Service, ...]:
    """Return a robot's services without values that became secrets; none where another robot's would change one.

    Args:
        services: Of one robot.
        hider: The values of all robots.
        own: Those of this one.
        notes: Takes what was hidden, and why they are left out.
    """
    kept = tuple(one for service in services if (one := without(service, hider, own, notes)))
    if len(kept) == len(services):
        return kept
    why = "all are left out, as which of them hold a secret of another robot is none of this one's business"
    notes.lost("containers", f"{why}; look at this robot alone to have them")
    return ()


def another_s(text: str, hider: Hider, own: Hider) -> bool:
    """Return whether a text of a robot holds a secret of another one's, and none of its own."""
    return own.without(text) == text != hider.without_strong(text)


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
        mine = value if name in _KEPT else _texts(value, lambda text: masked(own.without(text)), free=name in FREE_KEYS)
        clean = value if name in _KEPT else _cleaned(name, value, hider, own)
        if clean != mine:
            why = f"its {name} holds what is a secret of another robot: it is left out"
            notes.lost(subject, f"{why}; look at its own robot alone to have it")
            return None
        if clean != value:
            notes.secret(subject, f"its {name} holds what is a secret elsewhere: {MASK} stands there")
        found[name] = clean
    return dataclasses.replace(service, fields=found)


def _cleaned(name: str, value: Any, hider: Hider, own: Hider) -> Any:  # noqa: ANN401 - any field
    return _texts(value, lambda text: masked(own.without(hider.without_strong(text))), free=name in FREE_KEYS)


def _texts(value: Any, change: Callable[[str], str], *, free: bool) -> Any:  # noqa: ANN401 - any field
    """Return a field with every text in it changed; `free` says that its keys are texts, too."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, list):
        return [_texts(one, change, free=False) for one in value]
    if isinstance(value, Mapping):
        return {change(key) if free else key: _texts(one, change, free=key in FREE_KEYS) for key, one in value.items()}
    return value
