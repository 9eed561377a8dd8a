"""Calls of the other process: which of their values travel, and which stay here and are called again.

Takes sessions, and what they give: channels, shells, commands and streams.
"""

from __future__ import annotations

from typing import Any

from srprov.session import LockChannel, Progress
from srprov.transport.workers.far import FarItems
from srprov.transport.workers.flow import Flow
from srprov.transport.workers.link import Link
from srprov.transport.workers.sealed import Handle

_TOLD = "execute"
"""The method whose last argument is told lines."""
_STAYING = frozenset(("connect", "peer", "open_shell", "run_in"))
_FLOWING = frozenset(("save_image", "container_log", "copy_out", "output", "layer", "data_set"))


def act(
    link: Link, found: object, method: str, words: tuple[Any, ...], named: dict[str, Any], progress: Progress
) -> object:
    """Call a method for the other process, or read an attribute; what has to stay here is given as a handle."""
    attribute = getattr(found, method)
    if not callable(attribute):
        return attribute
    given = [iter(FarItems(link, word)) if isinstance(word, Handle) else word for word in words]
    result = attribute(*given, progress) if method == _TOLD else attribute(*given, **named)
    if method == "open_lock_channel":
        return link.export(result), _first(result)
    if result is None:
        return None
    if method in _FLOWING:
        return link.export(Flow(result))
    return link.export(result) if method in _STAYING else result


def _first(channel: LockChannel) -> str:
    return channel.first_answer
