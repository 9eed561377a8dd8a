"""Images come from the engines that have them, by id, into the cache of this machine."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from srprov.codes import Code
from srprov.controller.built_here import counting
from srprov.controller.bundle_images import Engines
from srprov.controller.kept_images import Content, keep
from srprov.controller.plan import Planned
from srprov.controller.trial_images import Ran, ran
from srprov.definitions.model import Host, Inventory
from srprov.errors import TransportError, UsageError
from srprov.facts.model import Docker, HostFacts, Snapshot
from srprov.layers import read_config
from srprov.oci.layout import leading, sha256
from srprov.planning.plan import Plan
from srprov.record.memory import note_images, note_ran
from srprov.resource import Observed
from srprov.transport.blobs import Blobs
from tests.unit.transport.thin_world import CONTAINERD, InContainerd, Made, Robot, sha

IMAGE = Made(b"base" * 500, b"top" * 500, architecture="amd64")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "cache"


class Had(Ran):
    """What is remembered of a run: these robots had all of its images, under any name."""

    by: tuple[str, ...] = ()
    built: tuple[str, ...] = (IMAGE.id,)
    """Ids of the images that count as built, under any name, by robots of the architecture amd64."""

    def robots(self, image: str, names: Collection[str]) -> frozenset[str]:
        return frozenset(f"{one} key" for one in self.by)

    def counting(self, tags: Collection[str]) -> dict[str, dict[str, frozenset[str]]]:
        return {tag: {"amd64": frozenset(self.built)} for tag in tags}


def engines(
    *robots: Robot, away: tuple[str, ...] = (), by: tuple[str, ...] = ("gone",), built: tuple[str, ...] = (IMAGE.id,)
) -> Engines:
    def get(name: str) -> Any:
        if name in away:
            raise TransportError(name, "it is off", code=Code.LOST)
        return next(one for one in robots if one.host == name)

    hosts = dict.fromkeys([*away, *(one.host for one in robots)])
    fleet: Any = SimpleNamespace(inventory=SimpleNamespace(hosts=hosts), sessions=SimpleNamespace(get=get))
    return Engines(fleet, Path(os.environ["XDG_CACHE_HOME"], "apart"), Had("t", by, built))


def test_an_image_is_read_from_the_robot_that_has_it_by_its_id(tmp_path: Path) -> None:
    """Its tag may be another image's by now; those that ran it are asked first."""
    first, second = Robot("a", tmp_path), Robot("b", tmp_path)
    first.images, second.images = {"x:1": Made(b"other")}, {"renamed:1": IMAGE}
    said: list[str] = []
    found = engines(first, second, away=("c",), by=("b",)).read(IMAGE.id, "x:1", ("b",), said.append)
    assert found.config == IMAGE.config and [one.digest for one in found.layers] == IMAGE.diff_ids
    assert tuple(b"".join(one.content()) for one in found.layers) == IMAGE.layers
    assert not first.shells and any(line.startswith("x:1, layer 2 of 2") for line in said)


def test_an_image_that_came_from_who_ran_it_comes_from_the_cache_too(tmp_path: Path) -> None:
    robot = Robot("a", tmp_path)
    robot.images = {"renamed:1": IMAGE}
    for _ in range(2):
        found = engines(robot, by=("a",)).read(IMAGE.id, "x", (), lambda _line: None, ["srprov/x:1"])
        assert found.config == IMAGE.config
        robot.images.clear()


def test_a_builder_that_names_another_experiments_image_gets_it_into_no_bundle(tmp_path: Path) -> None:
    """It says that what it built has that id; who has that image, or gave it to the cache, did not run it."""
    liar, other = Robot("a", tmp_path), Robot("b", tmp_path)
    other.images = {"srprov/private:1": IMAGE}
    assert engines(other, by=("b",)).read(IMAGE.id, "p", (), lambda _line: None, ["srprov/private:1"]).layers
    assert note_images({"srprov/x:1": {IMAGE.id}}) == ""
    with pytest.raises(UsageError, match="a: it does not have it; b: it does not have it under that name"):
        engines(liar, other, by=("a",)).read(IMAGE.id, "x", ("a", "b"), lambda _line: None, ["srprov/x:1"])


def test_the_folder_of_a_stranger_brings_no_image_into_a_bundle(tmp_path: Path) -> None:
    """It names an image of the user's as built here, with its id and the robot that ran it."""
    other, name = Robot("b", tmp_path), "srprov/private:1"
    other.images = {name: IMAGE}
    token, folder = "ab" * 16, tmp_path / "run"
    folder.mkdir()
    noted = {f"{token} {name} {IMAGE.id}": {other.identity}, f"{token} {name} amd64": {IMAGE.id}}
    assert note_images({name: {IMAGE.id}}) == "" == note_ran(noted)

    def read() -> object:
        known = Engines(engines(other)._fleet, tmp_path / "apart", ran(folder))
        return known.read(IMAGE.id, "p", ("b",), lambda _line: None, [name])

    for text in ("", "cd" * 16, "\n"):
        (folder / "token").write_text(text, encoding="utf-8")
        with pytest.raises(UsageError, match="no run of this machine is known that had it"):
            read()
    (folder / "token").write_text(f"{token}\n", encoding="utf-8")
    assert read()


def test_a_robot_that_names_another_ones_image_gets_it_into_no_bundle(tmp_path: Path) -> None:
    """Neither from who has it, under another name, nor by digests from this machine's cache."""
    liar, other = Robot("a", tmp_path), Robot("b", tmp_path)
    liar.images, other.images = {"x:1": Made(b"other")}, {"srprov/private:1": IMAGE}
    keep([Content(sha(one), len(one), lambda one=one: iter([one]), packed=False)
          for one in (IMAGE.config, *IMAGE.layers)], lambda _line: None)  # fmt: skip
    with pytest.raises(UsageError, match="b: it does not have it under that name"):
        engines(liar, other, by=("a",)).read(IMAGE.id, "x:1", ("a",), lambda _line: None, ["x:1"])
    assert note_images({"srprov/private:1": {IMAGE.id}}) == ""
    with pytest.raises(UsageError, match="b: it does not have it under that name"):
        engines(liar, other, by=("a",)).read(IMAGE.id, "x:1", ("a",), lambda _line: None, ["x:1"])


@pytest.mark.parametrize("architecture", ["amd64", "", "arm64"])
def test_a_robot_that_made_another_image_under_a_tag_of_ours_gets_it_into_no_bundle(
    tmp_path: Path, architecture: str
) -> None:
    """It got a copy of what another one built, and has an image of its own making there: a replay gave it to others."""
    liar, evil, tag = Robot("a", tmp_path), Made(b"evil", architecture=architecture), "srprov/x:1"
    liar.images = {tag: evil}
    with pytest.raises(UsageError, match=r"srprov/x:1: the run had .* under that name, which is not the image"):
        engines(liar, by=("a",)).read(evil.id, tag, ("a",), lambda _line: None, [tag])
    with pytest.raises(UsageError, match="which is not the image"):  # nor from the cache
        engines(liar, by=("a",)).read(evil.id, tag, ("a",), lambda _line: None, [tag, "x:1"])
    assert engines(liar, by=("a",)).read(evil.id, tag, ("a",), lambda _line: None, ["x:1"]), "no word is broken by that"


def test_what_is_built_for_another_architecture_is_no_image_of_this_one(tmp_path: Path) -> None:
    """A robot that says that it is of an architecture without a builder builds for itself what it likes."""
    liar, tag = Robot("a", tmp_path), "srprov/x:1"
    for architecture, taken in (("arm64", False), ("", False), ("amd64", True), ("386", True)):
        made = Made(b"evil", architecture=architecture)
        liar.images, asked = {tag: made}, engines(liar, by=("a",), built=(made.id,))
        if taken:
            assert asked.read(made.id, tag, ("a",), lambda _line: None, [tag])
            continue
        with pytest.raises(UsageError, match="which is not the image"):
            asked.read(made.id, tag, ("a",), lambda _line: None, [tag])


@pytest.mark.parametrize("index", [False, True])
def test_an_image_that_was_built_in_a_store_of_another_kind_is_the_same(tmp_path: Path, *, index: bool) -> None:
    """The builder knows it by a manifest, which leads to the configuration by which the robot that ran it does."""
    built, evil, tag = InContainerd(b"base", b"top", index=index, architecture="amd64"), Made(b"evil"), "srprov/x:1"
    robot, same = Robot("a", tmp_path), Made(b"base", b"top", architecture="amd64")
    robot.images = {tag: same}
    with pytest.raises(UsageError, match="which is not the image"):  # nothing leads there
        engines(robot, by=("a",), built=(built.id,)).read(same.id, tag, ("a",), lambda _line: None, [tag])
    keep([Content(sha(one), len(one), lambda one=one: iter([one]), packed=False) for one in built.documents],
         lambda _line: None)  # fmt: skip
    assert engines(robot, by=("a",), built=(built.id,)).read(same.id, tag, ("a",), lambda _line: None, [tag])
    robot.images = {tag: evil}
    with pytest.raises(UsageError, match="which is not the image"):
        engines(robot, by=("a",), built=(built.id,)).read(evil.id, tag, ("a",), lambda _line: None, [tag])


def test_what_came_from_a_bundle_is_what_its_name_says(tmp_path: Path) -> None:
    robot, evil = Robot("a", tmp_path), Made(b"evil", architecture="amd64")
    name = f"srprov/bundled:{IMAGE.id[7:]}"
    for image, taken in ((IMAGE, True), (evil, False)):
        robot.images, asked = {name: image}, engines(robot, by=("a",), built=(evil.id,))
        if taken:
            assert asked.read(image.id, name, ("a",), lambda _line: None, [name])
            continue
        with pytest.raises(UsageError, match="which is not the image"):
            asked.read(image.id, name, ("a",), lambda _line: None, [name])


def test_what_a_run_remembers_as_built_is_what_others_may_have(tmp_path: Path) -> None:
    """What a robot that is no builder built, or has, counts for nobody: not even where it was a builder before."""
    tag, ids = "srprov/x:1", {one: f"sha256:{one * 64}" for one in "abc"}
    assert note_images({f"{tag} amd64": {f"{ids[one]} {one} key" for one in "ab"}}) == ""
    facts = {one: HostFacts(name=one, arch="amd64", docker=Docker(version="26", api_version="1.41")) for one in "abc"}
    observed = {
        one: (Observed(module="image", name=tag, instance="", state={"id": ids[one], "labels": {}}),) for one in "abc"
    }
    snapshot = Snapshot(facts=facts, observed=observed, unreachable={})
    planned = Planned(plan=Plan(instance="x", source="s", steps=()), snapshot=snapshot, images={tag: cast(Any, None)})
    sessions = {one: cast(Any, SimpleNamespace(identity=f"{one} key")) for one in "abc"}

    def counts(*builders: str) -> set[str]:
        hosts = {one: Host(name=one, address="192.0.2.1") for one in "abc"}
        found = counting(planned, Inventory(hosts=hosts, groups={"builders": builders}), sessions)
        return {one for one, id_ in ids.items() if id_ in found[f"{tag} amd64"]}

    assert (counts("b"), counts("c"), counts()) == ({"b"}, {"c"}, {"a", "b"})
    assert note_ran({f"t {tag} amd64": {ids["b"]}, f"t {tag} {ids['a']}": {"a key"}}) == ""
    assert Ran("t").counting([tag, "y:1"]) == {tag: {"amd64": {ids["b"]}}, "y:1": {}}
    assert Ran("").counting([tag]) == {tag: {}}


@pytest.mark.parametrize("index", [False, True])
def test_an_image_in_a_containerd_store_comes_with_what_leads_to_it(tmp_path: Path, *, index: bool) -> None:
    image, robot = InContainerd(b"base" * 500, b"top" * 500, index=index), Robot("a", tmp_path)
    robot.images, robot.info["DriverStatus"] = {"x:1": image}, CONTAINERD
    found = engines(robot).read(image.id, "x:1", (), lambda _line: None, ["x:1"])
    config_id = sha256(found.config)
    assert config_id == image.config_id != image.id and read_config(config_id, json.loads(found.config))
    documents = {sha256(one): one for one in found.documents}
    assert leading([image.id], config_id, documents.get)


def test_an_image_that_nobody_has_is_an_error_that_says_who_was_asked(tmp_path: Path) -> None:
    robot = Robot("a", tmp_path)
    robot.images = {"x:1": Made(b"other")}
    with pytest.raises(UsageError, match=r"x:1 cannot be had: a: it does not have it under that name; c: it is off"):
        engines(robot, away=("c",)).read(IMAGE.id, "x:1", ("gone",), lambda _line: None)


def test_what_a_bundle_holds_is_kept_when_it_is_what_it_is_called(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    good = Content(sha(b"x"), 1, lambda: iter([b"x"]), packed=False)
    keep([good, good], said.append)
    blob = Blobs().get(sha(b"x"))
    assert blob is not None and b"".join(blob.content()) == b"x"
    keep([good], said.append)
    assert len(said) == 2, "what is there is not written again"
    for bad in (Content(sha(b"y"), 1, lambda: iter([b"x"]), packed=False),
                Content(sha(b"y"), 1, lambda: iter([b"x"]), packed=True)):  # fmt: skip
        with pytest.raises(UsageError, match="is not what it says"):
            keep([bad], said.append)
    assert sorted(one.name for one in (cache / "srprov/blobs").iterdir()) == [f"{sha(b'x')[7:]}.gz"]
    with pytest.raises(UsageError, match="there is no room"):
        keep([Content(sha(b"z"), 1 << 60, lambda: iter([b"z"]), packed=False)], said.append)
