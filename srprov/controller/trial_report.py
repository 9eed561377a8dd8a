"""What came of a run of trials: for the exit code, for people, and as JSON. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from srprov.controller.run import RunReport
from srprov.names import few
from srprov.trials import Design
from srprov.trials.judge import COUNTED
from srprov.untrusted import integer

_MOST_NAMED = 5


class TrialsReport(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a run."""

    folder: Path
    rows: Sequence[Mapping[str, object]]
    """Of all attempts, in the order in which they ended; also of trials that are not in `design`."""
    design: Design
    """What was asked for."""
    ended_early: str
    """Why the run ended before its last trial, or nothing."""
    discarded: frozenset[str] = frozenset()
    """Trials that count no more, and are not run."""
    forgetful: str = ""
    """Why this machine does not remember which images the run had, or nothing."""
    base: RunReport | None = None
    """What came of what is there over all trials, when something was to be done."""

    @property
    def attempts(self) -> Mapping[str, Sequence[Mapping[str, object]]]:
        """Trial -> its attempts, for those that were asked for and begun; in the design's order."""
        found: dict[str, list[Mapping[str, object]]] = {trial.id: [] for trial in self.design.trials}
        for one in self.rows:
            if (some := found.get(str(one["trial"]))) is not None:
                some.append(one)
        return {trial: some for trial, some in found.items() if some}

    @property
    def done(self) -> int:
        """How many trials ended in a way that counts."""
        return sum(any(one["status"] in COUNTED for one in some) for some in self.attempts.values())

    @property
    def exit_code(self) -> int:
        """0 when every trial ended in a way that counts, whatever its verdict."""
        if self.base is not None and self.base.result.exit_code:
            return self.base.result.exit_code
        if self.ended_early == "interrupted":
            return 130
        left = {one.id for one in self.design.trials} - self.discarded
        return 0 if self.done >= len(left) else 3

    @property
    def document(self) -> dict[str, Any]:
        """What `run --json` prints; see `schemas/trials-run.schema.json`."""
        return {
            "run": str(self.folder),
            "trials": len(self.design.trials),
            "done": self.done,
            "ended_early": self.ended_early,
            "rows": [one for some in self.attempts.values() for one in some],
        }

    @property
    def loading(self) -> str:
        """Python that loads the attempts that count; an id of digits alone is no number."""
        table = str(self.folder / "trials.csv")
        return f"pandas.read_csv({table!r}, dtype={{'point': str}}).query(\"status in {list(COUNTED)}\")"

    def in_words(self) -> list[str]:
        """Return how the trials ended, each counted once, and which of them took more than one attempt."""
        attempts, total = self.attempts, len(self.design.trials)
        counts: dict[str, int] = {}
        for some in attempts.values():
            word = _word(next((one for one in some if one["status"] in COUNTED), some[-1]))
            counts[word] = counts.get(word, 0) + 1
        told = [f"{count} {word}" for word, count in sorted(counts.items())]
        if out := self.discarded & {one.id for one in self.design.trials} - attempts.keys():
            told.append(f"{len(out)} discarded before any attempt")
        if left := total - len(attempts) - len(out):
            told.append(f"{left} not begun")
        again = [f"{trial} ({len(some)} attempts)" for trial, some in attempts.items() if len(some) > 1]
        repeated = [f"tried again: {few(again, _MOST_NAMED)}"] if again else []
        unclosed = sum(integer(one.get("unclosed")) for some in attempts.values() for one in some)
        bags = [f"{_bags(unclosed)}; collected.json of each trial names what"] if unclosed else []
        return [f"{self.done} of {total} trials count: {'; '.join(told)}", *repeated, *bags]


def _word(one: Mapping[str, object]) -> str:
    judged = one.get("verdict")
    return f"{one['status']}, {judged}" if judged not in (None, "unknown") else str(one["status"])


def _bags(unclosed: int) -> str:
    return f"{unclosed} recording{'s' * (unclosed != 1)} not closed"


def in_words(one: Mapping[str, object]) -> str:
    """Return how one attempt ended."""
    duration = one.get("duration_s")
    took = f" after {duration:.1f} s" if isinstance(duration, float) else ""
    judged = one.get("verdict")
    verdict_word = f", {judged}" if judged not in (None, "unknown") else ""
    bags = f"; {_bags(unclosed)}" if (unclosed := integer(one.get("unclosed"))) else ""
    return f"{one['status']}{verdict_word}{took}: {one['reason']}{bags}"
