"""A run as it is compared: its story, the attempts that count, and what their robots were.

Reads run folders and bundles; of a bundle every file must have the hash of its manifest.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.evidence import checks_files, story
from srprov.evidence.checks_files import Hashed
from srprov.evidence.files import Files, NotThere, json_of, of_run, opened
from srprov.evidence.story import Story, attempt_folder
from srprov.evidence.verified import Bundle, reopened
from srprov.trials import Trial
from srprov.trials.judge import COUNTED
from srprov.trials.marks import Row
from srprov.untrusted import decimal, mapping, string

_MOST = 1e50
"""Of a metric: a stranger's may be anything, and is squared."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run, with what is read from it when it is asked for."""

    name: str
    """As the user named it."""
    files: Files
    story: Story
    only: frozenset[str] = frozenset()
    """Trials and points that are compared; empty: all."""

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Return the trials of the last session's design that are compared, in its order."""
        every = self.story.last.design.trials
        return tuple(one for one in every if not self.only or self.only & {one.id, one.point.id})

    @cached_property
    def inputs(self) -> Mapping[str, Any]:
        """Return which files it was made of."""
        return json_of(self.files, f"{self.story.home}/inputs.json")

    @cached_property
    def robots(self) -> Mapping[str, Any]:
        """Return robot -> facts."""
        return mapping(json_of(self.files, f"{self.story.home}/facts.json").get("robots"))

    @cached_property
    def counted(self) -> tuple[Row, ...]:
        """Return the attempts that count, one of each trial, in the order in which they ended."""
        last = {string(row.get("trial")): row for row in self.story.rows if row.get("status") in COUNTED}
        wanted = {one.id for one in self.trials}
        return tuple(row for name, row in last.items() if not self.only or name in wanted)

    @cached_property
    def images(self) -> Mapping[str, tuple[str, str]]:
        """Return service -> its image's name, and the id that its engine gave to it; empty where nothing says it."""
        found = {name: ("", string(mapping(one).get("Image"))) for name, one in self._containers.items()}
        stated = self.story.images
        return {**found, **{name: (one, id_ or found.get(name, ("", ""))[1]) for name, (one, id_) in stated.items()}}

    @property
    def _containers(self) -> Mapping[str, Any]:
        """Return what engines said of the containers of the last trial that counts."""
        try:
            return json_of(self.files, f"{attempt_folder(self.counted[-1])}/containers.json") if self.counted else {}
        except NotThere:
            return {}

    def values(self, metric: str) -> dict[str, dict[str, float]]:
        """Return point -> trial -> value of a metric, of the trials that gave it."""
        found: dict[str, dict[str, float]] = {}
        for row in self.counted:
            value = decimal(row.get(f"m_{metric}"), low=-_MOST, high=_MOST, default=math.nan)
            if not math.isnan(value):
                found.setdefault(string(row.get("point")), {})[string(row.get("trial"))] = value
        return found


@contextmanager
def read(
    paths: Sequence[str], only: Collection[str] = (), verified: Collection[Bundle] = ()
) -> Iterator[tuple[Run, ...]]:
    """Read runs, each the folder of one or a bundle; they are open as long as the block lasts.

    Args:
        paths: Where they are.
        only: Trials and points that are compared; empty: all.
        verified: Those of them that were verified before.

    Raises:
        UsageError: One is neither, or cannot be read, or does not have the hashes of its manifest.
    """
    with ExitStack() as stack:
        known = {one.path: one for one in verified}
        yield tuple(_read(path, stack, frozenset(only), known.get(path)) for path in paths)


def _read(path: str, stack: ExitStack, only: frozenset[str], verified: Bundle | None) -> Run:
    try:
        if Path(path).is_dir():
            files: Files = of_run(Path(path))
        else:
            files = stack.enter_context(reopened(verified)) if verified else _checked(path, stack)
        return Run(name=path, files=files, story=stack.enter_context(story.read(files)), only=only)
    except (OSError, ValueError) as error:
        hint = "name the folder of a run of trials, or what `srprov bundle` made of one"
        raise UsageError(f"{path} cannot be compared: {error}", hint=hint, code=Code.NOT_COMPARABLE) from error


def _checked(path: str, stack: ExitStack) -> Files:
    """Return the files of a bundle, each of which has the hash of its manifest."""
    hashed = Hashed(stack.enter_context(opened(path)))
    if wrong := next(chain(checks_files.hashes(hashed), checks_files.nothing_else(hashed)), ""):
        raise UsageError(
            f"{path}: {wrong}",
            hint=f"srprov verify {shlex.quote(path)} says what else is wrong",
            code=Code.NOT_COMPARABLE,
        )
    return hashed.bound().files
