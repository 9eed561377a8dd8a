"""The paper's capability matrix H for all services and robots at once.

Takes services, their CDFs' platforms and all facts; gives an integer per service, one bit per robot. What a robot
lacks, in words, is `requirements`' work and agrees with this (a property test holds them together); here every distinct
requirement is compared once with every robot, since a thousand services on a thousand robots would otherwise be a
million conversations. Pure, and without numpy: a small decision is made sooner than numpy is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import and_

from srprov.assignment.requirements import (
    GPU_TAG,
    arch_of,
    devices,
    has_platform,
    homes,
    is_there,
    kernel_fits,
    makes_rules,
    needs_rules,
    wants_gpu,
)
from srprov.definitions.model import Service
from srprov.facts.model import HostFacts


def matrix(
    services: Mapping[str, Service], platforms: Mapping[str, Sequence[str]], robots: Sequence[HostFacts]
) -> dict[str, int]:
    """Return each service's row: bit i is set where robot i, of the order given, lacks nothing.

    Raises:
        UsageError: `requires.kernel` cannot be read.
    """
    answers, everybody = _Answers(robots), (1 << len(robots)) - 1
    return {
        name: reduce(and_, answers.of(service, platforms.get(name, ())), everybody)
        for name, service in services.items()
    }


@dataclass
class _Answers:
    """Per distinct requirement the robots that meet it, a bit for each."""

    robots: Sequence[HostFacts]
    known: dict[Hashable, int] = field(default_factory=dict)

    def of(self, service: Service, platforms: Sequence[str]) -> list[int]:
        """Return a row for each thing that a service asks for."""
        wanted, ask = service.requires, self._ask
        rows = [ask("docker", lambda robot: robot.docker is not None and not robot.docker.rootless)]
        if service.robot:
            rows.append(ask(("robot", service.robot), lambda robot: robot.name == service.robot))
        if service.data_on:
            rows.append(ask(("robot", service.data_on), lambda robot: robot.name == service.data_on))
        if wanted.arch:
            rows.append(ask(("arch", *wanted.arch), lambda robot: robot.arch in wanted.arch))
        if platforms:
            built = {arch_of(platform) for platform in platforms}
            rows.append(ask(("platforms", *sorted(built)), lambda robot: robot.arch in built))
        rows += [
            ask(("images", *there), lambda robot, there=there: has_platform(there, robot))
            for there in service.platforms.values()
        ]
        rows += [ask(("tag", tag), lambda robot, tag=tag: tag in robot.tags) for tag in wanted.tags]
        rows += [
            ask(("device", path), lambda robot, path=path: is_there(path, robot.devices)) for path in devices(service)
        ]
        if wants_gpu(service):
            rows.append(ask(("tag", GPU_TAG), lambda robot: GPU_TAG in robot.tags))
        if wanted.memory:
            rows.append(ask(("memory", wanted.memory), lambda robot: wanted.memory <= robot.memory_total))
        if wanted.disk:
            rows.append(ask(("disk", wanted.disk), lambda robot: wanted.disk <= robot.disk_total))
        if wanted.cpus:
            rows.append(ask(("cpus", wanted.cpus), lambda robot: wanted.cpus <= robot.cpus))
        if wanted.kernel:
            rows.append(ask(("kernel", wanted.kernel), lambda robot: kernel_fits(wanted.kernel, robot.kernel)))
        if wanted.wireguard:
            rows.append(ask("wireguard", lambda robot: bool(robot.wireguard)))
        if needs_rules(service):
            rows.append(ask("rules", makes_rules))
        rows += [ask(("home", user), lambda robot, user=user: bool(robot.home(user))) for user in homes(service)]
        return rows

    def _ask(self, key: Hashable, meets: Callable[..., bool]) -> int:
        if key not in self.known:
            self.known[key] = sum(1 << bit for bit, robot in enumerate(self.robots) if meets(robot))
        return self.known[key]
