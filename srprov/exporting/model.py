"""The values of an export: what was made of an experiment, and what became of each of its fields. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from srprov.errors import Location
from srprov.planning.graver import LEFT_THERE, noted

EXACT, ADAPTED, DROPPED, REFUSED = "exact", "adapted", "dropped", "refused"
KINDS = (EXACT, ADAPTED, DROPPED, REFUSED)
"""The same in the other tool; kept by other means; without a counterpart; would mean something else: not written."""

Path = tuple[str, ...]
"""Keys that lead to a field of the EDF."""


class Remark(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a field in this experiment, where it is not what its line of the table says."""

    path: Path
    kind: str
    words: str


class File(msgspec.Struct, frozen=True, kw_only=True):
    """One file of the export."""

    path: str
    """Relative to the export's folder, with `/`."""
    content: bytes = b""
    mode: int = 0o644
    link: str | None = None
    """Where a symbolic link points to."""
    is_folder: bool = False


class Need(msgspec.Struct, frozen=True, kw_only=True, order=True):
    """What whoever uses the export must give: it is not in it."""

    kind: str
    """`file`, `variable` or `secret`"""
    name: str
    """Path in the export's folder, or name of the variable."""
    what: str
    """One sentence."""
    command: str = ""
    """What a shell runs for it in the export's folder, with what a stranger wrote in quotes."""


class Lent(msgspec.Struct, frozen=True, kw_only=True, order=True):
    """A folder of the export that containers write to: one of whoever runs the file, on his machine."""

    place: str
    """Path in the export's folder."""
    service: str
    """In the EDF."""

    @property
    def what(self) -> str:
        """Return what the service gets, with why that is grave."""
        return noted(f"./{self.place} of the export, a folder of whoever runs it, writable", LEFT_THERE)


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    """One machine, which has a Compose file of its own."""

    robot: str
    """Its name in the inventory; empty: a PC that stands for all robots."""
    services: tuple[str, ...]
    """In name order."""
    file: str = "compose.yml"
    """What starts them, in its folder."""
    shares_folder: bool = False
    """It has no folder of its own: one tool starts what runs on all machines."""

    @property
    def folder(self) -> str:
        """Return where its files lie in the export, with a slash at the end; empty: at its top."""
        return f"{self.robot}/" if self.robot and not self.shares_folder else ""


class Field(msgspec.Struct, frozen=True, kw_only=True):
    """One field that the EDF or a CDF has, and what became of it."""

    kind: str
    name: str
    """As it is shown: `services.talker.ports`."""
    location: Location
    words: str


class Export(msgspec.Struct, frozen=True, kw_only=True):
    """All that is written, and the report."""

    experiment: str
    edf: str
    """The EDF's path, as the user gave it."""
    machines: tuple[Machine, ...]
    files: tuple[File, ...]
    fields: tuple[Field, ...]
    """In the order of the files, the EDF first."""
    needs: tuple[Need, ...] = ()
    notes: tuple[str, ...] = ()
    lent: tuple[Lent, ...] = ()
    made_by: str = "Docker Compose files, made by `srprov export compose`"


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """What one piece of the conversion gives."""

    files: tuple[File, ...] = ()
    remarks: tuple[Remark, ...] = ()
    needs: tuple[Need, ...] = ()
    lent: tuple[Lent, ...] = ()
    document: Mapping[str, object] = msgspec.field(default_factory=lambda: MappingProxyType({}))
