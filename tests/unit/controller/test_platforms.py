"""An image that a robot's architecture has none of is refused by the plan, where that is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller.platforms import check_platforms
from srprov.errors import UsageError
from srprov.facts.model import HostFacts

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
