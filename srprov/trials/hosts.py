"""The counters of a whole robot, from /proc and /sys: read before and after a trial, and the difference. Pure.

Source: proc(5); the kernel's documents on iostats, thermal sysfs-api and power_supply; `get_throttled` of a Pi.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import msgspec

from srprov import time_sync
from srprov.time_sync import TimeSync
from srprov.trials.files import Files, by_file, first, links, number, total
from srprov.untrusted import decimal, lines_of

SCRIPT = (
    """\
grep -sHa '^cpu' /proc/stat
grep -sHa '^MemAvailable:' /proc/meminfo
grep -sHa cgroup /proc/self/mountinfo
printf '/disks:%s\\n' /sys/block/*/device
grep -sHa '' /proc/uptime /proc/net/dev /proc/diskstats /sys/class/thermal/thermal_zone*/temp \
/sys/class/power_supply/*/type /sys/class/power_supply/*/scope /sys/class/power_supply/*/capacity \
/sys/devices/system/cpu/cpu*/thermal_throttle/core_throttle_count \
/sys/devices/platform/soc/soc:firmware/get_throttled
"""
    + time_sync.SCRIPT
)
"""What is asked of a robot's shell, after `df -Pk` of the folder that holds Docker's data."""
MOUNTINFO = "/proc/self/mountinfo"
COLUMNS = (
    *("measured_s", "cpus", "cpu_s", "cpu_steal_s", "memory_available_start_bytes", "memory_available_end_bytes"),
    *("disk_read_bytes", "disk_written_bytes", "net_received_bytes", "net_sent_bytes"),
    *("overlay_received_bytes", "overlay_sent_bytes", "temperature_start_c", "temperature_end_c"),
    *("battery_start_percent", "battery_end_percent", "throttled"),
)
_TICKS = 100
"""Of /proc/stat, a second: USER_HZ of all architectures that Docker runs on."""
_SECTOR = 512
"""Bytes, in /proc/diskstats, whatever the disk's own are."""
_ZONE = re.compile(r"/sys/class/thermal/thermal_zone[0-9]{1,4}/temp")
_SUPPLY = re.compile(r"(/sys/class/power_supply/[^/]{1,60})/capacity")
_THROTTLE = re.compile(r"/sys/devices/system/cpu/cpu[0-9]{1,4}/thermal_throttle/core_throttle_count")
_NOW, _SINCE_BOOT = 0xF, 0xF0000


class HostReading(msgspec.Struct, frozen=True, kw_only=True):
    """A robot at one moment; None where it does not say."""

    uptime_s: float | None = None
    cpus: int | None = None
    busy_s: float | None = None
    """Of all its processors, since it booted."""
    steal_s: float | None = None
    memory_available: int | None = None
    disk_free: int | None = None
    """Bytes, where Docker keeps its data."""
    read: int | None = None
    """Bytes, of all disks that are devices."""
    written: int | None = None
    links: Mapping[str, tuple[int | None, int | None]] = msgspec.field(default_factory=dict)
    """Interface -> bytes received and sent."""
    temperature_c: float | None = None
    """The warmest zone's."""
    battery_percent: int | None = None
    """The emptiest battery's."""
    throttle_count: int | None = None
    throttle_bits: int | None = None
    time_sync: TimeSync | None = None
    """None: nothing that is known keeps its clock."""


def read(out: str) -> HostReading:
    """Return what a robot's answer says."""
    files = by_file(out)
    processors = [line.split() for line in files.get("/proc/stat", ())]
    whole = next((words for words in processors if words[:1] == ["cpu"]), [])
    received, written = _disks(files)
    return HostReading(
        uptime_s=_decimal(files.get("/proc/uptime", ("",))[0].partition(" ")[0], 1.0),
        cpus=sum(words[0] != "cpu" for words in processors if words) or None,
        # user, nice, system, irq and softirq; not idle and iowait; guests are in user
        busy_s=_ticks([whole[at] for at in (1, 2, 3, 6, 7) if at < len(whole)]),
        steal_s=_ticks(whole[8:9]),
        memory_available=_memory(files),
        disk_free=_free(out),
        read=received,
        written=written,
        links=links(files.get("/proc/net/dev", ())),
        temperature_c=_temperature(files),
        battery_percent=_battery(files),
        throttle_count=total(first(files, path) for path in files if _THROTTLE.fullmatch(path)),
        throttle_bits=_bits(files),
        time_sync=time_sync.parse(out),
    )


def _decimal(text: str, unit: float) -> float | None:
    value = decimal(text, low=-1e15, high=1e15, default=1e16)
    return None if value > 1e15 else value * unit


def _ticks(words: Sequence[str]) -> float | None:
    counted = total(number(word) for word in words)
    return None if counted is None else counted / _TICKS


def _memory(files: Files) -> int | None:
    words = files.get("/proc/meminfo", ("",))[0].split()
    kib = number(words[1]) if len(words) == 3 and words[0] == "MemAvailable:" else None
    return None if kib is None else kib * 1024


def _free(out: str) -> int | None:
    """Return what the last line of `df -Pk` says, before all files."""
    words = lines_of(out, 3)[1:2]
    row = words[0].rsplit(None, 5)[1:] if words and not words[0].startswith("/proc") else []
    kib = number(row[2]) if len(row) == 5 else None
    return None if kib is None else kib * 1024


def _disks(files: Files) -> tuple[int | None, int | None]:
    """Return the bytes read and written: of disks, not of partitions or what is made of them, which counts twice."""
    disks = {path.split("/")[3] for path in files.get("/disks", ()) if path.count("/") == 4}
    rows = [row for line in files.get("/proc/diskstats", ()) if len(row := line.split()) >= 10 and row[2] in disks]
    counts = [total(number(row[at]) for row in rows) for at in (5, 9)]
    read, written = (None if one is None else one * _SECTOR for one in counts)
    return read, written


def _temperature(files: Files) -> float | None:
    """Return the warmest zone's degrees; a sensor that is off says absurd ones."""
    every = [_decimal(lines[0], 1e-3) for path, lines in files.items() if _ZONE.fullmatch(path)]
    return max((one for one in every if one is not None and -60 < one < 200 and one), default=None)


def _battery(files: Files) -> int | None:
    """Return the emptiest battery's charge; those of mice and the like say that their scope is a device."""
    found = []
    for path in files:
        if match := _SUPPLY.fullmatch(path):
            battery = files.get(f"{match[1]}/type", ("",))[0] == "Battery"
            if battery and files.get(f"{match[1]}/scope", ("",))[0] != "Device":
                found.append(first(files, path))
    return min((one for one in found if one is not None and one <= 100), default=None)


def _bits(files: Files) -> int | None:
    """Return a Raspberry Pi's bits; the colon in the file's name ends what is taken for its path."""
    lines = files.get("/sys/devices/platform/soc/soc", ("",))
    word = lines[0].removeprefix("firmware/get_throttled:")
    return int(word, 16) if re.fullmatch("[0-9a-fA-F]{1,8}", word) else None


def difference(before: HostReading, after: HostReading | None, outer: str, overlay: Sequence[str]) -> dict[str, object]:
    """Return the columns of a robot in hosts.csv.

    Args:
        before: Before the trial.
        after: After it; None when it came to no end, and only the first is known.
        outer: The interface that the robots reach each other over; empty where it is not known.
        overlay: The interfaces of the experiment's own network.
    """
    if after is None or not (known := _since(before.uptime_s, after.uptime_s)):
        return {**_one("start", before), **(_one("end", after) if after else {}), "cpus": before.cpus}
    return {
        "measured_s": known,
        "cpus": after.cpus,
        "cpu_s": _since(before.busy_s, after.busy_s),
        "cpu_steal_s": _since(before.steal_s, after.steal_s),
        **_one("start", before),
        **_one("end", after),
        "disk_read_bytes": _since(before.read, after.read),
        "disk_written_bytes": _since(before.written, after.written),
        **_traffic("net", [outer], before, after),
        **_traffic("overlay", overlay, before, after),
        "throttled": _throttled(before, after),
    }


def _one(when: str, one: HostReading) -> dict[str, object]:
    return {
        f"memory_available_{when}_bytes": one.memory_available,
        f"temperature_{when}_c": one.temperature_c,
        f"battery_{when}_percent": one.battery_percent,
    }


def _since(before: float | None, after: float | None) -> float | None:
    """Return how much a counter grew; None where it is not known, or began anew: the robot did, or its driver."""
    return None if before is None or after is None or after < before else after - before


def _traffic(what: str, names: Sequence[str], before: HostReading, after: HostReading) -> dict[str, object]:
    nothing = (None, None)
    pairs = [(before.links.get(name, nothing), after.links.get(name, nothing)) for name in names]
    grown = [[_since(one[at], other[at]) for one, other in pairs] for at in (0, 1)]
    received, sent = (sum(one for one in some if one is not None) if any(one is not None for one in some) else None
                      for some in grown)  # fmt: skip
    return {f"{what}_received_bytes": received, f"{what}_sent_bytes": sent}


def _throttled(before: HostReading, after: HostReading) -> bool | None:
    """Return whether heat or a weak supply slowed its processors down in the trial."""
    known: list[bool] = []
    if (grown := _since(before.throttle_count, after.throttle_count)) is not None:
        known.append(grown > 0)
    if before.throttle_bits is not None and after.throttle_bits is not None:
        now = (before.throttle_bits | after.throttle_bits) & _NOW
        known.append(bool(now or after.throttle_bits & ~before.throttle_bits & _SINCE_BOOT))
    return any(known) if known else None
