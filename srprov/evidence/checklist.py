"""CHECKLIST.md: what reviewers of artifacts ask, and what of that a bundle shows. Pure.

Nothing is ticked: each row says what is in the bundle, or that the authors must say it.

Source: ACM, Artifact Review and Badging, version 1.1, and what committees ask for each of its badges
(https://sysartifacts.github.io).
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping
from typing import Any

from srprov.evidence.citation import CITATION, LICENSE, LICENSES, authors, given
from srprov.evidence.crate_base import Told, ended_utc, of_robot, utc
from srprov.evidence.deposits import DATACITE, ZENODO, instruments
from srprov.names import few
from srprov.trials.judge import COUNTED
from srprov.untrusted import decimal, mapping, string

NAME = "CHECKLIST.md"
_AUTHORS = "**the authors must say**"
_MOST_SHOWN = 5
Rows = Iterable[tuple[str, str]]


def text(told: Told) -> bytes:
    """Return CHECKLIST.md."""
    parts = {
        "Artifacts available": _available(told),
        "Artifacts evaluated: functional": _functional(told),
        "Artifacts evaluated: reusable": _reusable(told),
        "Results reproduced": _reproduced(told),
        "Results replicated": [("other artifacts than these give the same results", _AUTHORS)],
    }
    lines = [
        "# What reviewers ask",
        "",
        "After the badges of ACM, version 1.1. Nothing is ticked here: a row says what the bundle shows, or that the",
        f"authors must say it. `srprov verify` checks the bundle; {NAME} follows from it.",
    ]
    for title, rows in parts.items():
        lines += ["", f"## {title}", "", "| asked | shown |", "|---|---|"]
        lines += [f"| {asked} | {_cell(shown)} |" for asked, shown in rows]
    return ("\n".join(lines) + "\n").encode("utf-8", "replace")


def _cell(shown: str) -> str:
    return shown.replace("|", "/").replace("\n", " ")


def _available(told: Told) -> Rows:
    license_ = given(told, "license")
    own = next((name for name in LICENSES if name in told.own), "")
    named = ", ".join(name for name, _ in authors(told))
    ready = f"`{ZENODO}` and `{DATACITE}` are ready for one"
    yield "it is in a public archive, with an identifier", f"{_AUTHORS} where; {ready}"
    yield "the paper that it belongs to", given(told, "doi") or _AUTHORS
    yield "who made it", f"`{CITATION}`: {named}" if named else _AUTHORS
    if license_ or own:
        yield "its license", f"`{LICENSE}`: {license_ or f'the experiment has the file {own}'}"
    else:
        yield "its license", _AUTHORS


def _functional(told: Told) -> Rows:
    yield "documented: files and tables", "`README.md`, `csv-metadata.json`"
    yield "documented: what is measured and why", _descriptions(told)
    yield "consistent: each file is as it was made", "`manifest-sha256.txt`; `srprov verify` says whether it is so"
    yield "complete: definitions", f"`{told.story.home}/inputs/`, all that the EDF names but data sets"
    yield "complete: images", _images(told)
    yield "complete: data sets", _data_sets(told)
    yield "exercisable: a small example, and its command", _shortest(told)
    yield "exercisable: systems that it ran on", _systems(told)


def _descriptions(told: Told) -> str:
    given_ = told.story.given
    every = [*((f"parameter {one.name}", one.description) for one in given_.parameters),
             *((f"metric {one.name}", one.description) for one in given_.metrics),
             ("the experiment", told.story.definitions.experiment.description)]  # fmt: skip
    missing = [name for name, description in every if not description]
    if not missing:
        return "the EDF describes the experiment, each parameter and each metric"
    return f"{_AUTHORS}: the EDF has no description of {few(missing, _MOST_SHOWN)}"


def _images(told: Told) -> str:
    services = told.story.images
    known = sum(1 for _, digest in services.values() if digest)
    ids = f"ids of {known} of {len(services)} services in `ro-crate-metadata.json`"
    if any(name.startswith("images/") for name in told.files):
        return f"`images/`; {ids}"
    return f"{ids}; whether they can be had: {_AUTHORS}, since they are not in the bundle"


def _data_sets(told: Told) -> str:
    if not told.data_sets:
        return "it has none from files"
    count = len(told.data_sets)
    return f"sha256 of {count} in `{told.story.home}/inputs.json`; where they can be had: {_AUTHORS}"


def _shortest(told: Told) -> str:
    ended = [row for row in told.story.rows if row.get("status") in COUNTED]
    timed = [(_seconds(row.get("duration_s")), string(row.get("trial"))) for row in ended]
    if not timed:
        return f"{_AUTHORS}: no trial counts"
    seconds, trial = min(timed)
    return f"`srprov replay BUNDLE -i INVENTORY -o again --only {trial}`; that trial took {seconds:.1f} s"


def _systems(told: Told) -> str:
    robots = [mapping(one) for _, one in sorted(mapping(told.facts.get("robots")).items())]
    kinds = sorted({f"{of_robot(one.get('os'))}, {of_robot(one.get('arch'))}, Docker {_docker(one)}" for one in robots})
    return "; ".join(kinds[:_MOST_SHOWN]) + (f"; {len(kinds) - _MOST_SHOWN} more" if kinds[_MOST_SHOWN:] else "")


def _docker(one: Mapping[str, Any]) -> str:
    return of_robot(mapping(one.get("docker")).get("version")) or "unknown"


def _reusable(told: Told) -> Rows:
    files = [name for name in told.files if name.startswith(f"{told.story.home}/rendered/")]
    dockerfiles = sum(name.endswith(".Dockerfile") for name in files)
    built = f"{dockerfiles} Dockerfiles in `{told.story.home}/rendered/`"
    yield "how images are built", built if dockerfiles else "srprov built none: all come from elsewhere"
    yield "where the definitions are kept", _source(told)
    yield "how others change it", f"parameters of `{told.story.edf}`: {_parameters(told)}"


def _source(told: Told) -> str:
    source = mapping(told.environment.get("source"))
    commit = string(source.get("commit"))
    if not commit:
        return f"{_AUTHORS}: they were in no git repository"
    state = "with changes" if source.get("dirty") else "without changes"
    return f"commit {commit} of a git repository, {state}; where that is: {_AUTHORS}"


def _parameters(told: Told) -> str:
    return ", ".join(one.name for one in told.story.given.parameters) or "it has none"


def _reproduced(told: Told) -> Rows:
    robots = mapping(told.facts.get("robots"))
    pids = [name for name, _ in instruments(told)]
    tokens = sum(bool(mapping(one).get("machine_id")) for one in robots.values())
    yield "the exact environment", f"`{told.story.home}/facts.json`, image ids, `{told.story.home}/environment.json`"
    yield "which hardware", f"{len(robots)} robots: {tokens} with a token, {len(pids)} with a persistent identifier"
    yield "which result supports which claim", _AUTHORS
    yield "the command for all of it", "`srprov replay BUNDLE -i INVENTORY -o again --map OLD=NEW`"
    yield "time, robots and disk that it takes", _resources(told)
    yield "when results count as equal", _margins(told)


def _resources(told: Told) -> str:
    begun = next((found for one in told.story.events if (found := utc(one.get("utc")))), "")
    try:
        took = dt.datetime.fromisoformat(ended_utc(told.story)) - dt.datetime.fromisoformat(begun)
        seconds = f"{took.total_seconds():.0f} s from the first event to the last"
    except ValueError:
        seconds = "no times are recorded"
    used = len(set(told.story.services.values()))
    return f"{seconds}; {used} robots; {told.size / 1e6:.1f} MB of files"


def _margins(told: Told) -> str:
    metrics = told.story.given.metrics
    stated = [f"{one.name} {one.margin.text}" for one in metrics if one.margin is not None]
    missing = [one.name for one in metrics if one.margin is None]
    shown = [f"margins in the EDF: {', '.join(stated)}"] if stated else []
    shown += [f"{_AUTHORS}: a margin for {', '.join(missing)}"] if missing else []
    return "; ".join(shown) or "there are no metrics"


def _seconds(value: object) -> float:
    return decimal(value, low=0.0, high=1e9, default=0.0)
