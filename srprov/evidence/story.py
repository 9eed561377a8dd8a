"""What a run's files say, read once: its events, its rows, its experiment, its robots. For the crate and for checks.

Takes Files; gives a Story. The definitions are read from a folder of the caller's, into which the files of the last
session were written: nothing of them is run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from srprov.definitions.model import Definitions
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.evidence.files import JOURNAL, MOST_JOURNAL, Files, NotThere, content, sessions
from srprov.evidence.session import Earlier, Session, again, follows_from, read_session
from srprov.trials.marks import Row, marked
from srprov.trials.table import columns
from srprov.untrusted import integer, mapping, parse_json, string, string_map

_MOST_VALUES = 4_000_000
"""Of a journal: brackets, commas and colons."""
_MOST_TEXTS = 2_000_000
"""Of a journal, names of values included: a text of two letters may take 88 bytes of memory."""
_MOST_TRIALS = 100_000
"""Of sessions that differ, together: each is worked out again, and held in memory."""
_MOST_CELLS = 1_000_000


Attempt = tuple[str, int]
"""A trial, and the number of the attempt at it."""


class Story(msgspec.Struct, frozen=True, kw_only=True):
    """What a run's files say."""

    events: tuple[Mapping[str, Any], ...]
    rows: tuple[Row, ...]
    """Of all attempts, in the order in which they ended, as tables have them."""
    ended: tuple[Row, ...]
    """The same, as they were when they ended."""
    sessions: tuple[Session, ...]
    of: Mapping[Attempt, Session]
    """Attempt -> the session that began it."""

    @property
    def last(self) -> Session:
        """The last session, of which the tables are."""
        return self.sessions[-1]

    @property
    def definitions(self) -> Definitions:
        """What was run last."""
        return self.last.definitions

    @property
    def given(self) -> TrialDefinitions:
        """What that says of trials."""
        return self.last.given

    @property
    def home(self) -> str:
        """The folder of the last session."""
        return self.last.home

    @property
    def edf(self) -> str:
        """Name of its EDF in the bundle."""
        return self.last.edf

    @property
    def services(self) -> dict[str, str]:
        """Service of each trial -> its robot, in the last session."""
        return self.last.services

    @property
    def run(self) -> str:
        """The run's name."""
        return string(self.events[0].get("run"))

    @property
    def images(self) -> dict[str, tuple[str, str]]:
        """Service -> its image's name, and the id that its robot's engine gave to it, as last stated."""
        same = string_map(next((one["same"] for one in reversed(self.events) if "same" in one), {}))
        names = {key.removesuffix(": image"): value for key, value in same.items() if key.endswith(": image")}
        return {service: (name, same.get(f"{service}: image id", "")) for service, name in sorted(names.items())}


def attempt_folder(row: Mapping[str, Any]) -> str:
    """Return the folder of an attempt."""
    number = row.get("attempt")
    return f"trials/{string(row.get('trial'))}" + ("" if number == 1 else f".{number}")


def attempt_of(one: Mapping[str, Any]) -> Attempt:
    """Return which attempt an event or a row is of."""
    return string(one.get("trial")), integer(one.get("attempt"), high=1_000_000)


def events_of(files: Files) -> Iterator[Mapping[str, Any]]:
    """Return the events of the journal.

    Raises:
        NotThere: There is none, or a line is no event.
    """
    text = content(files, JOURNAL, MOST_JOURNAL)
    if sum(text.count(one) for one in (b"[", b"{", b",", b":")) > _MOST_VALUES:
        raise NotThere(f"{JOURNAL} holds more than {_MOST_VALUES} values")
    if text.count(b'"') > 2 * _MOST_TEXTS:
        raise NotThere(f"{JOURNAL} holds more than {_MOST_TEXTS} texts")
    for number, line in enumerate(text.split(b"\n")[:-1], start=1):
        try:
            event = mapping(parse_json(line.decode(), wide=True))
        except ValueError:
            event = {}
        if event.get("seq") != number or not isinstance(event.get("event"), str):
            raise NotThere(f"{JOURNAL}:{number} is not the event number {number}")
        yield event


@contextmanager
def read(files: Files) -> Iterator[Story]:
    """Read all of it, of a run or a bundle; the definitions lie in a folder of their own as long as the block lasts.

    Variables that services took from the controller's environment are empty.

    Raises:
        NotThere: Something is missing, or is not what a run writes.
    """
    events = tuple(events_of(files))
    if not events or events[0]["event"] != "run":
        raise NotThere(f"{JOURNAL} does not begin with a run")
    ended = tuple(_ended(events))
    if not (every := sessions(files)):
        raise NotThere("it does not say what was run: a run by an older srprov has no record of its own")
    with TemporaryDirectory(prefix="srprov-") as folder:
        found: list[Session] = []
        earlier, trials = Earlier(), 0
        for home in every:
            same = bool(found) and follows_from(files, home) == follows_from(files, found[-1].home)
            found.append(again(found[-1], home) if same else read_session(files, home, folder, earlier))
            trials += 0 if same else len(found[-1].places)
            if trials > _MOST_TRIALS:
                raise NotThere(f"its sessions have more than {_MOST_TRIALS} trials that differ")
        _check_size(ended, found[-1])
        yield Story(
            events=events,
            rows=tuple(marked(events)[0]),
            ended=ended,
            sessions=tuple(found),
            of=dict(_sessions_of(events, found)),
        )


def _check_size(ended: Sequence[Row], last: Session) -> None:
    """Refuse a small journal from which tables and a crate follow that are thousands of times as large.

    Raises:
        NotThere: Its attempts, each with a cell for each column and a word for each service, are more than any run has.
    """
    if len(ended) * (len(columns(last.given)) + len(last.assignment)) > _MOST_CELLS:
        raise NotThere(f"its {len(ended)} attempts have more than {_MOST_CELLS} cells and services together")


def _ended(events: Iterable[Mapping[str, Any]]) -> Iterator[Row]:
    """Return the row of each attempt that ended. Each has a folder of its own, so that no file is read for two.

    Raises:
        NotThere: One is no row, or is of an attempt that ended before.
    """
    folders = set[str]()
    for one in events:
        row = mapping(one.get("row"))
        if one["event"] != "end":
            continue
        words, numbers = (row.get("trial"), row.get("status")), (row.get("attempt"), row.get("segment", 1))
        if not all(type(word) is str for word in words) or not all(type(number) is int for number in numbers):
            raise NotThere(f"{JOURNAL}:{one['seq']} ends an attempt without a row of it")
        if (folder := attempt_folder(row)) in folders:
            raise NotThere(f"{JOURNAL}:{one['seq']} ends {folder}, which ended before")
        folders.add(folder)
        yield row


def _sessions_of(events: Iterable[Mapping[str, Any]], every: Sequence[Session]) -> Iterator[tuple[Attempt, Session]]:
    """Return which session began each attempt."""
    number = -1
    for one in events:
        number += one["event"] in ("run", "resume")
        if one["event"] == "begin" and 0 <= number < len(every):
            yield attempt_of(one), every[number]
