"""SSH latency: starts the delaying proxy (delay.py) of a robot.

It runs with the controller's Python and files, in the robot's network and cgroup: the robot does
not see it, and it ends with the robot.
"""

from __future__ import annotations

import sys
from pathlib import Path

from srprov.lab import cgroups
from srprov.lab.config import SSHD_BEHIND_PROXY
from srprov.lab.machine import find
from srprov.lab.places import Site
from srprov.lab.spec import Latency, Robot

PROGRAM = Path(__file__).with_name("delay.py")


def start(site: Site, robot: Robot, init: int, late: Latency) -> None:
    """Start the proxy in front of the sshd of the robot with this PID 1; it waits for the robot's address."""
    address = str(site.address(robot.name, robot.lan))
    words = [address, "22", str(SSHD_BEHIND_PROXY), str(late.to_ms), str(late.from_ms)]
    proxy = [sys.executable, "-I", str(PROGRAM), *words]
    program = [find("nsenter") or "nsenter", f"--net=/proc/{init}/ns/net", "--", *proxy]
    cgroups.start_beside(site, robot.name, program, "latency.log")
