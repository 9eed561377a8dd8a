"""What becomes of a key of a Compose file: the classes, and the row that each key of the specification has. Pure."""

from __future__ import annotations

import enum

import msgspec


class Kept(enum.Enum):
    """How much of a key's meaning an experiment has."""

    EXACT = "exact"
    """The same."""
    ADAPTED = "adapted"
    """The same by other means, or nearly; the report says how."""
    DROPPED = "dropped"
    """Left out: nothing here does it."""
    REFUSED = "refused"
    """The import fails: the experiment would be another one."""


class Row(msgspec.Struct, frozen=True):
    """One key of the Compose specification."""

    path: str
    """Keys with dots between; `*` stands for a name that users choose. A list and its entries have one path."""
    kept: Kept
    """What usually becomes of it."""
    to: str = ""
    """Where it goes: a field of the EDF or the CDF, or what stands for it."""
    why: str = ""
    """Why it is not kept exactly, for reports too: a sentence without its full stop."""
    but: tuple[tuple[Kept, str], ...] = ()
    """What else may become of it, and when."""
    whole: bool = False
    """All keys below it are in the same class."""


APART = (Kept.REFUSED, "in a folder apart, without `--root`")
"""When another Compose file is refused."""


def exact(path: str, to: str = "", *but: tuple[Kept, str]) -> Row:
    """Write the row of a key that is kept; `to` is left out where the EDF's field has the same name."""
    return Row(path, Kept.EXACT, to or f"`{path.rsplit('.', 1)[-1]}`", but=but)


def adapted(path: str, to: str, why: str, *but: tuple[Kept, str]) -> Row:
    """Write the row of a key that is kept by other means."""
    return Row(path, Kept.ADAPTED, to, why, but)


def dropped(path: str, why: str, *but: tuple[Kept, str]) -> Row:
    """Write the row of a key that is left out."""
    return Row(path, Kept.DROPPED, "", why, but)


def refused(path: str, why: str, *but: tuple[Kept, str]) -> Row:
    """Write the row of a key that an experiment cannot have."""
    return Row(path, Kept.REFUSED, "", why, but)
