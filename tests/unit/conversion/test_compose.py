"""Compose files as they are on disk, through the command line: the whole way to a folder that validates."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.definitions import check_files, load_experiment
from tests.unit.conversion.test_services import CASES


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("stack", "pair"):
        shutil.copytree(CASES / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DISPLAY", "of-the-caller")
    return tmp_path


def imported(*words: str) -> int:
    return run(["import", "compose", *words, "-o", "out"])


def written(here: Path) -> Any:
    return yaml.safe_load((here / "out" / "experiment.edf").read_text(encoding="utf-8"))


def test_a_published_stack_becomes_an_experiment(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported("stack/compose.yaml", "--set", "ROS_IMAGE=busybox", "--format", "json") == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("import")).iter_errors(document)) == []
    assert document["counts"]["refused"] == 0 and document["counts"]["exact"] > 100
    said = {(one["line"], one["kept"], one["key"]) for one in document["findings"]}
    assert (71, "dropped", "services.web.dns") in said
    assert (15, "adapted", "services.roscore.container_name") in said
    assert {one["name"]: one["source"] for one in document["variables"]}["ROS_IMAGE"] == "--set"
    edf = written(here)
    services = edf["services"]
    assert edf["name"] == "rover-stack" and edf["placement"] == {"slots_per_robot": 7}
    assert services["roscore"]["hostname"] == "rover_roscore"
    assert services["roscore"]["healthcheck"]["test"] == ["CMD-SHELL", "wget -q -O- http://localhost:11311/state"]
    assert services["base"] | {"environment": 0, "logging": 0} == {
        "image": "busybox", "command": ["sleep", "86400"], "network": "host", "ipc": "host", "privileged": True,
        "depends_on": {"roscore": {"condition": "healthy"}}, "devices": ["/dev/null:/dev/rover"], "environment": 0,
        "volumes": ["/dev/shm:/dev/shm", "./files/config/base.yaml:/etc/base.yaml"], "restart": "unless-stopped",
        "stop_signal": "SIGKILL", "logging": 0,
    }  # fmt: skip
    assert services["lidar"]["environment"] == {"ROS_DOMAIN_ID": "7", "ROS_HOME": "/tmp/ros 7", "LIDAR_BAUD": "115200"}
    assert services["lidar"]["command"][2] == "echo lidar of $HOSTNAME at ${LIDAR_BAUD}; exec sleep 86400"
    assert services["mapper"]["cdf"] == "mapper.cdf"
    assert services["mapper"]["volumes"] == ["config:/config", "maps:/maps"]
    web, rosbag = services["web"], services["rosbag"]
    assert (web["cpus"], web["mem_limit"], web["ports"]) == (0.5, "64m", ["8080:80"])
    assert (rosbag["profiles"], rosbag["volumes"]) == (["record"], ["bags:/bags"])
    assert edf["volumes"] == {"config": {"seed": "./files/config"}}
    cdf = yaml.safe_load((here / "out" / "mapper.cdf").read_text())
    assert cdf["dockerfile"] == {"context": "files/mapper", "dockerfile": "Dockerfile", "args": {"BASE": "busybox"}}
    assert check_files([here / "out" / "experiment.edf", here / "out" / "mapper.cdf"]) == []
    assert "of-the-caller" not in "".join(one.read_text() for one in Path("out").rglob("*") if one.is_file())
    report = (here / "out" / "import-report.md").read_text()
    assert "| stack/compose.yaml:43:9 |" in report and "DISPLAY" in report and "DISPLAY" not in str(edf)


def test_the_same_files_give_the_same_folder(here: Path) -> None:
    """Byte for byte: an import can be repeated and compared."""
    for target in ("one", "two"):
        assert run(["import", "compose", "stack/compose.yaml", "--set", "ROS_IMAGE=busybox", "-o", target]) == 0
    files = [one.relative_to("one") for one in Path("one").rglob("*") if one.is_file()]
    assert len(files) == 6
    assert all((Path("one") / one).read_bytes() == (Path("two") / one).read_bytes() for one in files)


def test_profiles_choose_services_when_files_are_imported(here: Path) -> None:
    assert imported("stack/compose.yaml", "--set", "ROS_IMAGE=busybox", "--profile", "record") == 0
    assert "profiles" not in written(here)["services"]["rosbag"]
    shutil.rmtree("out")
    Path("stack/compose.yaml").write_text(
        "services: {a: {image: x, profiles: [p]}, b: {image: x}, c: {image: x, profiles: [q]}}\n"
    )
    assert imported("stack/compose.yaml", "--profile", "p") == 0
    assert sorted(written(here)["services"]) == ["a", "b"]


def test_several_files_are_one_project(here: Path) -> None:
    Path("stack/a.yaml").write_text("services: {roscore: {image: one:1, cap_add: [SYS_NICE]}, b: {image: x}}\n")
    Path("stack/over.yaml").write_text("services: {roscore: {image: other:1, cap_add: [NET_ADMIN]}}\n")
    assert imported("stack/a.yaml", "stack/over.yaml", "--name", "second") == 0
    edf = written(here)
    assert edf["services"]["roscore"] == {"image": "other:1", "cap_add": ["SYS_NICE", "NET_ADMIN"]}
    assert edf["name"] == "second" and edf["placement"] == {"slots_per_robot": 2}


def test_files_of_two_machines_become_one_experiment(here: Path) -> None:
    files = ("pair/compose.robot.yaml", "pair/compose.pc.yaml", "--robot-map", "pair/robots.yml")
    assert imported(*files) == 0
    edf = written(here)
    assert {name: one["robot"] for name, one in edf["services"].items()} == {
        "driver": "robot1", "agent": "robot1", "viewer": "robot2", "agent-robot2": "robot2",
    }  # fmt: skip
    assert edf["name"] == "out" and edf["placement"] == {"slots_per_robot": 2}
    assert load_experiment(here / "out" / "experiment.edf").containers


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("second", "noted"), [("", True), ("network_mode: host", False)])
def test_what_robots_open_to_each_other_is_told(second: str, noted: bool) -> None:
    """In Compose a proxy of the engine's socket on a network of its own is reached on its robot alone."""
    Path("a.yml").write_text("services: {web: {image: x}}\n")
    Path("b.yml").write_text(f"services: {{proxy: {{image: x, {second}}}}}\n")
    Path("robots.yml").write_text("a.yml: r1\nb.yml: r2\n")
    said = "all robots' services reach each other at every port"
    assert imported("a.yml", "b.yml", "--robot-map", "robots.yml", "--strict") == 0
    assert (said in Path("out/import-report.md").read_text()) is noted


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("compose.robot.yaml: robot1\n", "robots.yml:1:1: error[SRP-170]: no robot is named for pair/compose.pc.yaml"),
        (
            "compose.robot.yaml: robot1\nnone.yaml: robot2\n",
            "robots.yml:2:1: error[SRP-170]: 'none.yaml' is none of the files",
        ),
        (
            "compose.robot.yaml: robot1\ncompose.pc.yaml: 'a b'\n",
            "robots.yml:2:18: error[SRP-170]: 'a b' cannot be the name",
        ),
        ("[a]\n", "robots.yml:1:1: error[SRP-170]: is no map of files to robots"),
        ("", "robots.yml:1:1: error[SRP-170]: is no map of files to robots"),
    ],
)
def test_a_map_that_is_wrong_is_told(here: Path, capsys: pytest.CaptureFixture[str], text: str, says: str) -> None:
    Path("pair/robots.yml").write_text(text)
    assert imported("pair/compose.robot.yaml", "pair/compose.pc.yaml", "--robot-map", "pair/robots.yml") == 5
    assert says in capsys.readouterr().err
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("services:\n  a:\n    image: x\n    network_mode: service:b\n  b: {image: x}\n", "c.yaml:4:5: refused: "),
        ("services:\n  a:\n    image: x\n    ports: ['800:80/udp']\n", "refused: overlays have UDP port 800"),
        ("services:\n  a:\n    image: x\n    ports: ['4789:80/udp']\n", "refused: overlays have UDP port 4789"),
        ("services:\n  a:\n    image: x\n    volumes: ['../o:/o']\n", "c.yaml:4:15: refused: '../o' lies outside"),
        ("services:\n  a:\n    image: x:${TAG}\n", "c.yaml:3:12: error[SRP-171]: "),
        ("services:\n  a:\n    image: x\n    nonsense: 1\n", "c.yaml:4:5: error[SRP-170]: "),
        ("services:\n  a:\n    image: X y\n", "c.yaml:3:5: error[SRP-1"),
        ("services:\n  a:\n    image: x\n    env_file: ''\n", "c.yaml:4:15: error[SRP-170]: the file of variables has"),
        ("services:\n  a:\n    image: x\n    env_file: [{path: ''}]\n", "the file of variables has no path"),
        ("services:\n  a:\n    image: x\n    volumes: ['/etc/../etc/shadow:/s', './l:/l']\n", "c.yaml:4:40: "),
    ],
)
def test_what_is_refused_is_told_at_its_place_and_nothing_is_written(
    here: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    Path("stack/c.yaml").write_text(text)
    Path("stack/l").symlink_to("/etc")
    assert imported("stack/c.yaml") == 5
    shown = capsys.readouterr()
    assert says in shown.out + shown.err
    assert not Path("out").exists() and sorted(one.name for one in here.iterdir()) == ["pair", "stack"]


def test_the_home_of_a_user(here: Path) -> None:
    Path("stack/c.yaml").write_text("services: {a: {image: x, volumes: ['~/.ros:/ros', '${HOME}/maps:/maps']}}\n")
    assert imported("stack/c.yaml", "--home", "pilot", "--set", "HOME=~ada") == 0
    assert written(here)["services"]["a"]["volumes"] == ["~pilot/.ros:/ros", "~ada/maps:/maps"]


def test_secrets_of_files_are_never_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("stack/token").write_text("hunter2-hunter2")
    Path("stack/c.yaml").write_text(
        "services: {a: {image: x, secrets: [t], volumes: ['.:/ws']}}\nsecrets: {t: {file: ./token}}\n"
    )
    assert imported("stack/c.yaml", "--format", "markdown") == 0
    shown = capsys.readouterr()
    every = b"".join(one.read_bytes() for one in Path("out").rglob("*") if one.is_file())
    assert b"hunter2" not in every and "hunter2" not in shown.out + shown.err
    source = load_experiment("out/experiment.edf").experiment.secrets["t"]
    assert Path(source.file).read_text() == "hunter2-hunter2"


@pytest.mark.parametrize("form", ["json", "sarif"])
@pytest.mark.parametrize(
    "text",
    [
        "services: {a: {image: x, nonsense: 1}}\n",
        "services: {a: {image: X y}}\n",
    ],
)
def test_what_cannot_be_read_is_told_in_the_form_that_was_asked_for(
    here: Path, capsys: pytest.CaptureFixture[str], form: str, text: str
) -> None:
    """Code hosts show a refusal beside its line, whether Compose, srprov or `validate` gives it."""
    Path("stack/c.yaml").write_text(text)
    assert imported("stack/c.yaml", "--format", form) == 5
    document = json.loads(capsys.readouterr().out)
    if form == "json":
        assert list(Draft202012Validator(data.schema("import")).iter_errors(document)) == []
        assert document["counts"]["refused"] == 1 and document["findings"][0]["file"] == "stack/c.yaml"
    else:
        (result,) = document["runs"][0]["results"]
        assert result["level"] == "error" and result["ruleId"] == "refused"


def test_passwords_of_env_files_are_told(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They stood in a file of their own before."""
    Path("stack/db.env").write_text("DB_PASSWORD=hunter2\nDB_USER=lab\n")
    Path("stack/c.yaml").write_text("services: {a: {image: x, env_file: db.env, environment: {API_TOKEN: public}}}\n")
    assert imported("stack/c.yaml") == 0
    told = [line for line in capsys.readouterr().out.splitlines() if "in the clear" in line]
    assert len(told) == 1 and told[0].startswith("stack/db.env:1:1: adapted: the value of 'DB_PASSWORD' stands")
    assert "hunter2" not in Path("out/import-report.md").read_text()


def test_a_map_s_whole_name_is_no_other_file_s_last_part(here: Path) -> None:
    files = ("vendor/compose.yml", "compose.yml")
    for file, name in zip(files, "ab", strict=True):
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text(f"services: {{{name}: {{image: x}}}}\n")
    Path("robots.yml").write_text("compose.yml: robot1\nvendor/compose.yml: robot2\n")
    assert imported(*files, "--robot-map", "robots.yml", "--root", ".") == 0
    assert {name: one["robot"] for name, one in written(here)["services"].items()} == {"a": "robot2", "b": "robot1"}
