"""Robots choose how their containers and variables are called; none gets another one's secret by a name."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from srprov.snapshot.hider import Hider
from srprov.snapshot.secret_names import SecretNames
from srprov.snapshot.without import another_s
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


def test_no_robot_gets_what_the_user_set_for_another_one_s_snapshot(tmp_path: Path) -> None:
    """Robots are looked at one after the other, and the user's variables stay set: each is of one robot."""
    found = []
    for number, (robot, name, key) in enumerate((("r2", "db", "PASSWORD"), ("r1", "db", "PASSWORD")), 1):
        one = Robot(boxes=[box(number, name, [f"{key}=hunter2-and-{number}"])])
        _, edf, _ = taken(tmp_path / f"out{number}", **{robot: one})
        found += [one["env"] for one in edf["secrets"].values()]
    assert found == ["R2__DB__PASSWORD", "R1__DB__PASSWORD"]


def test_no_robot_learns_another_one_s_secret_by_which_of_its_containers_come_back(tmp_path: Path) -> None:
    """A few that each hold half of ten thousand guesses told it which one is right, in one snapshot."""
    guesses = [f"sunshine{number}" for number in range(8)]
    halves = {
        f"c{bit}-{value}": [one for at, one in enumerate(guesses) if at >> bit & 1 == value]
        for bit in range(3)
        for value in (0, 1)
    }
    lies = [box(at, name, [f"WORDS={' '.join(some)}"]) for at, (name, some) in enumerate(halves.items(), 1)]
    seen = set()
    for password in (*guesses, "another-one"):
        honest = Robot(boxes=[box(9, "db", [f"DB_PASSWORD={password}"])])
        document, edf, _ = taken(tmp_path / password, r1=Robot(boxes=lies), r2=honest)
        seen.add(frozenset(halves.keys() & edf["services"].keys()))
        assert "db" in edf["services"], "its own robot's has it still"
        assert ("all are left out" in str(document)) == (password in guesses), "the user is told"
    assert seen == {frozenset(), frozenset(halves)}

    short = Robot(boxes=[box(9, "db", ["DB_PASSWORD=ros1"])])
    _, edf, _ = taken(tmp_path / "short", r1=Robot(boxes=[box(1, "a", ["WORDS=ros1 ros2"])]), r2=short)
    assert edf["services"]["a"]["environment"] == ["WORDS=ros1 ros2"], "a usual word is hidden in its own robot's alone"


def test_a_change_in_a_repository_tells_no_robot_which_is_another_one_s_secret() -> None:
    every, own = Hider(["hunter2-and-more", "mine-and-nobody's"]), Hider(["mine-and-nobody's"])
    assert another_s("+hunter2-and-more", every, own) and not another_s("+mine-and-nobody's", every, own)
    assert not another_s("+nothing", every, own)
    assert not another_s("+mine-and-nobody's hunter2-and-more", every, own), "there is no patch, whoever else has one"


def test_no_variable_of_a_robot_begins_as_those_of_another_one() -> None:
    """Whatever its containers and their variables are called, and in whatever snapshot."""
    robots = ["r", "r-1", "r_1", "R-1", "r.1", "r--1", "r-1-", "r-1__db", "1", "s1", "é", "è", "r-1-db", "x" * 200]
    begun = {robot: SecretNames().of(robot)("db", "PASSWORD")[1].removesuffix("DB__PASSWORD") for robot in robots}
    assert begun["r"] == "R__" and begun["r-1"] == "R_1__"
    lies = [(one, key) for one in ("db", "1", "1__db", "-1") for key in ("PASSWORD", "_PASSWORD", "DB__PASSWORD")]
    for robot, begin in begun.items():
        names = SecretNames()
        for _ in range(3):
            assert all(names.of(robot)(*lie)[1].startswith(begin) for lie in lies)
        assert begin[0].isalpha() and not [one for one in begun.values() if one != begin and one.startswith(begin)]
    assert len(set(begun.values())) == len(robots)


def test_names_of_secrets_without_end_are_given_in_time() -> None:
    given, begun = SecretNames(), time.monotonic()
    every = [given.of("r1")("s" * 50, "k" * 20 + "!@$%^&*"[number % 7]) for number in range(100_000)]
    assert len({secret for secret, _ in every}) == len({variable for _, variable in every}) == len(every)
    assert max(map(len, (name for both in every for name in both))) <= 200 and time.monotonic() - begun < 10
