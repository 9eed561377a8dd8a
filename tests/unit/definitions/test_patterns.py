"""Ansible's host patterns."""

from __future__ import annotations

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
