"""`python -m tests.fuzz.fuzzer SECONDS`: mutated files, one after the other; prints a line of JSON for each fault.

It makes itself a mount namespace without network in which everything is read-only but a fresh folder in memory, so that
the kernel sees to it that nothing else is touched. No input may raise anything but srprov's own errors, take more than
two seconds of computing, or more memory than the limit. An input that never ends is told by the parent, which holds the
file that the input was written to. Needs Linux, and root or unprivileged user namespaces.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import faulthandler
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CPU_S = 2.0
_TRIES = 3
"""An input takes too long when it does so each time, and on the processors for which limits are meant."""
MEMORY_BYTES = 300 * 1024 * 1024
STALLED_S = 60
"""Of the clock, while other tests run as well; then an input counts as one that never ends."""
_ROUND = 5
"""Examples of one surface before it is the next one's turn; a turn of all takes half a minute."""
_SAME_FAULT = 3
"""How often the same fault is told."""


class TooMuch(AssertionError):
    """An input took longer than it may."""


def confine(folder: str) -> None:
    """Make everything read-only but a folder in memory; for a process in a mount namespace of its own."""
    with open("/proc/self/mountinfo", encoding="utf-8") as stream:
        places = [line.split()[4].encode().decode("unicode_escape") for line in stream]
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256m,mode=0700", "tmpfs", folder], check=True)
    for place in reversed(places):
        done = subprocess.run(["mount", "-o", "remount,bind,ro", place], check=False, capture_output=True)
        if done.returncode and os.path.isdir(place) and os.access(place, os.W_OK):
            raise SystemExit(f"{place} cannot be made read-only: {done.stderr.decode()}")
    for place in ("/", "/tmp", "/root", os.getcwd()):
        with contextlib.suppress(OSError):
            open(os.path.join(place, "written-by-the-fuzzer"), "w", encoding="ascii").close()
            raise SystemExit(f"{place} is not read-only")
    for name in ("HOME", "TMPDIR", "XDG_STATE_HOME", "XDG_CACHE_HOME", "XDG_RUNTIME_DIR"):
        os.environ[name] = f"{folder}/home"
    os.environ.pop("XDG_CONFIG_HOME", None)
    tempfile.tempdir = f"{folder}/home"


def limit_memory() -> None:
    """Allow so much more than what is there now."""
    with open("/proc/self/statm", encoding="ascii") as stream:
        space = int(stream.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (space + MEMORY_BYTES, space + MEMORY_BYTES))


def rounds(surface: str, one: Any, folder: Path, current: int, number: int) -> tuple[int, str, bytes]:
    """Try one surface with some mutated texts; return how many, and the fault with the smallest input that has it."""
    from hypothesis import HealthCheck, Phase, given, seed, settings
    from hypothesis import strategies as st

    from tests.bounded import slowness
    from tests.fuzz import mutations
    from tests.fuzz.surfaces import prepare

    texts = st.sampled_from(one.seeds).flatmap(mutations.of)
    count, last = 0, b""

    @seed(number)
    @settings(max_examples=_ROUND, deadline=None, database=None, phases=(Phase.generate, Phase.shrink),
              suppress_health_check=list(HealthCheck), print_blob=False, report_multiple_bugs=False)  # fmt: skip
    @given(content=texts)
    def attempt(content: bytes) -> None:
        nonlocal count, last
        count, last = count + 1, content
        os.ftruncate(current, 0)
        os.pwrite(current, json.dumps({"surface": surface, "input": _shown(content)}).encode(), 0)
        faulthandler.dump_traceback_later(STALLED_S, exit=True)
        for _ in range(_TRIES):
            prepare(folder)
            begin = time.process_time()
            one.use(folder, content)
            took = time.process_time() - begin
            if took <= CPU_S or took / slowness() <= CPU_S:
                return
        raise TooMuch(f"{took:.1f} s")

    try:
        attempt()
    except Exception as error:  # whatever it is, it is a fault
        return count, _fault(error), last
    finally:
        faulthandler.cancel_dump_traceback_later()
    return count, "", b""


def _fault(error: Exception) -> str:
    frames = [one for one in traceback.extract_tb(error.__traceback__) if "/srprov/" in one.filename]
    place = f"{frames[-1].filename.split('/srprov/', 1)[1]}:{frames[-1].lineno}" if frames else "tests"
    return f"{type(error).__name__} at {place}: {str(error)[:300]}"


def _shown(content: bytes) -> str:
    return base64.b64encode(content[:100_000]).decode("ascii")


def _import_solvers() -> None:
    """Import what an assignment of some size imports: hundreds of MiB of address space, which no input asked for."""
    import ortools.graph.python.min_cost_flow
    import ortools.math_opt.python.mathopt  # noqa: F401


def fuzz(seconds: float, folder: Path, current: int, start: int, wanted: list[str]) -> Iterator[dict[str, Any]]:
    """Yield a fault as it is found, and in the end how many inputs each surface had."""
    from tests.fuzz.foreign import Kept
    from tests.fuzz.surfaces import surfaces

    kept = folder.parent / "kept"
    Kept.make(kept)
    every = {name: one for name, one in surfaces(kept).items() if not wanted or name in wanted}
    _import_solvers()
    limit_memory()
    end, counts, told = time.monotonic() + seconds, dict.fromkeys(every, 0), dict[str, int]()
    number = start
    while time.monotonic() < end:
        for name, one in every.items():
            number += 1
            count, fault, content = rounds(name, one, folder, current, number)
            counts[name] += count
            kind = f"{name} {fault.split(':')[0]}"
            if fault and told.get(kind, 0) < _SAME_FAULT:
                told[kind] = told.get(kind, 0) + 1
                yield {"surface": name, "fault": fault, "input": _shown(content), "seed": number}
            if time.monotonic() > end and all(counts.values()):  # on a slow machine each has one turn all the same
                break
    yield {"inputs": counts, "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.fuzzer", description=__doc__.splitlines()[0])
    parser.add_argument("seconds", type=float)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**9))
    parser.add_argument("--only", nargs="+", default=[], metavar="SURFACE")
    parser.add_argument("--folder", default="", help=argparse.SUPPRESS)
    parser.add_argument("--current", type=int, default=-1, help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    if not wanted.folder:
        sys.exit(run(wanted.seconds, wanted.seed, wanted.only))
    confine(wanted.folder)
    place = Path(wanted.folder) / "work"
    place.mkdir()
    (Path(wanted.folder) / "home").mkdir()
    sys.path.insert(0, os.getcwd())
    os.chdir(place)
    faulthandler.enable()
    for found in fuzz(wanted.seconds, place, wanted.current, wanted.seed, wanted.only):
        _tell(json.dumps(found))


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def run(seconds: float, seed: int, only: list[str]) -> int:
    """Start the fuzzer in a namespace of its own, print what it prints; return 0 when it found nothing."""
    current = os.memfd_create("current")
    with tempfile.TemporaryDirectory(prefix="srprov-fuzz-") as folder:
        words = [sys.executable, "-m", "tests.fuzz.fuzzer", str(seconds), "--seed", str(seed), "--folder", folder]
        words += ["--current", str(current), *(["--only", *only] if only else [])]
        root = [] if os.geteuid() == 0 else ["--map-root-user"]
        process = subprocess.Popen(
            ["unshare", "--mount", "--net", *root, "--propagation", "private", "--", *words],
            stdout=subprocess.PIPE,
            text=True,
            pass_fds=(current,),
        )
        assert process.stdout is not None
        found = 0
        for line in process.stdout:
            _tell(line.rstrip())
            found += '"fault"' in line
        code = process.wait()
    if code:
        said = os.pread(current, 1 << 20, 0).decode() or "{}"
        _tell(json.dumps({"fault": f"it ended with {code}", **json.loads(said)}))
    return int(bool(found or code))


if __name__ == "__main__":
    main()
