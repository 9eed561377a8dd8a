"""Run-time fields on a real robot: what Docker says of the container, and what the process finds in it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Lab, busybox, causes, edf, part_of_lab
from tests.lab.looks import reached

pytestmark = pytest.mark.lab

FULL = {
    "mem_limit": "64m", "mem_reservation": "32m", "cpus": 0.5, "cpuset": "0", "pids_limit": 64, "shm_size": "1m",
    "init": True, "cap_drop": ["ALL"], "cap_add": ["NET_RAW"], "read_only": True,
    "tmpfs": ["/run", "/t:size=64k,mode=1777"],
    "extra_hosts": ["camera.lab:10.9.9.9", "robot=host-gateway"], "stdin_open": True, "hostname": "turtle.lab",
    "logging": {"driver": "local", "options": {"max-size": "1m"}}, "labels": {"org.example.team": "drive"},
    "oom_score_adj": 500, "runtime": "runc", "restart": "on-failure:2", "ulimits": {"nofile": 512},
    "volumes": [{"type": "tmpfs", "target": "/u", "tmpfs": {"size": "64k", "mode": "0700"}}],
}  # fmt: skip
ALLOW = [word for kind in ("capability", "runtime", "restart-always") for word in ("--allow", kind)]
WANTED: dict[str, Any] = {
    "Memory": 64 << 20, "MemoryReservation": 32 << 20, "CpuQuota": 50_000, "CpusetCpus": "0", "PidsLimit": 64,
    "ShmSize": 1 << 20, "Init": True, "ReadonlyRootfs": True, "OomScoreAdj": 500, "Runtime": "runc",
    "Tmpfs": {"/run": "", "/t": "size=64k,mode=1777", "/u": "size=65536,mode=0700"},
    "LogConfig": {"Type": "local", "Config": {"max-size": "1m"}},
}  # fmt: skip
"""In `docker inspect`'s words."""
FULL_NAME, PLAIN_NAME = "srprov.fields.full", "srprov.fields.plain"


@dataclass
class Fields:
    """An experiment with every field, and a service beside it of which nothing is said."""

    lab: Lab
    words: tuple[str, ...]

    def plan(self) -> dict[str, str]:
        """Give what `plan` wants to do: step id -> action and cause."""
        done = self.lab.srprov("plan", *self.words, "--json")
        assert done.code == 0, done
        return causes(done.json)

    def gateway(self) -> str:
        """Give the robot's own address on the overlay."""
        out = self.lab.shell("robot1", "docker", "network", "inspect", "srprov.fields").out
        return str(json.loads(out)[0]["IPAM"]["Config"][0]["Gateway"])

    def inside(self, name: str, script: str) -> str:
        """Give what a shell in a container says."""
        return self.lab.shell("robot1", "docker", "exec", name, "sh", "-c", script).out.strip()


@pytest.fixture(scope="module")
def fields(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Fields:
    """Bring both up on one robot."""
    folder = tmp_path_factory.mktemp("fields")
    services = {"full": busybox(**FULL), "plain": busybox()}
    path: Path = folder / "fields.edf"
    path.write_text(edf("fields", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    made = Fields(lab_of_module, (str(path), "-i", part_of_lab(lab_of_module, ["robot1"], folder / "lab.yml")))
    done = lab_of_module.srprov("apply", *made.words, *ALLOW, "--yes", "--settle", "0")
    assert done.code == 0, done
    return made


def test_docker_has_every_field_and_a_second_plan_is_empty(fields: Fields) -> None:
    """What an engine fills in by itself is no difference, and neither is a second apply."""
    assert fields.plan() == {}
    found = fields.lab.inspect("robot1", FULL_NAME)
    assert {key: found["HostConfig"][key] for key in WANTED} == WANTED
    assert found["HostConfig"]["CapDrop"] == ["ALL"]
    assert (found["Config"]["OpenStdin"], found["Config"]["Hostname"]) == (True, "turtle.lab")
    assert found["Config"]["Labels"]["org.example.team"] == "drive"


def test_the_process_finds_what_the_fields_say(fields: Fields) -> None:
    assert fields.inside(FULL_NAME, "touch /x 2>&1; cat /proc/1/comm /proc/1/oom_score_adj; stat -c %a /t /u") == (
        "touch: /x: Read-only file system\ndocker-init\n500\n1777\n700"
    )
    assert fields.inside(FULL_NAME, "ping -q -c 1 -W 2 robot | head -1; grep CapEff /proc/1/status").splitlines() == [
        f"PING robot ({fields.gateway()}): 56 data bytes",
        "CapEff:\t0000000000002000",
    ]
    assert reached(fields.lab, "robot1", FULL_NAME, ["robot", "plain"]) == {"robot", "plain"}


def test_names_are_known_where_they_should_be(fields: Fields) -> None:
    """The hostname to every service, at the address of its service; further hosts to the one that has them alone."""
    own, other = (fields.inside(name, "cat /etc/hosts").split("\n") for name in (FULL_NAME, PLAIN_NAME))
    (address,) = (line.split()[0] for line in other if line.split()[1:] == ["full"])
    assert f"{address}\tturtle.lab" in other and f"{address}\tturtle.lab" in own
    assert "10.9.9.9\tcamera.lab" in own and "10.9.9.9\tcamera.lab" not in other
    assert fields.inside(FULL_NAME, "hostname") == "turtle.lab"


def test_logs_rotate_where_nothing_is_said(fields: Fields) -> None:
    found = fields.lab.inspect("robot1", PLAIN_NAME)["HostConfig"]
    assert found["LogConfig"] == {"Type": "json-file", "Config": {"max-file": "3", "max-size": "10m"}}
    assert not found.get("Init")


def test_limits_that_docker_update_changed_are_named_and_mended(fields: Fields) -> None:
    """They are the only fields that a container can lose without being another one."""
    options = (
        "--memory 48m --memory-swap 48m --memory-reservation 16m --cpu-quota 40000 --pids-limit 32 --restart always"
    )
    fields.lab.shell(
        "robot1", "sh", "-c", f"docker update {options} {FULL_NAME} && docker update --cpus 1 {PLAIN_NAME}"
    )
    assert fields.plan() == {
        f"robot1/container:{FULL_NAME}": (
            "replace: cpus, mem_limit, mem_reservation, pids_limit, restart were changed on the robot"
        ),
        f"robot1/container:{PLAIN_NAME}": "replace: cpus was changed on the robot",
    }
    done = fields.lab.srprov("apply", *fields.words, *ALLOW, "--yes", "--settle", "0")
    assert done.code == 0, done
    assert fields.lab.inspect("robot1", FULL_NAME)["HostConfig"]["Memory"] == WANTED["Memory"]


def test_containers_of_a_robot_stop_side_by_side(fields: Fields, tmp_path: Path) -> None:
    """Four that need all of their grace die at the same time, by the engine's word."""
    stubborn = busybox("sh", "-c", "trap '' TERM; while :; do sleep 1; done", stop_grace_period="2s", network="none")
    del stubborn["stop_signal"]
    services = {f"s{number}": stubborn for number in range(4)}
    path = tmp_path / "stubborn.edf"
    path.write_text(edf("stubborn", services, placement={"slots_per_robot": 4}), encoding="utf-8")
    words = (str(path), "-i", part_of_lab(fields.lab, ["robot2"], tmp_path / "lab.yml"), "--yes")
    up = fields.lab.srprov("apply", *words, "--settle", "0")
    assert up.code == 0, up
    gone = fields.lab.srprov("destroy", *words)
    assert gone.code == 0 and fields.lab.leftovers("robot2")["containers"] == [], gone
    # `--until 0s` leaves out the present second
    script = (
        "docker events --since 1h --until $(($(date +%s) + 1)) --filter event=die "
        "--format '{{.TimeNano}} {{.Actor.Attributes.exitCode}} {{.Actor.Attributes.name}}'"
    )
    every = [line.split() for line in fields.lab.shell("robot2", "sh", "-c", script).out.splitlines()]
    died = [one for one in every if one[2].startswith("srprov.stubborn.")]
    assert [one[1] for one in died] == ["137"] * 4, every
    assert int(died[-1][0]) - int(died[0][0]) < 2_000_000_000
