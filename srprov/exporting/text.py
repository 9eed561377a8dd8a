"""A Compose file as text: JSON values -> YAML in which Compose replaces nothing that is not meant to be. Pure.

Compose replaces `$` in values by variables, and never in keys: each is doubled, but for those of a `Raw` text.
Source: Compose specification, "Interpolation".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov.yamldoc import writer


class Raw(str):
    """A text in which `${NAME}` is meant as Compose reads it."""

    __slots__ = ()


def dump(value: Mapping[str, object], comment: str = "") -> str:
    """Return a document; each line of the comment stands at its head."""
    return writer.document(_doubled(value), comment)


def _doubled(value: object) -> Any:  # noqa: ANN401 - JSON is any
    if isinstance(value, Mapping):
        return {key: _doubled(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_doubled(one) for one in value]
    if isinstance(value, str):
        return str(value) if isinstance(value, Raw) else value.replace("$", "$$")
    return value
