"""An image that a robot's architecture has none of is refused by the plan, where that is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller.platforms import check_platforms
from srprov.definitions.model import Definitions
from srprov.errors import NoAssignment, UsageError
from srprov.facts.model import HostFacts
from srprov.planning.plan import Plan
from tests.fakes import World
from tests.worlds import experiment, made, service

BASE = "debian@sha256:" + "1" * 64


def check(platforms: tuple[str, ...], arch: str, *, image: str = "", robot: str = "r") -> None:
    """Check one service on robot `r`, whose CDF starts from two images, or which names one."""
    service = SimpleNamespace(image=image, cdf="" if image else "x.cdf")
    snapshot = SimpleNamespace(facts={"r": HostFacts(name="r", arch=arch)})
    experiment = SimpleNamespace(services={"one": service})
    inputs: Any = SimpleNamespace(placed={"one": robot}, experiment=experiment, snapshot=snapshot)
    containers = {"x.cdf": SimpleNamespace(images=("other", BASE))}
    definitions: Any = SimpleNamespace(platforms={BASE: platforms} if platforms else {}, containers=containers)
    check_platforms(inputs, definitions)


def test_a_service_goes_where_there_is_an_image_for_it_or_the_reasons_say_that_there_is_none() -> None:
    world = World().add("r1", "r2", arch="x86_64").add("r3", arch="aarch64")
    what = experiment(service("one", image=BASE), service("two", image=BASE))

    def plan(*platforms: str) -> Plan:
        return made(world, Definitions(experiment=what, containers={}, platforms={BASE: platforms})).plan

    assert set(plan("linux/arm64/v8", "linux/riscv64").assignment.values()) == {"r3"}
    assert set(plan("linux/amd64").assignment.values()) <= {"r1", "r2"}
    with pytest.raises(NoAssignment) as none:
        plan("linux/riscv64")
    assert "its image debian is only for linux/riscv64 (is amd64)" in str(none.value.misses)


@pytest.mark.parametrize("image", ["", BASE])
def test_an_image_for_other_architectures_alone_is_refused_with_what_there_is(image: str) -> None:
    with pytest.raises(UsageError, match="is for linux/amd64, linux/386; r is arm64") as raised:
        check(("linux/amd64", "linux/386"), "arm64", image=image)
    assert "requires" in raised.value.hint


@pytest.mark.parametrize(
    ("platforms", "arch", "robot"),
    [
        (("linux/amd64", "linux/arm64/v8"), "arm64", "r"),
        (("linux/arm/v7",), "arm64", "r"),  # a 64-bit system runs it
        ((), "arm64", "r"),  # nobody knows
        (("linux/amd64",), "", "r"),  # nobody knows what the robot is
        (("linux/amd64",), "arm64", "away"),  # it cannot be reached, and stays as it is
    ],
)
def test_an_image_that_may_be_there_is_not_refused(platforms: tuple[str, ...], arch: str, robot: str) -> None:
    check(platforms, arch, robot=robot)
