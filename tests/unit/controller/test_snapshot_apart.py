"""On an overlay robots' containers reach each other; where they came from, they did so at published ports alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from srprov.secret import redact
from tests.unit.controller.test_snapshot import Robot, box, taken


def with_bind(made: dict[str, Any], source: str, place: str = "/x") -> dict[str, Any]:
    return {**made, "Mounts": [{"Type": "bind", "Source": source, "Destination": place, "RW": True}]}


def services(edf: dict[str, Any]) -> set[str]:
    return {name for name, one in edf["services"].items() if "cdf" not in one}


@pytest.mark.parametrize("source", ["/var/run/docker.sock", "/run", "/", "/proc"])
def test_no_robot_reaches_a_container_that_has_another_one_s_engine(tmp_path: Path, source: str) -> None:
    """A proxy of its socket, on a network of its own, gave it to the other robot's containers: root there."""
    proxy = with_bind(box(1, "socket-proxy", NetworkMode="private"), source)
    robots = {"r1": Robot(boxes=[box(2, "camera")]), "r2": Robot(boxes=[proxy, box(3, "web")])}
    document, edf, _ = taken(tmp_path / "two", **robots)
    assert services(edf) == {"camera", "web"}
    (note,) = [one for one in document["notes"] if "gives its robot away" in one["words"]]
    assert (note["robot"], note["kind"], note["subject"]) == ("r2", "lost", "container socket-proxy")
    document, edf, _ = taken(tmp_path / "one", r2=robots["r2"])
    assert services(edf) == {"socket-proxy", "web"} and "gives its robot away" not in str(document)


@pytest.mark.parametrize("host", [
    {"Privileged": True},
    {"PidMode": "host"},
    {"CapAdd": ["CAP_SYS_ADMIN"]},
    {"Devices": [{"PathOnHost": "/dev/sda", "PathInContainer": "/dev/disk"}]},
    {"DeviceCgroupRules": ["b *:* rwm"]},
    {"SecurityOpt": ['seccomp={"defaultAction":"SCMP_ACT_ERRNO"}']},
    {"SecurityOpt": ['seccomp={"comment":"may be as good as root on the robot"}']},
])  # fmt: skip
def test_no_robot_reaches_a_container_that_is_as_good_as_root_on_another(tmp_path: Path, host: dict[str, Any]) -> None:
    """An engine in a privileged container, without a password on a network of its own, as builds of images have it."""
    engine = box(1, "dind", NetworkMode="ci", **host)
    robots = {"r1": Robot(boxes=[box(2, "camera")]), "r2": Robot(boxes=[engine, box(3, "web")])}
    document, edf, _ = taken(tmp_path / "two", **robots)
    assert services(edf) == {"camera", "web"}
    (note,) = [one for one in document["notes"] if "gives its robot away" in one["words"]]
    assert (note["robot"], note["kind"], note["subject"]) == ("r2", "lost", "container dind")
    _, edf, _ = taken(tmp_path / "one", r2=robots["r2"])
    assert services(edf) == {"dind", "web"}


@pytest.mark.parametrize("source", ["/run/dbus/system_bus_socket", "/var/run/dbus", "/run/systemd/private"])
def test_no_robot_reaches_a_container_that_tells_another_one_s_systemd_what_to_run(tmp_path: Path, source: str) -> None:
    robots = {"r1": Robot(boxes=[box(2, "camera")]), "r2": Robot(boxes=[with_bind(box(1, "bus"), source)])}
    _, edf, _ = taken(tmp_path / "two", **robots)
    assert services(edf) == {"camera"}


@pytest.mark.parametrize("place", ["/var/run/docker.sock", "/run/podman/podman.sock", "/run/user/1000/docker.sock"])
def test_a_link_to_an_engine_s_socket_is_known_by_its_place_in_the_container(tmp_path: Path, place: str) -> None:
    """Only the robot knows where `/srv/engine` leads, or that its engine listens there, too."""
    proxy = with_bind(box(1, "socket-proxy"), "/srv/engine", place)
    _, edf, _ = taken(tmp_path / "two", r1=Robot(boxes=[box(2, "camera")]), r2=Robot(boxes=[proxy, box(3, "web")]))
    assert services(edf) == {"camera", "web"}


def test_what_is_on_no_overlay_or_has_data_alone_stays(tmp_path: Path) -> None:
    boxes = [
        with_bind(box(1, "agent", NetworkMode="host"), "/var/run/docker.sock"),
        with_bind(box(2, "lonely", NetworkMode="none"), "/var/run/docker.sock"),
        with_bind(box(3, "web"), "/srv/data"),
        box(5, "driver", Devices=[{"PathOnHost": "/dev/ttyUSB0"}], CapAdd=["NET_ADMIN"]),
        box(7, "camera", Devices=[{"PathOnHost": "/dev/bus/usb"}]),
        box(6, "drivers", NetworkMode="host", Privileged=True),
    ]
    _, edf, _ = taken(tmp_path / "two", r1=Robot(boxes=boxes), r2=Robot(boxes=[box(4, "db")]))
    assert services(edf) == {"agent", "lonely", "web", "driver", "camera", "drivers", "db"}


def test_the_report_says_which_containers_are_reached_by_those_of_others(tmp_path: Path) -> None:
    boxes = [box(1, "store"), box(2, "agent", NetworkMode="host")]
    document, _, written = taken(tmp_path / "two", r1=Robot(boxes=[box(3, "camera")]), r2=Robot(boxes=boxes))
    told = {one["robot"]: one["words"] for one in document["notes"] if "also those that are not published" in str(one)}
    assert told.keys() == {"r1", "r2"} and told["r2"].startswith("containers of r1 reach all ports of store on the")
    assert "also those that are not published" in written
    document, _, _ = taken(tmp_path / "one", r2=Robot(boxes=boxes))
    assert "not published" not in str(document)


def test_what_a_robot_calls_a_secret_takes_no_word_out_of_the_report_of_another(tmp_path: Path) -> None:
    """It may be srprov's own sentence that a container of another was left out, or the one that stands for it."""
    lies = [
        "A_PASSWORD=gives its robot away",
        "B_PASSWORD=words of it are a secret",
        "C_PASSWORD=containers: containers of",
    ]
    proxy = with_bind(box(1, "socket-proxy"), "/run/docker.sock")
    honest = Robot(boxes=[proxy, box(2, "web", ["D_PASSWORD=Zk3kq9fj2Lm"]), box(3, "db", ["E=Zk3kq9fj2Lm"])])
    document, _, written = taken(tmp_path / "two", r1=Robot(boxes=[box(4, "camera", lies)]), r2=honest)
    withheld = "words of it are a secret of another robot: look at this robot alone to read it"
    told = [redact(f"{one['subject']}: {one['words']}") for one in document["notes"] if one["robot"] == "r2"]
    assert sum(withheld in one for one in told) == 2 and written.count(withheld) == 2, told
    assert any(
        "container db: its environment holds what is a secret elsewhere: *** stands there" in one for one in told
    )
    assert "Zk3kq9fj2Lm" not in written and "Zk3kq9fj2Lm" not in str(document)
