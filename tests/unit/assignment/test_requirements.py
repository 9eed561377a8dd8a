"""Every reason for a 0 in the capability matrix names what is required and what the robot has."""

from typing import Any

import pytest

from srprov.assignment.capability import matrix
from srprov.assignment.requirements import kernel_fits, missing
from srprov.definitions.containermodel import Requirements
from srprov.errors import UsageError
from srprov.facts.model import Docker
from tests.unit.assignment.worlds import GIB, robot, service


@pytest.mark.parametrize(
    ("wants", "has", "texts"),
    [
        ({}, {}, []),
        ({"tags": ("lidar",)}, {"tags": ("arm", "camera", "lidar")}, []),
        ({"tags": ("lidar",)}, {"tags": ("arm", "camera")}, ["needs tag 'lidar' (has: arm, camera)"]),
        ({"tags": ("arm", "gpio", "lidar")}, {"tags": ("arm",)}, ["needs tags 'gpio', 'lidar' (has: arm)"]),
        ({"tags": ("lidar",)}, {}, ["needs tag 'lidar' (has: none)"]),
        ({"devices": ("/dev/video0",)}, {"devices": ("/dev/video0", "/dev/video1")}, []),
        ({"devices": ("/dev/snd",)}, {"devices": ("/dev/snd/pcmC0D0p",)}, []),
        ({"devices": ("/dev/video1",)}, {"devices": ("/dev/video10",)}, ["needs device '/dev/video1' (not there)"]),
        ({"arch": ("arm64", "amd64")}, {}, []),
        ({"arch": ("arm64", "arm")}, {}, ["needs architecture arm64 or arm (has amd64)"]),
        ({"memory": 8 * GIB}, {"memory_available": 0}, []),
        ({"memory": 8 * GIB + (200 << 20)}, {}, ["needs 8.195 GiB of memory (has 8 GiB)"]),
        ({"disk": 64 * GIB}, {"disk_total": 300 << 20}, ["needs 64 GiB of disk (has 300 MiB)"]),
        ({"cpus": 4.0}, {"load1": 9.0}, []),
        ({"cpus": 4.5}, {}, ["needs 4.5 CPUs (has 4)"]),
        ({"gpu": True}, {"tags": ("gpu",)}, []),
        ({"gpu": True}, {"tags": ("camera",)}, ["needs a GPU (none found)"]),
        ({"kernel": ">=5.10"}, {}, []),
        ({"kernel": ">=6.6"}, {}, ["needs kernel >=6.6 (has 6.1.0-18-amd64)"]),
        ({"kernel": ">=6.6"}, {"kernel": ""}, ["needs kernel >=6.6 (has unknown)"]),
        ({}, {"docker": None}, ["no Docker"]),
        ({"wireguard": True}, {"wireguard": "userspace"}, []),
        (
            {"wireguard": True},
            {"wireguard_problem": "no wg"},
            ["no WireGuard (no wg), and network.encryption asks for it"],
        ),
        ({}, {"rules": "iptables"}, []),
        ({}, {"rules": "none"}, ["neither nft nor iptables, to keep others out of the overlay"]),
        ({"wireguard": True}, {"wireguard": "kernel", "rules": "none"}, []),
        ({}, {"docker": None, "docker_problem": "not installed"}, ["no Docker (not installed)"]),
        ({"tags": ("a",), "cpus": 9.0}, {}, ["needs tag 'a' (has: none)", "needs 9 CPUs (has 4)"]),
    ],
)
def test_reasons(wants: dict[str, Any], has: dict[str, Any], texts: list[str]) -> None:
    """Reasons."""
    lacks = missing(service("s", requires=Requirements(**wants)), (), robot("r", **has))
    assert [miss.text for miss in lacks] == texts
    assert all(miss.remedy for miss in lacks)


def test_an_image_that_is_not_there_for_a_robots_architecture_keeps_the_service_off_it() -> None:
    """Neither emulation nor a smaller architecture of the same processor does; what nobody knows does not either."""
    image = "debian@sha256:" + "1" * 64
    one = service("s", platforms={image: ("linux/arm/v7", "linux/386"), "other": ()})
    emulating = robot("qemu", arch="riscv64", emulates=("arm",))
    robots = [robot("arm64", arch="arm64"), robot("riscv", arch="riscv64"), emulating, robot("unknown", arch="")]
    assert matrix({"s": one}, {}, robots) == {"s": 0b1101}
    (miss,) = missing(one, (), robots[1])
    assert miss.text == "its image debian is only for linux/arm/v7 or linux/386 (is riscv64)"
    assert miss.remedy == "name an image that is there for riscv64, then lock again"
    assert not any(missing(one, (), able) for able in (robots[0], *robots[2:]))


@pytest.mark.parametrize(("network", "needs"), [("overlay", 1), ("both", 1), ("host", 0), ("none", 0)])
def test_rules_are_needed_where_there_is_an_overlay_to_close(network: str, needs: int) -> None:
    bare, able = robot("bare", rules="none"), robot("able", rules="nftables")
    one = service("s", network=network)
    assert len(missing(one, (), bare)) == needs
    assert matrix({"s": one}, {}, [bare, able]) == {"s": 0b10 if needs else 0b11}


ROOTLESS = Docker(version="24.0.5", api_version="1.43", rootless=True)


@pytest.mark.parametrize(
    ("network", "why"),
    [
        ("overlay", "its bridges are in a network namespace of its own"),
        ("both", "its bridges are in a network namespace of its own"),
        ("host", "a namespace of its own, not the robot's network"),
        ("none", "its containers have only a user's rights"),
    ],
)
def test_a_rootless_engine_runs_nothing_and_says_why(network: str, why: str) -> None:
    """The reason is about the service's own network; the matrix, which asks once for all, agrees with the words."""
    one, able, unable = service("s", network=network), robot("able"), robot("r", docker=ROOTLESS)
    (miss,) = missing(one, (), unable)
    assert miss.text.startswith("its Docker is rootless: ") and why in miss.text
    assert miss.remedy == "run a rootful Docker on r"
    assert matrix({"s": one}, {}, [able, unable]) == {"s": 0b01}


def test_a_pin_excludes_all_others() -> None:
    """A pin excludes all others."""
    pinned = service("s", robot="r2")
    assert [miss.text for miss in missing(pinned, (), robot("r1"))] == ["pinned to r2"]
    assert missing(pinned, (), robot("r2")) == ()


@pytest.mark.parametrize(
    ("platforms", "arch", "fits"),
    [
        ((), "riscv64", True),
        (("linux/amd64", "linux/arm64"), "arm64", True),
        (("linux/arm/v7",), "arm", True),
        (("linux/arm/v7",), "arm64", False),
    ],
)
def test_platforms_of_the_cdf(platforms: tuple[str, ...], arch: str, fits: bool) -> None:
    """Platforms of the cdf."""
    lacks = missing(service("s"), platforms, robot("r", arch=arch))
    assert (lacks == ()) is fits
    assert all(arch in miss.text and miss.text.startswith("its CDF is only for linux/") for miss in lacks)


@pytest.mark.parametrize(
    ("bound", "kernel", "fits"),
    [
        (">=5.10", "5.10.0-rpi7", True),
        (">=5.10", "5.9.16", False),
        (">=5.10", "6.1", True),
        ("5.10", "5.4.0", False),
        (">= 5.10.3", "5.10", False),
        (">=5.10.0", "5.10", True),
        (">=5", "5.15.0-1025-raspi+", True),
        (">=5.4, >=6.1", "5.15", False),
        (">=5", "custom", False),
        (">=999999999.999999999", "999999999.999999999-x", True),
        (">=5", "9" * 5000, False),
        (">=5.10", f"5.10.{'9' * 5000}", True),
    ],
)
def test_kernel_bounds(bound: str, kernel: str, fits: bool) -> None:
    """Kernel bounds."""
    assert kernel_fits(bound, kernel) is fits


@pytest.mark.parametrize("bound", ["newest", f">={'9' * 5000}", "5.1234567890", ">=\u0665"])
def test_a_bound_that_is_none_is_refused(bound: str) -> None:
    """Words, and numbers that no kernel has."""
    with pytest.raises(UsageError, match="not a version bound"):
        kernel_fits(bound, "6.1")
