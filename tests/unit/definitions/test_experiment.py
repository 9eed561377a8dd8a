"""What an EDF and its CDFs become."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.definitions import check_files, load_container, load_experiment
from srprov.definitions.containermodel import HealthCheck, Mount, Runtime
from srprov.definitions.model import Definitions, NetworkSettings, Placement, Service, Weights
from srprov.errors import DefinitionError
from tests.unit.definitions.examples import write_full


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Definitions:
    return load_experiment(write_full(tmp_path_factory.mktemp("full")))


def _one(folder: Path, service: str, top: str = "", environ: dict[str, str] | None = None) -> Service:
    path = folder / "e.edf"
    path.write_text(f"edf: 1\nname: a\nservices:\n  a: {service}\n{top}")
    return load_experiment(path, environ or {}, outside=True).experiment.services["a"]


def _runtime(folder: Path, fields: str, environ: dict[str, str] | None = None) -> Runtime:
    return _one(folder, f"{{image: x, {fields}}}", environ=environ).runtime


def test_experiment_has_its_fields(full: Definitions) -> None:
    experiment = full.experiment
    assert experiment.name == "full-house"
    assert experiment.authors == ("Ada Lovelace", "Grace Hopper")
    assert dict(experiment.metadata)["doi"] == "10.1000/182"
    assert list(experiment.services) == ["prepare", "recorder", "roscore", "talker"]
    assert experiment.weights == Weights(cpu=0.4, memory=0.3, swap=0.1, bandwidth=0.2)
    expected = Placement(slots_per_robot=3, fairness=0, sticky=False, bandwidth_reference_mbit=54)
    assert experiment.placement == expected
    assert experiment.network.vni == 4711
    assert experiment.same_robot == (("recorder", "talker"),)
    assert full.unsupported == ()


def test_scalars_are_their_source_text(full: Definitions) -> None:
    environment = full.experiment.services["talker"].runtime.environment
    assert environment["ROS_DOMAIN_ID"] == "0644"
    assert environment["VERBOSE"] == "on"
    assert environment["RATE"] == "1.10"


def test_environment_is_merged_from_base_cdf_env_file_and_edf(full: Definitions) -> None:
    environment = full.experiment.services["talker"].runtime.environment
    assert {key: environment[key] for key in ("FROM_BASE", "FROM_CDF", "FROM_FILE")} == {
        "FROM_BASE": "1",
        "FROM_CDF": "yes",
        "FROM_FILE": "1",
    }


def test_runtime_fields(full: Definitions) -> None:
    runtime = full.experiment.services["talker"].runtime
    assert runtime.command == ("talker", "--name", "big robot")
    assert runtime.entrypoint == ()
    assert runtime.ulimits == (("nofile", 1024, 1024), ("memlock", -1, -1))
    assert runtime.restart == "on-failure:3"
    assert runtime.devices == (
        ("/dev/video0", "/dev/video0", "rwm"),
        ("/dev/ttyUSB0", "/dev/lidar", "rw"),
        ("/dev/null", "/dev/null", "rm"),
    )
    assert runtime.cap_add == ("SYS_NICE", "NET_ADMIN")
    assert runtime.sysctls == {"net.ipv4.ip_forward": "1"}
    assert runtime.shm_size == 512 * 1024**2
    assert runtime.stop_grace_s == 60
    assert runtime.group_add == ("video", "44")
    assert (runtime.tty, runtime.privileged, runtime.gpus, runtime.user) == (True, False, "all", "1000:1000")


def test_mounts_and_the_edf_wins_at_a_target(full: Definitions) -> None:
    folder = full.experiment.folder
    assert full.experiment.services["talker"].runtime.mounts == (
        Mount(kind="volume", source="cache", target="/cache"),
        Mount(kind="tree", source=f"{folder}/config", target="/config", read_only=True),
        Mount(kind="bind", source="/dev/shm", target="/dev/shm", read_only=True),
        Mount(kind="volume", source="logs", target="/logs"),
        Mount(kind="tmpfs", source="", target="/tmp"),
        Mount(kind="volume", source="data", target="/data", read_only=True),
    )


def test_healthcheck_and_durations(full: Definitions) -> None:
    services = full.experiment.services
    expected = HealthCheck(
        test=("CMD", "rostopic", "list"), interval_s=90, timeout_s=0.5, retries=5, start_period_s=0.5
    )
    assert services["roscore"].runtime.healthcheck == expected
    merged = HealthCheck(test=("CMD-SHELL", "true"), interval_s=3, timeout_s=2)
    assert services["talker"].runtime.healthcheck == merged


def test_a_healthcheck_without_a_test_is_the_images_own(tmp_path: Path) -> None:
    """What is not said stays the image's: the engine takes an empty test and figures of 0 for that."""
    own = HealthCheck(test=(), interval_s=0, timeout_s=0, retries=0)
    assert _runtime(tmp_path, "healthcheck: {}").healthcheck == own
    assert _runtime(tmp_path, "healthcheck: {interval: 5s, retries: 2}").healthcheck == replace(
        own, interval_s=5, retries=2
    )
    edf = tmp_path / "w.edf"
    edf.write_text(
        "edf: 1\nname: w\nservices:\n  a: {image: x, healthcheck: {}}\n"
        "  b: {image: x, depends_on: {a: {condition: healthy}}}\n"
    )
    assert load_experiment(edf).experiment.services["b"].depends_on == {"a": "healthy"}


def test_ports(full: Definitions) -> None:
    assert full.experiment.services["roscore"].runtime.ports == (
        ("", 11311, 11311, "tcp"),
        ("127.0.0.1", 9000, 9100, "udp"),
        ("127.0.0.1", 9001, 9101, "udp"),
        ("", 80, 80, "tcp"),
    )


def test_requirements_of_cdf_and_edf_must_both_hold(full: Definitions) -> None:
    requires = full.experiment.services["talker"].requires
    assert requires.tags == ("arm", "camera")
    assert requires.memory == 2 * 1024**3
    assert requires.arch == ("arm64", "amd64")
    assert requires.kernel == ">=5.10"
    assert requires.gpu is True
    assert requires.disk == 8 * 1024**3


def test_dependencies_and_jobs(full: Definitions) -> None:
    services = full.experiment.services
    assert dict(services["talker"].depends_on) == {"prepare": "completed", "roscore": "healthy"}
    assert dict(services["recorder"].depends_on) == {"talker": "started"}
    assert services["prepare"].runtime.job is True
    assert services["roscore"].runtime.job is False


def test_cdf_after_extends(full: Definitions) -> None:
    (cdf,) = full.containers.values()
    assert full.experiment.services["talker"].cdf == cdf.file
    assert cdf.base == "debian:bookworm"
    assert cdf.platforms == ("linux/amd64", "linux/arm64")
    assert cdf.apt == ("curl", "vim")
    assert cdf.run == ("apt-get clean", "useradd -m robot")
    assert cdf.files[0].source == f"{cdf.folder}/talker.py"
    assert cdf.files[0].mode == "0755"
    assert dict(cdf.build_environment) == {"ROS_DOMAIN_ID": "1", "FROM_BASE": "1", "FROM_CDF": "yes"}
    assert cdf.runtime.command == ("sleep", "infinity")
    assert cdf.lines["files.0"] == 7
    assert cdf.lines["run"] == 8
    assert "base" not in cdf.lines, "it stands in the file that is extended"


def test_replace_tag_drops_what_is_below(tmp_path: Path) -> None:
    (tmp_path / "b.cdf").write_text(
        "cdf: 1\nbase: debian\nenvironment: {A: 1}\nvolumes: ['v:/v']\npackages: {apt: [a]}\n"
    )
    (tmp_path / "t.cdf").write_text("cdf: 1\nextends: b.cdf\npackages: {apt: !replace [b]}\n")
    service = _one(tmp_path, "{cdf: t.cdf, environment: !replace {B: 2}, volumes: !replace ['w:/w']}")
    assert dict(service.runtime.environment) == {"B": "2"}
    assert [mount.source for mount in service.runtime.mounts] == ["w"]
    assert load_container(tmp_path / "t.cdf").apt == ("b",)


def test_a_child_with_another_origin_drops_the_parents(tmp_path: Path) -> None:
    (tmp_path / "b.cdf").write_text("cdf: 1\nbase: debian\n")
    (tmp_path / "t.cdf").write_text("cdf: 1\nextends: b.cdf\nimage: x\n")
    cdf = load_container(tmp_path / "t.cdf")
    assert (cdf.base, cdf.image) == ("", "x")


def test_paths_start_from_the_file_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "cdfs" / "data").mkdir(parents=True)
    (tmp_path / "cdfs" / "b.cdf").write_text("cdf: 1\nbase: debian\nvolumes: ['./data:/data']\n")
    (tmp_path / "t.cdf").write_text("cdf: 1\nextends: cdfs/b.cdf\n")
    assert _one(tmp_path, "{cdf: t.cdf}").runtime.mounts[0].source == str(tmp_path / "cdfs" / "data")


def test_a_shared_cdf_outside_the_experiment_may_use_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir()
    (tmp_path / "exp").mkdir()
    (tmp_path / "shared" / "a.py").write_text("")
    (tmp_path / "shared" / "t.cdf").write_text("cdf: 1\nbase: debian\nfiles: [{src: a.py, dest: /a.py}]\n")
    assert _one(tmp_path / "exp", "{cdf: ../shared/t.cdf}").cdf == str(tmp_path / "shared" / "t.cdf")


def test_a_dockerfile_is_a_cdf(tmp_path: Path) -> None:
    (tmp_path / "camera").mkdir()
    (tmp_path / "camera" / "Dockerfile").write_text("FROM debian\nHEALTHCHECK CMD true\n")
    path = tmp_path / "e.edf"
    path.write_text(
        "edf: 1\nname: a\nservices:\n  a: {cdf: camera/Dockerfile}\n"
        "  b: {image: x, depends_on: {a: {condition: healthy}}}\n"
    )
    (cdf,) = load_experiment(path).containers.values()
    assert cdf.name == "camera"
    assert cdf.dockerfile == str(tmp_path / "camera" / "Dockerfile")


@pytest.mark.parametrize(
    ("text", "healthy"),
    [
        ("FROM a\nHEALTHCHECK CMD x\n", True),
        ("FROM a\nHEALTHCHECK NONE\n", False),
        ("FROM a AS b\nHEALTHCHECK CMD x\nFROM c\n", False),
        ("FROM a AS b\nHEALTHCHECK CMD x\nFROM b\n", True),
        ('FROM a\nRUN ["sh", "-c", "<<EOF\\nHEALTHCHECK CMD x\\nEOF"]\n', False),
        ("FROM a\nRUN true \\\n  HEALTHCHECK CMD x\n", False),
        ("FROM a\n# HEALTHCHECK CMD x\n", False),
    ],
)
def test_healthcheck_of_a_dockerfile(text: str, healthy: bool) -> None:
    from srprov.definitions.dockerfile import has_healthcheck

    assert has_healthcheck(text) is healthy


def test_bare_names_take_the_controllers_value(tmp_path: Path) -> None:
    runtime = _runtime(tmp_path, "environment: [DISPLAY, A=b=c]", {"DISPLAY": ":0"})
    assert dict(runtime.environment) == {"DISPLAY": ":0", "A": "b=c"}


def test_nothing_is_interpolated(tmp_path: Path) -> None:
    runtime = _runtime(tmp_path, 'environment: {A: "${HOME}"}, command: "echo ${HOME}"')
    assert runtime.environment["A"] == "${HOME}"
    assert runtime.command == ("echo", "${HOME}")


def test_env_file_syntax(tmp_path: Path) -> None:
    (tmp_path / "a.env").write_text(
        '# comment\n\nA=1\nexport B = two words # note\nC=\'$literal # kept\'\nD="a\\nb\\"c"\nE=\nF=a#b\nG\nH: x\n'
        'M="first\nsecond"\n'
    )
    runtime = _runtime(tmp_path, "env_file: a.env", {"G": "from here"})
    assert dict(runtime.environment) == {
        "A": "1",
        "B": "two words",
        "C": "$literal # kept",
        "D": 'a\nb"c',
        "E": "",
        "F": "a#b",
        "G": "from here",
        "H": "x",
        "M": "first\nsecond",
    }


def test_same_robot_groups_with_a_common_service_are_one(tmp_path: Path) -> None:
    path = tmp_path / "e.edf"
    path.write_text(
        "edf: 1\nname: a\nservices: {a: &x {image: x}, b: *x, c: *x, d: *x, e: *x}\n"
        "relations: {same_robot: [[d, e], [a, b], [b, c]]}\n"
    )
    assert load_experiment(path).experiment.same_robot == (("a", "b", "c"), ("d", "e"))


@pytest.mark.parametrize(("encryption", "needed"), [("none", []), ("wireguard", ["a", "both"])])
def test_encryption_is_required_of_robots_whose_services_are_on_the_overlay(
    tmp_path: Path, encryption: str, needed: list[str]
) -> None:
    path = tmp_path / "e.edf"
    path.write_text(
        f"edf: 1\nname: a\nnetwork: {{encryption: {encryption}}}\nservices:\n  a: {{image: x}}\n"
        "  both: {image: x, network: both}\n  host: {image: x, network: host}\n  none: {image: x, network: none}\n"
    )
    found = load_experiment(path)
    assert found.experiment.network.encryption == encryption
    assert found.unsupported == ()
    assert [name for name, one in found.experiment.services.items() if one.requires.wireguard] == needed


@pytest.mark.parametrize(
    ("network", "message"),
    [
        ("{discovery: zenoh}", "'discovery: zenoh' needs 'discovery_servers'"),
        ("{discovery: ros1, discovery_servers: c}", "there is no service 'c'"),
        ("{discovery: ros1, discovery_servers: [a, b]}", "there is one ROS master, not several"),
        ("{discovery: ros1, discovery_servers: two}", "several instances of 'two' cannot be one ROS master"),
        ("{discovery: zenoh, discovery_servers: alone}", "nobody reaches 'alone', which has 'network: none'"),
        ("{discovery: static-peers, discovery_servers: a}", "'discovery: static-peers' has no servers"),
        ("{discovery_servers: a}", "'discovery: multicast' has no servers"),
    ],
)
def test_servers_of_discovery_must_be_such(tmp_path: Path, network: str, message: str) -> None:
    path = tmp_path / "e.edf"
    services = "{a: {image: x}, b: {image: x}, two: {image: x, replicas: 2}, alone: {image: x, network: none}}"
    path.write_text(f"edf: 1\nname: a\nservices: {services}\nnetwork: {network}\n")
    (problem,) = check_files([path])
    assert message in problem.message and problem.location.line == 4


def test_servers_of_discovery_are_read(tmp_path: Path) -> None:
    path = tmp_path / "e.edf"
    path.write_text(
        "edf: 1\nname: a\nservices: {a: {image: x}, two: {image: x, replicas: 2}}\n"
        "network: {discovery: discovery-server, discovery_servers: [two, a]}\n"
    )
    found = load_experiment(path)
    assert found.unsupported == ()
    assert found.experiment.network == NetworkSettings(discovery="discovery-server", discovery_servers=("two", "a"))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("cdf: 1\nextends: {git: https://h/x, path: a.cdf}\n", 2),
    ],
)
def test_what_of_a_cdf_is_not_built_yet(tmp_path: Path, text: str, line: int) -> None:
    (tmp_path / "t.cdf").write_text(text)
    (tmp_path / "e.edf").write_text("edf: 1\nname: a\nservices: {a: {cdf: t.cdf}}\n")
    (problem,) = load_experiment(tmp_path / "e.edf").unsupported
    assert problem.location.line == line
    assert problem.location.file.endswith("t.cdf")


def test_every_problem_of_every_file_at_once(tmp_path: Path) -> None:
    (tmp_path / "t.cdf").write_text("cdf: 1\nbase: x\nbad: 1\n")
    (tmp_path / "e.edf").write_text(
        "edf: 1\nname: A\nservices: {a: {cdf: t.cdf}, b: {cdf: u.cdf}}\nweights: {cpu: 1}\n"
    )
    with pytest.raises(DefinitionError) as error:
        load_experiment(tmp_path / "e.edf")
    assert len(error.value.problems) == 4
    assert "4 problems" in error.value.message


def test_names_that_begin_with_x_are_services_and_variables(tmp_path: Path) -> None:
    (tmp_path / "e.edf").write_text("edf: 1\nname: a\nservices: {x-ray: {image: x, environment: {x-y: 1}}}\n")
    services = load_experiment(tmp_path / "e.edf").experiment.services
    assert dict(services["x-ray"].runtime.environment) == {"x-y": "1"}
