"""Copies of images without what is there: what goes over, what is refused, and what is left behind."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from srprov import spool
from srprov.codes import Code
from srprov.errors import TransportError
from srprov.spool import tidy_script
from srprov.transport import image_deliver, image_source, link_rate
from srprov.transport.blobs import Blobs
from srprov.transport.copies import copy
from srprov.transport.image_copy import copy_image
from srprov.transport.image_source import ImageSources
from srprov.transport.link_rate import Links
from srprov.transport.options import ConnectOptions
from srprov.wire import CopyImage, Query, Reply
from tests.unit.transport.thin_world import CONTAINERD, INFO, InContainerd, Made, Robot, sha, tar_of

TAG = "srprov/x:1"
BASE, TOP = os.urandom(400_000), os.urandom(90_000)
IMAGE = Made(BASE, TOP)


class World:
    """A builder that has the image, and another robot."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.builder, self.target = Robot("builder", folder), Robot("target", folder)
        self.builder.images[TAG] = IMAGE
        self.again()
        self.said: list[str] = []

    def copy(
        self, *, way: str = "", id: str = "", target: Robot | None = None, runs: tuple[str, ...] = (), base: str = ""
    ) -> Reply:  # fmt: skip
        session: Any = target or self.target
        peers: Any = lambda _name: self.builder  # noqa: E731 - a mapping of one
        options = ConnectOptions(image_sources=self.sources)
        copy = CopyImage(image=TAG, source_host="builder", id=id, way=way, base=base, runs=runs)
        return copy_image(copy, session, peers, options, self.said.append)

    def again(self) -> None:
        """Forget what only this process knows."""
        self.sources = ImageSources(Blobs(self.folder / "cache"))
        self.sources.links = links()

    def is_clean(self) -> bool:
        """Tell whether no robot keeps anything of a copy."""
        return not any(list(Path(one.folder, "state").rglob("*")) for one in (self.builder, self.target))


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def test_only_the_missing_layer_goes_over_and_the_image_is_the_same(world: World) -> None:
    world.target.images["base"] = Made(BASE)
    reply = world.copy(id=IMAGE.id)
    assert reply.ok and "1 of 2 layers" in reply.out, reply
    assert world.target.images[TAG].id == IMAGE.id
    assert world.target.streamed[0] < 1.05 * len(gzip.compress(TOP, 1)) and world.builder.saves == 0
    assert world.is_clean() and any("MiB/s" in line for line in world.said)


def test_a_robot_that_has_all_layers_gets_only_the_name(world: World) -> None:
    world.target.images["same"] = Made(BASE, TOP)
    assert world.copy().ok and world.target.images[TAG].id == IMAGE.id and world.target.streamed[0] < 5_000


def test_the_builder_is_read_once_for_all_robots_and_for_later_runs(world: World, tmp_path: Path) -> None:
    others = [Robot(f"other{number}", tmp_path) for number in range(4)]
    threads = [threading.Thread(target=world.copy, kwargs={"target": one}) for one in others]
    for one in threads:
        one.start()
    for one in threads:
        one.join(30)
    assert all(one.images[TAG].id == IMAGE.id for one in others)
    reads = sum("gzip" in one and "docker" not in one for one in world.builder.shells)
    assert reads == 3, "configuration and two layers"
    world.again()
    shells = len(world.builder.shells)
    assert world.copy().ok and len(world.builder.shells) == shells and world.is_clean()


def test_a_builder_that_can_unpack_nothing_is_read_as_a_stream_once(world: World, tmp_path: Path) -> None:
    world.builder.spools = False
    assert world.copy(way="thin").ok and world.copy(target=Robot("other", tmp_path)).ok
    assert world.builder.saves == 1 and world.target.images[TAG].id == IMAGE.id


def test_an_engine_that_has_lost_a_layer_meanwhile_gets_the_image_whole_and_that_is_said(world: World) -> None:
    world.target.images["base"] = Made(BASE)
    world.target.lost = {sha(BASE)}
    reply = world.copy()
    assert reply.ok and world.target.images[TAG].id == IMAGE.id and len(world.target.streamed) == 2
    assert reply.out.startswith("sent whole, as its engine did not take it: open /var")
    assert any(line.startswith(f"{TAG} is sent whole: its engine did not take it: open /var") for line in world.said)
    world.target.images = {"base": Made(BASE)}
    forced = world.copy(way="thin")
    assert not forced.ok and "cannot be sent without the layers that are there" in forced.err


@pytest.mark.parametrize(("side", "why"), [("builder", "does not say what it has"), ("target", "no classic store")])
def test_an_engine_that_tells_no_store_gets_or_gives_the_image_whole(world: World, side: str, why: str) -> None:
    robot: Robot = getattr(world, side)
    robot.info.clear()
    assert world.copy().ok and world.target.images[TAG].id == IMAGE.id and world.builder.saves == 1
    assert any(f"the engine of {side} " in line and why in line for line in world.said)
    assert not world.copy(way="thin").ok


def test_a_containerd_store_that_cannot_pull_gets_the_image_whole(world: World) -> None:
    world.target.info["DriverStatus"] = CONTAINERD
    assert world.copy().ok and world.target.images[TAG].id == IMAGE.id and world.builder.saves == 1
    assert f"{TAG} is sent whole: this machine forwards no port to itself" in world.said


@pytest.mark.parametrize("index", [False, True])
def test_a_builder_with_a_containerd_store_is_read_by_what_its_id_leads_to(world: World, *, index: bool) -> None:
    built = InContainerd(BASE, TOP, index=index)
    world.builder.images[TAG], world.builder.info["DriverStatus"] = built, CONTAINERD
    world.target.images["base"] = Made(BASE)
    assert world.copy(id=built.id, base="base").ok, world.said
    assert world.target.images[TAG].id == built.config_id == IMAGE.id
    (sent,) = world.target.streamed
    assert sent < len(built.packed[1]) + 10_000 and world.builder.saves == 0 and world.is_clean()
    kept = {path.name for path in Path(world.folder, "cache").iterdir()}
    assert {f"{sha(TOP)[7:]}.gz", f"{built.config_id[7:]}.gz"} <= kept and f"{sha(BASE)[7:]}.gz" not in kept


def test_what_the_id_of_a_containerd_store_does_not_lead_to_is_not_sent(world: World) -> None:
    built, other = InContainerd(BASE, TOP), InContainerd(BASE, b"other")
    world.builder.images[TAG], world.builder.info["DriverStatus"] = built, CONTAINERD
    built.documents = [built.config, other.manifest.encode()]
    assert not world.copy(way="thin").ok
    assert not world.copy(id=built.id).ok, "nor whole, where it is known what it should be"
    assert TAG not in world.target.images


def test_whole_is_whole(world: World) -> None:
    world.target.images["base"] = Made(BASE)
    assert world.copy(way="whole").ok and world.target.streamed[0] > len(BASE) and world.builder.shells == []


def test_a_flipped_byte_in_the_cache_is_read_again(world: World, tmp_path: Path) -> None:
    assert world.copy().ok
    (kept,) = (one for one in (tmp_path / "cache").iterdir() if one.stat().st_size > 300_000)
    content = bytearray(kept.read_bytes())
    content[5_000] ^= 1
    kept.write_bytes(content)
    world.again()
    world.target.images = {}
    assert world.copy().ok and world.target.images[TAG].id == IMAGE.id
    assert gzip.decompress(kept.read_bytes()) == BASE


def test_a_flipped_byte_in_the_builders_spool_is_refused_and_nothing_is_tagged(world: World) -> None:
    content = bytearray(IMAGE.saved())
    content[content.find(TOP[:100]) + 50] ^= 1
    world.builder.saved = bytes(content)
    reply = world.copy()
    assert not reply.ok and "layer 2 of 2 is not what its image names" in reply.err, reply
    assert TAG not in world.target.images and world.target.streamed == [] and world.is_clean()


def test_a_layer_that_is_cut_off_on_its_way_here_is_read_anew_and_the_others_are_kept(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = image_source.read_script

    def cut(place: str, name: str, *, raw: bool) -> str:
        script = whole(place, name, raw=raw)
        return f"{{ {script}; }} | head -c 1000" if sha(TOP)[7:] in name else script

    monkeypatch.setattr(image_source, "read_script", cut)
    reply = world.copy()
    assert not reply.ok and "cut off" in reply.err and world.target.streamed == [] and world.is_clean()
    assert [one.suffix for one in Path(world.folder, "cache").iterdir()] == [".gz", ".gz"]
    asked = world.builder.ask

    def lost(queries: Sequence[Any]) -> list[Reply]:
        if queries == [Query(command=":")]:
            raise TransportError("builder", "lost contact", code=Code.LOST)
        return asked(queries)

    monkeypatch.setattr(world.builder, "ask", lost)
    reply = world.copy()
    assert not reply.ok and reply.err == "builder: lost contact", "nobody is said to have another image"
    monkeypatch.undo()
    shells = len(world.builder.shells)
    assert world.copy().ok and world.target.images[TAG].id == IMAGE.id
    assert len(world.builder.shells) - shells == 2, "it is unpacked, and one layer is read"


def test_another_image_under_the_tag_is_refused(world: World) -> None:
    reply = world.copy(id=Made(b"what was built").id)
    assert not reply.ok and reply.err.startswith("builder: it gives another image under srprov/x:1")
    assert world.target.streamed == [] and world.builder.shells == []


def test_a_configuration_that_names_other_layers_than_the_engine_is_refused(world: World) -> None:
    """The id is believed; the engine's list of layers would have others sent."""
    liar = Made(BASE, TOP)
    liar.diff_ids = [sha(BASE), sha(b"evil")]
    world.builder.images[TAG] = liar
    world.builder.saved = IMAGE.saved()
    reply = world.copy(id=IMAGE.id)
    assert not reply.ok and "names other layers" in reply.err, reply
    assert TAG not in world.target.images


def test_tags_of_the_builders_archive_reach_nobody(world: World) -> None:
    world.builder.saved = IMAGE.saved([TAG, "busybox:latest"])
    assert world.copy().ok and set(world.target.images) == {TAG}


@pytest.mark.parametrize("listed", [b"", b"[]", b"[{}]", b'[{"Config": "/etc/shadow", "Layers": ["../a", "b"]}]'])
def test_a_list_that_no_engine_writes_is_refused(world: World, listed: bytes) -> None:
    saved = IMAGE.saved()
    at = saved.rindex(b"[{")
    end = saved.index(b"]}]", at) + 3
    world.builder.saved = saved[:at] + listed.ljust(end - at) + saved[end:]
    reply = world.copy()
    assert (not reply.ok and "its archive lists" in reply.err) or "does not list" in reply.err, reply
    assert world.is_clean()


def test_a_robot_with_too_small_a_disk_is_refused_before_the_first_byte_with_both_sizes(world: World) -> None:
    world.target.free_kib = 60 * 1024
    reply = world.copy()
    assert not reply.ok and reply.err == "its Docker's disk is too small: 65 MiB are needed, 60 MiB are free"
    assert world.target.streamed == []


@pytest.mark.parametrize("shell", [["dash"], ["busybox", "sh"]])
def test_what_copies_left_goes_but_for_what_is_in_use(tmp_path: Path, shell: list[str]) -> None:
    folder = tmp_path / "state" / ".images"
    for name in ("load/0123", f"save.{os.getpid()}/x", "save.4194304/x"):
        (folder / name).mkdir(parents=True)

    def tidy(*, arriving: bool) -> list[str]:
        script = tidy_script(arriving=arriving, folder=str(folder))
        assert subprocess.run([*shell, "-c", script], check=False, capture_output=True).stderr == b""
        return sorted(one.name for one in folder.iterdir()) if folder.exists() else []

    assert tidy(arriving=False) == ["load", f"save.{os.getpid()}"]
    assert tidy(arriving=True) == [f"save.{os.getpid()}"]
    shutil.rmtree(folder / f"save.{os.getpid()}")
    assert tidy(arriving=True) == [] and list(tmp_path.iterdir()) == [] and tidy(arriving=True) == []


class TestSpooled:
    """What is larger than a limit arrives in a file."""

    @pytest.fixture(autouse=True)
    def _low(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(image_deliver, "LARGE", 100_000)

    @pytest.mark.parametrize(("most", "streams"), [(256 << 20, 1), (300_000, 0)])
    def test_a_fast_link_is_streamed_to_up_to_what_it_sends_again_soon(
        self, world: World, monkeypatch: pytest.MonkeyPatch, most: int, streams: int
    ) -> None:
        monkeypatch.setattr(image_deliver, "_LARGE_IF_FAST", most)
        fast(world, "target")
        assert world.copy().ok and world.target.images[TAG].id == IMAGE.id
        assert len(world.target.streamed) == streams and world.is_clean()

    def test_it_is_loaded_from_there_and_the_file_goes(self, world: World) -> None:
        assert world.copy().ok and world.target.images[TAG].id == IMAGE.id
        assert world.target.streamed == [] and world.is_clean()

    @pytest.mark.parametrize("part", [1, 50_000, 450_000])
    def test_after_a_cut_only_the_rest_is_sent(self, world: World, part: int) -> None:
        assert world.copy(target=Robot("other", world.folder)).ok
        spool = Path(world.target.spool, "load")
        whole = self._archive(world)
        spool.mkdir(parents=True)
        (spool / sha(whole).removeprefix("sha256:")).write_bytes(whole[:part])
        (spool / ("0" * 64)).write_bytes(b"another that was never finished")
        assert world.copy().ok and world.target.images[TAG].id == IMAGE.id and world.is_clean()
        sent = [line for line in world.said if "from an earlier try" in line]
        assert sent == [f"{part / (1 << 20):.1f} of {len(whole) / (1 << 20):.1f} MiB are there from an earlier try"]

    def test_a_flipped_byte_in_the_part_is_noticed_and_all_is_sent_again(self, world: World) -> None:
        assert world.copy(target=Robot("other", world.folder)).ok
        whole = bytearray(self._archive(world))
        name = sha(bytes(whole)).removeprefix("sha256:")
        whole[70_000] ^= 1
        Path(world.target.spool, "load").mkdir(parents=True)
        Path(world.target.spool, "load", name).write_bytes(whole[:300_000])
        assert world.copy().ok and world.target.images[TAG].id == IMAGE.id and world.is_clean()
        assert any("is not what was sent" in line for line in world.said)

    def test_a_robot_without_a_place_for_it_gets_a_stream(self, world: World) -> None:
        world.target.spools = False
        assert world.copy().ok and len(world.target.streamed) == 1

    def test_room_is_asked_for_before_the_first_byte(self, world: World) -> None:
        world.target.free_kib = 65 * 1024
        reply = world.copy()
        assert not reply.ok and "65 MiB are free" in reply.err and world.is_clean()

    @staticmethod
    def _archive(world: World) -> bytes:
        other = Robot("probe", world.folder)
        other.spools = False
        taken: list[bytes] = []
        load = other.engine.client.load
        other.engine.client.load = lambda pieces, *more: load(iter([taken.append(b"".join(pieces)) or taken[0]]), *more)
        assert world.copy(target=other).ok
        return taken[0]


@pytest.mark.parametrize("way", ["", "thin", "registry", "whole"])
def test_an_image_for_another_architecture_is_not_sent_whatever_its_tag(world: World, way: str) -> None:
    other = Made(BASE, TOP, architecture="arm64")
    world.builder.images[TAG] = other
    refused = world.copy(way=way, id=other.id, runs=("amd64", "386"))
    assert not refused.ok and "it is an image for arm64, and the robot runs amd64 and 386" in refused.err
    assert world.target.streamed == [] and TAG not in world.target.images and world.is_clean()
    if way in ("", "thin"):
        assert world.copy(way=way, id=other.id, runs=("arm64",)).ok and world.target.images[TAG].id == other.id


def test_a_builder_that_lies_about_an_images_architecture_is_found_out(world: World) -> None:
    """The configuration says it too, and its hash is the image's id."""
    other = Made(BASE, TOP, architecture="arm64")
    world.builder.images[TAG], world.builder.says = other, "amd64"
    refused = world.copy(id=other.id, runs=("amd64",))
    assert not refused.ok and "configuration" in refused.err
    assert world.target.streamed == [] and TAG not in world.target.images


class TestFastLinks:
    """Between fast links a large layer goes as it is: compressing it would take longer."""

    @pytest.fixture
    def packable(self, world: World, monkeypatch: pytest.MonkeyPatch) -> World:
        monkeypatch.setattr(spool, "LARGE", 100_000)
        world.builder.images[TAG] = Made(b"much of the same " * 30_000, TOP)
        return world

    def test_a_large_layer_is_sent_as_it_is_and_a_small_one_compressed(self, packable: World) -> None:
        fast(packable, "builder", "target")
        assert packable.copy().ok and 510_000 + 90_000 < packable.target.streamed[0] < 606_000
        assert sum("exec cat <" in one and "gzip" not in one for one in packable.builder.shells) == 1

    @pytest.mark.parametrize("only", ["builder", "target"])
    def test_when_one_link_is_slow_it_is_compressed(self, packable: World, only: str) -> None:
        fast(packable, only)
        assert packable.copy().ok and packable.target.streamed[0] < 110_000

    def test_a_slow_robot_gets_it_compressed_also_when_it_was_read_for_a_fast_one(self, packable: World) -> None:
        slow = Robot("slow", packable.folder)
        fast(packable, "builder", "target")
        assert packable.copy().ok and packable.copy(target=slow).ok
        assert slow.streamed[0] < 110_000 < packable.target.streamed[0]
        assert slow.images[TAG].id == packable.target.images[TAG].id

    def test_another_content_is_refused(self, packable: World) -> None:
        fast(packable, "builder", "target")
        others = Made(b"something else   " * 30_000, TOP).saved()
        names = [
            sha(one.layers[0])[7:].encode()
            for one in (Made(b"something else   " * 30_000), packable.builder.images[TAG])
        ]
        packable.builder.saved = others.replace(*names)
        reply = packable.copy()
        assert not reply.ok and "not what its image names" in reply.err and not packable.target.images, reply


def fast(world: World, *robots: str) -> None:
    """Take the links of these robots for fast."""
    world.sources.links = links(*robots)


def links(*robots: str) -> Links:
    """Give links of which these are fast."""
    every = ("builder", "target", "slow", "other")
    return Links({(way, robot): robot in robots for way in ("gives", "takes") for robot in every})


def test_a_link_is_fast_when_it_takes_and_gives_a_mebibyte_in_time(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder: Any = world.builder
    for seconds, wanted in ((60.0, True), (1e-6, False)):
        monkeypatch.setattr(link_rate, "_MOST_S", seconds)
        links = Links()
        assert (links.gives_fast(builder), links.takes_fast(builder)) == (wanted, wanted)
    world.builder.spools = False  # its shell says something else
    assert not Links().takes_fast(builder)


NAME = "srprov/bundled:" + IMAGE.id[7:]


def kept(world: World, *, without: bytes = b"") -> None:
    """Have the image in the cache of this machine, as a bundle brings it there."""
    for content in (IMAGE.config, BASE, TOP):
        if content != without:
            world.sources.blobs.add_content(sha(content), [content])


def load(world: World, **more: Any) -> Reply:
    session: Any = world.target
    options = ConnectOptions(image_sources=world.sources)
    return copy(CopyImage(image=NAME, source_host="", id=IMAGE.id, **more), session, None, options, world.said.append)


def test_an_image_of_the_cache_is_loaded_without_the_layers_that_are_there(world: World) -> None:
    kept(world)
    world.target.images["base"] = Made(BASE)
    reply = load(world)
    assert reply.ok and world.target.images[NAME].id == IMAGE.id and reply.out.startswith("sent 1 of 2 layers")
    assert world.builder.saves == 0 and world.is_clean()
    again = load(world)
    assert again.ok and again.out.startswith("sent 0 of 2 layers")


@pytest.mark.parametrize("store", ["none", "containerd"])
def test_an_engine_of_another_store_gets_an_image_of_the_cache_whole(world: World, store: str) -> None:
    kept(world)
    if store == "none":
        world.target.info.clear()
    else:
        world.target.info["DriverStatus"] = CONTAINERD
    assert load(world).ok and world.target.images[NAME].id == IMAGE.id


def test_an_engine_that_has_lost_a_layer_gets_an_image_of_the_cache_whole(world: World) -> None:
    kept(world)
    world.target.images["base"] = Made(BASE)
    world.target.lost = {sha(BASE)}
    assert load(world).ok and world.target.images[NAME].id == IMAGE.id
    world.target.images = {"base": Made(BASE)}
    assert not load(world, way="thin").ok


def test_what_is_not_in_the_cache_or_is_for_another_robot_is_a_failure(world: World) -> None:
    missing = load(world)
    assert not missing.ok and "is not in this machine's cache of layers any more" in missing.err
    kept(world, without=TOP)
    assert not load(world).ok and not world.target.images
    kept(world)
    other: Any = CopyImage(image=NAME, source_host="", id=sha(BASE))
    session: Any = world.target
    found = copy(other, session, None, ConnectOptions(image_sources=world.sources), world.said.append)
    assert not found.ok and "is the configuration of no image" in found.err


@pytest.mark.parametrize("spools", [True, False])
def test_a_builder_that_names_what_others_gave_has_to_give_it_itself(world: World, *, spools: bool) -> None:
    """Its image could name a layer of another experiment's, by a digest that a record tells."""
    kept(world)
    world.builder.spools, world.builder.saved = spools, Made(BASE).saved([TAG])
    reply = world.copy(id=IMAGE.id, way="thin")
    assert not reply.ok and TAG not in world.target.images, reply
    world.sources.blobs.givers.note(sha(TOP), "other")
    world.again()
    assert not world.copy(id=IMAGE.id, way="thin").ok
    world.builder.saved = b""
    assert world.copy(id=IMAGE.id, way="thin").ok and world.target.images[TAG].id == IMAGE.id
    world.again()
    saves, shells = world.builder.saves, len(world.builder.shells)
    assert world.copy(way="thin").ok and (world.builder.saves, len(world.builder.shells)) == (saves, shells)


FALSE = {"junk": os.urandom(90_000), "nothing": b"", "its own name": sha(TOP).encode()}


@pytest.mark.parametrize("content", FALSE.values(), ids=FALSE.keys())
@pytest.mark.parametrize("way", ["", "thin", "whole"])
@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("there", ["secret", "not listed"])
def test_a_builder_that_names_what_the_robot_has_of_others_has_to_give_it_itself(
    world: World, *, way: str, content: bytes, there: str, silent: bool
) -> None:
    """The engine would take its own layer for what the builder named, and others got it from there, or a bundle.

    A builder that does not say which store it has gives it whole.
    """
    if there == "secret":
        world.target.images[there] = IMAGE
    else:
        world.target.unlisted = [IMAGE]
    if silent:
        world.builder.info.clear()
    files = {f"{IMAGE.id[7:]}.json": IMAGE.config, "a": BASE, "b": content}
    listed = [{"Config": f"{IMAGE.id[7:]}.json", "RepoTags": [TAG], "Layers": ["a", "b"]}]
    world.builder.saved = tar_of({**files, "manifest.json": json.dumps(listed).encode()})
    reply = world.copy(way=way, base="none")
    assert not reply.ok and TAG not in world.target.images, reply
    world.builder.saved, world.builder.info = b"", dict(INFO)
    assert world.copy(way=way).ok and world.target.images[TAG].id == IMAGE.id


@pytest.mark.parametrize("way", ["thin", "whole"])
def test_what_a_builder_gave_once_is_not_asked_of_it_again(world: World, way: str) -> None:
    world.target.images["same"] = IMAGE
    assert world.copy(way=way).ok
    world.again()
    world.sources.blobs.clear()
    world.builder.images[TAG] = Made(BASE, TOP, b"more")
    assert world.copy(way="thin").ok
    reads = [path.name for path in Path(world.folder, "cache").iterdir()]
    assert f"{sha(b'more')[7:]}.gz" in reads and not {f"{sha(one)[7:]}.gz" for one in (BASE, TOP)} & {*reads}


@pytest.mark.parametrize(("base", "read"), [("base", False), ("other", True), ("nothing", True), ("", True)])
def test_layers_of_the_base_are_not_asked_of_a_builder_where_the_robot_has_it(
    world: World, base: str, *, read: bool
) -> None:
    """`other` holds the same layer, and the image was not built on it."""
    world.target.images |= {"base": Made(BASE), "other": Made(BASE, b"other")}
    assert world.copy(base=base).ok and world.target.images[TAG].id == IMAGE.id
    assert Path(world.folder, "cache", f"{sha(BASE)[7:]}.gz").exists() == read


@pytest.mark.parametrize("members", [1, 2])
def test_layers_that_come_packed_are_known_by_what_they_hold(world: World, members: int) -> None:
    """In an archive of a containerd store; some tools write a file of several members."""
    built, half = InContainerd(BASE, TOP), len(TOP) // members
    built.packed[1] = b"".join(gzip.compress(TOP[at : at + half]) for at in range(0, len(TOP), half))
    world.target.images["same"], world.builder.images[TAG] = Made(BASE, TOP), built
    assert world.copy(way="whole").ok and world.target.images[TAG].id == IMAGE.id


def test_an_archive_of_another_image_than_the_engine_told_is_not_loaded(world: World) -> None:
    world.builder.saved = Made(BASE, b"other").saved([TAG])
    reply = world.copy(way="whole")
    assert not reply.ok and "another image than its engine says" in reply.err and not world.target.images


@pytest.mark.parametrize("spools", [True, False])
def test_a_builder_with_the_name_of_who_gave_a_layer_has_to_give_it_itself(world: World, *, spools: bool) -> None:
    """Every laboratory has a robot1; and a replay gives robots the names that its bundle says."""
    assert world.copy(id=IMAGE.id, way="thin").ok
    world.again()
    world.builder.identity, world.builder.spools = "builder another key", spools
    world.builder.saved, world.target.images = Made(BASE).saved([TAG]), {}
    reply = world.copy(id=IMAGE.id, way="thin")
    assert not reply.ok and TAG not in world.target.images, reply
