"""The words of a snapshot's report: without secrets, and without a robot's word for which of srprov's own these are.

A robot says what its secrets are, and may say any sentence of the report, such as the one that a container of another
robot was left out. So a note in which there is a secret of another robot is withheld as a whole, which is said. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from srprov.snapshot.folder import Robot
from srprov.snapshot.hider import Hider

_WITHHELD = "a note is withheld, as words of it are a secret of another robot: look at this robot alone to read it"


def is_our_own(value: str) -> bool:
    """Return whether a value is a part of what stands for a note: nobody has such a secret, and it is always shown."""
    return value.strip().casefold() in _WITHHELD


class Words:
    """Takes secrets out of a report."""

    def __init__(self, robots: Sequence[Robot]) -> None:
        """Take the robots with all values that became secrets."""
        self._all = _hider(value for robot in robots for one in robot.services for value in one.hidden)
        self._own = {robot.name: _hider(value for one in robot.services for value in one.hidden) for robot in robots}

    def clean(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return a report in which no text holds a secret; the names of fields stay."""
        return {**self._without(document), "notes": [self._note(one) for one in document["notes"]]}

    def _note(self, note: Mapping[str, str]) -> dict[str, str]:
        own = self._own[note["robot"]].without_strong
        line = own(f"{note['robot']}: {note['kind']}: {note['subject']}: {note['words']}")
        if self._all.without_strong(line) != line:
            return {**note, "subject": "report", "words": _WITHHELD}
        return {**note, "subject": own(note["subject"]), "words": own(note["words"])}

    def _without(self, value: Any) -> Any:  # noqa: ANN401 - JSON is any
        if isinstance(value, str):
            return self._all.without_strong(value)
        if isinstance(value, Mapping):
            return {key: self._without(one) for key, one in value.items()}
        return [self._without(one) for one in value] if isinstance(value, list) else value


def _hider(values: Iterable[str]) -> Hider:
    return Hider(value for value in values if not is_our_own(value))
