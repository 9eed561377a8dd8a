"""A robot's clock while it is up: how far off it is, for whoever asks `date`.

The wrapper over `date` (config.py) reads that from a file in the robot's /run, so it is as at boot
again after a restart. A robot that was booted with a right clock gets the wrapper when it is needed.
"""

from __future__ import annotations

from pathlib import Path

from srprov.lab import config
from srprov.lab.machine import run

MOST_S = 1e8
_WRAP = """\
program=$(command -v date)
: >/run/lab/date
mount --bind "$program" /run/lab/date
mount --bind /run/lab/date-wrapper "$program"
"""


def _folder(init: int) -> Path:
    return Path(f"/proc/{init}/root/run/lab")


def set_off(init: int, offset_s: float) -> None:
    """Have the clock of the robot with this PID 1 off by so many seconds from now on."""
    folder = _folder(init)
    draft = folder / "clock.new"
    draft.write_text(f"{offset_s:+f}\n")
    draft.replace(folder / "clock")  # no `date` reads half of it
    if not (folder / "date").exists():
        (folder / "date-wrapper").write_text(config.date(0.0))
        (folder / "date-wrapper").chmod(0o755)
        run(["nsenter", f"--target={init}", "--mount", "--root", "--", "/bin/sh", "-ec", _WRAP])


def put_back(init: int) -> bool:
    """Have it as the robot's options say. False when it was."""
    path = _folder(init) / "clock"
    if not path.exists():
        return False
    path.unlink()
    return True


def of(init: int) -> tuple[str, ...]:
    """What is wrong with it on purpose since the robot was booted, in words."""
    try:
        return (f"clock {float((_folder(init) / 'clock').read_text()):+g} s",)
    except OSError:
        return ()
