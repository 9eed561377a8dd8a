"""The documents in a folder of `collect`: what earlier calls wrote, and what becomes of it with what came now.

Reads and writes `collected.json`, `containers.json` and `facts.json`. What is here of a robot that is away stays, and
`brought_utc` says when it came.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec

from srprov import private, regular_file
from srprov.codes import Code
from srprov.controller.trial_folder import check_new, check_own
from srprov.errors import UsageError
from srprov.modules.container_taken import without_taken
from srprov.secret import redacted
from srprov.untrusted import mapping, parse_json, string

_LISTING, _CONTAINERS, _FACTS = "collected.json", "containers.json", "facts.json"
_MOST = 256 << 20
"""Bytes of one document."""


class Now(msgspec.Struct, frozen=True, kw_only=True):
    """What robots gave now."""

    robots: Mapping[str, str]
    """Service -> robot."""
    results: Mapping[str, list[dict[str, object]]]
    inspected: Mapping[str, Any]
    """Service -> what its engine says of its container; None where it says nothing."""
    facts: Mapping[str, Any]
    """`facts` as a document."""
    away: Mapping[str, str]
    """Robots that could not be reached, or were lost meanwhile."""
    said: Mapping[str, object]
    """What else `collected.json` says of this call."""


class Earlier(msgspec.Struct, frozen=True, kw_only=True):
    """What earlier calls wrote; nothing in a new folder."""

    collected: Mapping[str, Any]
    containers: Mapping[str, Any]
    facts: Mapping[str, Any]

    def replaced(self, folder: Path, now: Now) -> dict[str, Any]:
        """Write the documents with what came now, and return what `collected.json` says.

        Raises:
            OSError: They cannot be written.
        """
        here = now.facts["robots"].keys() - now.away.keys()
        facts = _with(mapping(self.facts.get("robots")), now.facts["robots"], here)
        # an engine that says nothing of a container takes nothing away
        said = {name for name, found in now.inspected.items() if found is not None and now.robots[name] in here}
        when = dt.datetime.now(dt.timezone.utc).isoformat(timespec="seconds")
        robots = mapping(self.collected.get("robots"))
        known = dict.fromkeys(robots.values(), string(self.collected.get("collected_utc")))
        known |= mapping(self.collected.get("brought_utc"))
        document = {
            "instance": self.collected["instance"],
            "collected_utc": when,
            "robots": {**robots, **now.robots},
            "brought_utc": _sorted(_with(known, dict.fromkeys(now.facts["robots"], when), here)),
            "results": _sorted({**mapping(self.collected.get("results")), **now.results}),
            "unreachable": _sorted(now.away),
            **now.said,
        }
        _keep(folder, _FACTS, {**now.facts, "robots": _sorted(facts)})
        _keep(folder, _CONTAINERS, _with(self.containers, without_taken(now.inspected), said))
        document = dict(mapping(redacted(document)))
        _keep(folder, _LISTING, document)
        return document


def _with(earlier: Mapping[str, Any], now: Mapping[str, Any], newer: Collection[str]) -> dict[str, Any]:
    """Return what is known by now: of what is not `newer`, what an earlier call has comes first."""
    return {**now, **earlier, **{name: now[name] for name in newer}}


def _sorted(values: Mapping[str, Any]) -> dict[str, Any]:
    return dict(sorted(values.items()))


def check_folder(folder: Path, instance: str) -> None:
    """Refuse a folder that is neither new nor of an earlier call for the same instance.

    Raises:
        UsageError, RefusedError: So it is.
    """
    if not (folder / _LISTING).exists():
        check_new(folder, "name a new folder with -o, or one that `srprov collect` made")
        return
    check_own(folder, ())
    read_earlier(folder, instance)


def read_earlier(folder: Path, instance: str) -> Earlier:
    """Return what earlier calls wrote.

    A new folder is of this instance from now on, also when srprov is killed.

    Raises:
        UsageError: Some of it is not what `collect` writes, or it is of another instance.
        OSError: The folder cannot be written.
    """
    if not (folder / _LISTING).exists():
        _keep(folder, _LISTING, {"instance": instance, "robots": {}, "results": {}})
    begin = f'write {{"instance": "{instance}"}} into it: what is here as robots have it is not fetched again'
    collected = _read(folder / _LISTING, begin)
    if not _is_listing(collected):
        raise _broken(folder / _LISTING, "it does not list what came", begin)
    if (before := collected["instance"]) != instance:
        raise UsageError(
            f"{folder} is of {before or 'something else'}", hint="name another folder with -o", code=Code.IN_THE_WAY
        )
    containers, facts = (_read(folder / name, "move it away") for name in (_CONTAINERS, _FACTS))
    return Earlier(collected=collected, containers=containers, facts=facts)


def _is_listing(document: Mapping[str, Any]) -> bool:
    robots, when, results = (document.get(key, {}) for key in ("robots", "brought_utc", "results"))
    return (
        isinstance(document.get("instance"), str)
        and all(isinstance(one, dict) and all(isinstance(text, str) for text in one.values()) for one in (robots, when))
        and isinstance(results, dict)
        and all(isinstance(some, list) and all(isinstance(one, dict) for one in some) for some in results.values())
    )


def _read(path: Path, remedy: str) -> Mapping[str, Any]:
    """Return a document; an empty one where there is none.

    Raises:
        UsageError: It is broken.
    """
    try:
        text = regular_file.read_text(path, _MOST)
        document = parse_json(text, max_characters=_MOST, max_values=_MOST)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise _broken(path, getattr(error, "strerror", None) or str(error), remedy) from error
    if not isinstance(document, dict):
        raise _broken(path, "it is no map", remedy)
    return document


def _broken(path: Path, why: str, remedy: str) -> UsageError:
    hint = f"nothing was changed, and what came is there; keep a copy and {remedy}; or name another folder with -o"
    return UsageError(f"{path} is broken: {why}", hint=hint, code=Code.RECORD)


def _keep(folder: Path, name: str, document: object) -> None:
    private.replace_json(folder / name, redacted(document))
