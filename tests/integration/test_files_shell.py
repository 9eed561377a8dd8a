"""The scripts of file and tree resources, run by real shells on a real filesystem.

Each script runs in a mount namespace of its own in which /var/lib holds nothing but the test's folder as
/var/lib/srprov, so the paths are the real ones and nothing of this machine is touched. Needs root, for `unshare -m`.
"""

from __future__ import annotations

import io
import os
import shutil
import stat
import subprocess
import tarfile
from pathlib import Path

import pytest

from srprov.modules import MODULES
from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT
from srprov.resource import Change, Resource
from srprov.wire import Put, Query, Reply, Run, quote
from tests.resources import resource

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or not shutil.which("unshare"), reason="a private mount namespace needs root"
)

ANY_BYTES = bytes(range(256)) * 5
HOSTILE = [
    "a b", "$(touch pwned)", "`touch pwned`", "';touch pwned;'", '"x"', "-rf", "*", "?", "[a]", "~", "#", "é 😀",
    "a&&b", "a|b", ">x", "a\tb", "%s%n", "!!",
]  # fmt: skip


class Robot:
    """A folder as /var/lib/srprov, and a shell that sees it there."""

    def __init__(self, folder: Path, shell: str) -> None:
        self.folder, self.shell = folder, shell

    def sh(self, script: str, *, root: bool = True) -> Reply:
        """Run a script; without `root` there is no /var/lib/srprov yet."""
        own = f"mkdir {STATE_ROOT} && mount --bind {self.folder} {STATE_ROOT} && " if root else ""
        setup = f"mount -t tmpfs none /var/lib && {own}cd / && exec {self.shell}"
        # as transport sends it: the shell reads its commands from standard input, each in a subshell
        sent = f"(eval {quote(script)}) </dev/null\n".encode()
        done = subprocess.run(["unshare", "-m", "sh", "-c", setup], input=sent, capture_output=True, timeout=60)
        out, err = done.stdout.decode("utf-8", "replace"), done.stderr.decode("utf-8", "replace")
        return Reply(status=done.returncode, out=out, err=err, ok=done.returncode == 0)

    def path(self, path: str) -> Path:
        """Return where a path of the robot lies on this machine."""
        return self.folder / path.removeprefix(STATE_ROOT + "/")

    def check(self, want: Resource) -> Change | None:
        """Ask the module what is due."""
        module = MODULES[want.module]
        replies = [self.sh(query.command) for query in module.queries() if isinstance(query, Query)]
        assert all(reply.ok for reply in replies), replies
        found = {one.name: one for one in module.parse(replies)}
        return module.check(want.name, want.params, found[want.name].state if want.name in found else None)

    def make(self, want: Resource) -> None:
        """Do what is due, and check that nothing is due then."""
        change = self.check(want)
        assert change is not None
        for command in change.commands:
            assert isinstance(command, Put | Run)
            reply = self.sh(command.script() if isinstance(command, Put) else command.script)
            assert reply.ok, reply.err
        assert self.check(want) is None

    def names(self) -> list[str]:
        """Return all paths below the root."""
        return sorted(one.relative_to(self.folder).as_posix() for one in self.folder.rglob("*"))


@pytest.fixture(params=["dash", "busybox sh"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    """Return an empty robot, once with each shell that robots have."""
    if not shutil.which(request.param.split()[0]):
        pytest.skip(f"{request.param} is not installed")
    return Robot(tmp_path, request.param)


def file(name: str, content: str, **params: object) -> Resource:
    """Return a wanted file."""
    full = f"{STATE_ROOT}/{name}"
    return resource("file", full, {"content": content, "mode": "0644", **params})


def tree(blob: bytes) -> Resource:
    """Return the wanted tree of a tar."""
    return resource("tree", f"{STATE_ROOT}/hello/trees/0123", {"blob": "sha"}, blobs={"sha": blob})


def tar(**files: bytes) -> bytes:
    """Return a tar with one top folder, `www`."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(f"www/{name}")
            entry.size, entry.mode = len(content), 0o755 if name.startswith("run") else 0o644
            archive.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


@pytest.mark.parametrize("in_place", [False, True])
@pytest.mark.parametrize("content", [b"", b"x", b"\n", b"_END_OF_FILE_\n", ANY_BYTES, ANY_BYTES * 800])
def test_any_bytes_arrive(robot: Robot, content: bytes, in_place: bool) -> None:
    """A file holds exactly the bytes that were sent, with its mode, and nothing half written stays beside it."""
    put = Put(path=f"{STATE_ROOT}/hello/blob", content=content, mode=0o640, in_place=in_place)
    reply = robot.sh(put.script())
    assert reply.ok, reply.err
    assert robot.path(put.path).read_bytes() == content
    assert stat.S_IMODE(robot.path(put.path).stat().st_mode) == 0o640
    assert robot.names() == ["hello", "hello/blob"]


@pytest.mark.parametrize(
    "content",
    ["", "x", "\n", "it's $(id) `id` \\\\n %s %n\\c", "-n", "-- x", "é\r\n\t", "x" * 8192, "x" * 8193, "a\0b"],
)
@pytest.mark.parametrize("left", [False, True])
def test_text_that_everybody_may_read_arrives(robot: Robot, content: str, left: bool) -> None:
    """The shell itself may write it: the same bytes, the same mode, whatever an earlier run left half written."""
    put = Put(path=f"{STATE_ROOT}/hello/text", content=content.encode())
    if left:
        robot.make(file("hello/text.part", "half"))
        robot.path(f"{put.path}.part").chmod(0o600)
    reply = robot.sh(put.script())
    assert reply.ok, reply.err
    assert robot.path(put.path).read_bytes() == content.encode()
    assert stat.S_IMODE(robot.path(put.path).stat().st_mode) == 0o644
    assert robot.names() == ["hello", "hello/text"]


def test_a_file_is_made_and_found_right(robot: Robot) -> None:
    """After its commands the module finds a file right; another content is an update."""
    robot.make(file("hello/hosts", "127.0.0.1\tlocalhost\n"))
    robot.make(file("hello/hosts", "other\n", in_place=True))
    assert robot.path(f"{STATE_ROOT}/hello/hosts").read_text() == "other\n"


def test_rewriting_keeps_the_inode_and_replacing_does_not(robot: Robot) -> None:
    """A file that containers have mounted keeps its inode; any other appears by one rename."""
    robot.make(file("hello/hosts", "one"))
    path = robot.path(f"{STATE_ROOT}/hello/hosts")
    first = path.stat().st_ino
    robot.make(file("hello/hosts", "two", in_place=True))
    assert path.stat().st_ino == first
    robot.make(file("hello/hosts", "three", in_place=False))
    assert path.stat().st_ino != first


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_only_names(robot: Robot, name: str) -> None:
    """A name that means something to a shell is written, found and removed as that name, and runs nothing."""
    want = file(f"hello/{name}", "x")
    robot.make(want)
    robot.make(file("hello/neighbour", "y"))
    assert robot.names() == sorted(["hello", f"hello/{name}", "hello/neighbour"])
    assert robot.sh(remove_path(want.name).script).ok
    assert robot.names() == ["hello", "hello/neighbour"]


def test_only_files_directly_in_an_instance_are_read(robot: Robot) -> None:
    """Trees, stray files and links are no file resources; half-written ones are, so that they are cleaned up."""
    for name in ("a/one", "b/two", "a/trees/abc/deep", "stray", "a/half.part"):
        (robot.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (robot.folder / name).write_text("x")
    (robot.folder / "a/link").symlink_to("/etc/passwd")
    (query,) = MODULES["file"].queries()
    assert isinstance(query, Query)
    found = MODULES["file"].parse([robot.sh(query.command)])
    assert sorted(one.name for one in found) == [f"{STATE_ROOT}/{name}" for name in ("a/half.part", "a/one", "b/two")]


@pytest.mark.parametrize("kind", ["file", "tree"])
def test_a_fresh_robot_has_nothing(robot: Robot, kind: str) -> None:
    """Where nothing of ours ever was, the questions succeed and say nothing."""
    (query,) = MODULES[kind].queries()
    assert isinstance(query, Query)
    for root in (False, True):
        reply = robot.sh(query.command, root=root)
        assert (reply.ok, reply.out, reply.err) == (True, "", "")


def test_a_tree_is_unpacked_readable(robot: Robot) -> None:
    """A tree appears under its name with contents and modes, readable for a container's user, without its tar."""
    want = tree(tar(**{"index.html": ANY_BYTES, "run.sh": b"#!/bin/sh\n", "a b/$(x)": b"1"}))
    robot.make(want)
    top = robot.path(want.name)
    assert (top / "www/index.html").read_bytes() == ANY_BYTES
    assert (top / "www/a b/$(x)").read_bytes() == b"1"
    assert stat.S_IMODE((top / "www/run.sh").stat().st_mode) == 0o755
    assert stat.S_IMODE((top / "www/index.html").stat().st_mode) == 0o644
    assert stat.S_IMODE(top.stat().st_mode) == 0o755
    assert sorted(one.name for one in top.parent.iterdir()) == ["0123"]


def test_a_tree_survives_a_cut_connection(robot: Robot) -> None:
    """What an earlier run left half sent and half unpacked does not end up in the tree."""
    want = tree(tar(a=b"new"))
    left = robot.path(want.name + ".part") / "www"
    left.mkdir(parents=True)
    (left / "stale").write_text("old")
    robot.path(want.name + ".tar").write_bytes(b"half")
    robot.make(want)
    assert sorted(one.name for one in (robot.path(want.name) / "www").iterdir()) == ["a"]


def test_a_broken_tar_makes_no_tree(robot: Robot) -> None:
    """A tar that cannot be unpacked fails, and nothing stands under the tree's name."""
    want = tree(b"no tar at all" * 99)
    change = robot.check(want)
    assert change is not None
    put, unpack = change.commands
    assert isinstance(put, Put) and isinstance(unpack, Run)
    assert robot.sh(put.script()).ok
    assert not robot.sh(unpack.script).ok
    assert not robot.path(want.name).exists()


def test_removal_tidies_up_to_the_root(robot: Robot) -> None:
    """The last thing of an instance takes the instance's folder along; other instances and the root stay."""
    for name in ("a/trees/t1/www/x", "a/trees/t2/www/x", "a/hosts", "b/hosts"):
        (robot.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (robot.folder / name).write_text("x")
    steps = [("a/trees/t1", True), ("a/trees/t2", True), ("a/hosts", False)]
    for name, stays in steps:
        assert robot.sh(remove_path(f"{STATE_ROOT}/{name}").script).ok
        assert (robot.folder / "a").exists() is stays
    assert robot.names() == ["b", "b/hosts"]
    assert robot.sh(remove_path(f"{STATE_ROOT}/a/hosts").script).ok, "what is gone already is fine"


def test_removal_does_not_follow_links(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A symbolic link is removed itself; what it points to stays."""
    outside = tmp_path_factory.mktemp("outside")
    (outside / "precious").write_text("x")
    (robot.folder / "a").mkdir()
    (robot.folder / "a/link").symlink_to(outside)
    assert robot.sh(remove_path(f"{STATE_ROOT}/a/link").script).ok
    assert (outside / "precious").read_text() == "x"


@pytest.mark.parametrize(
    "path",
    [
        "", "/", "/etc/passwd", STATE_ROOT, STATE_ROOT + "/", STATE_ROOT + "/a", STATE_ROOT + "/a/",
        STATE_ROOT + "/../x",
        STATE_ROOT + "/a/../b", STATE_ROOT + "/a/..", STATE_ROOT + "//a", STATE_ROOT + "/./a", STATE_ROOT + "x/a/b",
        "var/lib/srprov/a/b",
    ],
)  # fmt: skip
def test_nothing_else_can_be_removed(path: str) -> None:
    """A path that is not inside an instance's folder is refused before any shell sees it."""
    with pytest.raises(ValueError, match="is not inside an instance's folder"):
        remove_path(path)


def test_a_nul_byte_is_refused() -> None:
    """No shell word holds a NUL byte; the name is refused rather than cut."""
    with pytest.raises(ValueError, match="NUL"):
        remove_path(f"{STATE_ROOT}/a/b\0c")
