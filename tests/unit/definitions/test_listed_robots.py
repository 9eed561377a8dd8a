"""Lists of robots: what a stranger's may cost, and what a fleet's must not be refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from srprov.definitions.model import Host, Inventory
from srprov.definitions.patterns import select
from srprov.errors import UsageError
from tests.bounded import within

NUMBERED = [f"r{number:05}" for number in range(10_000)]
LONG_NAMED = [f"r{format(number * 0x9E3779B97F4A7C15 % 2**189, '0189b')}" for number in range(10_000)]


def fleet(names: list[str], groups: int = 1) -> Inventory:
    hosts = {name: Host(name=name, address=name) for name in names}
    many = {f"g{number}": tuple(names) for number in range(groups)}
    return Inventory(hosts=hosts, groups={"all": tuple(names), **many})


@pytest.mark.parametrize(
    ("line", "names", "groups"),
    [
        ("~(r|g).*x?" + "x?" * 90 + "N", NUMBERED, 1),
        ("~(r|g).*x?" + "[01]?" * 90 + "N?", LONG_NAMED, 1),
        ("~r.*(0|1).{1,30}0.{1,30}N?", LONG_NAMED, 1),
        ("~r0{0,N}.*", NUMBERED, 1),
        ("g*STARS", NUMBERED, 50),
        ("~gN?.*", NUMBERED, 50),
        ("*" + "?" * 95 + "N", LONG_NAMED, 1),
        ("r*" + "*0*" * 150 + "N*", LONG_NAMED, 1),
        ("r0[0000:LAST]", NUMBERED, 1),
        ("all[N:]", NUMBERED, 1),
        ("g*[N:]", NUMBERED, 50),
    ],
)
def test_lines_for_many_robots_are_read_or_refused_in_time(
    tmp_path: Path, line: str, names: list[str], groups: int
) -> None:
    """Two hundred lines, each against ten thousand robots and all members of their groups, took up to 38 s."""
    lines = [
        line.replace("STARS", "*" * number).replace("LAST", str(9999 - number)).replace("N", str(number))
        for number in range(1, 199)
    ]
    (tmp_path / "list").write_text("\n".join(lines))
    inventory = fleet(names, groups)
    told = ""
    with within(2):
        try:
            assert select(inventory, f"@{tmp_path}/list")
        except UsageError as error:
            told = str(error)
    assert not told or re.search(r"list', line [0-9]+: .* takes too long$|matches no host", told)


def test_names_of_groups_count_too(tmp_path: Path) -> None:
    (tmp_path / "list").write_text("".join(f"g{number}\n" for number in range(600)))
    with within(2), pytest.raises(UsageError, match=r"list', line 500: .* takes too long"):
        select(fleet(NUMBERED, 600), f"@{tmp_path}/list")


@pytest.mark.parametrize(
    ("lines", "robots"),
    [
        (NUMBERED[:200], 1000),
        (NUMBERED, 10_000),
        ([f"r{number:03}*" for number in range(100)], 10_000),
        ([f"r{number:03}[00:99]" for number in range(100)], 10_000),
        ([f"~r0{number:02}[0-9]+" for number in range(10)], 1000),
        (["~r0(0|1)[0-9]{3}", "~r0[2-9].*"], 10_000),
        ([f"g{number}" for number in range(50)], 10_000),
    ],
)
def test_lists_of_fleets_are_read(tmp_path: Path, lines: list[str], robots: int) -> None:
    (tmp_path / "list").write_text("\n".join(lines))
    inventory = fleet(NUMBERED[:robots], 50)
    with within(2):
        assert len(select(inventory, f"@{tmp_path}/list")) in (200, robots)


@pytest.mark.parametrize("line", ["robots[" + "1" * 5000 + "]", "a" * 600, "*a" * 300])
def test_a_long_line_of_a_list_is_none(tmp_path: Path, line: str) -> None:
    (tmp_path / "list").write_text(line)
    with pytest.raises(UsageError, match="is longer than 512 characters"):
        select(fleet(NUMBERED[:2]), f"@{tmp_path}/list")
