"""Run one command and say what it took: time, CPU and memory of all its processes, bytes on the lab's bridge."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from srprov.lab.sites import find

_PR_SET_CHILD_SUBREAPER = 36


@dataclass(frozen=True)
class Taken:
    """What one run of a command took."""

    code: int
    seconds: float
    cpu: float
    """seconds, user and system, of the process and of all that it started, those it left behind included"""
    rss_mib: float
    """The most memory of one of its processes."""
    sent: int
    """bytes, from the controller to the robots"""
    received: int
    out: str
    err: str
    idle: float
    """Share of the machine's CPU time that was idle just before."""

    @property
    def failure(self) -> str:
        """What a run that failed said last; nothing when it didn't fail."""
        return f"exit {self.code}: {(self.out + self.err)[-400:]}" if self.code else ""


def adopt_orphans() -> None:
    """Make this process the parent of what tools leave behind, so that its CPU time is counted.

    OpenSSH's ControlPersist masters are such processes.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def wire() -> tuple[int, int]:
    """Return bytes sent to and received from robots so far, by the controller's end of the lab's bridge."""
    site = find(os.environ.get("SRPROV_LAB", ""))
    if site.number is None or not Path("/sys/class/net", site.bridge).exists():
        return 0, 0
    return counted(site.bridge)


def counted(link: str) -> tuple[int, int]:
    """Return bytes sent and received over a link of this machine so far."""
    counters = Path("/sys/class/net", link, "statistics")
    return int((counters / "tx_bytes").read_text()), int((counters / "rx_bytes").read_text())


def _ticks() -> tuple[int, int]:
    fields = [int(word) for word in Path("/proc/stat").read_text().splitlines()[0].split()[1:9]]
    return fields[3] + fields[4], sum(fields)


def calm(patience_s: float = 5.0, enough: float = 0.9) -> float:
    """Wait until the machine is idle, but not for ever; give the idle share of the last look."""
    deadline = time.monotonic() + patience_s
    while True:
        idle, total = _ticks()
        time.sleep(0.25)
        idle_after, total_after = _ticks()
        share = (idle_after - idle) / max(1, total_after - total)
        if share >= enough or time.monotonic() > deadline:
            return round(share, 3)


def _children() -> list[int]:
    listed = Path(f"/proc/self/task/{os.getpid()}/children")
    return [int(word) for word in listed.read_text().split()] if listed.exists() else []


def _end_orphans(mine: set[int]) -> tuple[float, float]:
    """End what the command left running; give its CPU seconds and its greatest memory in MiB."""
    cpu = rss = 0.0
    for sign in (signal.SIGTERM, signal.SIGKILL):
        for pid in set(_children()) - mine:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, sign)
        deadline = time.monotonic() + 2
        while (left := set(_children()) - mine) and time.monotonic() < deadline:
            for pid in left:
                with contextlib.suppress(ChildProcessError):
                    done, _, used = os.wait4(pid, os.WNOHANG)
                    if done:
                        cpu, rss = cpu + used.ru_utime + used.ru_stime, max(rss, used.ru_maxrss / 1024)
            time.sleep(0.01)
    return cpu, rss


def _environment(more: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a measured command: tools may keep compiled modules, as they do for users."""
    return {**{key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}, **more}


def run(
    argv: Sequence[str],
    *,
    cwd: Path,
    env: Mapping[str, str] | None = None,
    stdin: str = "",
    limit_s: float = 300,
    wait_calm: bool = True,
) -> Taken:
    """Run a command to its end, at most `limit_s` seconds (then its code is -9)."""
    idle = calm() if wait_calm else 1.0
    mine = set(_children())
    said, complained, given = cwd / "last.out", cwd / "last.err", cwd / "last.in"
    given.write_text(stdin, encoding="utf-8")
    with said.open("wb") as out, complained.open("wb") as err, given.open("rb") as source:
        before, begun = wire(), time.perf_counter()
        process = subprocess.Popen(
            list(argv),
            cwd=cwd,
            env=_environment(env or {}),
            stdin=source,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        watch = threading.Timer(limit_s, lambda: os.killpg(process.pid, signal.SIGKILL))
        watch.daemon = True
        watch.start()
        try:
            _, status, used = os.wait4(process.pid, 0)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)  # whoever ends the benchmark ends what it measures
            raise
        seconds, after = time.perf_counter() - begun, wire()
        watch.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    orphan_cpu, orphan_rss = _end_orphans(mine)
    return Taken(
        code=process.returncode,
        seconds=seconds,
        cpu=used.ru_utime + used.ru_stime + orphan_cpu,
        rss_mib=max(used.ru_maxrss / 1024, orphan_rss),
        sent=after[0] - before[0],
        received=after[1] - before[1],
        out=said.read_text(encoding="utf-8", errors="replace"),
        err=complained.read_text(encoding="utf-8", errors="replace"),
        idle=idle,
    )


def raise_limits() -> None:
    """Allow as many open files as the machine does: a hundred connections need some."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
