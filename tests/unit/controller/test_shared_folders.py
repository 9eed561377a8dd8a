"""Containers of others that have a folder of a new one: a plan names them."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.controller.device_links import led_to
from srprov.controller.robot_mounts import Mounts
from srprov.controller.shared_folders import shared
from srprov.wire import Reply
from tests.bounded import bounded


def container(name: str, *sources: str, writes: bool = True, **labels: str) -> dict[str, Any]:
    mounts = [{"Type": "bind", "Source": one, "RW": writes} for one in sources]
    named = {f"srprov.{key}": value for key, value in labels.items()}
    return {"Names": [f"/{name}"], "Mounts": mounts, "Labels": named}


def said(path: str, *containers: object, written: bool = True, status: int = 200) -> list[str]:
    reply = Reply(status=status, out=json.dumps(list(containers)), ok=status == 200)
    return list(shared([("it", written, (path,))], reply, "nav"))


RUN = "of others: they may run or believe what is written there"


@pytest.mark.parametrize("source", ["/srv/ws", "/srv", "/", "/srv/ws/install"])
def test_who_has_the_folder_or_what_holds_it_or_lies_in_it_is_named(source: str) -> None:
    assert said("/srv/ws", container("own", source)) == [f"it is had by the container own {RUN}"]
    assert said("/srv/ws", container("own", source, writes=False)), "it runs what is written there"


def test_one_that_only_reads_is_told_of_those_that_write() -> None:
    both = container("b", "/srv/ws"), container("a", "/srv/ws", writes=False)
    assert said("/srv/ws", *both, written=False) == [
        "it may be written to by the container b of others: what lies there may be theirs"
    ]
    assert said("/srv/ws", *both) == [f"it is had by the containers a, b {RUN}"]


def test_neither_its_own_experiment_nor_other_folders_count() -> None:
    assert (
        said(
            "/srv/ws",
            container("srprov.nav.x", "/srv/ws", instance="nav", service="x"),
            container("y", "/srv/w", "/srv/ws2", "/etc"),
        )
        == []
    )
    assert said("/srv/ws", container("srprov.other.x", "/srv/ws", instance="other", service="x"))
    assert said("/srv/ws", container("tool", "/srv/ws", instance="nav", service="x")), "its image has these labels"


def test_where_a_link_led_counts_too() -> None:
    assert said("/mnt/ws", container("x", "/srv/ws", led=json.dumps({"/srv/ws": "/mnt/ws"})))


def test_an_engine_that_does_not_say_is_told_of_and_odd_ones_count_for_nothing() -> None:
    assert said("/srv/ws", status=500) == ["which other containers have the folders of new ones cannot be told"]
    odd = [7, {"Names": 7, "Mounts": {"a": 1}, "Labels": []}, {"Mounts": [{"Type": "bind", "Source": 7}]}]
    assert said("/srv/ws", *odd) == []


MORE = "which other containers have the folders of new ones cannot all be told: more is there than is looked at"


def test_volumes_do_not_hide_a_folder_and_what_is_not_looked_at_is_told_of() -> None:
    """An image has as many volumes as it likes, and an engine lists them in any order."""
    own = container("own", "/srv/ws")
    own["Mounts"] = [{"Type": "volume", "Source": f"/v/{n}", "RW": True} for n in range(1100)] + own["Mounts"]
    assert said("/srv/ws", own) == [f"it is had by the container own {RUN}"]
    many = container("many", *(f"/data/{n}" for n in range(1001)))
    assert said("/srv/ws", many, own) == [MORE, f"it is had by the container own {RUN}"]
    assert said("/srv/ws", *(container(f"c{n}", "/data") for n in range(10_001))) == [MORE]


def test_thousands_of_each_are_told_in_time() -> None:
    many = [container(f"c{n}", *(f"/data/{n}/{m}" for m in range(50))) for n in range(1000)]
    reply = Reply(status=200, out=json.dumps(many))
    paths = [(f"{n}", True, (f"/srv/{n}",)) for n in range(3000)]
    assert bounded(lambda: list(shared(paths, reply, "nav")), 10.0) == []


def test_a_robot_s_path_of_thirty_thousand_folders_costs_nothing() -> None:
    """Each folder above it was built: a gigabyte of names for one bind."""
    reply = Reply(status=200, out=json.dumps([container("x", "/srv/other")]))

    def told() -> list[str]:
        real = led_to(f"0 /srv{'/a' * 30_000}\n")["0"] or "/srv/d"
        Mounts("1 0 8:1 / / rw - ext4 /dev/sda rw\n").names(real)
        return list(shared([("it", True, ("/srv/d", real))], reply, "nav"))

    assert bounded(told) == []
