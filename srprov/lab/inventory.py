"""The lab as an Ansible inventory, and its host keys as a known_hosts. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from srprov import regular_file
from srprov.lab.places import Site
from srprov.lab.spec import Robot

HEADER = "# Written by `srprov lab up`; `srprov lab down` removes it.\n"


def user_of(robot: Robot, user: str | None) -> str:
    """Who logs in: `--user`, else the robot's own option, else root; nobody but `robot` where that is all there is."""
    return "robot" if robot.unprivileged else user or robot.user or "root"


def as_text(site: Site, robots: Sequence[Robot], user: str | None) -> str:
    """The inventory. Tags, slots and devices stand there only where the spec gives them."""
    shared = {
        "ansible_ssh_private_key_file": str(site.key),
        "ansible_ssh_common_args": f"-o UserKnownHostsFile={site.known_hosts}",
    }
    hosts = {robot.name: _variables(site, robot, user) for robot in robots}
    text = yaml.safe_dump({"all": {"hosts": hosts, "vars": shared}}, sort_keys=False)
    return f"{HEADER}{regular_file.WHOLE}\n{text}"


def _variables(site: Site, robot: Robot, user: str | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "ansible_host": str(site.address(robot.name, robot.lan)),
        "ansible_user": user_of(robot, user),
    }
    if robot.ipv6:
        found["srprov_underlay"] = str(site.address6(robot.name, robot.lan))
    if robot.tags:
        found["srprov_tags"] = list(robot.tags)
    if robot.slots is not None:
        found["srprov_slots"] = robot.slots
    if robot.devices:
        found["srprov_devices"] = list(robot.devices)
    return found


def known_hosts(site: Site, keys: Mapping[Robot, str]) -> str:
    """One line per robot, by its addresses; `keys` maps robot -> public host key."""
    return "".join(f"{','.join(_addresses(site, robot))} {key}\n" for robot, key in keys.items())


def _addresses(site: Site, robot: Robot) -> list[str]:
    ipv6 = [str(site.address6(robot.name, robot.lan))] if robot.ipv6 else []
    return [str(site.address(robot.name, robot.lan)), *ipv6]
