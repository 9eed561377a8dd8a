"""Facts against other words for the same: what the lab was told to simulate, the robots' own tools, and psutil."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from tests.lab.conftest import ROBOTS, Lab, part_of_lab, scrub

pytestmark = pytest.mark.lab

GIB, MIB = 2**30, 2**20
SPEC = {
    "robot11": {
        "tags": ["lidar", "manipulator"],
        "slots": 3,
        "devices": ["/dev/video0", "/dev/ttyUSB0", "/dev/gripper"],
        "load": 3.5,
        "memory": {"total": "4G", "used": "1G"},
        "swap": {"total": "1G", "used": "256M"},
    },
    "robot12": {"load": 0.25, "memory": {"total": "512M", "used": "128M"}, "swap": {"total": "0"}},
}
PLAIN = "robot13"
NAMES = [*SPEC, PLAIN]
PASSING = ("load1", "memory_available", "swap_free", "disk_free", "traffic_mbit", "clock_offset_s")
"""What may differ from one look to the next."""


@pytest.fixture(scope="module")
def figured(lab_session: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Give the lab with robots that simulate something; afterwards all are plain again."""
    spec = tmp_path_factory.mktemp("spec") / "lab-spec.yml"
    spec.write_text(yaml.safe_dump({"robots": SPEC}), encoding="utf-8")
    up = lab_session.srprov("lab", "up", "-n", str(ROBOTS), "--spec", str(spec))
    assert up.code == 0, up
    yield lab_session
    up = lab_session.srprov("lab", "up", "-n", str(ROBOTS))
    assert up.code == 0, up
    scrub(lab_session)


@pytest.fixture(scope="module")
def facts(figured: Lab, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Give the facts of the three robots."""
    inventory = part_of_lab(figured, NAMES, tmp_path_factory.mktemp("facts") / "lab.yml")
    return ask(figured, inventory)


def ask(lab: Lab, inventory: str) -> dict[str, dict[str, Any]]:
    done = lab.srprov("facts", "-i", inventory, "--json")
    assert done.code == 0, done
    robots = done.json["robots"]
    assert isinstance(robots, dict)
    return robots


def lasting(robots: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    kept = {name: {key: one[key] for key in one if key not in PASSING} for name, one in robots.items()}
    for one in kept.values():
        # a link-local IPv6 address comes a second after its link
        settled = [[a for a in link["addresses"] if not a.startswith("fe80:")] for link in one["links"]]
        one["links"] = [{**link, "addresses": a} for link, a in zip(one["links"], settled, strict=True)]
    return kept


def test_what_the_lab_simulates_is_what_the_facts_say(facts: dict[str, dict[str, Any]]) -> None:
    """Tags, slots, devices, load, memory and swap are those of the lab-spec; hardware tags follow from the devices."""
    strong, weak = facts["robot11"], facts["robot12"]
    assert {"lidar", "manipulator", "camera", "serial"} <= set(strong["tags"])
    assert set(SPEC["robot11"]["devices"]) <= set(strong["devices"])
    assert (strong["slots"], strong["load1"]) == (3, 3.5)
    assert (strong["memory_total"], strong["memory_available"]) == (4 * GIB, 3 * GIB)
    assert (strong["swap_total"], strong["swap_free"]) == (GIB, 768 * MIB)
    assert (weak["slots"], weak["load1"]) == (1, 0.25)
    assert (weak["memory_total"], weak["memory_available"]) == (512 * MIB, 384 * MIB)
    assert (weak["swap_total"], weak["swap_free"]) == (0, 0)
    for other in (weak, facts[PLAIN]):
        assert not {"lidar", "manipulator", "camera", "serial"} & set(other["tags"])
        assert not set(SPEC["robot11"]["devices"]) & set(other["devices"])


def test_the_robots_own_tools_say_the_same(figured: Lab, facts: dict[str, dict[str, Any]]) -> None:
    """CPUs, memory, kernel, host name, links, disk, engine and address are what its own programs print."""
    for name, one in facts.items():

        def tool(*words: str, robot: str = name) -> str:
            return figured.shell(robot, *words).out.strip()

        assert one["hostname"] == tool("hostname") == name
        assert one["kernel"] == tool("uname", "-r")
        assert one["arch"] == {"x86_64": "amd64", "aarch64": "arm64"}[tool("uname", "-m")]
        assert one["cpus"] == int(tool("nproc", "--all"))
        memory = [line.split() for line in tool("free", "-b").splitlines()]
        totals = {words[0]: int(words[1]) for words in memory if words[0] in ("Mem:", "Swap:")}
        assert (one["memory_total"], one["swap_total"]) == (totals["Mem:"], totals["Swap:"])
        links = {link["ifname"]: link for link in json.loads(tool("ip", "-j", "addr"))}
        assert {link["name"]: (link["mtu"], link["mac"]) for link in one["links"]} == {
            link: (known["mtu"], known["address"]) for link, known in links.items()
        }
        address = next(a["local"] for a in links["eth0"]["addr_info"] if a["family"] == "inet")
        assert (one["underlay_link"], one["underlay_address"]) == ("eth0", address)
        assert one["underlay_mtu"] == links["eth0"]["mtu"]
        assert one["docker"]["version"] == tool("docker", "version", "--format", "{{.Server.Version}}")
        assert one["docker"]["storage_driver"] == tool("docker", "info", "--format", "{{.Driver}}")
        assert one["docker"]["log_driver"] == tool("docker", "info", "--format", "{{.LoggingDriver}}")
        total = int(tool("df", "-B1", "--output=size", "/var/lib/docker").split()[-1])
        assert one["disk_total"] == total
        assert abs(one["clock_offset_s"]) < 1
        assert (one["user"], one["privileged"]) == ("root", True)


def moving() -> tuple[float, dict[str, int]]:
    """Return what other programs change at any time: the load, and each link's MTU."""
    return psutil.getloadavg()[0], {name: stats.mtu for name, stats in psutil.net_if_stats().items()}


def test_this_machine_itself_is_what_psutil_says(figured: Lab, tmp_path: Path) -> None:
    """With `ansible_connection: local`: CPUs, memory, swap, load within tolerance, every link with its MTU."""
    path = tmp_path / "local.yml"
    path.write_text("all: {hosts: {here: {ansible_connection: local}}}\n", encoding="utf-8")
    load, before = moving()
    here = ask(figured, str(path))["here"]
    later, after = moving()
    memory, swap = psutil.virtual_memory(), psutil.swap_memory()
    assert here["cpus"] == psutil.cpu_count()
    assert here["memory_total"] == memory.total
    assert here["memory_available"] == pytest.approx(memory.available, rel=0.2)
    assert (here["swap_total"], here["swap_free"]) == (swap.total, pytest.approx(swap.free, rel=0.2))
    assert min(load, later) - 2 < here["load1"] < max(load, later) + 2
    assert here["hostname"] == socket.gethostname()
    assert here["disk_total"] == pytest.approx(psutil.disk_usage("/").total, rel=0.01)
    assert here["clock_offset_s"] == pytest.approx(0, abs=0.5)
    links = {link["name"]: link["mtu"] for link in here["links"]}
    assert before.items() & after.items() <= links.items()


def test_the_table_has_every_robot(figured: Lab, tmp_path: Path) -> None:
    """One line per robot, with its figures; one that cannot be reached stands at its place, its reason below."""
    inventory = part_of_lab(figured, ["robot10", *NAMES], tmp_path / "lab.yml", robot10={"ansible_port": 2222})
    done = figured.srprov("facts", "-i", inventory)
    assert done.code == 4, done
    heading, *lines = done.out.splitlines()
    rows = {line.split()[0]: line for line in lines[:4]}
    assert heading.split()[:3] == ["ROBOT", "STATE", "ARCH"]
    assert list(rows) == ["robot10", *NAMES]
    assert rows["robot10"].split()[1] == "unreachable"
    assert "3.50" in rows["robot11"] and "1.0/4.0 GiB" in rows["robot11"] and "0.2/1.0 GiB" in rows["robot11"]
    assert "lidar" in rows["robot11"] and "gripper" in rows["robot11"]
    assert "0.25" in rows["robot12"] and "0.1/0.5 GiB" in rows["robot12"]
    why = f"{figured.site.address('robot10')} port 2222: connection refused"
    assert (done.out + done.err).count(why) == 1 and f"unreachable: robot10: {why}" in done.err


def test_inventories_of_every_kind_give_the_same_facts(
    figured: Lab, facts: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    """A program that prints JSON and an INI file, with the same robots and variables as the YAML, change nothing."""
    whole = yaml.safe_load(figured.inventory.read_text(encoding="utf-8"))["all"]
    hosts = {name: whole["hosts"][name] for name in NAMES}

    program = tmp_path / "inventory.py"
    listing = {"_meta": {"hostvars": hosts}, "all": {"children": ["robots"], "vars": whole["vars"]}}
    listing["robots"] = {"hosts": NAMES}
    text = "import json, sys\nassert sys.argv[1:] == ['--list']\n"
    program.write_text(f"#!/usr/bin/env python3\n{text}print(json.dumps({listing!r}))\n", encoding="utf-8")
    program.chmod(0o755)
    assert lasting(ask(figured, str(program))) == lasting(facts)

    ini = tmp_path / "inventory.ini"
    lines = ["[robots]"]
    for name, variables in hosts.items():
        lines.append(" ".join([name, *(f'{key}="{value}"' for key, value in variables.items())]))
    lines += ["", "[all:vars]", *(f"{key}={value}" for key, value in whole["vars"].items())]
    ini.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert lasting(ask(figured, str(ini))) == lasting(facts)
