"""Limits before a trial: what surely is beyond one, and what cannot be told."""

from __future__ import annotations

import pytest

from srprov.definitions.trialsmodel import Limits
from srprov.trials.clock import Offset
from srprov.trials.hosts import HostReading
from srprov.trials.limits import check

LIMITS = Limits(clock_offset_s=0.02, disk_free_bytes=2 << 30, battery_percent=30, temperature_c=80.0)
GOOD = HostReading(disk_free=2 << 30, battery_percent=30, temperature_c=80.0)


def clock(offset_ms: float, error_ms: float) -> Offset:
    return Offset(offset_s=offset_ms / 1000, error_s=error_ms / 1000, rtt_s=error_ms / 500, samples=16)


@pytest.mark.parametrize(
    ("one", "reading", "surely", "said"),
    [
        (clock(20, 0), GOOD, None, ""),
        (clock(-12, 8), GOOD, None, ""),
        (clock(-12, 9), GOOD, False, "r1: its clock is 12.0 ms off (+-9.0 ms), so it may be more than 20.0 ms"),
        (clock(29, 10), GOOD, False, "so it may be more than"),
        (clock(31, 10), GOOD, True, "r1: its clock is 31.0 ms off (+-10.0 ms), and may be 20.0 ms"),
        (clock(-2031, 10), GOOD, True, "its clock is 2.0 s off"),
        (None, GOOD, False, "it gives no time"),
        (clock(0, 1), HostReading(disk_free=(2 << 30) - 1, battery_percent=99, temperature_c=9.0), True,
         "r1: 2048 MiB of its disk are free, and 2048 MiB are wanted"),
        (clock(0, 1), HostReading(disk_free=9 << 30, battery_percent=29, temperature_c=9.0), True,
         "r1: 29 % are left in its battery, and 30 % are wanted"),
        (clock(0, 1), HostReading(disk_free=9 << 30, battery_percent=99, temperature_c=80.5), True,
         "r1: it has 80.5 °C, and may have 80"),
        (clock(0, 1), HostReading(battery_percent=99, temperature_c=9.0), False, "how much of its disk is free"),
        (clock(0, 1), HostReading(disk_free=9 << 30, temperature_c=9.0), False, "how much is left in its battery"),
        (clock(0, 1), HostReading(disk_free=9 << 30, battery_percent=99), False, "how warm it is"),
    ],
)  # fmt: skip
def test_a_robot_is_compared_with_the_limits(
    one: Offset | None, reading: HostReading, surely: bool | None, said: str
) -> None:
    found = check(LIMITS, "r1", one, reading)
    assert [finding.surely for finding in found] == ([] if surely is None else [surely])
    assert all(said in finding.text and finding.text.startswith("r1: ") for finding in found)


def test_without_limits_nothing_is_compared() -> None:
    assert not Limits(wait_s=5.0).any
    assert check(Limits(), "r1", None, HostReading()) == []
