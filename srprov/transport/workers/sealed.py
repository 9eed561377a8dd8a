"""Messages between srprov and its own worker processes as bytes, secrets included.

A secret refuses to be pickled, so that none leaves by accident. This is the one place where they are let through: the
bytes go into a socket pair that only the two processes have. Both ends run the same files of srprov, and neither takes
such bytes from anybody else.
"""

from __future__ import annotations

import copyreg
import io
import pickle
from collections.abc import Callable
from typing import Any

import msgspec

from srprov.secret import Hidden, Secret


class Handle(msgspec.Struct, frozen=True):
    """An object that stays in its process, by its number there."""

    number: int


def _kept(hidden: Hidden) -> tuple[type[Hidden], tuple[str]]:
    """Say how to make the same one there: a `Secret` is known to that process's `redact`, too."""
    return type(hidden), (hidden.reveal(),)


_TABLE: dict[Any, Callable[[Any], Any]] = {
    # libraries (Dask's is one) register errors there, to travel with their tracebacks
    **{kind: made for kind, made in copyreg.dispatch_table.items() if not issubclass(kind, BaseException)},
    Hidden: _kept,
    Secret: _kept,
}


def packed(message: object) -> bytes:
    """Return a message as bytes.

    Raises:
        Exception: Something in it cannot leave its process; of whichever kind pickle meets.
    """
    out = io.BytesIO()
    pickler = pickle.Pickler(out, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = _TABLE
    pickler.dump(message)
    return out.getvalue()


def unpacked(data: bytes) -> Any:  # noqa: ANN401 - a message is any; `link.py` has their shapes
    """Return the message."""
    return pickle.loads(data)  # noqa: S301 - written by this program, in a process that it started
