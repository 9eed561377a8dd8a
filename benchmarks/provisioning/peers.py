"""Environments of the peers: each in a virtual environment of its own below the cache folder, kept between runs."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.provisioning.robots import Trouble

CACHE = Path(os.environ.get("SRPROV_BENCH_CACHE") or Path.home() / ".cache" / "srprov-bench")
INSTALL_LIMIT_S = 900


def environment(name: str, packages: Sequence[str]) -> Path:
    """Return the folder of a virtual environment with these packages; made when it is not there or was not finished."""
    folder, done = CACHE / name, CACHE / name / "installed.txt"
    wanted = "\n".join([sys.version, *packages])
    if done.exists() and done.read_text() == wanted:
        return folder
    print(f"installing {', '.join(packages)} into {folder}", file=sys.stderr)
    _run([sys.executable, "-m", "venv", "--clear", str(folder)])
    _run([str(folder / "bin" / "pip"), "install", "-q", *packages])
    done.write_text(wanted)
    return folder


def for_robots(packages: Sequence[str]) -> bytes:
    """Return a tar of pure Python packages, for Python modules that run on robots."""
    folder, archive = CACHE / "robots", CACHE / "robots.tar"
    if not archive.exists():
        _run([sys.executable, "-m", "pip", "install", "-q", "--target", str(folder), *packages])
        _run(["tar", "-C", str(folder), "-cf", str(archive), "."])
    return archive.read_bytes()


def version(name: str, *packages: str) -> str:
    """Return the installed versions, as `package version`, or nothing when the environment is not there."""
    code = "import sys, importlib.metadata as m; print(', '.join(p + ' ' + m.version(p) for p in sys.argv[1:]))"
    argv = [str(CACHE / name / "bin" / "python"), "-c", code, *packages]
    try:
        return subprocess.run(argv, capture_output=True, text=True, timeout=30, check=False).stdout.strip()
    except OSError:
        return ""


def _run(argv: Sequence[str]) -> None:
    done = subprocess.run(argv, capture_output=True, text=True, timeout=INSTALL_LIMIT_S, check=False)
    if done.returncode:
        raise Trouble(f"{' '.join(argv)}: exit {done.returncode}: {done.stderr.strip()[-500:]}")
