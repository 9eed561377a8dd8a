"""The paper's capability matrix H for all services and robots at once.

Takes services, their CDFs' platforms and all facts; gives booleans. What a robot lacks, in words, is `requirements`'
work and agrees with this (a property test holds them together); here every distinct requirement is compared once with
every robot, since a thousand services on a thousand robots would otherwise be a million conversations. Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from srprov.assignment.requirements import GPU_TAG, arch_of, devices, is_there, kernel_fits, wants_gpu
from srprov.assignment.table import Array
from srprov.definitions.model import Service
from srprov.facts.model import HostFacts


def matrix(
    services: Mapping[str, Service], platforms: Mapping[str, Sequence[str]], robots: Sequence[HostFacts]
) -> Array:
    """Give bool [services, robots], in the order given: True where the robot lacks nothing.

    Raises:
        UsageError: `requires.kernel` cannot be read.
    """
    capable: Array = np.ones((len(services), len(robots)), dtype=bool)
    answers = _Answers(robots)
    for row, (name, service) in enumerate(services.items()):
        for vector in answers.of(service, platforms.get(name, ())):
            capable[row] &= vector
    return capable


@dataclass
class _Answers:
    """Per distinct requirement the robots that meet it, bool [robots]."""

    robots: Sequence[HostFacts]
    known: dict[Hashable, Array] = field(default_factory=dict)

    def of(self, service: Service, platforms: Sequence[str]) -> list[Array]:
        """Give a vector for each thing that a service asks for."""
        wanted, ask = service.requires, self._ask
        vectors = [ask("docker", lambda robot: robot.docker is not None and not robot.docker.rootless)]
        if service.robot:
            vectors.append(ask(("robot", service.robot), lambda robot: robot.name == service.robot))
        if wanted.arch:
            vectors.append(ask(("arch", *wanted.arch), lambda robot: robot.arch in wanted.arch))
        if platforms:
            built = {arch_of(platform) for platform in platforms}
            vectors.append(ask(("platforms", *sorted(built)), lambda robot: robot.arch in built))
        vectors += [ask(("tag", tag), lambda robot, tag=tag: tag in robot.tags) for tag in wanted.tags]
        vectors += [
            ask(("device", path), lambda robot, path=path: is_there(path, robot.devices)) for path in devices(service)
        ]
        if wants_gpu(service):
            vectors.append(ask(("tag", GPU_TAG), lambda robot: GPU_TAG in robot.tags))
        if wanted.memory:
            vectors.append(ask(("memory", wanted.memory), lambda robot: wanted.memory <= robot.memory_total))
        if wanted.disk:
            vectors.append(ask(("disk", wanted.disk), lambda robot: wanted.disk <= robot.disk_total))
        if wanted.cpus:
            vectors.append(ask(("cpus", wanted.cpus), lambda robot: wanted.cpus <= robot.cpus))
        if wanted.kernel:
            vectors.append(ask(("kernel", wanted.kernel), lambda robot: kernel_fits(wanted.kernel, robot.kernel)))
        return vectors

    def _ask(self, key: Hashable, meets: Callable[..., bool]) -> Array:
        if key not in self.known:
            self.known[key] = np.array([meets(robot) for robot in self.robots], dtype=bool)
        return self.known[key]
