"""Where the lab keeps what it makes, and how its parts are named and addressed.

Everything of the lab lies below three folders and on one bridge, so `lab down` knows where to
look even after a killed run: `RUN` (state, keys; gone after a reboot of the machine), `DISKS`
(one folder per robot) and `CACHE` (images, kept).
"""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path

RUN = Path("/run/srprov-lab")
DISKS = Path("/var/lib/srprov-lab")
CACHE = Path("/var/cache/srprov-lab")

KEY = RUN / "id_ed25519"
KNOWN_HOSTS = RUN / "known_hosts"
INVENTORY = Path("inventory/lab.yml")

TAG = "srprov-lab"
"""Name of the cgroup and comment of every firewall rule of the lab."""

BRIDGE = "srlab0"
SUBNET = IPv4Network("10.213.0.0/24")
CONTROLLER = IPv4Address("10.213.0.1")
REGISTRY_PORT = 5000
FIRST_HOST = 10
MOST_ROBOTS = 200


def robot_name(number: int) -> str:
    """`robot7` for 7."""
    return f"robot{number}"


def robot_number(name: str) -> int | None:
    """7 for `robot7`; None for a name that no robot of a lab can have."""
    found = re.fullmatch(r"robot([1-9][0-9]{0,2})", name)
    number = int(found[1]) if found else 0
    return number if 1 <= number <= MOST_ROBOTS else None


def address(name: str) -> IPv4Address:
    """The robot's address on the bridge; `name` must be a robot's name."""
    number = robot_number(name)
    if number is None:
        raise ValueError(f"{name} is not the name of a lab robot")
    return SUBNET.network_address + FIRST_HOST + number


def link(name: str) -> str:
    """The controller's end of the robot's cable."""
    return f"srlab-r{robot_number(name)}"


def disk(name: str) -> Path:
    """The robot's disk: kept by kill and restart, removed with the robot."""
    return DISKS / name
