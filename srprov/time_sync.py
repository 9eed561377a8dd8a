"""What keeps a robot's clock, by what chrony or systemd-timesyncd say of themselves. Pure.

Source: chronyc(1), `tracking` and `-c`; systemd-timesyncd.service(8), /run/systemd/timesync/synchronized.
"""

from __future__ import annotations

import re

import msgspec

from srprov.untrusted import decimal, lines_of

SCRIPT = """\
command -v chronyc >/dev/null 2>&1 && printf '/chrony:%s\\n' "$(timeout 2 chronyc -c -n tracking 2>/dev/null)"
[ -d /run/systemd/timesync ] && for f in /run/systemd/timesync/synchronized; do
  [ -e "$f" ] && echo /timesyncd:yes || echo /timesyncd:no
done
:"""
"""What a robot's shell is asked; it only reads."""
_FIELDS = 14
_MOST_LINES = 20_000


class TimeSync(msgspec.Struct, frozen=True, kw_only=True):
    """What keeps a clock, and how well."""

    daemon: str
    """`chrony` or `timesyncd`"""
    synchronised: bool
    bound_s: float | None = None
    """How far from the time of its source the clock is at most, as chrony says."""

    @property
    def in_words(self) -> str:
        """Say it."""
        bound = "" if self.bound_s is None else f", within {1000 * self.bound_s:.1f} ms of its source"
        return f"{self.daemon}: synchronised{bound}" if self.synchronised else f"{self.daemon}: not synchronised"


def parse(out: str) -> TimeSync | None:
    """Return what stands in an answer to `SCRIPT`, among other lines or not; None where neither runs."""
    timesyncd = None
    for line in lines_of(out, _MOST_LINES):
        if line.startswith("/chrony:") and (found := _chrony(line.removeprefix("/chrony:"))):
            return found
        if line.startswith("/timesyncd:"):
            timesyncd = TimeSync(daemon="timesyncd", synchronised=line == "/timesyncd:yes")
    return timesyncd


def _chrony(line: str) -> TimeSync | None:
    """Read `tracking`; a chronyc whose daemon does not run prints no such line."""
    fields = line[:1000].split(",")
    if len(fields) < _FIELDS or not re.fullmatch("[0-9A-F]{8}", fields[0]):
        return None
    offset, delay, dispersion = (decimal(fields[at], low=-1e9, high=1e9, default=1e10) for at in (4, 10, 11))
    known = fields[13].strip() != "Not synchronised" and max(offset, delay, dispersion) <= 1e9
    return TimeSync(
        daemon="chrony", synchronised=known, bound_s=abs(offset) + dispersion + delay / 2 if known else None
    )
