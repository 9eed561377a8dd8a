"""What a container sees, by what its engine and its robot say: within limits whatever they say."""

from __future__ import annotations

import base64
from typing import Any

import pytest

from srprov.transport.container_view import View, about, view
from tests.bounded import bounded


def inspected(mounts: list[dict[str, Any]]) -> dict[str, Any]:
    data = {"MergedDir": "/m"}
    return {"State": {"Status": "running"}, "GraphDriver": {"Name": "overlay2", "Data": data}, "Mounts": mounts}


def bind(at: str, source: str = "/q") -> dict[str, Any]:
    return {"Type": "bind", "Source": source, "Destination": at}


def seen(mounts: list[dict[str, Any]], real: list[str], mounted: list[str]) -> View:
    said = "\0".join([*(f"d{one}" for one in real), "\n".join(mounted)])
    return view(about(inspected(mounts)), base64.b64encode(said.encode()).decode())


def test_what_the_robot_has_mounted_is_found_in_each_part() -> None:
    mounted = ["/", "/m", "/srv/d/x y", "/e", "/e/z", "/srv"]
    found = seen([bind("/d"), bind("/d/in", "/e")], ["/m", "/srv/d", "/e"], mounted)
    over = {"/d/x y/1": "/d/x y", "/d/x": "", "/d/in/z": "/d/in/z", "/d/in/1": "", "/1": ""}
    assert {path: found.mounted_over(path, "/d/in" if path.startswith("/d/in/") else "/d") for path in over} == over
    below = {"/d": "/d/in", "/d/x y": "", "/d/in": "/d/in/z", "/d/in/z": "", "/": "/d", "/x": ""}
    assert {path: found.mounted_below(path) for path in below} == below
    parts = {"/d/x y/1": None, "/d/x": "/d", "/d/in/1": "/d/in", "/d/in/z/1": None, "/1": "/"}
    assert {path: getattr(found.part_of(path), "at", None) for path in parts} == parts


@pytest.mark.parametrize("at", ["d", "/d", "//d", "///d/", "/x/../d", "/../d/."])
def test_a_mount_is_where_its_path_leads_however_an_engine_spells_it(at: str) -> None:
    found = seen([bind(at)], ["/m", "/srv/d"], ["/", "/m", "/srv"])
    (part,) = [one for one in found.parts if one.at != "/"]
    assert part.at == "/d" and found.part_of("/d/f") == part
    assert found.mounted_over("/d/f", "/") == "/d" and found.mounted_below("/") == "/d"


def test_mounts_times_what_the_robot_has_mounted_are_not_gone_through() -> None:
    """A thousand binds whose sources hold five thousand mounts each: every call built them all."""

    def looked() -> list[bool]:
        binds = [bind(f"/d{n}") for n in range(1000)]
        found = seen(binds, ["/m", *["/"] * 1000], ["/m", *(f"/{n:0>100}" for n in range(4990))])
        return [found.part_of(f"/d{n}/x") is not None and found.mounted_below(f"/d{n}") != "" for n in range(1000)]

    assert bounded(looked) == [True] * 1000


@pytest.mark.parametrize(
    ("mounts", "too_many"),
    [
        ([bind("/a" * 2048)], False), ([bind("/a" * 2049)], True), ([bind("/d", "/a" * 2049)], True),
        ([bind(f"/{n}" + "/a" * 500) for n in range(900)], False),
        ([bind(f"/{n}" + "/a" * 600) for n in range(900)], True),
    ],
)  # fmt: skip
def test_mounts_that_are_longer_than_are_looked_at_are_told(mounts: list[dict[str, Any]], *, too_many: bool) -> None:
    assert about(inspected(mounts)).too_many == too_many
