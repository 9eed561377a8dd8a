"""Images come from the engines that have them, by id, into the cache of this machine."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.codes import Code
from srprov.controller.bundle_images import Engines
from srprov.controller.kept_images import Content, keep
from srprov.controller.trial_images import Ran, ran
from srprov.errors import TransportError, UsageError
from srprov.layers import read_config
from srprov.oci.layout import leading, sha256
from srprov.record.memory import note_images, note_ran
from srprov.transport.blobs import Blobs
from tests.unit.transport.thin_world import CONTAINERD, InContainerd, Made, Robot, sha

IMAGE = Made(b"base" * 500, b"top" * 500)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "cache"


class Had(Ran):
    """What is remembered of a run: these robots had all of its images, under any name."""

    by: tuple[str, ...] = ()

    def robots(self, image: str, names: Collection[str]) -> frozenset[str]:
        return frozenset(f"{one} key" for one in self.by)


def engines(*robots: Robot, away: tuple[str, ...] = (), by: tuple[str, ...] = ("gone",)) -> Engines:
    def get(name: str) -> Any:
        if name in away:
            raise TransportError(name, "it is off", code=Code.LOST)
        return next(one for one in robots if one.host == name)

    hosts = dict.fromkeys([*away, *(one.host for one in robots)])
    fleet: Any = SimpleNamespace(inventory=SimpleNamespace(hosts=hosts), sessions=SimpleNamespace(get=get))
    return Engines(fleet, Path(os.environ["XDG_CACHE_HOME"], "apart"), Had("t", by))


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
    assert note_images({name: {IMAGE.id}}) == "" == note_ran({f"{token} {name} {IMAGE.id}": {other.identity}})

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
