"""Looks at robots that do not go through srprov: a real ping, a container's log, the kernel's word on a VXLAN link."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tests.lab.conftest import BEGUN, ROOT, Lab

_T = TypeVar("_T")


def built(folder: Path, name: str, source: str) -> Path:
    """Make a program of C that needs nothing else of a robot or a container, in a folder `bin`; return its path."""
    (folder / "bin").mkdir()
    (folder / f"{name}.c").write_text(source, encoding="utf-8")
    program = folder / "bin" / name
    subprocess.run(["gcc", "-static", "-o", str(program), str(folder / f"{name}.c")], check=True)
    return program


def wait_until(look: Callable[[], _T], seconds: float, what: str) -> _T:
    """Look again and again until there is something to see; after the deadline the test fails.

    A deadline for a machine that is not shared; where other machines take its processors, all is several times as slow.
    """
    seconds *= 6
    until = time.monotonic() + seconds
    while not (seen := look()):
        assert time.monotonic() < until, f"not within {seconds:g} s: {what}; last seen: {seen!r}"
        time.sleep(0.1)
    return seen


def log_of(lab: Lab, robot: str, container: str) -> list[str]:
    """Give a container's log by `docker logs` on its robot."""
    return lab.shell(robot, "sh", "-c", 'docker logs "$0" 2>&1', container).out.splitlines()


def reached(lab: Lab, robot: str, container: str, targets: Iterable[str]) -> set[str]:
    """Give those addresses and names that answer a ping from inside a container within two seconds."""
    # ping looks a name up for as long as the resolver likes: `timeout` ends that too
    script = 'for t in "$@"; do (timeout 4 ping -c 1 -W 2 "$t" >/dev/null 2>&1 && echo "$t") & done; wait; true'
    return set(lab.shell(robot, "docker", "exec", container, "sh", "-c", script, "sh", *targets).out.split())


def address_of(lab: Lab, robot: str, container: str) -> str:
    """Give a container's only address, by Docker's word."""
    (network,) = lab.inspect(robot, container)["NetworkSettings"]["Networks"].values()
    assert isinstance(network["IPAddress"], str)
    return network["IPAddress"]


def vxlans(lab: Lab, robot: str) -> dict[str, int]:
    """Give bridge -> VNI of the VXLAN ports on a robot, by the kernel's word."""
    found = json.loads(lab.shell(robot, "ip", "-j", "-d", "link", "show", "type", "vxlan").out or "[]")
    return {link.get("master", ""): link["linkinfo"]["info_data"]["id"] for link in found if link}


def networks(lab: Lab, robot: str) -> dict[str, dict[str, Any]]:
    """Give the Docker networks of a robot that are not Docker's own, by name."""
    script = "docker network inspect $(docker network ls -q --filter type=custom)"
    return {network["Name"]: network for network in json.loads(lab.shell(robot, "sh", "-c", script).out)}


def begin(lab: Lab, *arguments: str) -> subprocess.Popen[str]:
    """Start `srprov` and go on; it gets Ctrl-C only from the test, whatever the terminal does."""
    run = subprocess.Popen(
        [sys.executable, "-m", "srprov", *arguments],
        cwd=lab.folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    BEGUN.append(run)
    return run


def begin_on(lab: Lab, robot: str, *words: str) -> subprocess.Popen[str]:
    """Start a command on a robot and go on."""
    return begin(lab, "lab", "shell", robot, *words)


def ids(lab: Lab, robots: Sequence[str], instance: str) -> dict[str, str]:
    """Give container -> id of one instance, on all these robots; also those that do not run."""
    every = {name: one for there in lab.everywhere(robots).values() for name, one in there.items()}
    return {name: one for name, one in every.items() if name.startswith(f"srprov.{instance}.")}
