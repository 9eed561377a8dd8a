"""The mirror: Debian's docker-registry on the lab's bridge, read-only, serving the cached images.

It runs in a cgroup of its own beside the robots', so it is found and ended without a process id
on record.
"""

from __future__ import annotations

import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

from srprov.errors import LabError
from srprov.lab import cgroups, robot
from srprov.lab.machine import SYSTEM_PATH, find
from srprov.lab.places import CONTROLLER, REGISTRY_PORT, RUN

GROUP = "registry"
URL = f"http://{CONTROLLER}:{REGISTRY_PORT}"

CONFIG = """\
version: 0.1
log: {{level: warn}}
storage:
  cache: {{blobdescriptor: inmemory}}
  filesystem: {{rootdirectory: {storage}}}
  maintenance: {{readonly: {{enabled: true}}}}
http: {{addr: "{address}"}}
"""


def ensure(storage: Path) -> None:
    """The mirror serves `storage` afterwards; it is started again when it serves another."""
    text = CONFIG.format(storage=storage, address=f"{CONTROLLER}:{REGISTRY_PORT}")
    config = RUN / "registry.yml"
    if config.exists() and config.read_text() == text and answers():
        return
    remove()
    config.write_text(text)
    program = find("docker-registry") or "docker-registry"
    groups = " ".join(str(group) for group in cgroups.make(GROUP))
    with open(RUN / "registry.log", "wb") as log:
        subprocess.Popen(
            ["/bin/sh", "-c", cgroups.LAUNCH, program, "serve", str(config)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            cwd="/",
            env={"PATH": SYSTEM_PATH, "LAB_CGROUPS": groups, "OTEL_TRACES_EXPORTER": "none"},
            start_new_session=True,
        )
    _await_answer()


def _await_answer(patience_s: float = 10.0) -> None:
    until = time.monotonic() + patience_s
    while not answers():
        if time.monotonic() > until:
            log = (RUN / "registry.log").read_text(errors="replace").strip().splitlines()
            raise LabError(
                f"the mirror does not answer: {log[-1] if log else 'no message'}",
                hint="srprov lab down",
            )
        time.sleep(0.02)


def answers() -> bool:
    """Whether the mirror is there."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"{URL}/v2/", timeout=1.0) as reply:
            return bool(reply.status == 200)
    except (urllib.error.URLError, OSError):
        return False


def remove() -> None:
    """End the mirror; no error if it does not run."""
    robot.kill(GROUP)
