"""A robot's further names for paths that containers write to, asked of real shells of this machine."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, cast

import pytest

from srprov.controller.robot_mounts import MOUNTS, Mounts
from srprov.controller.writers import _question, check_writers
from srprov.definitions.containermodel import Mount
from srprov.errors import UsageError
from srprov.facts.gather import Gathering
from srprov.wire import Query, Reply
from tests.bounded import within
from tests.fakes import World
from tests.readonly import shell_violations
from tests.worlds import experiment, plan_for, service

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))


class Here:
    """Asks this machine."""

    def __init__(self, shell: tuple[str, ...]) -> None:
        self.shell = shell
        self.asked = 0

    def ask_each(self, questions: Mapping[str, Sequence[Query]]) -> dict[str, Sequence[Reply]]:
        """Run each question in a shell."""
        self.asked += len(questions)
        return {robot: [self._run(one.command) for one in some] for robot, some in questions.items()}

    def _run(self, command: str) -> Reply:
        try:
            done = subprocess.run([*self.shell, command], capture_output=True, text=True, check=True)
        except FileNotFoundError:
            pytest.skip(f"there is no {self.shell[0]} here")
        return Reply(status=0, out=done.stdout)


def checked(shell: tuple[str, ...], *mounts: tuple[Path, bool]) -> int:
    """Check services of one robot, each with one path that is read-only or not; return how many robots were asked."""
    return checked_by(Here(shell), *mounts)


def checked_by(look: Here, *mounts: tuple[Path, bool]) -> int:
    """Check as `checked` does, by what one way of asking says."""
    services = [
        service(f"s{at}", mounts=(Mount(kind="bind", source=str(path), target="/x", read_only=only),))
        for at, (path, only) in enumerate(mounts)
    ]
    steps = plan_for(World().add("r1"), experiment(service("s0"))).steps
    check_writers(steps, [("r1", one) for one in services], cast("Gathering", look))
    return look.asked


class InNamespace(Here):
    """Asks this machine, as it is with some mounts."""

    mounts = ""

    def _run(self, command: str) -> Reply:
        words = ["unshare", "-m", *self.shell, f"{self.mounts} || exit 9\n{command}"]
        return Reply(status=0, out=subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("written", ["data", "data/maps", "above"])
def test_a_part_of_a_written_folder_that_is_mounted_elsewhere_is_refused(tmp_path: Path, written: str) -> None:
    """A link that is swapped there while the robot looks gave the engine."""
    for one in ("data/maps/x", "data/other", "above/disk", "a part"):
        (tmp_path / one).mkdir(parents=True)
    look = InNamespace(SHELLS[0])
    look.mounts = f"cd {tmp_path} && mount --bind data/maps 'a part' && mount --bind data above/disk"

    def check(path: str) -> None:
        checked_by(look, (tmp_path / written, False), (tmp_path / path, True))

    for path in ("a part/x", "a part/none"):
        with pytest.raises(UsageError, match="lies in a folder that a container"):
            check(path)
    check("a partly")
    check("data-files/x")


def test_where_a_path_is_mounted_is_what_the_kernel_says(tmp_path: Path) -> None:
    """Also where mounts are on and below each other, in any order."""
    for one in ("a/b/c", "d/b/c", "e/c"):
        (tmp_path / one).mkdir(parents=True)
    mounts = ("tmpfs a/b", "tmpfs a/b", "bind d a", "tmpfs a/b", "bind e a/b", "tmpfs a/b/c", "bind a e", "bind e d/b")
    made = [
        f"mount --bind {one[5:]}" if one.startswith("bind") else f"mount -t tmpfs t {one[6:]} && mkdir -p {one[6:]}/c"
        for one in mounts
    ]
    paths = ["a", "a/b", "a/b/c", "d", "d/b", "d/b/c", "e", "e/c", "e/b", "e/b/c"]
    told = " ".join(f'{one} "$(stat -c %d {one} 2>/dev/null || echo none)"' for one in paths)
    for count in range(len(made) + 1):
        script = "\n".join([f"cd {tmp_path}", *made[:count], f"printf '%s %s\\n' {told}", "cat /proc/self/mountinfo"])
        done = subprocess.run(["unshare", "-m", "sh", "-ec", script], capture_output=True, text=True, check=True)
        said = done.stdout.split("\n")
        mounted = Mounts("\n".join(said[len(paths) :]))
        for path, device in (one.split(" ") for one in said[: len(paths)]):
            major, _, minor = next(iter(mounted.places(f"{tmp_path}/{path}"))).partition(" ")[0].partition(":")
            assert device in ("none", str(os.makedev(int(major), int(minor)))), (count, path)


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("below", ["x", "x/y", "new", "new/er", "odd\nname", "odd\nname/none", "it's"])
def test_what_lies_in_a_written_folder_by_another_name_is_refused(
    tmp_path: Path, shell: tuple[str, ...], below: str
) -> None:
    """So /run/lock and /var/lock/x were two paths, and a link in the first gave the engine with the second."""
    (tmp_path / "run/lock/x/y").mkdir(parents=True)
    if "none" not in below and "new" not in below:
        (tmp_path / "run/lock" / below).mkdir(parents=True, exist_ok=True)
    (tmp_path / "run/lock/odd\nname").mkdir(exist_ok=True)
    (tmp_path / "lock").symlink_to("run/lock")
    with pytest.raises(UsageError, match=r"which 's1' mounts, lies in a folder that a container of the experiment"):
        checked(shell, (tmp_path / "run/lock", False), (tmp_path / "lock" / below, True))
    with pytest.raises(UsageError, match="which 's1' mounts"):
        checked(shell, (tmp_path / "lock", False), (tmp_path / "run/lock" / below, False))


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("below", ["", "/x", "/none/x"])
@pytest.mark.parametrize("to", ["data/not-there", "data/turned/maps", "data/turned/..", "way/../data/turned/maps/.."])
def test_a_path_that_a_written_folder_is_on_the_way_of_is_refused(
    tmp_path: Path, shell: tuple[str, ...], to: str, below: str
) -> None:
    """A link of the robot's leads there: it has no end yet, or one that the container turns, to the engine's socket."""
    for one in ("data", "elsewhere/maps", "deep/way"):
        (tmp_path / one).mkdir(parents=True)
    (tmp_path / "way").symlink_to("deep/way/..")
    (tmp_path / "data/turned").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "link").symlink_to(to)
    with pytest.raises(UsageError, match="which 's1' mounts, lies in a folder that a container"):
        checked(shell, (tmp_path / "data", False), (tmp_path / f"link{below}", True))
    assert checked(shell, (tmp_path / "data", False), (tmp_path / "elsewhere/maps", True)) == 1


def test_a_path_whose_links_have_no_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match="loop/x, which 's1' mounts"):
        checked(SHELLS[0], (tmp_path / "data", False), (tmp_path / "loop/x", True))


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("to", ["a/../" * 600 + "out", "a/" * 500 + "out"])
def test_a_path_that_goes_through_hundreds_of_folders_is_refused(
    tmp_path: Path, shell: tuple[str, ...], to: str
) -> None:
    """No command took as many words, so no folder was known; or the kernel no name of that length, so no link was."""
    deep = tmp_path / "run/lock" / "/".join(["d" * 200] * 17)
    for one in (deep / "a", tmp_path / "elsewhere"):
        one.mkdir(parents=True)
    (tmp_path / "lock").symlink_to("run/lock")
    (deep / "out").symlink_to(os.path.relpath(tmp_path / "elsewhere", deep))
    (deep / "on").symlink_to(to)
    (tmp_path / "run/lock/x").symlink_to(f"{deep.relative_to(tmp_path / 'run/lock')}/on")
    with pytest.raises(UsageError, match="lock/x, which 's1' mounts, lies in a folder that a container"):
        checked(shell, (tmp_path / "run/lock", False), (tmp_path / "lock/x", True))


@pytest.mark.parametrize(
    ("written", "mounted"), [("shown/data", "disk/up/data/x"), ("shown", "disk/low/data"), ("disk/up", "shown/data/x")]
)
def test_a_folder_of_an_overlay_is_known_by_the_names_of_its_layers(tmp_path: Path, written: str, mounted: str) -> None:
    """Robots whose disk is read-only show one beside memory (overlayroot), and both by their own names, too."""
    for one in ("disk", "shown", "maps"):
        (tmp_path / one).mkdir()
    look = InNamespace(SHELLS[0])
    look.mounts = (
        f"cd {tmp_path} && mount -t tmpfs tmpfs disk && mkdir -p disk/low/data/x disk/up disk/work disk/maps && "
        f"mount -t overlay overlay -o lowerdir={tmp_path}/disk/low,upperdir={tmp_path}/disk/up,workdir=disk/work shown "
        "&& mkdir -p shown/data/x"
    )

    def check(path: str) -> None:
        checked_by(look, (tmp_path / written, False), (tmp_path / path, True))

    with pytest.raises(UsageError, match=f"{mounted}, which 's1' mounts, lies in a folder"):
        check(mounted)
    check("disk/maps")
    check("maps/x")


@pytest.mark.parametrize(("way", "refused"), [("rw", True), ("ro", False)])
def test_what_is_mounted_below_a_read_only_path_is_written_to(tmp_path: Path, way: str, refused: bool) -> None:
    """Docker before 25 makes the path read-only, and nothing that is mounted below it."""
    (tmp_path / "top/disk").mkdir(parents=True)
    look = InNamespace(SHELLS[0])
    look.mounts = f"mount -t tmpfs tmpfs {tmp_path}/top/disk && mkdir {tmp_path}/top/disk/x && "
    look.mounts += f"mount -o remount,{way} {tmp_path}/top/disk"
    with pytest.raises(UsageError, match="top/disk/x, which 's1' mounts") if refused else nullcontext():
        checked_by(look, (tmp_path / "top", True), (tmp_path / "top/disk/x", True))


@pytest.mark.parametrize(("ipc", "refused"), [("host", True), ("private", False)])
def test_shared_memory_by_another_name_is_refused_beside_who_writes_to_it(
    tmp_path: Path, ipc: str, refused: bool
) -> None:
    """A container in the robot's IPC namespace has it without a mount; `/run/shm` is a link to it on some robots."""
    (tmp_path / "shm").symlink_to("/dev/shm")
    steps = plan_for(World().add("r1"), experiment(service("s0"))).steps
    mount = Mount(kind="bind", source=f"{tmp_path}/shm/none", target="/x")
    placed = [("r1", service("a", ipc=ipc)), ("r1", service("b", mounts=(mount,)))]
    how = pytest.raises(UsageError, match="shm/none, which 'b' mounts, lies in") if refused else nullcontext()
    with how:
        check_writers(steps, placed, cast("Gathering", Here(SHELLS[0])))


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_other_paths_are_mounted_as_ever(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """One folder by two names, what lies above, what nobody writes to, and what was asked for as what it is."""
    for name in ("a/x", "b"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "c").symlink_to("a")
    assert checked(shell, (tmp_path / "a", False), (tmp_path / "c", False), (tmp_path / "b", False)) == 1
    assert checked(shell, (tmp_path / "c/x", False), (tmp_path / "none", False), (tmp_path / "a", True)) == 1
    assert checked(shell, (tmp_path / "a", True), (tmp_path / "c/x", True)) == 1
    assert checked(shell, (tmp_path / "a", True), (tmp_path / "a", False)) == 0
    assert checked(shell, (tmp_path / "a", False), (tmp_path / "a/x", True)) == 1


def test_the_question_only_reads() -> None:
    """It is asked by `plan`."""
    assert shell_violations(_question(["/srv/it's", "/srv/a b"]).command) == []


def test_a_folder_that_is_mounted_twice_is_one() -> None:
    """Of which links know nothing: device and inode tell."""

    class Told(Here):
        def _run(self, command: str) -> Reply:
            first = "1 /srv/w2/a\n8:0 /\n8:1 /srv\n8:2 /srv/w2\n8:3 /srv/w2/a\n"
            return Reply(status=0, out=f"{first}0 /srv/w\n8:0 /\n8:1 /srv\n8:2 /srv/w\n")

    services = [
        service(name, mounts=(Mount(kind="bind", source=path, target="/x"),))
        for name, path in (("s0", "/srv/w"), ("s1", "/srv/w2/a"))
    ]
    steps = plan_for(World().add("r1"), experiment(service("s0"))).steps
    look: Any = Told(("sh",))
    with pytest.raises(UsageError, match="/srv/w2/a, which 's1' mounts"):
        check_writers(steps, [("r1", one) for one in services], cast("Gathering", look))


def test_a_robot_that_does_not_answer_is_no_robot_without_such_paths() -> None:
    """Thousands of paths would keep it from answering in time."""

    class Silent(Here):
        def ask_each(self, questions: Mapping[str, Sequence[Query]]) -> dict[str, Sequence[Reply]]:
            return {}

    mounts = tuple(Mount(kind="bind", source=f"/srv/{name}", target=f"/{name}") for name in ("w", "w2"))
    steps = plan_for(World().add("r1"), experiment(service("s0"))).steps
    look: Any = Silent(("sh",))
    with pytest.raises(UsageError, match="r1: it does not say what its paths are"):
        check_writers(steps, [("r1", service("s0", mounts=mounts))], cast("Gathering", look))


class Talks(Here):
    """Has mounts without end."""

    said = ""

    def _run(self, command: str) -> Reply:
        places = "".join(f"{n} /srv/{one}\n8:0 /\n8:1 /srv\n8:{n + 2} /srv/{one}\n" for n, one in enumerate("ab"))
        return Reply(status=0, out=self.said if command == MOUNTS.command else places)


def test_mounts_without_end_are_looked_through_in_time() -> None:
    """All pairs of them were: half an hour for what a robot says in 4 MB, in which all others waited."""
    look = Talks(("sh",))
    look.said = "".join(f"1 0 8:1 /{n} /srv/a/{n} rw - ext4 x rw\n" for n in range(90_000))
    with within(10):
        assert checked_by(look, (Path("/srv/a"), False), (Path("/srv/b"), True)) == 1


def _layers(n: int) -> str:
    return ":".join(f"/l/{n}/{one}" for one in range(50))


@pytest.mark.parametrize(
    "many",
    [
        "".join(f"1 0 0:9 / /srv/a/{n} rw - overlay x rw,lowerdir={_layers(n)}\n" for n in range(3000)),
        "".join(f"1 0 0:9 / /srv/a/{n} rw - overlay x rw,lowerdir={'/l' * 900}\n" for n in range(3000)),
    ],
)
def test_layers_without_end_are_the_robot_s_failure(many: str) -> None:
    look = Talks(("sh",))
    look.said = many
    with within(10), pytest.raises(UsageError, match="r1: more is mounted there than can be looked through"):
        checked_by(look, (Path("/srv/a"), False), (Path("/srv/b"), True))


def test_many_paths_are_not_looked_up_in_layers_without_end() -> None:
    """Each path was compared with each layer of an overlay: minutes, for all robots."""
    layers = ":".join(f"/{at}{'/a' * 1000}" for at in range(500))

    class Told(Here):
        def _run(self, command: str) -> Reply:
            places = "".join(f"{at} /srv/{at}\n8:0 /\n8:1 /srv\n9:{at} /srv/{at}\n" for at in range(200))
            said = f"1 0 0:1 / / rw - ext4 x rw\n2 1 0:1 / /x rw - overlay o rw,lowerdir={layers}\n"
            return Reply(status=0, out=said if command == MOUNTS.command else places)

    with within(10), pytest.raises(UsageError, match="r1: more is mounted there than can be looked through"):
        checked_by(Told(("sh",)), *((Path(f"/srv/{at}"), at % 2 == 1) for at in range(200)))


@pytest.mark.parametrize(
    ("of_paths", "of_mounts", "why"),
    [
        (Reply(status=124, ok=False, err="timed out"), Reply(status=0, out="m"), "its paths are: timed out"),
        (Reply(status=0, out="0 /a\n1 /b\n"), Reply(status=1, ok=False, err="no proc"), "its paths are: no proc"),
        (Reply(status=0, out="0 /a\n8:1 /\n"), Reply(status=0), "its path /b is"),
        (Reply(status=0, out="0 /a\n" + "8:1 /x\n" * 100_000 + "1 /b\n"), Reply(status=0), "100000 folders"),
    ],
)
def test_what_a_robot_does_not_say_of_its_paths_is_refused(of_paths: Reply, of_mounts: Reply, why: str) -> None:
    """Deep paths made its answer longer than is read, and the rest of them passed."""

    class Silent(Here):
        def ask_each(self, questions: Mapping[str, Sequence[Query]]) -> dict[str, Sequence[Reply]]:
            return dict.fromkeys(questions, (of_paths, of_mounts))

    with pytest.raises(UsageError, match=why):
        checked_by(Silent(SHELLS[0]), (Path("/a"), False), (Path("/b"), True))
