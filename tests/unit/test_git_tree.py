"""What a commit of a stranger lists is judged in time that grows with its size alone."""

from __future__ import annotations

import pytest

from srprov.git.program import GitError
from srprov.git.tree import MOST_FILES, check_links, entries
from tests.bounded import bounded


def listed(*paths: str) -> bytes:
    return b"".join(b"100644 blob %s      1\t%s\0" % (b"0" * 40, path.encode()) for path in paths)


@pytest.mark.parametrize(
    ("paths", "why"),
    [
        (("a", "a/b"), "a/b below a,"),
        (("a b", "a/b/c", "a.b", "a-", "a"), "a/b/c below a,"),
        (("x/a/b", "x/a", "x/a.b"), "x/a/b below x/a,"),
        (("a", "b", "a"), "twice"),
    ],
)
def test_what_lies_below_a_file_or_stands_twice_is_refused(paths: tuple[str, ...], why: str) -> None:
    with pytest.raises(GitError, match=why):
        entries(listed(*paths), 100)


def test_names_that_only_begin_alike_are_taken() -> None:
    paths = ["a.b/c", "a/b", "ab", "a/bc", "b/a"]
    assert [one.path for one in entries(listed(*paths), 100)] == paths


def test_deep_paths_are_no_work() -> None:
    deep = "/".join("d" * 490)
    every = listed(*(f"{deep}/{number}" for number in range(MOST_FILES)))
    assert bounded(lambda: len(entries(every, 1 << 20))) == MOST_FILES


@pytest.mark.parametrize(
    ("links", "stays"),
    [
        ({"a": b"b/c"}, True),
        ({"d/a": b"../b"}, True),
        ({"d/a": b"../../b"}, False),
        ({"a": b"/etc/passwd"}, False),
        ({"a": b""}, False),
        ({"a": b"b\0c"}, False),
        ({"d/up": b"..", "a": b"d/up/x"}, True),
        ({"d/up": b"..", "a": b"d/up/../x"}, False),
        ({"a": b"b", "b": b"a"}, False),
        ({"a": b"x/" * 2048}, False),
    ],
)
def test_links_stay_in_their_tree(links: dict[str, bytes], stays: bool) -> None:
    if stays:
        check_links(links)
    else:
        with pytest.raises(GitError, match="leads out of the repository"):
            check_links(links)


@pytest.mark.parametrize(
    "links",
    [
        {f"l{number}": b"x/" * 15_000 for number in range(2000)},
        {f"l{number}": b"x/" * 2047 for number in range(2000)},
        {"a" * 200: b"x/" * 2000, **{f"l{number}": b"/".join([b"a" * 200] * 20) for number in range(MOST_FILES)}},
    ],
    ids=["longer than any", "long", "over others"],
)
def test_long_links_are_no_work(links: dict[str, bytes]) -> None:
    def check() -> None:
        with pytest.raises(GitError):
            check_links(links)

    bounded(check)


@pytest.mark.parametrize(
    "path", ["", "/a", "a/", "a//b", ".", "a/./b", "../a", "a/..", ".git/x", "a/.GIT", "a\nb", "\x7f"]
)
def test_names_that_no_folder_can_have_are_refused(path: str) -> None:
    with pytest.raises(GitError, match="no folder can have"):
        entries(listed(path), 100)


@pytest.mark.parametrize("path", ["...", "a/.gitignore", ".github/x", "a..b", "x.git", " "])
def test_names_that_are_only_alike_are_taken(path: str) -> None:
    assert [one.path for one in entries(listed(path), 100)] == [path]
