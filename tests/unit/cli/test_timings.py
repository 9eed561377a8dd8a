"""The table names phases in their order and the slowest robots first."""

from __future__ import annotations

from typing import Any

from srprov.cli.timings import timings_text


def robot(connect: float, asked: float = 0.0, **more: Any) -> dict[str, Any]:
    base = {"connect_s": connect, "asked_s": asked, "acted_s": 0.0, "round_trips": 5, "bytes_sent": 2048}
    return {**base, "bytes_received": 3 << 20, **more}


def test_slowest_first() -> None:
    text = timings_text({"definitions": 0.1, "facts": 1.25}, {"r1": robot(0.1), "r2": robot(0.1, 2.0)})
    lines = [line.split() for line in text.splitlines()]
    assert ["definitions", "0.100"] in lines and ["facts", "1.250"] in lines
    assert [line[0] for line in lines if line and line[0] in ("r1", "r2")] == ["r2", "r1"]
    assert ["r2", "0.100", "2.000", "0.000", "5", "2.0", "KiB", "3.0", "MiB"] in lines


def test_many_robots_are_counted() -> None:
    text = timings_text({}, {f"r{n:03}": robot(n / 10) for n in range(50)})
    assert text.splitlines()[-1] == "and 30 faster ones" and "r049" in text and "r000" not in text
