"""The mirror: Debian's docker-registry on a lab's bridge, read-only, serving the cached images.

It runs in a cgroup of its own beside the robots', so it is found and ended without a process id
on record.
"""

from __future__ import annotations

import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterable
from pathlib import Path

import yaml

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import cgroups, robot
from srprov.lab.machine import SYSTEM_PATH, find
from srprov.lab.places import REGISTRY_PORT, Site

GROUP = "registry"
CONFIG_FILE = "registry.yml"

CONFIG = """\
version: 0.1
log: {{level: warn}}
storage:
  cache: {{blobdescriptor: inmemory}}
  filesystem: {{rootdirectory: {storage}}}
  maintenance: {{readonly: {{enabled: true}}}}
http: {{addr: "{address}"}}
"""


def ensure(site: Site, storage: Path) -> None:
    """The mirror serves `storage` afterwards; it is started again when it serves another."""
    text = CONFIG.format(storage=storage, address=f"{site.controller}:{REGISTRY_PORT}")
    config = site.run / CONFIG_FILE
    if config.exists() and config.read_text() == text and answers(site):
        return
    remove(site)
    config.write_text(text)
    _start(site, config)
    _await_answer(site)


def _start(site: Site, config: Path) -> None:
    program = find("docker-registry") or "docker-registry"
    groups = " ".join(str(group) for group in cgroups.make(site, GROUP))
    with open(site.run / "registry.log", "wb") as log:
        subprocess.Popen(
            ["/bin/sh", "-c", cgroups.LAUNCH, program, "serve", str(config)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            cwd="/",
            env={"PATH": SYSTEM_PATH, "LAB_CGROUPS": groups, "OTEL_TRACES_EXPORTER": "none"},
            start_new_session=True,
        )


def storages(sites: Iterable[Site]) -> set[Path]:
    """Return the storages that the mirrors of these labs serve."""
    configs = [site.run / CONFIG_FILE for site in sites]
    read = [yaml.safe_load(config.read_text()) for config in configs if config.exists()]
    return {Path(config["storage"]["filesystem"]["rootdirectory"]) for config in read}


def _await_answer(site: Site, patience_s: float = 10.0) -> None:
    until = time.monotonic() + patience_s
    while not answers(site):
        if time.monotonic() > until:
            log = (site.run / "registry.log").read_text(errors="replace").strip().splitlines()
            raise LabError(
                f"the mirror does not answer: {log[-1] if log else 'no message'}",
                hint=f"{site.command} down",
                code=Code.LAB_STUCK,
            )
        time.sleep(0.02)


def answers(site: Site) -> bool:
    """Whether the mirror is there."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"http://{site.controller}:{REGISTRY_PORT}/v2/", timeout=1.0) as reply:
            return bool(reply.status == 200)
    except (urllib.error.URLError, OSError):
        return False


def remove(site: Site) -> None:
    """End the mirror; no error if it does not run."""
    robot.kill(site, GROUP)
