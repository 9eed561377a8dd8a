"""Twelve robots with a service each: names, pings and multicast between all, and a thirteenth that disturbs nobody.

One experiment for all tests of this file; they stand in the order in which it grows.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.lab.conftest import ROOT, Lab, busybox, causes, edf, part_of_lab
from tests.unit.report.pages import Page, wrong_numbers

pytestmark = pytest.mark.lab

NAMES = [f"s{number:02}" for number in range(1, 13)]
HOME = {name: f"robot{number}" for number, name in enumerate(NAMES, start=1)}

TALK = """
import select, socket, struct, sys, time
group, port, own, name, others = "239.255.0.7", 45454, *sys.argv[1:3], int(sys.argv[3])
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind((group, port))
here = socket.inet_aton(own)
s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", socket.inet_aton(group), here))
s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, here)
s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 0)
print("ready", flush=True)
sys.stdin.readline()
s.sendto(name.encode(), (group, port))
heard, until = set(), time.monotonic() + 6
while len(heard) < others and time.monotonic() < until:
    if select.select([s], [], [], 0.2)[0]:
        data, sender = s.recvfrom(64)
        heard.add(data.decode() + "=" + sender[0])
print(" ".join(sorted(heard)), flush=True)
"""
"""Join the group, say so, wait for a line, send one datagram, and list who was heard."""


@dataclass
class Twelve:
    lab: Lab
    file: Path
    inventory: str
    record: str = ""
    """The folder of the last run."""

    def apply(self, services: dict[str, dict[str, object]]) -> None:
        self.file.write_text(edf("twelve", services, placement={"slots_per_robot": 2}), encoding="utf-8")
        done = self.lab.srprov("apply", str(self.file), "-i", self.inventory, "--yes", "--settle", "0", "--json")
        assert done.code == 0, done
        self.record = done.json["run"]

    def exec(self, name: str, script: str, robot: str = "") -> str:
        """Run a script in a service's container."""
        return self.lab.shell(robot or HOME[name], "docker", "exec", f"srprov.twelve.{name}", "sh", "-c", script).out

    def every(self, script: str) -> dict[str, str]:
        """Run a script in all twelve containers at the same time."""
        with ThreadPoolExecutor(len(NAMES)) as pool:
            return dict(zip(NAMES, pool.map(lambda name: self.exec(name, script), NAMES), strict=True))

    def look(self) -> dict[str, dict[str, str]]:
        """Give, by Docker's own word, what there is of each of the twelve containers."""
        form = "{{.Id}} {{.State.StartedAt}} {{range .NetworkSettings.Networks}}{{.IPAddress}}{{end}} {{.State.Pid}}"

        def one(name: str) -> dict[str, str]:
            words = self.lab.shell(HOME[name], "docker", "inspect", "--format", form, f"srprov.twelve.{name}").out
            return dict(zip(("id", "started", "ip", "pid"), words.split(), strict=True))

        with ThreadPoolExecutor(len(NAMES)) as pool:
            return dict(zip(NAMES, pool.map(one, NAMES), strict=True))


@pytest.fixture(scope="module")
def twelve(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Twelve:
    """Bring up one service on each of twelve robots that have a slot more."""
    folder = tmp_path_factory.mktemp("twelve")
    inventory = part_of_lab(lab_of_module, [*HOME.values()], folder / "lab.yml")
    made = Twelve(lab_of_module, folder / "twelve.edf", inventory)
    made.apply({name: busybox(robot=HOME[name]) for name in NAMES})
    return made


def test_all_twelve_run_where_they_should(twelve: Twelve) -> None:
    """`apply` brings up one container on each of twelve robots, and no other."""
    with ThreadPoolExecutor(4) as pool:
        there = pool.map(lambda robot: list(twelve.lab.containers(robot, running=True)), HOME.values())
    assert dict(zip(HOME, there, strict=True)) == {name: [f"srprov.twelve.{name}"] for name in NAMES}


def test_every_service_pings_every_other_by_name(twelve: Twelve) -> None:
    """All 132 pairs reach each other by service name, at the address that Docker gave the other."""
    ips = {name: found["ip"] for name, found in twelve.look().items()}
    assert len(set(ips.values())) == len(NAMES)
    script = f"for n in {' '.join(NAMES)}; do test $n = $(hostname) || ping -c 1 -W 2 $n || echo LOST $n; done"
    said = twelve.every(script)
    for name, text in said.items():
        for other in NAMES:
            if other != name:
                assert f"PING {other} ({ips[other]})" in text, f"{name} -> {other}: {text}"
        assert text.count(" 0% packet loss") == len(NAMES) - 1, f"{name}: {text}"
        assert "LOST" not in text


def test_multicast_reaches_all_others(twelve: Twelve) -> None:
    """One UDP multicast datagram from each container arrives in the eleven others, from the sender's own address.

    With snooping and no querier, bridges would forget after minutes who listens; so it is off on every robot's bridge.
    """
    snooping = "cat /sys/class/net/srp*/bridge/multicast_snooping"
    assert {robot: twelve.lab.shell(robot, "sh", "-c", snooping).out for robot in HOME.values()} == dict.fromkeys(
        HOME.values(), "0\n"
    )
    found = twelve.look()
    with talkers(twelve.lab, found) as processes:
        for process in processes.values():
            assert line_of(process, 20) == "ready"
        for process in processes.values():
            assert process.stdin is not None
            process.stdin.write(b"go\n")
            process.stdin.flush()
        heard = {name: line_of(process, 20).split() for name, process in processes.items()}
    for name in NAMES:
        assert heard[name] == [f"{other}={found[other]['ip']}" for other in NAMES if other != name], name


def test_the_page_of_the_run_says_what_its_result_says(twelve: Twelve, tmp_path: Path) -> None:
    """Each number is that of result.json; the page is small, and names each pair of robots that was tried."""
    target = tmp_path / "page.html"
    done = twelve.lab.srprov("report", twelve.record, "-o", str(target))
    assert done.code == 0, done
    page = Page(target.read_text())
    result = json.loads(Path(twelve.record, "result.json").read_text())
    assert page.faults == [] and wrong_numbers(page, result) == []
    shown = {pointer: exact for pointer, exact, _ in page.numbers}
    assert shown["/changed"] == str(result["changed"]) and shown["/failed"] == "0"
    assert {f"/robots/{robot}/bytes_sent" for robot in HOME.values()} <= shown.keys()
    assert target.stat().st_size < 300_000
    assert "Critical path" in page.text and f"all {result['probe']['pairs']} pairs" in page.text


def test_a_thirteenth_joins_and_nobody_restarts(twelve: Twelve) -> None:
    """A service that is added starts somewhere; no other container is touched, and all know its name."""
    before = twelve.look()
    twelve.apply({**{name: busybox(robot=HOME[name]) for name in NAMES}, "extra": busybox()})
    assert twelve.look() == before
    with ThreadPoolExecutor(4) as pool:
        there = dict(zip(HOME.values(), pool.map(twelve.lab.containers, HOME.values()), strict=True))
    homes = [robot for robot, found in there.items() if "srprov.twelve.extra" in found]
    assert len(homes) == 1
    assert sum(len(found) for found in there.values()) == 13
    networks = twelve.lab.inspect(homes[0], "srprov.twelve.extra")["NetworkSettings"]["Networks"]
    (address,) = (network["IPAddress"] for network in networks.values())
    for name, text in twelve.every("ping -c 1 -W 2 extra").items():
        assert f"PING extra ({address})" in text and " 0% packet loss" in text, f"{name}: {text}"
    ask = f"for n in extra {' '.join(NAMES)}; do ping -c 1 -W 2 $n; done"
    own = twelve.exec("extra", ask, homes[0])
    assert own.count(" 0% packet loss") == 13, own
    plan = twelve.lab.srprov("plan", str(twelve.file), "-i", twelve.inventory, "--json")
    assert causes(plan.json) == {}


@contextlib.contextmanager
def talkers(lab: Lab, found: dict[str, dict[str, str]]) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Start the multicast script on every robot, inside its container's network; end it whatever happens."""
    processes: dict[str, subprocess.Popen[bytes]] = {}
    try:
        for name, seen in found.items():
            net = f"--net=/proc/{seen['pid']}/ns/net"
            inside = ["nsenter", net, "/usr/bin/python3", "-c", TALK, seen["ip"], name, str(len(found) - 1)]
            processes[name] = subprocess.Popen(
                [sys.executable, "-m", "srprov", "lab", "shell", HOME[name], *inside],
                cwd=lab.folder,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
            )
        yield processes
    finally:
        for process in processes.values():
            process.kill()
            process.communicate(timeout=120)


def line_of(process: subprocess.Popen[bytes], patience_s: float) -> str:
    """Give the next line that a process prints, or what there was of it at the deadline."""
    assert process.stdout is not None
    line, until = b"", time.monotonic() + patience_s
    while not line.endswith(b"\n") and (left := until - time.monotonic()) > 0:
        if not select.select([process.stdout], [], [], left)[0]:
            break
        byte = os.read(process.stdout.fileno(), 1)
        if not byte:
            break
        line += byte
    return line.decode().rstrip("\n")
