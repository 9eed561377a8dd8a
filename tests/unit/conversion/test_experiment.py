"""Whole projects: names, several machines, what is shared, and what services wait for. Values in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from srprov.conversion.experiment import Draft, convert
from srprov.conversion.kept import Kept
from srprov.conversion.project import Choices, Machine
from srprov.errors import Location
from tests.unit.conversion.making import draft, normal, project

IMAGE = {"image": "busybox:1"}


def two(tmp_path: Path, robot: dict[str, Any], pc: dict[str, Any]) -> Draft:
    """Give the draft of two machines' projects, each in a folder of its own."""
    machines = []
    for name, document in (("turtle", robot), ("Base.1", pc)):
        folder = tmp_path / name
        (folder / "config").mkdir(parents=True)
        (folder / "config" / "a").write_text(name)
        machines.append(Machine(normal(document, str(folder / "compose.yaml")), (str(folder.resolve()),), name))
    return convert(machines, "lab", Choices(), str(tmp_path / "out"))


def messages(found: Draft, kept: Kept) -> list[str]:
    return [f"{one.key}: {one.message}" for one in found.findings if one.kept is kept]


def test_names_that_an_edf_cannot_have_are_changed_everywhere(tmp_path: Path) -> None:
    services = {
        "ROS.Master": IMAGE,
        "talker": {**IMAGE, "depends_on": {"ROS.Master": {"condition": "service_started"}},
                   "environment": {"URI": "http://ROS.Master:11311"}},
    }  # fmt: skip
    found = draft(project(services), tmp_path)
    assert found.edf["services"] == {
        "ros-master": {**IMAGE, "hostname": "ROS.Master"},
        "talker": {**IMAGE, "depends_on": ["ros-master"], "environment": {"URI": "http://ROS.Master:11311"}},
    }
    assert "services.ROS.Master: the service is 'ros-master': an EDF cannot have that name" in messages(
        found, Kept.ADAPTED
    )


def test_two_names_that_become_one_stay_two(tmp_path: Path) -> None:
    found = draft(project({"cam": IMAGE, "CAM": IMAGE, "Cam": IMAGE}), tmp_path)
    assert list(found.edf["services"]) == ["cam", "cam-2", "cam-3"]


def test_a_robot_takes_as_many_services_as_its_file_has(tmp_path: Path) -> None:
    services = {"a": IMAGE, "b": {**IMAGE, "deploy": {"replicas": 3}}, "c": {**IMAGE, "deploy": {"mode": "global"}}}
    assert draft(project(services), tmp_path).edf["placement"] == {"slots_per_robot": 4}
    assert "placement" not in draft(project({"a": IMAGE}), tmp_path).edf


def test_two_machines_become_one_experiment_with_pins(tmp_path: Path) -> None:
    mounts = {
        "volumes": [
            {"type": "bind", "source": "./config", "target": "/c"},
            {"type": "volume", "source": "logs", "target": "/l"},
        ]
    }
    robot = project({"driver": {**IMAGE, **mounts}, "rviz": IMAGE}, volumes={"logs": {"name": "lab_logs"}})
    waits = {"depends_on": {"nav": {"condition": "service_started"}}}
    pc = project(
        {"rviz": {**IMAGE, **mounts, **waits}, "nav": IMAGE, "x": IMAGE}, volumes={"logs": {"name": "lab_logs"}}
    )
    found = two(tmp_path, robot, pc)
    assert found.edf["services"] == {
        "driver": {**IMAGE, "robot": "turtle", "volumes": ["turtle-config:/c", "logs:/l"]},
        "rviz": {**IMAGE, "robot": "turtle"},
        "rviz-base-1": {
            **IMAGE,
            "robot": "Base.1",
            "depends_on": ["nav"],
            "volumes": ["base-1-config:/c", "logs-base-1:/l"],
        },
        "nav": {**IMAGE, "robot": "Base.1"},
        "x": {**IMAGE, "robot": "Base.1"},
    }
    assert found.edf["volumes"] == {
        "turtle-config": {"seed": "./files/turtle/config"},
        "base-1-config": {"seed": "./files/base-1/config"},
    }
    assert found.edf["placement"] == {"slots_per_robot": 3}
    assert sorted(found.copies) == ["files/base-1/config", "files/turtle/config"]
    assert found.refused == ()


def test_services_of_one_machine_share_a_folder_that_is_written(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    mount = {"volumes": [{"type": "bind", "source": "./maps", "target": "/maps"}]}
    found = draft(project({"a": {**IMAGE, **mount}, "b": {**IMAGE, **mount}}), tmp_path)
    assert [one["volumes"] for one in found.edf["services"].values()] == [["maps:/maps"], ["maps:/maps"]]


def test_secrets_that_are_the_same_are_one_and_others_are_apart(tmp_path: Path) -> None:
    def one(variable: str) -> dict[str, Any]:
        use = {"secrets": [{"source": "pin", "target": "/run/secrets/pin"}]}
        return project({"a" + variable.lower(): {**IMAGE, **use}}, secrets={"pin": {"environment": variable}})

    assert two(tmp_path / "1", one("A"), one("A") | {"name": "x"}).edf["secrets"] == {"pin": {"env": "A"}}
    found = two(tmp_path / "2", one("A"), one("B"))
    assert found.edf["secrets"] == {"pin": {"env": "A"}, "pin-base-1": {"env": "B"}}
    assert found.edf["services"]["ab"]["secrets"] == [
        {"source": "pin-base-1", "target": "/run/secrets/pin", "mode": "0444"}
    ]


def test_a_service_that_is_awaited_to_be_healthy_has_a_healthcheck(tmp_path: Path) -> None:
    services = {"a": IMAGE, "b": {**IMAGE, "depends_on": {"a": {"condition": "service_healthy"}}}}
    found = draft(project(services), tmp_path)
    assert found.edf["services"]["a"]["healthcheck"] == {}
    assert "services.a: its health is awaited: it must have a healthcheck in its image" in messages(found, Kept.ADAPTED)


def test_services_that_are_built_alike_share_a_cdf(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "Dockerfile").write_text("ARG DISTRO\nFROM busybox\n")
    build = {
        "context": "./d",
        "dockerfile": "Dockerfile",
        "args": {"DISTRO": "jazzy", "http_proxy": "x", "EMPTY": None},
    }
    services = {
        "a": {"build": build, "image": "lab/driver:1"},
        "b": {"build": build},
        "c": {"build": {**build, "args": {"DISTRO": "humble"}}, "platform": "linux/arm64"},
    }
    found = draft(project(services), tmp_path)
    assert [one["cdf"] for one in found.edf["services"].values()] == ["a.cdf", "a.cdf", "c.cdf"]
    dockerfile = {"context": "files/d", "dockerfile": "Dockerfile", "args": {"DISTRO": "jazzy"}}
    assert found.cdfs["a.cdf"] == {"cdf": 1, "dockerfile": dockerfile}
    assert found.cdfs["c.cdf"]["platforms"] == ["linux/arm64"]
    assert sorted(found.copies) == ["files/d", "files/d/Dockerfile"]
    dropped = messages(found, Kept.DROPPED)
    assert "services.a.build.args.http_proxy: no ARG of the Dockerfile declares 'http_proxy'" in dropped
    assert "services.a.image: an image that is built is named after its content" in dropped


def test_a_dockerfile_in_the_file_is_written_beside(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    build = {"context": "./d", "dockerfile_inline": "FROM busybox\n", "target": "x"}
    found = draft(project({"a": {"build": build}}), tmp_path)
    assert found.texts == {"written/a.dockerfile": "FROM busybox\n"}
    assert found.cdfs["a.cdf"]["dockerfile"] == {
        "context": "files/d", "dockerfile": "../../written/a.dockerfile", "target": "x",
    }  # fmt: skip


def test_what_cannot_be_built_is_refused(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    bad = {
        "address": {"context": "https://example.org/x.git"},
        "outside": {"context": "../elsewhere"},
        "missing": {"context": "./none"},
        "no-file": {"context": "./d"},
        "contexts": {"context": "./d", "dockerfile_inline": "FROM x", "additional_contexts": {"a": "b"}},
    }
    found = draft(project({name: {"build": build} for name, build in bad.items()}), tmp_path)
    assert sorted(one.key for one in found.refused) == [
        "services.address.build.context",
        "services.contexts.build.additional_contexts",
        "services.missing.build.context",
        "services.no-file.build.dockerfile",
        "services.outside.build.context",
    ]


def test_a_project_without_services_is_refused(tmp_path: Path) -> None:
    assert [(one.key, one.message) for one in draft(project({}), tmp_path).refused] == [
        ("services", "there is no service")
    ]


def test_volumes_and_networks_of_other_drivers_are_refused(tmp_path: Path) -> None:
    document = project(
        {"a": IMAGE},
        volumes={"v": {"name": "lab_v", "driver": "rexray"}, "w": {"name": "outer", "external": True}},
        networks={"n": {"name": "lab_n", "driver": "macvlan"}, "default": {"name": "lab_default", "ipam": {}}},
    )
    found = draft(document, tmp_path)
    assert sorted(one.key for one in found.refused) == ["networks.n.driver", "volumes.v.driver"]
    assert (
        "volumes.w.external: a volume of the experiment: what an outer one holds already is not taken over"
        in messages(found, Kept.ADAPTED)
    )
    assert not any(one.key.startswith("networks.default") for one in found.findings if one.kept is not Kept.EXACT)


def test_every_finding_has_its_place(tmp_path: Path) -> None:
    found = draft(project({"a": {**IMAGE, "dns": ["8.8.8.8"]}}), tmp_path)
    (dropped,) = (one for one in found.findings if one.kept is Kept.DROPPED)
    assert isinstance(dropped.at, Location) and dropped.at.file.endswith("compose.yaml") and dropped.at.line > 1


def test_a_hostname_that_two_services_have_is_the_first_ones(tmp_path: Path) -> None:
    """Compose allows it, as nobody finds a container by it; here others do."""
    found = draft(project({"a": {**IMAGE, "hostname": "rover"}, "b": {**IMAGE, "hostname": "rover"}}), tmp_path)
    assert [one.get("hostname") for one in found.edf["services"].values()] == ["rover", None]
    assert messages(found, Kept.DROPPED) == ["services.b.hostname: 'rover' is the name of another service"]


def test_robots_whose_names_are_alike_have_folders_of_their_own(tmp_path: Path) -> None:
    """`arm.1` and `arm-1`: a file of the one, which may be a stranger's, took the place of the other's."""
    machines = []
    for robot in ("arm.1", "arm-1"):
        (tmp_path / robot / "cfg").mkdir(parents=True)
        mount = {"type": "bind", "source": "./cfg", "target": "/cfg", "read_only": True}
        given = normal(project({"a": {"image": "x", "volumes": [mount]}}), str(tmp_path / robot / "compose.yaml"))
        machines.append(Machine(given, (str((tmp_path / robot).resolve()),), robot))
    found = convert(machines, "lab", Choices(), str(tmp_path / "out"))
    assert {place: Path(source).parent.name for place, source in found.copies.items()} == {
        "files/arm-1/cfg": "arm.1", "files/arm-1-2/cfg": "arm-1",
    }  # fmt: skip


def test_a_volume_without_a_name_is_its_services_alone(tmp_path: Path) -> None:
    """In Compose nobody else can have it. Another service named it, whose file may be a stranger's."""
    given = {
        "a": {**IMAGE, "volumes": [{"type": "volume", "source": "db-var-lib", "target": "/x"}]},
        "db": {**IMAGE, "volumes": [{"type": "volume", "target": "/var/lib"}]},
        "db-var": {**IMAGE, "volumes": [{"type": "volume", "target": "/lib"}]},
        "z": {**IMAGE, "volumes": [{"type": "volume", "source": "db-var-lib", "target": "/x"}]},
    }
    found = draft(project(given, volumes={"db-var-lib": None}), tmp_path).edf["services"]
    names = {name: one["volumes"][0].partition(":")[0] for name, one in found.items()}
    assert names["a"] == names["z"] == "db-var-lib" and len(set(names.values())) == 3
