"""A host becomes a CDF that srprov takes, also with archives of others and more packages than a list or a line has."""

from __future__ import annotations

from typing import Any

from srprov.snapshot.debian import Chosen, Package, Policy
from srprov.snapshot.folder import Definition, Robot, definition_of
from srprov.snapshot.host import Host, with_origins
from srprov.snapshot.notes import Notes
from srprov.snapshot.python import PipPackage
from srprov.snapshot.sources import Source

ROS = Source("http://packages.ros.org/ros2/ubuntu", "jammy", ("main",), "amd64", "/usr/share/keyrings/ros.gpg")
UBUNTU = Source("http://archive.ubuntu.com/ubuntu", "jammy", ("main",))


def defined(host: Host) -> tuple[Definition, list[str]]:
    robot = Robot(name="r1", short="r1", host=host)
    one = definition_of(robot)
    assert one is not None
    return one, [note.words for note in robot.notes.all()]


def names(listed: list[Any]) -> list[str]:
    return [one.value for one in listed]


def test_packages_of_other_archives_come_with_their_lists_and_keys() -> None:
    """Once these are in the image: `packages` is installed before `files` are there."""
    wanted = Chosen(by_hand=tuple(Package(name=name, version="1") for name in ("ros-x", "tree", "mine", "node")))
    policy = Policy(
        addresses={"ros-x": (ROS.url,), "tree": (UBUNTU.url,), "mine": (), "node": (UBUNTU.url,)},
        ahead=frozenset({"node"}),
    )
    notes = Notes()
    found = with_origins(Host(base="ubuntu:22.04", chosen=wanted, sources=(ROS, UBUNTU)), policy, {}, notes)
    assert (found.sources, found.elsewhere, found.gone, found.older) == ((ROS,), {"ros-x"}, {"mine"}, {"node"})
    assert len(notes.all()) == 2
    keyed = Host(base=found.base, chosen=wanted, sources=found.sources, elsewhere=found.elsewhere, gone=found.gone,
                 keys={ROS.key: b"public"})  # fmt: skip
    one, _ = defined(keyed)
    assert names(one.values["packages"]["apt"]) == ["tree", "node"]
    assert one.files["r1/sources.list"].decode() == f"{ROS.line()}\n" and one.files["r1/keys/0"] == b"public"
    assert [each["dest"] for each in one.values["files"]] == ["/etc/apt/sources.list.d/srprov-snapshot.list", ROS.key]
    (run,) = one.values["run"]
    assert run.startswith("apt-get update\n") and " ros-x\n" in run and "mine" not in run
    _, notes_of = defined(Host(base="x:1", chosen=wanted, sources=(ROS,), elsewhere=found.elsewhere))
    assert any("keys that could not be read: /usr/share/keyrings/ros.gpg" in words for words in notes_of)


def test_a_list_that_is_too_long_for_a_definition_goes_on_in_commands() -> None:
    many = tuple(Package(name=f"p{number:04}{'x' * 90}", version="1") for number in range(2000))
    one, _ = defined(Host(base="debian:bookworm", chosen=Chosen(by_hand=many)))
    first, rest = names(one.values["packages"]["apt"]), one.values["run"]
    assert 0 < len(first) <= 900 and all(len(run) < 60_000 for run in rest)
    assert first + [word for run in rest for word in run.split() if word.startswith("p0") or word.startswith("p1")] == [
        package.name for package in many
    ]


def test_pips_own_parts_and_versions_of_nobody_are_not_asked_for() -> None:
    pip = (
        PipPackage(name="idna", version="3.7"),
        PipPackage(name="pip", version="24"),
        PipPackage(name="torch", version="2.1+cu118"),
        PipPackage(name="mine", version="1", git="https://h.example/a.git", commit="a" * 40, subfolder="py"),
        PipPackage(name="theirs", version="1", git="ext::reboot", commit="a" * 40),
    )
    one, notes = defined(Host(base="debian:bookworm", pip=pip))
    assert one.values["packages"] == {"pip": ["idna==3.7"]}
    (place,) = one.values["repositories"]
    assert place["path"] == "/usr/src/srprov-pip/mine" and place["run"][0].endswith("--no-deps ./py")
    assert len(notes) == 3


def test_a_system_that_nobody_knows_has_no_definition() -> None:
    assert definition_of(Robot(name="r1", short="r1", host=Host())) is None
