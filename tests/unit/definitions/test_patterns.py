"""Ansible's host patterns."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import pytest

from srprov.definitions.model import Host, Inventory
from srprov.definitions.patterns import select
from srprov.errors import UsageError
from tests.bounded import bounded, within

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


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("@failed", ["arm1", "robot02", "robot03"]),
        ("@failed,!robot03", ["arm1", "robot02"]),
        ("@failed:!robot03", ["arm1", "robot02"]),
        ("@failed:&robots", ["robot02", "robot03"]),
        ("robots,&@failed", ["robot02", "robot03"]),
        ("!@failed", ["robot01", "robot10", "spare"]),
        ("spare,@failed", ["arm1", "robot02", "robot03", "spare"]),
    ],
)
def test_failed_is_a_term_like_any_other(pattern: str, expected: list[str]) -> None:
    assert select(LAB, pattern, lambda: {"arm1", "robot02", "robot03", "sold"}) == tuple(expected)


def test_failed_is_asked_for_only_when_it_is_named() -> None:
    def never() -> Collection[str]:
        raise AssertionError

    assert select(LAB, "arm1,robots:!robot10", never) == ("arm1", "robot01", "robot02", "robot03")


def test_failed_without_an_experiment_or_without_its_robots_is_an_error() -> None:
    with pytest.raises(UsageError, match="the last run of an experiment"):
        select(LAB, "@failed")
    with pytest.raises(UsageError, match="means sold: not in this inventory"):
        select(LAB, "@failed", lambda: {"sold"})


def test_a_file_lists_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Empty lines and comments are passed over; a file that is called `failed` is named with its folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "failed").write_text("# after the fire\n\n robot01 \r\nfast\n")
    assert select(LAB, "@./failed") == ("arm1", "robot01", "robot02")
    assert select(LAB, f"@{tmp_path}/failed,!fast") == ("robot01",)
    assert select(LAB, "@failed", lambda: {"spare"}) == ("spare",)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "No such file"),
        (b"", "names no robot"),
        (b"# robot01\n", "names no robot"),
        (b"robot01\nrobto02\n", "'robto02' matches no host"),
        (b"@failed\n", "cannot name another"),
        (b"robot\xff01\n", "not UTF-8 text"),
    ],
)
def test_a_list_that_is_no_list_is_an_error(tmp_path: Path, content: bytes | None, said: str) -> None:
    if content is not None:
        (tmp_path / "list").write_bytes(content)
    with pytest.raises(UsageError, match=said):
        select(LAB, f"@{tmp_path}/list")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("~(r.|\\pL{20}xN)\n", "all patterns together are too large"),
        ("~robot0.|N\n", "more than 200 lines"),
        ("# N\n", "larger than"),
    ],
)
def test_a_long_list_is_read_or_refused(tmp_path: Path, content: str, said: str) -> None:
    """Each line was compiled, and held against all robots and groups."""
    lines = [content.replace("N", str(number)) for number in range(90_000 if "#" in content else 9_000)]
    (tmp_path / "list").write_text("".join(lines))
    with pytest.raises(UsageError, match=said):
        bounded(lambda: select(LAB, f"@{tmp_path}/list"))


def test_no_line_of_a_file_elsewhere_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a project that was cloned come links, and what matches no robot is told."""
    (tmp_path / "key").write_text("secret\n")
    (tmp_path / "project").mkdir()
    monkeypatch.chdir(tmp_path / "project")
    Path("robots.txt").symlink_to(tmp_path / "key")
    Path("up").symlink_to(tmp_path)
    Path(".git").mkdir()
    Path(".git/credentials").write_text("secret\n")
    Path("list").symlink_to(".git/credentials")
    for term in ("@robots.txt", "@./robots.txt", "@up/key", "@list"):
        with pytest.raises(UsageError, match=r"is a link that leads (out of its folder|into a repository)") as refused:
            select(LAB, term)
        assert "secret" not in str(refused.value) + refused.value.hint
    Path("hard").hardlink_to(tmp_path / "key")  # as an archive makes one that is unpacked in a home
    with pytest.raises(UsageError, match="has another name") as refused:
        select(LAB, "@hard")
    assert "secret" not in str(refused.value) + refused.value.hint


def test_a_regular_expression_in_a_list_takes_little_time(tmp_path: Path) -> None:
    """A list and an inventory of a stranger's may be made for each other."""
    name = "a" * 28
    file = tmp_path / "robots.txt"
    file.write_text("~(a+)+b\n")
    with within(2), pytest.raises(UsageError, match="matches no host"):
        select(Inventory(hosts={name: Host(name=name, address="10.0.0.1")}, groups={}), f"@{file}")
    file.write_text("~robot0[12]\n")
    assert select(LAB, f"@{file}") == ("robot01", "robot02")


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
    with within(2), pytest.raises(UsageError, match="list', line 500: .* takes too long"):
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
        select(LAB, f"@{tmp_path}/list")
