"""What the probes' answers say: one pure parser for each, and the small values that they give.

Takes the text that a robot's shell sent back; gives values that `host.py` puts together. Nothing here raises: a line
that is not as it should be is left out, and a value that is missing keeps its default.
Source: proc(5), sysfs-class-net, POSIX df, iw(8).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import msgspec

from srprov.untrusted import LIST_LENGTH, TEXT_LENGTH, decimal, folder, integer, lines_of, text

_DF_ROW = re.compile(r".{0,400}\s([0-9]{1,15})\s+-?[0-9]{1,15}\s+(-?[0-9]{1,15})\s+[0-9-]{1,4}%?\s+(/.{0,400})")
_DEVICE = re.compile(r"/dev(/[A-Za-z0-9][A-Za-z0-9._:+,@#=-]*){1,4}")


class OsIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """Who answered, and when."""

    clock_s: float | None = None
    """Seconds since the epoch by the robot's clock; None when it said nothing."""
    machine: str = ""
    """As `uname -m` has it."""
    bits: int = 0
    """Of the system's programs, 32 or 64; 0 where it does not say."""
    uid: int = -1
    user: str = ""
    reached_at: str = ""
    """The address of the robot that the SSH connection ends at."""
    client: str = ""
    """The address that the SSH connection comes from."""


class Devices(msgspec.Struct, frozen=True, kw_only=True):
    """Device files, as absolute paths, sorted."""

    known: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    """Symbolic links directly below /dev to a character device."""


class Filesystem(msgspec.Struct, frozen=True, kw_only=True):
    """One mounted filesystem; sizes in bytes."""

    mount: str
    total: int
    free: int


class Disks(msgspec.Struct, frozen=True, kw_only=True):
    """Docker's root as its configuration file names it, empty where that does not; and what is mounted."""

    root: str = ""
    mounts: tuple[Filesystem, ...] = ()


class Counters(msgspec.Struct, frozen=True, kw_only=True):
    """Bytes that passed an interface, per second, while the robot was asked."""

    received_bps: float
    sent_bps: float


Files = Mapping[str, tuple[str, ...]]
"""Path -> its lines."""


def parse_identity(out: str) -> OsIdentity:
    """Read `key value` lines; what is missing or odd keeps its default."""
    words: dict[str, str] = {}
    for line in lines_of(out, 64):
        key, _, value = line.partition(" ")
        words.setdefault(key, value.strip())
    clock = decimal(words.get("clock", "").rstrip(".%N"), low=0, high=1e11, default=-1)
    if clock >= 0 and clock == int(clock):
        clock += 0.5  # busybox's date knows no fractions: so the error is half a second at most
    connection = text(words.get("connection", "")).split()
    uid, _, _groups = words.get("id", "").removeprefix("uid=").partition(" ")
    number, _, name = uid.partition("(")
    return OsIdentity(
        clock_s=clock if clock >= 0 else None,
        machine=text(words.get("machine", ""), length=32),
        bits=integer(words.get("bits"), low=0, high=64, default=0),
        uid=integer(number, low=0, high=2**32, default=-1),
        user=text(words.get("user", name.partition(")")[0]), length=64),
        reached_at=connection[2] if len(connection) == 4 else "",
        client=connection[0] if len(connection) == 4 else "",
    )


def parse_devices(out: str) -> Devices:
    """Read `dev PATH` and `alias PATH` lines; paths with anything but plain characters are left out."""
    kinds: dict[str, set[str]] = {"dev": set(), "alias": set()}
    for line in lines_of(out, 4 * LIST_LENGTH):
        kind, _, path = line.partition(" ")
        if kind in kinds and len(path) <= TEXT_LENGTH and _DEVICE.fullmatch(path):
            kinds[kind].add(path)
    aliases = kinds["alias"] - kinds["dev"] - {"/dev/stdin", "/dev/stdout", "/dev/stderr", "/dev/rtc"}
    return Devices(known=tuple(sorted(kinds["dev"])[:LIST_LENGTH]), aliases=tuple(sorted(aliases)[:LIST_LENGTH]))


def parse_files(out: str) -> Files:
    """Read `path:line` lines. A line is always after its own path, so no file can speak for another."""
    found: dict[str, list[str]] = {}
    for line in lines_of(out, 8192):
        path, colon, rest = line.partition(":")
        if colon and path.startswith("/") and len(path) <= 200:
            found.setdefault(path, []).append(rest[:4096].rstrip("\0"))
    return {path: tuple(lines) for path, lines in found.items()}


def parse_processor(out: str) -> str:
    """Read `model name : …`."""
    return text(" ".join(out.partition("\n")[0].partition(":")[2].split()))


def parse_count(out: str) -> int:
    """Read a count of processors; 0 when there is none."""
    return integer(out.strip(), low=0, high=4096, default=0)


def parse_wireless(out: str) -> Mapping[str, float]:
    """Read interfaces and what `iw` says of them: name -> bit rate in Mbit/s, 0 where it is unknown."""
    found: dict[str, float] = {}
    name = ""
    for line in lines_of(out, 32 * LIST_LENGTH):
        if line.startswith("wireless "):
            name = text(line[9:], length=15)
            found.setdefault(name, 0.0)
        elif name and (rate := re.match(r"\s*tx bitrate:\s*([0-9]{1,6}(\.[0-9]{1,3})?) MBit/s", line)):
            found[name] = decimal(rate[1], low=0, high=1e6, default=0.0)
    return found


def parse_disk(out: str) -> Disks:
    """Read `root PATH` and `df -Pk`; each mount once, in the order of the answer."""
    root, found = "", dict[str, Filesystem]()
    for line in lines_of(out, 64):
        # both names may hold blanks; the four columns between them cannot
        row = _DF_ROW.fullmatch(line)
        if row is None or not row[3].isprintable():
            root = root or folder(line.removeprefix("root ") if line.startswith("root /") else "")
            continue
        total = int(row[1]) * 1024
        free = integer(row[2], low=0, high=int(row[1]), default=0) * 1024
        found.setdefault(row[3], Filesystem(mount=row[3], total=total, free=free))
    return Disks(root=root, mounts=tuple(found.values()))


def parse_traffic(out: str) -> Mapping[str, Counters]:
    """Read /proc/uptime and /proc/net/dev, twice: interface -> bytes per second; a counter that went back is idle."""
    uptimes: list[float] = []
    counts: list[dict[str, tuple[int, int]]] = []
    for line in lines_of(out, 8 * LIST_LENGTH):
        if row := re.fullmatch(r"\s*(\S{1,15}):\s*([0-9 ]{1,400})", line):
            columns = row[2].split()
            if counts and len(columns) >= 9:
                counts[-1][row[1]] = (int(columns[0][:18]), int(columns[8][:18]))
        elif row := re.fullmatch(r"([0-9]{1,12}\.[0-9]{1,3}) [0-9.]{1,20}", line):
            uptimes.append(float(row[1]))
            counts.append({})
    if len(counts) != 2:
        return {}
    elapsed = uptimes[1] - uptimes[0]
    if not 0.1 <= elapsed <= 3600:
        return {}  # it booted meanwhile, or its clock is no clock
    return {
        name: Counters(
            received_bps=max(0, received - counts[0][name][0]) / elapsed,
            sent_bps=max(0, sent - counts[0][name][1]) / elapsed,
        )
        for name, (received, sent) in sorted(counts[1].items())
        if name in counts[0]
    }
