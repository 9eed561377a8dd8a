"""`python -m tools.recording`: do the steps of `make demo` in a lab of their own; docs/media/demo.svg shows them.

As root, about two minutes. The lab is called `recording`, and is taken down in the end.
"""

from __future__ import annotations

import datetime as dt
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from srprov import __version__
from tools.recording.svg import drawn
from tools.recording.terminal import Recording

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "media" / "demo.svg"
LAB = "recording"
COLUMNS, ROWS = 120, 30
USER, HOST, PLACE = "user", "controller", "/srv"
"""Who does it, and where: no picture names the machine that made it."""
_THERE = 'hostname "$0" && mount --bind "$1" "$2" && cd "$2" && exec bash -c "$3"'


def commands() -> list[str]:
    """Return what is typed: the commands of tools/demo.sh, and what it suggests in the end."""
    script = (ROOT / "tools" / "demo.sh").read_text(encoding="utf-8")
    edf = re.search(r"^EDF=(\S+)$", script, re.MULTILINE)
    assert edf, "tools/demo.sh names no EDF"
    verbs = re.findall(r"^run srprov (\w+) \"\$EDF\"", script, re.MULTILINE)
    listed = [f"srprov {verb} {edf[1]} -i inventory/lab.yml" for verb in (*verbs, "wait", "logs", "apply")]
    more = {"apply": " --yes", "wait": " --until log:listener=heard", "logs": " listener | tail -n 3"}
    return [line + more.get(line.split()[1], "") for line in listed]


def there(folder: Path) -> tuple[str, ...]:
    """Return what runs a command in a folder under another name, on a machine of another name."""
    return ("unshare", "--uts", "--mount", "sh", "-c", _THERE, HOST, str(folder), PLACE)


def record(folder: Path) -> Recording:
    """Do all of it in a folder that has examples/ and the lab's inventory under its usual name."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "SRPROV_LAB": LAB, "LOGNAME": USER, "TERM": "xterm-256color"}
    env = {key: value for key, value in env.items() if key not in ("NO_COLOR", "COLUMNS", "LINES")}
    env |= {"PATH": f"{Path(sys.executable).parent}:{env['PATH']}", "XDG_STATE_HOME": str(folder / "state")}
    shutil.copytree(ROOT / "examples", folder / "examples")
    recording = Recording(COLUMNS, ROWS)
    try:
        subprocess.run(["srprov", "lab", "up", "-n", "3"], cwd=folder, env=env, check=True)
        (folder / "inventory" / "lab.yml").symlink_to(f"lab-{LAB}.yml")
        for command in commands():
            code = recording.run(command, folder, env, there(folder))
            if code:
                raise SystemExit(f"{command}: exit {code}")
    finally:
        subprocess.run(["srprov", "lab", "down"], cwd=folder, env=env, check=True)
    return recording


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        recording = record(Path(folder))
    today = dt.datetime.now(dt.timezone.utc).date()
    about = f"A terminal, recorded on {today} with srprov {__version__}; waiting is shortened."
    frames = recording.shown()
    title = "srprov apply, status and logs of ROS 1 on three robots"
    PICTURE.parent.mkdir(exist_ok=True)
    PICTURE.write_text(drawn(frames, COLUMNS, title, about), encoding="utf-8")
    print(f"{PICTURE}: {len(frames)} screens, {frames[-1][0]:.0f} s, {PICTURE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
