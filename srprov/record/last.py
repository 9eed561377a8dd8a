"""The last recorded run of an instance, and the robots on which it did not do all that it should: `@failed`.

Takes the folder of records and an instance; reads the newest record of it that is of no `stop`, `start` or `restart`;
gives a LastRun. A run that came to its end
says so in `result.json`. Of one that was killed, plan and events tell how far it came.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.execution import Outcome
from srprov.untrusted import mapping, parse_json, string

_NAME = re.compile(r"(?P<time>\d{8}T\d{6}Z)-(?P<instance>.+)-[0-9a-f]{8}(?:-\d{1,2})?", re.ASCII)
_LARGEST = 32 * regular_file.MIB
"""Bytes of one file of a record."""
_HANDLING = frozenset({"stop", "start", "restart"})
"""Verbs whose records tell nothing of what an instance should be."""
_DONE = frozenset({Outcome.CHANGED.value, Outcome.UNCHANGED.value})


class LastRun(msgspec.Struct, frozen=True, kw_only=True):
    """One record, read again."""

    path: Path
    failed: frozenset[str]
    """Robots with a step that failed, was skipped or was never begun, and robots that could not be reached."""


def last_run(root: Path, instance: str) -> LastRun | None:
    """Read the newest record of an instance below `root`, as `newest` has it; None when there is none.

    Raises:
        UsageError: It cannot be read, or is no record.
    """
    path = next(newest(records(root, instance).get(instance, [])), None)
    if path is None:
        return None
    try:
        return LastRun(path=path, failed=frozenset(_failed(path)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        hint = "name the robots instead of @failed, or remove that folder"
        raise UsageError(f"{path} is no record that can be read: {error!r}", hint=hint, code=Code.RECORD) from error


def last_verb(root: Path, instance: str) -> str:
    """Return what made the newest record of an instance, as `newest` has it; empty where there is none.

    Raises:
        UsageError: The folder cannot be read.
    """
    return next((_verb(path) for path in newest(records(root, instance).get(instance, []))), "")


def records(root: Path, only: str = "") -> dict[str, list[Path]]:
    """Return instance -> its records below `root`, the newest last; of one instance, if it is named.

    Raises:
        UsageError: The folder cannot be read.
    """
    found: dict[str, list[Path]] = {}
    try:
        for path in root.iterdir():
            named = _NAME.fullmatch(path.name)
            if named and only in ("", named["instance"]) and path.is_dir():
                found.setdefault(named["instance"], []).append(path)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise UsageError(
            f"{root}: {error.strerror}", hint="name another folder with --runs", code=Code.RECORD
        ) from error
    return {instance: sorted(paths, key=_begun) for instance, paths in found.items()}


def newest(folders: list[Path]) -> Iterator[Path]:
    """Return records, the newest first, without those of `stop`, `start` and `restart`: they apply nothing."""
    return (path for path in reversed(folders) if _verb(path) not in _HANDLING)


def _verb(path: Path) -> str:
    """Return what made a record; empty where it does not say."""
    try:
        return string(mapping(record_json(path / "environment.json")).get("verb"))
    except (OSError, ValueError):
        return ""


def _begun(path: Path) -> tuple[str, int, str]:
    """Order records by the second in their name, and within it by when their first file was written."""
    try:
        written = (path / "environment.json").stat().st_mtime_ns
    except OSError:
        written = 0
    return path.name[:16], written, path.name


def _failed(path: Path) -> Iterator[str]:
    result = path / "result.json"
    if result.exists():
        read = record_json(result)
        yield from read["unreachable"]
        yield from (str(step["id"]).partition("/")[0] for step in read["steps"] if step["outcome"] not in _DONE)
        return
    plan = record_json(path / "plan.json")
    done = {event["step"] for event in _events(path) if event["event"] == "end" and event["outcome"] in _DONE}
    yield from plan["unreachable"]
    yield from (step["robot"] for step in plan["steps"] if step["number"] not in done)


def _events(path: Path) -> Iterator[Mapping[str, Any]]:
    """Return the events that are whole: the last line of a killed run may not be."""
    for line in _text(path / "events.jsonl").split("\n"):
        try:
            yield parse_json(line)
        except ValueError:
            continue


def record_json(path: Path) -> Any:  # noqa: ANN401 - JSON is any
    """Return a file of a record; OSError or ValueError where that is not possible."""
    return parse_json(_text(path), max_characters=_LARGEST)


def _text(path: Path) -> str:
    """Return the text of a file of a record, which is no link: a folder may come from a stranger."""
    if path.is_symlink():
        raise OSError(errno.ELOOP, "it is a link, and srprov makes none", str(path))
    return regular_file.read_text(path, _LARGEST)
