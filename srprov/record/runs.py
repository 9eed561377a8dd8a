"""Runs that this machine recorded, read again for a person: what `apply` and its like left, and runs of trials.

Takes folders; gives a KeptRun for each, and a TrialsRun. Writes nothing: a run may be under way. A folder may be
somebody else's, so what it says is bounded and compared with what a run writes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.record import journal
from srprov.record.last import record_json
from srprov.trials.judge import COUNTED
from srprov.trials.marks import DISCARD, RERUN, marked
from srprov.untrusted import integer, mapping, mappings, string

_MOST_JOURNAL = 64 << 20
"""Bytes of a journal: more than 5000 trials of a dozen robots leave."""
_MOST_COLUMNS = 1000
_MOST_CELLS = 2_000_000
"""Of all attempts, measurements of their robots included: about what 1000 trials of a dozen robots have."""
_MOST_STEPS = 100_000
_INSTANCE = re.compile(r"\d{8}T\d{6}Z-(.+)-[0-9a-f]{8}", re.ASCII)
_ROW = ("trial", "status", "reason")
_NOT_ENDED = "it has not ended, or was killed"


class TrialsRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run of trials, as its journal has it."""

    path: Path
    instance: str
    begun: str
    """ISO 8601, UTC."""
    trials: int
    """The most that were asked for at once, when it was begun or gone on with."""
    rows: tuple[Mapping[str, Any], ...]
    """Of all attempts, in the order in which they ended."""
    ended_early: str
    """Why it ended before its last trial, or has no end; or nothing."""

    @property
    def killed(self) -> bool:
        """Whether it has no end: it is under way, or was killed."""
        return self.ended_early == _NOT_ENDED

    @property
    def done(self) -> int:
        """How many trials ended in a way that counts."""
        return len({one["trial"] for one in self.rows if one["status"] in COUNTED})

    @property
    def document(self) -> dict[str, Any]:
        """What `runs show --json` prints, as `run --json` does; see `schemas/trials-run.schema.json`."""
        return {
            "run": str(self.path),
            "trials": self.trials,
            "done": self.done,
            "ended_early": self.ended_early,
            "rows": [one for one in self.rows if "point" in one],  # an earlier design's, lost by a kill, has none
        }


class KeptRun(msgspec.Struct, frozen=True, kw_only=True):
    """One run in a list, as `schemas/runs.schema.json` describes it."""

    run: str
    """The folder's name."""
    path: str
    verb: str
    instance: str
    begun: str
    ended: bool
    """It came to its end."""
    trials: int | None = None
    done: int | None = None
    changed: int | None = None
    failed: int | None = None
    """Steps that failed, were skipped, or were not begun."""


def trials_run(folder: Path, *, whole: bool = True) -> TrialsRun:
    """Read a run of trials; without `whole`, of its rows only what says which trials count.

    Raises:
        UsageError: The folder holds none, or not what a run writes.
    """
    return trials_of(journal.look(folder, _MOST_JOURNAL), folder, whole=whole)


def trials_of(events: Iterable[Mapping[str, Any]], folder: Path, *, whole: bool = True) -> TrialsRun:
    """Return the same of events that were read already; `folder` is what errors and the answer call it.

    Raises:
        UsageError: They are of no run of trials, or not what one writes.
    """
    kept: list[Mapping[str, Any]] = []
    first, last, asked, cells, ends = None, None, 0, 0, 0
    columns: set[str] = set()
    for event in events:
        first, last = first or event, last if last and event["event"] in (DISCARD, RERUN) else event
        if event["event"] in ("run", "resume"):
            asked = max(asked, integer(event.get("trials"), high=1_000_000))
        elif event["event"] == "end":
            row, more = _row(folder, mapping(event.get("row")))
            kept.append({"event": "end", "row": row if whole else {key: row[key] for key in ("trial", "status")}})
            cells, ends = cells + more, ends + 1
            columns.update(row)
        elif event["event"] in (DISCARD, RERUN):
            kept.append(event)
        if len(columns) > _MOST_COLUMNS:
            raise UsageError(
                f"{folder}: its attempts have more than {_MOST_COLUMNS} columns",
                hint="read its tables",
                code=Code.TOO_LARGE,
            )
        if max(cells, ends * len(columns)) > _MOST_CELLS:  # a table has a cell of each column for each
            raise UsageError(
                f"{folder}: its attempts have more than {_MOST_CELLS} numbers",
                hint="read its tables",
                code=Code.TOO_LARGE,
            )
    if first is None or last is None or first["event"] != "run":
        raise UsageError(f"{folder} holds no run of trials", hint="`srprov runs` lists runs", code=Code.NO_RUN)
    named = _INSTANCE.fullmatch(string(first.get("run")))
    return TrialsRun(
        path=folder,
        instance=named[1] if named else "",
        begun=string(first.get("utc")),
        trials=asked,
        rows=tuple(marked(kept)[0]),
        ended_early=string(last.get("reason")) if last["event"] == "ended" else _NOT_ENDED,
    )


def _row(folder: Path, found: Mapping[str, Any]) -> tuple[dict[str, Any], int]:
    """Return an attempt's row: texts, numbers, and lists of what was measured on each robot; and how much that is.

    Raises:
        UsageError: It is none.
    """
    whole = all(isinstance(found.get(name), str) for name in _ROW) and isinstance(found.get("attempt"), int)
    if not whole or len(found) > _MOST_COLUMNS:
        raise UsageError(f"{folder}: the journal has rows that are none", hint="somebody changed it", code=Code.RECORD)
    cells = {key: value for key, value in found.items() if _is_cell(value)}
    lists = {key: mappings(value) for key, value in found.items() if isinstance(value, list)}
    return {**cells, **lists}, len(found) + sum(len(one) for some in lists.values() for one in some)


def _is_cell(value: object) -> bool:
    return value is None or isinstance(value, str | int) or (isinstance(value, float) and math.isfinite(value))


def is_trials(folder: Path) -> bool:
    """Return whether a folder holds a run of trials, or something that has the name of one's journal."""
    return (folder / journal.NAME).is_file()


def kept_runs(folder: Path) -> Iterator[KeptRun | UsageError]:
    """Return the runs of either kind in a folder, or the one that it is; an error for each that cannot be read.

    Raises:
        UsageError: The folder cannot be read.
    """
    try:
        inside = [folder] if _is_run(folder) else sorted(folder.iterdir())
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror}", hint="name a folder with runs", code=Code.NO_FILE) from None
    for path in inside:
        try:
            if path == folder or _is_run(path):
                yield kept_run(path)
        except UsageError as error:
            yield error
        except OSError as error:
            yield UsageError(f"{path}: {error.strerror}", hint="ask its owner for access", code=Code.NO_FILE)


def _is_run(folder: Path) -> bool:
    return is_trials(folder) or (folder / "environment.json").is_file()


def kept_run(path: Path) -> KeptRun:
    """Return what a list says of one run.

    Raises:
        UsageError: It cannot be read, or is none.
    """
    if is_trials(path):
        one = trials_run(path, whole=False)
        return KeptRun(
            run=path.name, path=str(path), verb="run", instance=one.instance, begun=one.begun,
            ended=one.ended_early != _NOT_ENDED, trials=one.trials, done=one.done,
        )  # fmt: skip
    try:
        about = mapping(record_json(path / "environment.json"))
        ended = (path / "result.json").is_file()
        result = mapping(record_json(path / "result.json")) if ended else {}
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise UsageError(
            f"{path} is no record that can be read: {why}", hint="`srprov runs` lists runs", code=Code.RECORD
        ) from None
    counts = {name: integer(result.get(name), high=1_000_000) for name in ("failed", "skipped", "not_reached")}
    return KeptRun(
        run=path.name,
        path=str(path),
        verb=string(about.get("verb")),
        instance=string(about.get("instance")),
        begun=string(about.get("begun")),
        ended=ended,
        changed=integer(result.get("changed"), high=1_000_000) if ended else None,
        failed=sum(counts.values()) if ended else None,
    )


def kept_steps(path: Path) -> list[Mapping[str, Any]]:
    """Return what came of each step of a run that has ended, as its `result.json` has it; else nothing.

    Raises:
        UsageError: It cannot be read.
    """
    file = path / "result.json"
    try:
        result = mapping(record_json(file)) if file.is_file() else {}
    except (OSError, ValueError) as error:
        raise UsageError(f"{file} cannot be read: {error}", hint="`srprov runs` lists runs", code=Code.RECORD) from None
    steps = mappings(result.get("steps"), most=_MOST_STEPS)
    return [{name: string(one.get(name)) for name in ("id", "outcome", "message")} for one in steps]
