"""Folders in order say what going through all of them would."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.transport.container_view import within
from srprov.transport.path_index import Folders
from tests.bounded import bounded

NAMES = st.lists(st.sampled_from(["a", "a-b", "a.", "b", "ä", "0"]), max_size=4)
PATHS = NAMES.map(lambda names: "/" + "/".join(names))


@given(folders=st.lists(PATHS, max_size=12), path=PATHS)
def test_the_order_says_what_each_by_itself_would(folders: list[str], path: str) -> None:
    found = Folders(folders)
    assert list(found.holding(path)) == sorted({one for one in folders if within(path, one)}, key=len, reverse=True)
    below = {one for one in folders if one != path and within(one, path)}
    assert (found.below(path) in below) if below else found.below(path) == ""


@pytest.mark.parametrize("path", ["/", "/a", "/a/b"])
def test_of_none_none_holds_a_path_or_lies_below(path: str) -> None:
    assert list(Folders().holding(path)) == [] and Folders().below(path) == ""


def test_folders_in_each_other_are_not_gone_through_for_a_path_that_they_do_not_hold() -> None:
    """A robot named 2000 mounts in each other, and each question went through all of them."""
    folders = Folders("/m" + "/!" * number for number in range(2000))
    assert bounded(lambda: [next(folders.holding(f"/m{'/!' * 1999}-/{number}")) for number in range(300)], cpu_s=1)
