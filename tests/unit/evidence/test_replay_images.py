"""Which image of a bundle each service has that is run again, and what is said of it before."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from srprov.controller.request import BundledImage
from srprov.evidence.replay_images import Kept, _of_services, in_words
from srprov.facts.model import HostFacts, Snapshot
from srprov.oci.layout import Stored

IDS = {one: f"sha256:{one * 64}" for one in "abcd"}
SNAPSHOT = Snapshot(facts={"robot1": HostFacts(name="robot1", arch="amd64")}, observed={}, unreachable={})


def stored(one: str, name: str, architecture: str) -> Stored:
    return Stored(
        id=IDS[one], engine_ids=(IDS[one],), names=(name,), config=b"", layers=(), documents=(),
        architecture=architecture, os="linux", variant="",
    )  # fmt: skip


def test_what_a_robot_had_of_a_name_is_no_image_of_the_services_of_others() -> None:
    """Only of what srprov built does who made the bundle say for each architecture what the name stands for."""
    every = (stored("a", "busybox:1", "amd64"), stored("b", "busybox:1", "arm64"),
             stored("c", "srprov/x:1", "amd64"), stored("d", "srprov/x:1", "arm64"))  # fmt: skip
    images = {
        "one": ("busybox:1", IDS["a"]), "two": ("busybox:1", IDS["b"]), "three": ("busybox:1", ""),
        "four": ("srprov/x:1", IDS["c"]), "five": ("srprov/x:1", ""),
    }  # fmt: skip
    found = dict(_of_services(cast(Any, SimpleNamespace(images=images)), every))
    assert {service: [one.id for one in some] for service, some in found.items()} == {
        "one": [IDS["a"]], "two": [IDS["b"]], "four": [IDS["c"], IDS["d"]], "five": [IDS["c"], IDS["d"]],
    }  # fmt: skip


def test_whose_word_it_is_which_image_a_name_stands_for_is_said_before_the_question() -> None:
    one = (BundledImage(IDS["a"], "amd64"),)
    names = {"own": "srprov/x:1", "again": "srprov/bundled:1", "theirs": "busybox:1", "gone": "debian:12"}
    kept = Kept(images=dict.fromkeys(("own", "again", "theirs"), one), names=names)
    assert [*in_words(kept, SNAPSHOT, dict.fromkeys(names, "robot1"))] == [
        "again: the bundle's srprov/bundled:1, aaaaaaaaaaaa, as its robot1 had it",
        "gone: debian:12, by its name: it may be another image today",
        "own: the bundle's srprov/x:1, aaaaaaaaaaaa, built of its CDF by the bundle's word; "
        "--no-bundled-images builds it here",
        "theirs: the bundle's busybox:1, aaaaaaaaaaaa, as its robot1 had it",
    ]
