"""Robots choose how their containers and variables are called; none gets another one's secret by a name."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from srprov.snapshot.secret_names import SecretNames
from tests.unit.controller.test_snapshot import Robot, box, taken


@pytest.mark.parametrize(
    ("lies", "honest"),
    [
        (("my", "db-password"), ("my-db", "PASSWORD")),
        (("cam_era", "TOKEN"), ("cam-era", "TOKEN")),
        (("a__b", "TOKEN"), ("a", "B__TOKEN")),
        (("1a", "TOKEN"), ("s1a", "TOKEN")),
        (("x" * 50, "y" * 50 + "_token"), ("x" * 50, "y" * 50 + "_key")),
    ],
)
def test_no_robot_gets_the_secret_of_another_by_the_name_of_its_own(
    tmp_path: Path, lies: tuple[str, str], honest: tuple[str, str]
) -> None:
    """Neither two secrets have one name, nor do two come from one variable of the user's."""
    for at, order in enumerate(((lies, honest), (honest, lies))):
        robots = {
            f"r{number}": Robot(boxes=[box(number, name, [f"{key}=hunter2-and-{number}"])])
            for number, (name, key) in enumerate(order, 1)
        }
        document, edf, _ = taken(tmp_path / f"out{at}", **robots)
        listed = [one["secrets"] for one in edf["services"].values() if "secrets" in one]
        assert len(listed) == 2 and not set(listed[0]) & set(listed[1])
        variables = [one["env"] for one in edf["secrets"].values()]
        assert len(set(variables)) == 2 and sorted(variables) == sorted(one["env"] for one in document["secrets"])


def test_names_of_secrets_without_end_are_given_in_time() -> None:
    given, begun = SecretNames(), time.monotonic()
    every = [given.give("s" * 50, "k" * 20 + "!@$%^&*"[number % 7]) for number in range(100_000)]
    assert len({secret for secret, _ in every}) == len({variable for _, variable in every}) == len(every)
    assert max(map(len, (name for both in every for name in both))) <= 200 and time.monotonic() - begun < 10
