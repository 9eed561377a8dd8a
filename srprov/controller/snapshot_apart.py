"""What robots that are in one experiment would open to each other, and did not have open before.

On its robot, a container of an engine's network is reached by its neighbours, and by others at the ports that it
publishes. On an experiment's overlay all services reach each other at every port, those of other robots, too. So in a
snapshot of several robots there is no container on it that has what gives its own robot away: what it tells whoever
asks, as a proxy of the engine's socket on a network of its own does, or an engine in a privileged container, would make
root on one robot root on another. What else is reached now is noted. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from srprov.modules.mount_kind import GRAVE, TELLS_SYSTEMD, mount_kind, plain
from srprov.names import few
from srprov.planning.graver import AS_ROOT, EVERY_PROCESS, gives_root, of_capability, of_device, of_rule
from srprov.planning.security_options import of_option
from srprov.snapshot.folder import Robot

_OFF = ("host", "none")
"""Networks of services that are as they were."""
_SHOWN = 6


def apart(robots: Sequence[Robot]) -> list[Robot]:
    """Return robots without containers that would give them to each other; one alone is returned as it is."""
    if len(robots) < 2:
        return list(robots)
    return [_one(robot, [other.name for other in robots if other is not robot]) for robot in robots]


def _one(robot: Robot, others: Sequence[str]) -> Robot:
    gone = {one.name for one in robot.services if _is_on_overlay(one.fields) and _lends_its_robot(one.fields)}
    for name in sorted(gone):
        words = "it has what gives its robot away, and containers of other robots would reach all of its ports"
        robot.notes.lost(f"container {name}", f"{words}: it is left out; look at its own robot alone to have it")
    kept = tuple(one for one in robot.services if one.name not in gone)
    if reached := [one.name for one in kept if _is_on_overlay(one.fields)]:
        words = f"containers of {few(others, 3)} reach all ports of {few(reached, _SHOWN)} on the overlay"
        robot.notes.adapted("containers", f"{words}, also those that are not published; alone, a robot has its own")
    return replace(robot, services=kept)


def _is_on_overlay(fields: Mapping[str, Any]) -> bool:
    return fields.get("network") not in _OFF


def _lends_its_robot(fields: Mapping[str, Any]) -> bool:
    """Return whether a service has what is as good as root on its robot, by the words that a plan has for it.

    So is the mount of an engine's socket, of what is as grave, or of any path in the place of such a one: on the robot
    that may be a link to it, or the engine may have its socket elsewhere; a client looks at its own place.
    """
    binds = [one for one in fields.get("volumes", ()) if one["type"] == "bind"]
    kinds = [mount_kind(one[end]) for one in binds for end in ("source", "target")]
    return any(kind == GRAVE or why == TELLS_SYSTEMD for kind, why in kinds) or any(map(gives_root, _notes(fields)))


def _notes(fields: Mapping[str, Any]) -> Iterator[str]:
    """Yield what a plan says of what a service asks for beside mounts."""
    if fields.get("privileged"):
        yield AS_ROOT
    if fields.get("pid"):
        yield EVERY_PROCESS
    yield from map(of_capability, fields.get("cap_add", ()))
    yield from (of_device(plain(one.partition(":")[0])) for one in fields.get("devices", ()))
    yield from map(of_rule, fields.get("device_cgroup_rules", ()))
    yield from map(of_option, fields.get("security_opt", ()))
