"""What the import of one project says of each key: gathered while it is converted, completed from the table.

Takes a project's normal form; gives findings, each with its place. Pure.
"""

from __future__ import annotations

import msgspec

from srprov.codes import Code
from srprov.conversion.kept import Kept
from srprov.conversion.table import present
from srprov.errors import Diagnostic
from srprov.importing.normal import Normal
from srprov.importing.position import Path, Position

_UNKNOWN = "is no key of the Compose specification as it is known here"


class Finding(msgspec.Struct, frozen=True):
    """What became of one key at one place."""

    at: Position
    key: str
    """The way to it, such as `services.camera.dns`."""
    kept: Kept
    message: str = ""
    hint: str = ""
    code: str = ""
    """Of the problem that it is, where it is one by itself."""

    @property
    def problem(self) -> Diagnostic:
        """Return it as a problem of a file."""
        return Diagnostic(self.at, self.message, self.key, "", self.hint, code=Code.NOT_TRANSLATED)


class Notes:
    """Gathers findings of one project; `say` is for what depends on values, `finished` adds what the table says."""

    def __init__(self, normal: Normal) -> None:
        """Begin with nothing said."""
        self.normal = normal
        self._said: dict[Path, list[Finding]] = {}

    def say(self, path: Path, kept: Kept, message: str = "", hint: str = "") -> None:
        """Note what became of the key at a path; with `Kept.EXACT` the table is not asked about it."""
        key = ".".join(str(part) for part in path)
        found = Finding(self.normal.position_of(path), key, kept, message, hint)
        if found not in self._said.setdefault(path, []):
            self._said[path].append(found)

    def exact(self, *paths: Path) -> None:
        """Note that keys are kept as they are."""
        for path in paths:
            if path not in self._said:
                self.say(path, Kept.EXACT)

    def adapted(self, path: Path, message: str, hint: str = "") -> None:
        """Note that a key is kept by other means."""
        self.say(path, Kept.ADAPTED, message, hint)

    def dropped(self, path: Path, message: str, hint: str = "") -> None:
        """Note that a key is left out."""
        self.say(path, Kept.DROPPED, message, hint)

    def refused(self, path: Path, message: str, hint: str = "") -> None:
        """Note that a key cannot be had, so that the import fails."""
        self.say(path, Kept.REFUSED, message, hint)

    def finished(self) -> list[Finding]:
        """Return all findings; what nothing was said of is in its row's class."""
        for one in present(self.normal.document):
            if one.path in self._said or one.holds:
                continue
            if one.row is None:
                self.refused(one.path, f"'{str(one.path[-1])[:60]}' {_UNKNOWN}")
            elif _of_itself(one.path, one.value, str(self.normal.document.get("name"))):
                self.exact(one.path)
            else:
                self.say(one.path, one.row.kept, one.row.why)
        return [one for found in self._said.values() for one in found]


def _of_itself(path: Path, value: object, project: str) -> bool:
    """Return whether a value is what Compose takes where nothing was written."""
    last = path[-1]
    if path[0] in ("volumes", "networks", "secrets", "configs") and last == "name":
        return value == f"{project}_{path[1]}"
    return value in (None, {}, []) or (path[0] == "services" and (last, value) in _DEFAULTS)


_DEFAULTS: tuple[tuple[str, object], ...] = (
    *(("mode", "ingress"), ("mode", "host"), ("mode", "replicated")),
    *(("required", True), ("isolation", "default"), ("propagation", "rprivate"), ("consistency", "")),
)
