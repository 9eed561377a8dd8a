"""What `requires` can ask is asked everywhere: a field that one of these places forgot would be ignored in silence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from srprov.assignment.capability import matrix
from srprov.assignment.requirements import missing
from srprov.data import schema
from srprov.definitions.containermodel import Requirements
from srprov.definitions.requirements import combined, read
from srprov.facts.model import HostFacts
from srprov.planning.fingerprint import fingerprints
from srprov.planning.plan import Plan
from srprov.yamldoc.loader import parse
from srprov.yamldoc.nodes import Findings
from tests.unit.assignment.worlds import GIB, found, robot, service

EVERY: Mapping[str, tuple[str, Any, Mapping[str, Any], Mapping[str, Any]]] = {
    "tags": ("[lidar]", ("lidar",), {"tags": ("lidar",)}, {}),
    "devices": ("[/dev/video0]", ("/dev/video0",), {"devices": ("/dev/video0",)}, {}),
    "arch": ("arm64", ("arm64",), {"arch": "arm64"}, {"arch": "amd64"}),
    "memory": ("2g", 2 * GIB, {"memory_total": 2 * GIB}, {"memory_total": GIB}),
    "cpus": ("2", 2.0, {"cpus": 2}, {"cpus": 1}),
    "gpu": ("true", True, {"tags": ("gpu",)}, {}),
    "kernel": ("'>=6.6'", ">=6.6", {"kernel": "6.6.31"}, {"kernel": "6.1.0"}),
    "disk": ("8g", 8 * GIB, {"disk_total": 8 * GIB}, {"disk_total": GIB}),
}
"""Field -> as it is written, as it is read, what a robot has that meets it, and what one has that does not."""


def test_every_field_is_here_and_in_the_schema() -> None:
    """`wireguard` is no field of `requires`: the experiment's `network` asks for it."""
    assert EVERY.keys() == set(Requirements.__struct_fields__) - {"wireguard"}
    assert EVERY.keys() == schema("edf")["$defs"]["requires"]["properties"].keys()


@pytest.mark.parametrize("field", EVERY)
def test_it_is_read_and_kept_from_a_cdf_and_from_its_service(field: str) -> None:
    written, value, _, _ = EVERY[field]
    asked = read(parse(f"{field}: {written}", "e.edf"), Findings(), ())
    assert asked == Requirements(**{field: value})
    assert combined(asked, Requirements()) == asked == combined(Requirements(), asked)


@pytest.mark.parametrize("field", EVERY)
def test_the_words_and_the_matrix_agree_and_a_plan_relies_on_it(field: str) -> None:
    _, value, meets, lacks = EVERY[field]
    able, unable = robot("r", **meets), robot("r", **lacks)
    one = service("s", requires=Requirements(**{field: value}))
    assert missing(one, (), able) == () and len(missing(one, (), unable)) == 1
    assert matrix({"s": one}, {}, [able, unable]) == {"s": 0b01}
    assert relied_on(able) != relied_on(unable)


def relied_on(facts: HostFacts) -> Mapping[str, Any]:
    """Return what a plan from a file compares of a robot."""
    snapshot = found(facts, observed={"r": ()})
    return fingerprints(Plan(instance="i", source="s", steps=()), snapshot, (), ["r"])
