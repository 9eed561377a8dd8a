"""Ansible's host patterns."""

from __future__ import annotations

import pytest

from srprov.definitions.model import Host, Inventory
from srprov.definitions.patterns import select
from srprov.errors import UsageError

NAMES = ["arm1", "robot01", "robot02", "robot03", "robot10", "spare"]
LAB = Inventory(
    hosts={name: Host(name=name, address=name) for name in NAMES},
    groups={"all": tuple(NAMES), "robots": ("robot01", "robot02", "robot03", "robot10"), "fast": ("arm1", "robot02")},
)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("all", NAMES),
        ("*", NAMES),
        ("arm1", ["arm1"]),
        ("arm1,spare", ["arm1", "spare"]),
        ("spare:arm1", ["arm1", "spare"]),
        (" arm1 , spare ", ["arm1", "spare"]),
        ("robot*", ["robot01", "robot02", "robot03", "robot10"]),
        ("robot0?", ["robot01", "robot02", "robot03"]),
        ("fast", ["arm1", "robot02"]),
        ("fas*", ["arm1", "robot02"]),
        ("robots:!robot02", ["robot01", "robot03", "robot10"]),
        ("!robot02:robots", ["robot01", "robot03", "robot10"]),
        ("!fast", ["robot01", "robot03", "robot10", "spare"]),
        ("robots:&fast", ["robot02"]),
        ("all:&robots:!fast", ["robot01", "robot03", "robot10"]),
        ("~robot0[12]", ["robot01", "robot02"]),
        ("~(arm|spare)", ["arm1", "spare"]),
        ("!~robot.*", ["arm1", "spare"]),
        ("robot[01:03]", ["robot01", "robot02", "robot03"]),
        ("robot[01:02],arm1", ["arm1", "robot01", "robot02"]),
        ("robots[0]", ["robot01"]),
        ("robots[-1]", ["robot10"]),
        ("robots[1:2]", ["robot02", "robot03"]),
        ("robots[2:]", ["robot03", "robot10"]),
    ],
)
def test_pattern_picks(pattern: str, expected: list[str]) -> None:
    assert select(LAB, pattern) == tuple(expected)


def test_several_patterns_are_joined() -> None:
    assert select(LAB, ["arm1", "robots", "!robot10"]) == ("arm1", "robot01", "robot02", "robot03")


@pytest.mark.parametrize(
    "pattern", ["robot9", "arm1,robto01", "!nobody", "&fast:spare", "arm1:!arm1", "~[", "robots[9]"]
)
def test_what_matches_nothing_is_an_error(pattern: str) -> None:
    with pytest.raises(UsageError) as error:
        select(LAB, pattern)
    assert error.value.exit_code == 5


def test_the_error_lists_hosts_and_groups_and_guesses() -> None:
    with pytest.raises(UsageError) as error:
        select(LAB, "robto01")
    assert "did you mean 'robot01'?" in error.value.hint
    assert "hosts: arm1, robot01" in error.value.hint
    assert "groups: all, robots, fast" in error.value.hint
