"""The counters of one container: which files of its cgroups have them, and what they say. Pure.

Each controller may be of version 1 or 2, on one machine too. Where the files are is read, not guessed: the groups of a
process are in /proc/PID/cgroup, and where they can be seen is in /proc/self/mountinfo.

Source: cgroups(7); the kernel's cgroup-v1 and cgroup-v2 documents; proc_pid_mountinfo(5).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec

from srprov.trials.files import Files, first, links, number, total, value_of

Counters = Mapping[str, float | None]
"""Column of containers.csv -> its value; None where the robot does not say."""
PEAKS = ("memory_peak_bytes", "memory_anon_bytes")
"""Counters that do not add up."""
_UNIFIED = ""
"""What stands for the controllers of version 2."""
_V1 = {
    "cpuacct": ("cpuacct.usage",),
    "cpu": ("cpu.stat",),
    "memory": ("memory.max_usage_in_bytes", "memory.stat", "memory.oom_control"),
    "blkio": tuple(f"blkio.{who}.io_service_bytes{all}" for who in ("bfq", "throttle") for all in ("_recursive", "")),
}
"""Controller of version 1 -> the files of it that are read."""
_V2 = {
    "cpuacct": ("cpu.stat",),
    "cpu": ("cpu.stat",),
    "memory": ("memory.peak", "memory.stat", "memory.events"),
    "blkio": ("io.stat",),
}
_ESCAPED = re.compile(r"\\([0-7]{3})")
_LONGEST_PATH = 1000


class Mount(msgspec.Struct, frozen=True):
    """Where a hierarchy of groups can be seen, and which of its groups is seen there."""

    place: str
    root: str


@dataclass(frozen=True, slots=True)
class Group:
    """A container's files."""

    pid: int
    folders: Mapping[str, tuple[int, str]]
    """Controller -> its version and its folder; one that cannot be seen is missing."""

    @property
    def files(self) -> tuple[str, ...]:
        """What is to be read."""
        names = {1: _V1, 2: _V2}
        found = [f"{path}/{name}" for key, (version, path) in self.folders.items() for name in names[version][key]]
        return (*dict.fromkeys(found), f"/proc/{self.pid}/net/dev")


def mounts(lines: Iterable[str]) -> Mapping[str, Mount]:
    """Return the hierarchies in lines of mountinfo by their controllers; version 2's has the name ""."""
    found: dict[str, Mount] = {}
    for line in lines:
        before, _, after = line.partition(" - ")
        words, kind = before.split(), after.split()
        if len(words) < 5 or len(kind) < 3:
            continue
        mount = Mount(_plain(words[4]), _plain(words[3]))
        if kind[0] == "cgroup2":
            found.setdefault(_UNIFIED, mount)
        elif kind[0] == "cgroup":
            for option in kind[2].split(","):
                found.setdefault(option, mount)
    return found


def _plain(path: str) -> str:
    """Return a path without the escapes of mountinfo."""
    return _ESCAPED.sub(lambda match: chr(int(match[1], 8)), path)


def group(pid: int, lines: Iterable[str], there: Mapping[str, Mount]) -> Group:
    """Return where the groups of a process can be seen.

    Args:
        pid: The process.
        lines: Of /proc/PID/cgroup.
        there: The hierarchies that can be seen.
    """
    paths: dict[str, str] = {}
    for line in lines:
        _, _, rest = line.partition(":")
        controllers, colon, path = rest.partition(":")
        if colon:
            paths |= {one: path for one in controllers.split(",")}
    folders = {}
    for key in _V1:
        version, name = (1, key) if key in paths else (2, _UNIFIED)
        if name in paths and name in there and (folder := _folder(there[name], paths[name])):
            folders[key] = (version, folder)
    return Group(pid, folders)


def _folder(mount: Mount, path: str) -> str:
    """Return a group's folder; nothing where it is not below what can be seen, or could be taken for another file."""
    root = mount.root.rstrip("/")
    inside = path == root or path.startswith(f"{root}/")
    whole = mount.place + path[len(root) :].rstrip("/")
    # whose group is the root's has no container's group: its counters would be the machine's
    odd = ".." in whole.split("/") or ":" in whole or not whole.isprintable() or path in ("/", "", root)
    return whole if inside and not odd and len(whole) <= _LONGEST_PATH and whole.startswith("/") else ""


def counters(one: Group, files: Files, *, own_network: bool) -> Counters:
    """Return what a container's files say of it since it began.

    Args:
        one: Which files these are.
        files: What was read.
        own_network: Whether its interfaces are its own, and not its robot's or another container's.
    """
    received, sent = _network(files.get(f"/proc/{one.pid}/net/dev", ())) if own_network else (None, None)
    read, written = _disk(one, files)
    return {
        "cpu_s": _cpu(one, files),
        "throttled_s": _throttled(one, files),
        **_memory(one, files),
        "disk_read_bytes": read,
        "disk_written_bytes": written,
        "net_received_bytes": received,
        "net_sent_bytes": sent,
    }


COLUMNS = (
    *("cpu_s", "throttled_s", "memory_peak_bytes", "memory_anon_bytes", "oom_kills"),
    *("disk_read_bytes", "disk_written_bytes", "net_received_bytes", "net_sent_bytes"),
)


def _at(one: Group, controller: str) -> tuple[int, str]:
    return one.folders.get(controller, (0, ""))


def _seconds(value: int | None, unit: float) -> float | None:
    return None if value is None else value * unit


def _cpu(one: Group, files: Files) -> float | None:
    version, folder = _at(one, "cpuacct")
    if version == 1:
        return _seconds(first(files, f"{folder}/cpuacct.usage"), 1e-9)
    return _seconds(value_of(files, f"{folder}/cpu.stat", "usage_usec"), 1e-6)


def _throttled(one: Group, files: Files) -> float | None:
    version, folder = _at(one, "cpu")
    if version == 1:
        return _seconds(value_of(files, f"{folder}/cpu.stat", "throttled_time"), 1e-9)
    return _seconds(value_of(files, f"{folder}/cpu.stat", "throttled_usec"), 1e-6)


def _memory(one: Group, files: Files) -> Counters:
    version, folder = _at(one, "memory")
    if version == 1:
        return {
            "memory_peak_bytes": first(files, f"{folder}/memory.max_usage_in_bytes"),
            "memory_anon_bytes": value_of(files, f"{folder}/memory.stat", "total_rss"),
            "oom_kills": value_of(files, f"{folder}/memory.oom_control", "oom_kill"),
        }
    return {
        "memory_peak_bytes": first(files, f"{folder}/memory.peak"),
        "memory_anon_bytes": value_of(files, f"{folder}/memory.stat", "anon"),
        "oom_kills": value_of(files, f"{folder}/memory.events", "oom_kill"),
    }


def _disk(one: Group, files: Files) -> tuple[int | None, int | None]:
    """Return the bytes read and written, of all devices."""
    version, folder = _at(one, "blkio")
    if version == 1:
        for name in _V1["blkio"]:
            read, written = (_service_bytes(files.get(f"{folder}/{name}", ()), what) for what in ("Read", "Write"))
            if read is not None or written is not None:
                return read, written
        return None, None
    path = f"{folder}/io.stat"
    words = [word.partition("=") for line in files.get(path, ()) for word in line.split()[1:]]
    return (
        total(number(value) for key, _, value in words if key == "rbytes"),
        total(number(value) for key, _, value in words if key == "wbytes"),
    )


def _service_bytes(lines: Sequence[str], what: str) -> int | None:
    """Return the sum of `8:0 Read 4096`.

    Not of `Total 0` alone: so also says a kernel that counts only for groups with a limit.
    """
    rows = [line.split() for line in lines]
    return total(number(row[2]) for row in rows if len(row) == 3 and row[1] == what)


def _network(lines: Sequence[str]) -> tuple[int | None, int | None]:
    own = [both for name, both in links(lines).items() if name != "lo"]
    return total(one for one, _ in own), total(one for _, one in own)


class Used(msgspec.Struct, frozen=True, kw_only=True):
    """What a service used, up to the last time that it was read."""

    counters: Counters = msgspec.field(default_factory=dict)
    moment: float = 0.0
    """When that was, by the controller's clock, in seconds since the epoch; 0 when it never was."""
    finished: float = 0.0
    """When it ended, by its robot's clock; 0 when it has not."""


def row(used: Used, offset_s: float | None) -> dict[str, object]:
    """Return the columns of a service in containers.csv; `offset_s` is its robot's clock minus the controller's."""
    known = used.moment and used.finished and offset_s is not None
    return {
        **{key: used.counters.get(key) for key in COLUMNS},
        "unread_s": max(0.0, used.finished - (offset_s or 0.0) - used.moment) if known else None,
    }


def added(earlier: Counters, later: Counters) -> Counters:
    """Return the counters of a service whose container was started again, which begins to count anew."""
    return {key: _together(key, earlier.get(key), later.get(key)) for key in COLUMNS}


def highest(earlier: Counters, later: Counters) -> Counters:
    """Return a later reading of the same container, with the largest memory, and what was read only before."""
    known = {key: value for key, value in later.items() if value is not None}
    return {**earlier, **known, **{key: _together(key, earlier.get(key), later.get(key)) for key in PEAKS}}


def _together(key: str, one: float | None, other: float | None) -> float | None:
    known = [each for each in (one, other) if each is not None]
    if not known:
        return None
    return max(known) if key in PEAKS else sum(known)
