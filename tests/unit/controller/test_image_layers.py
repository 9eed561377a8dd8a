"""What a plan says of a copy: the way, by the stores of both engines, and how much it is."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.controller.image_layers import _copied
from srprov.layers import Image
from srprov.transport.image_there import Room, Target
from srprov.wire import Reply

BASE, TOP = (f"sha256:{one * 64}" for one in "ab")
ID = "sha256:" + "1" * 64
CLASSIC = {"Driver": "overlay2", "DriverStatus": [["Backing Filesystem", "extfs"]]}
CONTAINERD = {"Driver": "overlayfs", "DriverStatus": [["driver-type", "io.containerd.snapshotter.v1"]]}
HISTORY = [{"Size": 7}, {"Size": 0}, {"Size": 1000}]
THERE = (Image(ID, (BASE,)),)


def target(store: dict[str, Any]) -> Target:
    return Target(store is CLASSIC, THERE, Room(), containerd=store is CONTAINERD)


def copied(way: str, to: dict[str, Any], source: dict[str, Any] = CLASSIC, **cache: int) -> dict[str, Any]:
    image = {"Id": ID, "RootFS": {"Layers": [BASE, TOP]}}
    replies = [Reply(status=200, out=json.dumps(one)) for one in (source, image, HISTORY)]
    return _copied(way, target(to), replies, {BASE: cache.get("base"), TOP: cache.get("top")}.get)


def missing(layers: int, bytes_: int, *, exact: bool) -> dict[str, Any]:
    return {"layers": layers, "of": 2, "bytes": bytes_, "exact": exact}


def test_a_containerd_store_pulls_and_a_classic_one_loads_only_what_is_missing() -> None:
    assert copied("", CONTAINERD) == {"way": "registry", "missing": missing(1, 7, exact=False)}
    assert copied("", CONTAINERD, top=5) == {"way": "registry", "missing": missing(1, 5, exact=True)}
    assert copied("", CLASSIC, top=5) == {"way": "", "missing": missing(1, 5, exact=True)}


def test_a_classic_store_that_is_to_pull_may_take_all_layers() -> None:
    assert copied("registry", CLASSIC, top=5, base=600) == {"way": "registry", "missing": missing(2, 605, exact=False)}


@pytest.mark.parametrize(("to", "source"), [({}, CLASSIC), (CLASSIC, {}), (CONTAINERD, {})])
def test_where_nobody_knows_what_is_missing_the_image_goes_whole(to: dict[str, Any], source: dict[str, Any]) -> None:
    assert copied("", to, source) == {"way": "whole"}


def test_a_way_that_the_user_chose_is_not_changed_in_the_plan() -> None:
    assert copied("thin", {}) == copied("thin", CLASSIC, {}) == copied("registry", CLASSIC, {}) == {}
