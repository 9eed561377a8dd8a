"""Which image of a bundle each service has that is run again, and what is said of it before."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from srprov.controller.request import BundledImage
from srprov.definitions import load_experiment
from srprov.evidence.replay_images import Kept, _built, _called, _of_services, in_words
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
    """That a CDF is built the definitions say: a journal may call its image as it likes, also as one of a replay."""
    one = (BundledImage(IDS["a"], "amd64"),)
    by_its_word = "built of its CDF by the bundle's word; --no-bundled-images builds it here"
    names = {"own": "srprov/x:1", "again": "srprov/bundled:1", "called": "busybox:1", "theirs": "srprov/x:1"}
    kept = Kept(
        images=dict.fromkeys(names, one),
        names={**names, "gone": "debian:12"},
        built=frozenset({"own", "again", "called"}),
    )
    assert [*in_words(kept, SNAPSHOT, dict.fromkeys(names, "robot1"))] == [
        f"again: the bundle's srprov/bundled:1, aaaaaaaaaaaa, {by_its_word}",
        f"called: the bundle's busybox:1, aaaaaaaaaaaa, {by_its_word}",
        "gone: debian:12, by its name: it may be another image today",
        f"own: the bundle's srprov/x:1, aaaaaaaaaaaa, {by_its_word}",
        "theirs: the bundle's srprov/x:1, aaaaaaaaaaaa, as its robot1 had it",
    ]


def test_which_services_are_built_the_definitions_say(tmp_path: Path) -> None:
    (tmp_path / "base.cdf").write_text("cdf: 1\nbase: debian:12\npackages: {apt: [curl]}\n")
    (tmp_path / "more.cdf").write_text("cdf: 1\nextends: base.cdf\ncommand: [run]\n")
    (tmp_path / "there.cdf").write_text("cdf: 1\nimage: busybox:1\n")
    services = "own: {cdf: base.cdf}, again: {cdf: more.cdf}, there: {cdf: there.cdf}, theirs: {image: srprov/x:1}"
    (tmp_path / "tour.edf").write_text(f"edf: 1\nname: tour\nservices: {{{services}}}\n")
    found = load_experiment(str(tmp_path / "tour.edf"))
    last = SimpleNamespace(choice=SimpleNamespace(experiment=found.experiment))
    told = cast(Any, SimpleNamespace(definitions=found, last=last))
    assert {*_built(told)} == {"own", "again"}


def test_a_journal_says_nothing_else_where_an_image_is_named() -> None:
    """With words and a thousand blanks for a name, whose word it is stood behind the end of the line."""
    for name in ("busybox:1, by its name: it may be another image today", "busybox:1" + 1000 * " ", "x" * 1000, ""):
        assert _called(name) == "image, which it calls as no image is called"
    for name in ("busybox:1", "srprov/x:1", f"reg.lab.example:5000/nav@sha256:{'0' * 64}"):
        assert _called(name) == name
