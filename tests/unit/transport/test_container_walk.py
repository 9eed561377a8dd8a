"""Links of a container are followed as it would, all paths together, and to an end."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from srprov.codes import Code
from srprov.errors import RefusedError
from srprov.transport.container_look import Found
from srprov.transport.container_view import Part, View
from srprov.transport.container_walk import Walk
from srprov.transport.path_index import Folders
from tests.bounded import bounded


class Robot:
    """Has links at places of its own, and folders everywhere else."""

    def __init__(self, links: Mapping[str, str]) -> None:
        self.links = links
        self.rounds = 0
        self.walk = Walk(self.look, self.part_of, lambda path, why, _: RefusedError(f"{path}: {why}", code=Code.ENGINE))

    def look(self, _path: str, names: Mapping[str, Collection[str]]) -> Mapping[str, Mapping[str, Found]]:
        self.rounds += 1
        return {
            root: {name: self.found(os.path.normpath(f"{root}/{name}")) for name in some}
            for root, some in names.items()
        }

    def found(self, place: str) -> Found:
        return Found("l", 0, self.links[place]) if place in self.links else Found("d")

    def part_of(self, view: View, path: str) -> Part:
        found = view.part_of(path)
        assert found is not None
        return found

    def settled(self, *at: str) -> list[str]:
        """Return where mounts are, each of which is on the robot where it is called, below `/v`."""
        parts = [Part(at="/", root="/m"), *(Part(at=one, root=f"/v{one}") for one in at)]
        return [one.at for one in self.walk.settled(View(parts, Folders())).parts[len(parts) :]]

    def to(self, path: str) -> str:
        return self.walk.to(View([Part(at="/", root="/m")], Folders()), path, follow=True)[0]


CHAIN = {"/m/c0": "real", **{f"/m/c{n}": f"/c{n - 1}" for n in range(1, 25)}}


def test_all_mounts_are_walked_together() -> None:
    """Sixty volumes behind a chain of links took a round trip for each link of each: three minutes."""
    robot = Robot(CHAIN)
    assert bounded(lambda: (robot.settled(*(f"/c20/v{n}" for n in range(60))), robot.rounds)) == (
        [f"/real/v{n}" for n in range(60)], 22,
    )  # fmt: skip


def test_a_mount_is_found_through_the_links_of_one_before_it() -> None:
    robot = Robot({"/m/var/run": "/run", "/v/var/run/a/in": "/run/a/it", "/m/run/a/in": "/nowhere"})
    assert robot.settled("/var/run/a/in/b", "/var/run/a") == ["/run/a", "/run/a/it/b"]


def test_mounts_of_which_none_lies_behind_a_link_take_one_question() -> None:
    robot = Robot({"/m/var/run": "/run"})
    assert robot.settled("/a/b", "/c", "/a") == [] and robot.rounds == 1


@pytest.mark.parametrize(
    ("links", "at", "why"),
    [
        ({"/m/a": "/b", "/m/b": "/a"}, ["/a/x"], "links lead in a circle"),
        ({f"/m/c{n}": f"/c{n + 1}" for n in range(60)}, ["/c0/x"], "circle|more links"),
        ({"/m/v": "/w"}, [f"/v/{n}" + "/a" * 500 for n in range(100)], "more folders than are looked at"),
        ({}, [f"/v{n}" + "/a" * 1000 for n in range(40)], "more folders than are looked at"),
        ({"/m/a": "/b", **{f"/v/a{'/a' * n}/a": f"/a{'/a' * n}/b" for n in range(80)}},
         ["/a" + "/a" * n for n in range(80)], "more links"),
        ({**CHAIN, **{f"/m/d{n}": f"/c{n % 25}" for n in range(1000)}},
         [f"/d{n}/x" for n in range(1000)], "more links"),
    ],
)  # fmt: skip
def test_what_has_no_end_is_refused_in_time(links: Mapping[str, str], at: list[str], why: str) -> None:
    robot = Robot(links)

    def walked() -> None:
        with pytest.raises(RefusedError, match=why):
            robot.settled(*at)
        assert robot.rounds <= 40

    bounded(walked)


@pytest.mark.parametrize("path", ["/a/y", "/" + "y/" * 3000])
def test_a_path_that_links_make_longer_and_longer_is_refused(path: str) -> None:
    """Each of forty links added four thousand characters to it."""
    text = "b/" + f"{'y' * 100}/" * 15
    with pytest.raises(RefusedError, match="longer than a path"):
        bounded(lambda: Robot({"/m/a": text, "/m/b": text}).to(path))


NAMES = st.sampled_from(["a", "b", "c", "..", "."])
TARGETS = st.builds(
    lambda names, top: top + "/".join(names), st.lists(NAMES, min_size=1, max_size=3), st.sampled_from(["", "/"])
)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    links=st.dictionaries(st.sampled_from(["a", "b", "c", "a/a", "a/b", "b/c", "a/b/c"]), TARGETS, max_size=5),
    path=st.lists(NAMES, min_size=1, max_size=4),
)
def test_links_are_followed_as_the_system_does(links: dict[str, str], path: list[str]) -> None:
    """What `realpath` says without looking whether a folder is there, which is how this goes on, too."""
    made = {os.path.normpath(f"/m/{place}"): to for place, to in links.items()}
    try:
        led = Robot(made).to("/" + "/".join(path))
    except RefusedError:
        return
    assert led == _plain(made, "/" + "/".join(path))


def _plain(links: Mapping[str, str], path: str) -> str:
    """Go name by name, as path_resolution(7) has it."""
    here, left = Path("/"), path.split("/")
    while left:
        name = left.pop(0)
        if name in ("", "."):
            continue
        if name == "..":
            here = here.parent
        elif (to := links.get(f"/m{here / name}")) is None:
            here /= name
        else:
            here, left = (Path("/") if to.startswith("/") else here), [*to.split("/"), *left]
    return str(here)
