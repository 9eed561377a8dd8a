"""The paper's capability matrix H: what a robot lacks for a service, in words.

Takes a service, its CDF's platforms and one robot's facts; gives every `UnmetRequirement`, not only the first.
Requirements are compared with totals and presence, never with what is free at the moment. Pure.

Source: the paper's matrix H (m x n, binary); the reasons are ours.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import msgspec

from srprov.codes import Code
from srprov.definitions.containermodel import Requirements
from srprov.definitions.model import Service
from srprov.errors import UsageError
from srprov.facts.model import HostFacts
from srprov.sizes import size_text


class UnmetRequirement(msgspec.Struct, frozen=True, order=True):
    """One thing that a robot lacks for a service: what is required and what the robot has, and what would help."""

    text: str
    remedy: str
    count: int = 1
    """How many things those are, e.g. tags."""


GPU_TAG = "gpu"
"""As the facts detect it, or the inventory says."""
_OVERLAY = "its bridges are in a network namespace of its own, where no VXLAN link of the robot can join them"
_UNFIT = {
    "overlay": _OVERLAY,
    "both": _OVERLAY,
    "host": "the network of the host is to it a namespace of its own, not the robot's network",
    "none": "its containers have only a user's rights on the robot: too few for secrets and devices",
}
"""Network of a service -> why a rootless engine does not run it."""
_SHOWN = 8
"""Platforms of an image that are named."""
_VERSION = r"[0-9]{1,9}(?:\.[0-9]{1,9})*"
"""What is read of a kernel's release: a number of thousands of digits is none to Python."""
_BOUND = re.compile(rf"\s*(?:>=)?\s*({_VERSION})\s*")
_RELEASE = re.compile(rf"{_VERSION}(?![0-9])")


def missing(service: Service, platforms: Sequence[str], facts: HostFacts) -> tuple[UnmetRequirement, ...]:
    """Return everything that a reachable robot lacks for a service; empty when it can run there.

    Args:
        service: With its CDF's requirements merged in.
        platforms: The CDF's `platforms` such as `linux/arm64`; empty when it names none.
        facts: The robot.

    Raises:
        UsageError: `requires.kernel` cannot be read.
    """
    wanted = service.requires
    return (
        *_engine_and_pin(service, facts),
        *_architecture(wanted, platforms, facts),
        *_images(service, facts),
        *_presence(wanted, devices(service), wants_gpu(service), facts),
        *_amounts(wanted, facts),
        *_kernel(wanted, facts),
        *_encryption(wanted, facts),
        *_rules(service, facts),
        *_homes(service, facts),
    )


def kernel_fits(bound: str, kernel: str) -> bool:
    """Return whether a kernel release such as `5.15.0-91-generic` is at least `bound`, such as `>=5.10` or `5.10`.

    Several bounds, as of a CDF and an EDF, stand side by side with a comma: all must hold.

    Raises:
        UsageError: The bound cannot be read.
    """
    found = _RELEASE.match(kernel)
    has = _numbers(found.group()) if found else ()
    # 5.10 is at least 5.10.0, so what is not there counts as 0.
    return all(has and has + (0,) * (len(want) - len(has)) >= want for want in _lower_bounds(bound))


def _lower_bounds(bound: str) -> Iterator[tuple[int, ...]]:
    for part in bound.split(","):
        match = _BOUND.fullmatch(part)
        if match is None:
            raise UsageError(
                f"requires.kernel '{bound}' is not a version bound", hint="write it as '>=5.10'", code=Code.WRONG_VALUE
            )
        yield _numbers(match.group(1))


def _engine_and_pin(service: Service, facts: HostFacts) -> Iterator[UnmetRequirement]:
    if facts.docker is None:
        cause = f" ({facts.docker_problem})" if facts.docker_problem else ""
        yield UnmetRequirement(f"no Docker{cause}", f"make Docker work on {facts.name}")
    elif facts.docker.rootless:
        yield UnmetRequirement(
            f"its Docker is rootless: {_UNFIT[service.network]}", f"run a rootful Docker on {facts.name}"
        )
    yield from pinned_elsewhere(service, facts.name)


def _encryption(wanted: Requirements, facts: HostFacts) -> Iterator[UnmetRequirement]:
    if wanted.wireguard and not facts.wireguard:
        cause = f" ({facts.wireguard_problem})" if facts.wireguard_problem else ""
        remedy = f"install wireguard-tools on {facts.name}, and wireguard-go where the kernel has no WireGuard"
        yield UnmetRequirement(f"no WireGuard{cause}, and network.encryption asks for it", remedy)


def _rules(service: Service, facts: HostFacts) -> Iterator[UnmetRequirement]:
    if needs_rules(service) and not makes_rules(facts):
        remedy = f"install nftables on {facts.name}: its rules let only the overlay's own robots in"
        yield UnmetRequirement("neither nft nor iptables, to keep others out of the overlay", remedy)


def needs_rules(service: Service) -> bool:
    """Return whether its robot needs rules of a firewall: on an overlay, unless keys keep others out."""
    return service.network in ("overlay", "both") and not service.requires.wireguard


def makes_rules(facts: HostFacts) -> bool:
    """Return whether a robot has what makes such rules; one of which it is not known counts as if."""
    return facts.rules != "none"


def _homes(service: Service, facts: HostFacts) -> Iterator[UnmetRequirement]:
    if absent := [user for user in homes(service) if not facts.home(user)]:
        remedy = f"make {_quoted('user', absent)} with a home on {facts.name}, or write an absolute path"
        yield UnmetRequirement(f"mounts the home of {_quoted('user', absent)} (not there)", remedy)


def homes(service: Service) -> tuple[str, ...]:
    """Return the users of its robot whose homes a service mounts."""
    return tuple(dict.fromkeys(mount.home_of for mount in service.runtime.mounts if mount.home_of))


def pinned_elsewhere(service: Service, robot: str) -> Iterator[UnmetRequirement]:
    """Return what keeps a service off a robot when it is pinned to another."""
    if service.robot and service.robot != robot:
        remedy = f"remove 'robot: {service.robot}' from service '{service.instance_of or service.name}'"
        yield UnmetRequirement(f"pinned to {service.robot}", remedy)
    if service.data_on and service.data_on != robot:
        remedy = f"copy the data of '{service.name}' with --data move, or start without it with --data leave"
        yield UnmetRequirement(f"its data is on {service.data_on}", remedy)


def _architecture(wanted: Requirements, platforms: Sequence[str], facts: HostFacts) -> Iterator[UnmetRequirement]:
    has = facts.arch or "unknown"
    if wanted.arch and facts.arch not in wanted.arch:
        yield UnmetRequirement(f"needs architecture {_either(wanted.arch)} (has {has})", f"add {has} to requires.arch")
    # `linux/arm/v7`: the facts know the architecture, not its variant.
    if platforms and facts.arch not in {arch_of(platform) for platform in platforms}:
        remedy = f"add linux/{has} to the platforms of its CDF"
        yield UnmetRequirement(f"its CDF is only for {_either(platforms)} (is {has})", remedy)


def _images(service: Service, facts: HostFacts) -> Iterator[UnmetRequirement]:
    for image, there in service.platforms.items():
        if not has_platform(there, facts):
            name, arch = image.partition("@")[0], facts.runs[0]
            text = f"its image {name} is only for {_either(there[:_SHOWN])} (is {arch})"
            yield UnmetRequirement(text, f"name an image that is there for {arch}, then lock again")


def has_platform(there: Sequence[str], facts: HostFacts) -> bool:
    """Return whether a robot runs one of the platforms that an image is there for, or nobody knows."""
    return not there or not facts.runs or any(arch_of(one) in facts.runs for one in there)


def devices(service: Service) -> tuple[str, ...]:
    """Return the devices that a robot must have: those of `requires`, and those that the container is given."""
    return tuple(dict.fromkeys((*service.requires.devices, *(path for path, _, _ in service.runtime.devices))))


def wants_gpu(service: Service) -> bool:
    """Return whether a service needs a GPU: `requires.gpu`, or `gpus` of its container."""
    return service.requires.gpu or service.runtime.gpus not in ("", "0")


def _presence(wanted: Requirements, paths: Sequence[str], gpu: bool, facts: HostFacts) -> Iterator[UnmetRequirement]:
    tags = [tag for tag in wanted.tags if tag not in facts.tags]
    if tags:
        remedy = f"give {facts.name} the {_quoted('tag', tags)} (srprov_tags in the inventory)"
        yield UnmetRequirement(
            f"needs {_quoted('tag', tags)} (has: {', '.join(facts.tags) or 'none'})", remedy, len(tags)
        )
    absent = [path for path in paths if not is_there(path, facts.devices)]
    if absent:
        remedy = f"attach {', '.join(absent)} to {facts.name} (or name it in srprov_devices in the inventory)"
        yield UnmetRequirement(f"needs {_quoted('device', absent)} (not there)", remedy, len(absent))
    if gpu and GPU_TAG not in facts.tags:
        yield UnmetRequirement(
            "needs a GPU (none found)", f"give {facts.name} the tag '{GPU_TAG}' if it has one all the same"
        )


def _amounts(wanted: Requirements, facts: HostFacts) -> Iterator[UnmetRequirement]:
    for word, needs, has in (
        ("memory", wanted.memory, facts.memory_total),
        ("disk", wanted.disk, facts.disk_total),
    ):
        if needs > has:
            text = f"needs {size_text(needs)} of {word} (has {size_text(has)})"
            yield UnmetRequirement(text, f"lower requires.{word}")
    if wanted.cpus > facts.cpus:
        yield UnmetRequirement(f"needs {wanted.cpus:g} CPUs (has {facts.cpus})", "lower requires.cpus")


def _kernel(wanted: Requirements, facts: HostFacts) -> Iterator[UnmetRequirement]:
    if wanted.kernel and not kernel_fits(wanted.kernel, facts.kernel):
        has = facts.kernel or "unknown"
        remedy = f"give {facts.name} such a kernel, or relax requires.kernel"
        yield UnmetRequirement(f"needs kernel {wanted.kernel} (has {has})", remedy)


def is_there(path: str, devices: Sequence[str]) -> bool:
    """Return whether a device, or a folder of devices such as /dev/snd, is among the robot's."""
    return any(device == path or device.startswith(f"{path.rstrip('/')}/") for device in devices)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def arch_of(platform: str) -> str:
    """Return the architecture of a platform such as `linux/arm64`."""
    parts = platform.split("/")
    return parts[1] if len(parts) > 1 else parts[0]


def _either(words: Sequence[str]) -> str:
    return " or ".join(words)


def _quoted(noun: str, words: Sequence[str]) -> str:
    return f"{noun}{'s' if len(words) > 1 else ''} {', '.join(repr(word) for word in words)}"
