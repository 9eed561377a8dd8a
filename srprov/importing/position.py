"""Where something was written in a foreign file: file, line and column, both counted from 1. Pure."""

from __future__ import annotations

from srprov.errors import Location

Position = Location
Path = tuple[str | int, ...]
"""A way into a document: keys of maps and indices of lists, from the root."""
