"""A robot's CPUs, load, memory and swap. Pure; what a robot says is untrusted.

Source: proc(5), sysfs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov.facts.answers import Files
from srprov.session import Measures
from srprov.untrusted import decimal, integer

_MOST_BYTES = 2**60


def amounts(files: Files, counted: int, measures: Measures | None) -> dict[str, Any]:
    """Return CPUs, load, memory and swap, consistent with each other: free is never more than total."""
    raw: Mapping[str, object]
    if measures is not None:
        raw = {
            "cpus": measures.cpus,
            "load1": measures.load1,
            "memory_total": measures.memory_total,
            "memory_available": measures.memory_available,
            "swap_total": measures.swap_total,
            "swap_free": measures.swap_free,
        }
    else:
        load = files.get("/proc/loadavg", ("",))[0].partition(" ")[0]
        raw = {"cpus": counted or _online(files), "load1": load, **_memory(files)}
    bounded = {
        key: integer(raw[key], low=0, high=_MOST_BYTES, default=0) for key in raw if key not in ("cpus", "load1")
    }
    return {
        "cpus": integer(raw["cpus"], low=1, high=4096, default=1),
        "load1": decimal(raw["load1"], low=0.0, high=100_000.0, default=0.0),
        "memory_total": bounded["memory_total"],
        "memory_available": min(bounded["memory_available"], bounded["memory_total"]),
        "swap_total": bounded["swap_total"],
        "swap_free": min(bounded["swap_free"], bounded["swap_total"]),
    }


def _memory(files: Files) -> dict[str, int]:
    kib = {}
    for line in files.get("/proc/meminfo", ()):
        name, _, amount = line.partition(":")
        kib[name] = integer(amount.removesuffix("kB").strip(), low=0, high=_MOST_BYTES // 1024, default=0)
    # MemAvailable came with Linux 3.14; this sum is what tools used before.
    before = sum(kib.get(name, 0) for name in ("MemFree", "Buffers", "Cached"))
    return {
        "memory_total": kib.get("MemTotal", 0) * 1024,
        "memory_available": kib.get("MemAvailable", before) * 1024,
        "swap_total": kib.get("SwapTotal", 0) * 1024,
        "swap_free": kib.get("SwapFree", 0) * 1024,
    }


def _online(files: Files) -> int:
    """Count `0-3,6` of /sys, for kernels whose /proc/cpuinfo numbers no processors."""
    total = 0
    for part in files.get("/sys/devices/system/cpu/online", ("",))[0].strip().split(",")[:4096]:
        first, _, last = part.partition("-")
        low = integer(first, low=0, high=4095, default=-1)
        high = integer(last or first, low=0, high=4095, default=-1)
        total += high - low + 1 if 0 <= low <= high else 0
    return total
