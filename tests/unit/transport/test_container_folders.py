"""Files of a container without its engine, in folders of this machine that a played engine says that it has."""

from __future__ import annotations

import io
import json
import os
import subprocess
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.codes import Code
from srprov.container_files import InContainer
from srprov.definitions.model import Host
from srprov.errors import RefusedError, SrprovError, TransportError, UsageError
from srprov.session import Session
from srprov.transport import connect
from srprov.transport.container_streams import given
from tests.unit.transport.test_local_session import PlayedEngine, pytestmark, reply

__all__ = ["pytestmark"]

OLD, MENDED = "20.10.24+dfsg1", "29.5.1"


class World:
    """A container with a volume at /data, a bind that is read only at /maps, and a hosts file of its engine's."""

    def __init__(self, folder: Path) -> None:
        self.merged, self.data, self.maps = folder / "merged", folder / "data", folder / "maps"
        for one in (self.merged, self.data, self.maps):
            one.mkdir()
        own = folder / "containers" / "c1" / "hosts"
        own.parent.mkdir(parents=True)
        own.write_text("hosts")
        self.version, self.status, self.having = OLD, "running", "[]"
        self.inspected: dict[str, Any] = {
            "State": {"Status": self.status},
            "GraphDriver": {"Name": "overlay2", "Data": {"MergedDir": str(self.merged)}},
            "Id": "c1",
            "HostsPath": str(own),
            "Mounts": [
                {"Type": "volume", "Name": "d", "Source": str(self.data), "Destination": "/data", "RW": True},
                {"Type": "bind", "Source": str(self.maps), "Destination": "/maps", "RW": False},
            ],
        }
        self.engine = PlayedEngine(folder / "engine.sock", self._answer)
        self.archive: list[bytes] = []

    def _answer(self, request: str, _headers: dict[str, str], body: bytes) -> bytes:
        if "/archive" in request:
            self.archive.append(body)
            return reply(b"")
        if request.endswith("/version"):
            return reply(json.dumps({"Version": self.version}).encode())
        if "/containers/json" in request:
            return reply(self.having.encode())
        return reply(json.dumps({**self.inspected, "State": {"Status": self.status}}).encode())

    @property
    def asked_engine(self) -> bool:
        """Whether it was asked for files."""
        return any("/archive" in one for one in self.engine.requests)


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/engine.sock")
    made = World(tmp_path)
    subprocess.run(["mount", "-t", "tmpfs", "test", made.merged], check=True)
    try:
        for name in ("etc", "data", "maps", "w"):
            (made.merged / name).mkdir()
        (made.merged / "etc/hosts").write_text("")
        (made.merged / "w/file").write_text("content")
        yield made
    finally:
        subprocess.run(["umount", "-l", made.merged], check=True)


@pytest.fixture
def session() -> Iterator[Session]:
    made = connect(Host(name="here", address="localhost", connection="local"))
    yield made
    made.close()


def tar(**content: str | None) -> Iterator[bytes]:
    """Give a tar of files, or of folders without content; `__` is a slash."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as made:
        for name, text in content.items():
            one = tarfile.TarInfo(name.replace("__", "/"))
            one.type, one.size = (tarfile.DIRTYPE, 0) if text is None else (tarfile.REGTYPE, len(text))
            one.mode, one.uid, one.gid = 0o750 if text is None else 0o640, 1000, 1001
            made.addfile(one, io.BytesIO((text or "").encode()))
    return iter([b"", out.getvalue()[:700], b"", out.getvalue()[700:]])


def names(chunks: Iterator[bytes]) -> dict[str, bytes | None]:
    with tarfile.open(fileobj=io.BytesIO(b"".join(chunks))) as read:
        return {one.name: read.extractfile(one).read() if one.isreg() else None for one in read}  # type: ignore[union-attr]


def test_each_path_is_looked_at_where_it_lies(world: World, session: Session) -> None:
    (world.data / "run").mkdir()
    (world.data / "run/x").write_text("four")
    (world.maps / "hall").write_text("")
    (world.merged / "data/hidden").write_text("")
    for link, to in {"data/abs": "/data/run", "data/rel": "run/../run", "data/out": "/w/file", "w/in": "../data/abs/x",
                     "data/gone": "/no/where", "w/up": "../../../../../data"}.items():  # fmt: skip
        (world.merged if link.startswith("w/") else world.data.parent).joinpath(link).symlink_to(to)
    found = {
        "/": InContainer(is_folder=True),
        "/data": InContainer(is_folder=True),
        "/data/run/x": InContainer(is_file=True, size=4),
        "/data/abs": InContainer(link="/data/run"),
        "/data/abs/x": InContainer(is_file=True, size=4),
        "/data/rel/x": InContainer(is_file=True, size=4),
        "/data/out": InContainer(link="/w/file"),
        "/w/in": InContainer(link="/data/run/x"),
        "/w/up/run/x": InContainer(is_file=True, size=4),
        "/data/gone": InContainer(link="/no/where"),
        "/data/hidden": None,
        "/data/run/x/y": None,
        "/maps/hall": InContainer(is_file=True),
        "/etc/hosts": InContainer(is_file=True, size=5),
        "/etc/passwd": None,
    }
    assert {path: session.path_in("c", path) for path in found} == found
    assert not world.asked_engine


def test_a_link_leads_to_nothing_of_the_robot(world: World, session: Session, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("decoy")
    for number, to in enumerate(
        (f"{tmp_path}/secret", "../secret", f"../../../../../..{tmp_path}/secret", "/etc/shadow")
    ):
        (world.data / f"l{number}").symlink_to(to)
        assert session.path_in("c", session.path_in("c", f"/data/l{number}").link) is None  # type: ignore[union-attr]
    (world.data / "d").symlink_to(tmp_path)
    with pytest.raises(TransportError, match="it is gone"):
        list(session.copy_out("c", "/data/d/secret"))
    with pytest.raises(UsageError, match="there is no folder"):
        session.copy_into("c", "/data/d", tar(x="x"))
    (world.data / "a").symlink_to("b")
    (world.data / "b").symlink_to("a")
    with pytest.raises(RefusedError, match="links lead in a circle"):
        session.path_in("c", "/data/a/x")


def test_a_folder_or_file_comes_as_a_tar(world: World, session: Session) -> None:
    (world.data / "run/deep").mkdir(parents=True)
    (world.data / "run/deep/big").write_bytes(b"x" * 3_000_000)
    (world.data / "run/link").symlink_to("/etc/passwd")
    assert names(session.copy_out("c", "/data/run")) == {
        "./run": None, "./run/link": None, "./run/deep": None, "./run/deep/big": b"x" * 3_000_000,
    }  # fmt: skip
    assert names(session.copy_out("c", "/data/run/link")) == {"./link": None}
    assert names(session.copy_out("c", "/w/file")) == {"./file": b"content"}
    assert names(session.copy_out("c", "/etc/hosts")) == {"./hosts": b"hosts"}
    assert set(names(session.copy_out("c", "/data"))) == {".", "./run", "./run/link", "./run/deep", "./run/deep/big"}
    assert not world.asked_engine


def test_a_tar_is_unpacked_with_its_owners(world: World, session: Session) -> None:
    (world.data / "a").write_text("old")
    (world.merged / "w/data").symlink_to("/data")
    session.copy_into("c", "/w/data", tar(a="new", deep=None, deep__b="b", implied__c="c"))
    assert {str(one.relative_to(world.data)) for one in world.data.rglob("*")} == {
        "a", "deep", "deep/b", "implied", "implied/c",
    }  # fmt: skip
    assert (world.data / "a").read_text() == "new"
    about, folder = (world.data / "deep/b").stat(), (world.data / "deep").stat()
    assert (about.st_uid, about.st_gid, about.st_mode & 0o777, folder.st_mode & 0o777) == (1000, 1001, 0o640, 0o750)
    session.copy_into("c", "/", tar(new=None, new__x="x", etc__new="y"))
    assert (world.merged / "new/x").read_text() + (world.merged / "etc/new").read_text() == "xy"
    assert not world.asked_engine


@pytest.mark.parametrize(
    ("folder", "content", "why"),
    [
        ("/data", {"file": None}, "/data/file: no folder is there, where one is to be"),
        ("/data", {"dir": "x"}, "/data/dir: a folder is there, where a file is to be"),
        ("/data", {"dir__file": None}, "/data/dir/file: no folder"),
        ("/data", {"dir__link__x": "x"}, "/data/dir/link: no folder"),
        ("/data", {"fine": "x", "dir__file__x": "x"}, "/data/dir/file: no folder"),
        ("/", {"data__x": "x"}, "/data is mounted in /"),
        ("/", {"etc": None, "etc__hosts": "x"}, "/etc/hosts is mounted in /"),
        ("/maps", {"x": "x"}, "read only"),
        ("/", {"..__x": "x"}, "leads out"),
    ],
)
def test_nothing_takes_another_place(
    world: World, session: Session, folder: str, content: dict[str, str | None], why: str
) -> None:
    (world.data / "dir").mkdir()
    (world.data / "dir/file").write_text("old")
    (world.data / "dir/link").symlink_to("/w")
    (world.data / "file").write_text("old")
    with pytest.raises(SrprovError, match=why):
        session.copy_into("c", folder, tar(**content))
    assert (world.data / "file").read_text() + (world.data / "dir/file").read_text() == "oldold"
    assert os.listdir(world.maps) == os.listdir(world.merged / "data") == []
    assert (world.merged / "etc/hosts").read_text() == ""


def test_a_folder_is_not_copied_without_what_is_mounted_in_it(world: World, session: Session) -> None:
    for path, inside in (("/", "/data"), ("/etc", "/etc/hosts")):
        with pytest.raises(RefusedError, match=f"{inside} is mounted in it") as error:
            session.copy_out("c", path)
        assert "29.5.1" in error.value.hint and error.value.code == Code.ENGINE
    other = world.data / "disk here"
    other.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "test", other], check=True)
    try:
        with pytest.raises(RefusedError, match="/data/disk here is mounted in it"):
            session.copy_out("c", "/data")
        with pytest.raises(RefusedError, match="mounted at /data/disk here cannot be read"):
            session.path_in("c", "/data/disk here/x")
        with pytest.raises(RefusedError, match="mounted at /data/disk here cannot be read"):
            session.copy_into("c", "/data", tar(**{"disk here__x": "x"}))
    finally:
        subprocess.run(["umount", other], check=True)


def test_a_mount_is_found_where_a_link_of_the_image_leads_its_path(world: World, session: Session) -> None:
    (world.merged / "run/x").mkdir(parents=True)
    (world.merged / "var").mkdir()
    (world.merged / "var/run").symlink_to("/run")
    world.inspected["Mounts"][0]["Destination"] = "/var/run/x"
    (world.data / "there").write_text("x")
    for path in ("/var/run/x/there", "/run/x/there"):
        assert session.path_in("c", path) == InContainer(is_file=True, size=1)
    with pytest.raises(RefusedError, match="/run/x is mounted in it"):
        session.copy_out("c", "/run")


def test_more_folders_above_mounts_than_a_program_takes_as_words_are_looked_at(world: World, session: Session) -> None:
    """Their names were one word of `sh -c`, which takes 128 KiB: no file of such an image's containers was copied."""
    (world.merged / "var").mkdir()
    (world.merged / "var/run").symlink_to("/run")
    (world.data / "it's").write_text("x")
    mounts, data = world.inspected["Mounts"], world.inspected["Mounts"][0]
    mounts += [{**data, "Destination": f"/var/run/{n}" + "/a" * 300} for n in range(2)]
    mounts += [{**data, "Destination": f"/var/run/{n}/" + "b" * 250} for n in range(100)]
    assert session.path_in("c", f"/run/7/{'b' * 250}/it's") == InContainer(is_file=True, size=1)
    assert session.path_in("c", "/run/1" + "/a" * 300 + "/it's") == InContainer(is_file=True, size=1)


def test_mounts_in_more_folders_than_are_looked_at_are_refused(world: World, session: Session) -> None:
    mounts, data = world.inspected["Mounts"], world.inspected["Mounts"][0]
    mounts += [{**data, "Destination": f"/v{n}" + "/abc" * 220} for n in range(90)]
    with pytest.raises(RefusedError, match="more folders than are looked at") as error:
        session.path_in("c", "/w/file")
    assert "29.5.1" in error.value.hint


def test_a_mount_without_a_slash_is_found_below_the_root(world: World, session: Session) -> None:
    """`VOLUME data` of an image: what is there was left out without a word."""
    world.inspected["Mounts"][0]["Destination"] = "data"
    (world.data / "here").write_text("x")
    assert session.path_in("c", "/data/here") == InContainer(is_file=True, size=1)


def use(session: Session, path: str) -> None:
    session.copy_into("c", path, tar(x="x"))


CHOICES: dict[str, tuple[Callable[[World], object], str, str]] = {
    "an engine that has mended it": (lambda w: setattr(w, "version", MENDED), "/", ""),
    "a later one": (lambda w: setattr(w, "version", "30.0.0-rc.1"), "/", ""),
    "an earlier one": (lambda w: setattr(w, "version", "29.5.0"), "/w", "folder"),
    "one that names no version": (lambda w: setattr(w, "version", "dev"), "/w", "folder"),
    "no mounts, and it runs": (lambda w: w.inspected.pop("Mounts"), "/w", "folder"),
    "no mounts, and nobody runs": (lambda w: (w.inspected.pop("Mounts"), setattr(w, "status", "exited")), "/w", ""),
    # who holds an open folder of it was given that by it, and is in no list of the engine's
    "no mounts, and somebody runs": (
        lambda w: (w.inspected.pop("Mounts"), setattr(w, "status", "exited"), setattr(w, "having", '[{"Id":"x"}]')),
        "/w", "it does not run, and others could"),
    "nobody runs": (lambda w: (w.inspected["Mounts"].pop(), setattr(w, "status", "exited")), "/w", ""),
    "it does not run, and somebody does": (
        lambda w: (w.inspected["Mounts"].pop(), setattr(w, "status", "exited"), setattr(w, "having", '[{"Id":"x"}]')),
        "/w", "it does not run, and others could"),
    "the same, in the volume": (
        lambda w: (w.inspected["Mounts"].pop(), setattr(w, "status", "exited"), setattr(w, "having", '[{"Id":"x"}]')),
        "/data", "folder"),
    "it does not run, and reads what srprov keeps": (
        lambda w: (w.inspected["Mounts"][1].update(Source="/run/srprov/x/key"), setattr(w, "status", "exited")),
        "/w", ""),
    "it does not run, and has a bind": (lambda w: setattr(w, "status", "exited"), "/w", "it does not run, and others"),
    "it does not run, and has a bind behind more volumes than are looked at": (
        lambda w: (
            setattr(w, "status", "exited"),
            w.inspected.update(Mounts=[
                *({**w.inspected["Mounts"][0], "Destination": f"/v/{n}"} for n in range(1100)),
                w.inspected["Mounts"][1],
            ])),
        "/w", "it has more mounts than are looked at"),
    "it does not run, and has a bind where an engine has its own": (
        lambda w: (w.inspected["Mounts"][1].update(Destination="/etc/hosts"), setattr(w, "status", "exited")),
        "/w", "it does not run, and others"),
    "it restarts": (lambda w: setattr(w, "status", "restarting"), "/data", "folder"),
    "another store": (lambda w: w.inspected.update(GraphDriver=None), "/w", "have no folder on the robot"),
    "another store, in the volume": (lambda w: w.inspected.update(GraphDriver=None), "/data", "folder"),
    "files that are not mounted": (lambda w:
        w.inspected["GraphDriver"]["Data"].update(MergedDir=str(w.maps)), "/w", "have no folder on the robot"),
    "remapped users": (lambda w: w.inspected.update(HostsPath="/d/165536.165536/containers/x/hosts"), "/w", "numbers"),
    "a root that is read only": (lambda w: w.inspected.update(HostConfig={"ReadonlyRootfs": True}), "/w", "read only"),
}  # fmt: skip


@pytest.mark.parametrize("case", CHOICES)
def test_an_engine_is_asked_only_where_nobody_can_change_a_name_meanwhile(
    world: World, session: Session, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    change, folder, end = CHOICES[case]
    change(world)
    monkeypatch.setattr(type(session), "holds_lock", property(lambda _session: True))
    if end in ("", "folder"):
        use(session, folder)
    else:
        with pytest.raises(RefusedError, match=end) as error:
            use(session, folder)
        assert error.value.hint
    assert world.asked_engine == (end == "")
    assert (world.data / "x").exists() == (folder == "/data") and (world.merged / "w/x").exists() == (
        (folder, end) == ("/w", "folder")
    )


def test_what_leads_elsewhere_than_when_the_container_was_made_is_not_read(world: World, session: Session) -> None:
    """A link came in the way after `cp` had looked: it read, and wrote, a folder of the robot's."""
    path = str(world.maps)
    world.inspected["Config"] = {"Labels": {"srprov.led": json.dumps({path: path})}}
    (world.maps / "file").write_text("content")
    assert session.path_in("c", "/maps/file")
    world.inspected["Config"] = {"Labels": {"srprov.led": json.dumps({path: f"{path}-of-before"})}}
    with pytest.raises(RefusedError, match="mounted at /maps cannot be read"):
        session.path_in("c", "/maps/file")


def test_no_engine_is_asked_without_the_robots_lock(world: World, session: Session) -> None:
    """`cp` takes it of a container that does not run; one that ended since is asked of nobody."""
    world.inspected["Mounts"].pop()
    world.status = "exited"
    with pytest.raises(RefusedError, match="it does not run, and others could"):
        use(session, "/w")
    assert not world.asked_engine


@pytest.mark.parametrize("version", [OLD, MENDED])
@pytest.mark.parametrize(
    "given", [b"", b"\x1f\x8b\x08" + bytes(2000), b"BZh91AY" * 300, b"no tar" * 300, b"x", bytes(511)]
)
def test_what_is_no_tar_goes_nowhere(world: World, session: Session, given: bytes, version: str) -> None:
    world.version = version
    pieces = iter([given[:3], given[3:], b"more" * 1000]) if len(given) > 511 else iter([given] if given else [])
    with pytest.raises(UsageError, match="is no tar"):
        session.copy_into("c", "/data", pieces)
    assert not world.asked_engine and os.listdir(world.data) == []


def test_a_tar_that_is_cut_or_broken_is_told(world: World, session: Session) -> None:
    whole = b"".join(tar(a="a" * 2000, b="b"))
    for broken in (whole[:1500], whole[:2560] + b"?" * 512 + whole[3072:]):
        with pytest.raises(UsageError, match="is no tar"):
            session.copy_into("c", "/data", iter([broken]))


@pytest.mark.parametrize("name", [b"\x1f\x8b\x08x", b"BZh91AY", b"\xfd7zXZ\x00"[:5], b"\x28\xb5\x2f\xfd"])
@pytest.mark.parametrize("version", [OLD, MENDED])
def test_no_name_of_a_file_is_the_beginning_of_what_an_engine_gets(
    world: World, session: Session, name: bytes, version: str
) -> None:
    """It would take the tar for compressed, and run the container's own programs to unpack that."""
    world.version = version
    text = os.fsdecode(name)
    session.copy_into("c", "/data", tar(**{text: "content"}))
    if version == OLD:
        assert (world.data / text).read_text() == "content"
        return
    (body,) = world.archive
    assert not body.startswith(name) and names(iter([body])) == {text: b"content"}


def test_a_robot_without_what_is_needed_says_so(
    world: World, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srprov.transport.container_folders._GNU", "exit 46; ")
    for act in (lambda: list(session.copy_out("c", "/data")), lambda: use(session, "/data")):
        with pytest.raises(TransportError, match="GNU tar and find are needed"):
            act()


class Talker:
    """A robot whose shell talks for ever, and takes nothing."""

    ended = False

    def __init__(self, said: bytes) -> None:
        self.said = said

    def read(self) -> tuple[bytes, bytes]:
        said, self.said = self.said, b"x" * 4096
        return said, b"x"

    def write(self, _data: memoryview) -> int:
        return 0

    def wait(self, _seconds: float, *, writing: bool) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.mark.parametrize("said", [b"x", b"ready\n"])
def test_who_only_talks_is_not_waited_for(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    """What it takes counts: it may print without end."""
    seconds = iter(range(0, 100_000, 5))
    monkeypatch.setattr("srprov.pace.time.monotonic", lambda: float(next(seconds)))
    with pytest.raises(TransportError, match="cannot be written"):
        given("robot1", Talker(said), "/x", {}, iter([b"a" * 100]))  # type: ignore[arg-type]


@pytest.mark.parametrize("how", ["cut", "removed", "grown"])
def test_what_is_cut_or_removed_while_it_is_copied_is_told(world: World, session: Session, how: str) -> None:
    """In the place of what was cut there are zeros, which nobody wrote."""
    files = [world.data / "run" / name for name in ("a", "b")]
    files[0].parent.mkdir()
    for one in files:
        one.write_bytes(b"x" * (8 << 20))
    pieces = session.copy_out("c", "/data/run")
    whole = len(next(pieces))
    for one in files:
        if how == "cut":
            os.truncate(one, 1000)
        elif how == "removed":
            one.unlink()
        else:
            with one.open("ab") as more:
                more.write(b"more")
    if how == "grown":
        assert whole + sum(map(len, pieces)) > 16 << 20
        return
    with pytest.raises(TransportError, match="was cut or removed while it was copied") as caught:
        for _ in pieces:
            pass
    assert {"cut": "padding with zeros", "removed": "removed before we read it"}[how] in caught.value.message
