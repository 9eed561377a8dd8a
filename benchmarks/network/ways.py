"""Ways for two programs on two robots to reach each other: a shell at the near end, and the far end's address."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.network.measures import Target, servers
from benchmarks.network.shell import Shell, opened
from benchmarks.provisioning.robots import SITE, Lab, Trouble
from srprov.lab import lab as labs

PROGRAMS = ("iperf3", "qperf")
CDF = {
    "cdf": 1,
    "name": "end",
    "base": "debian:bookworm",
    "packages": {"apt": list(PROGRAMS)},
    "command": ["sleep", "infinity"],
}
PLAIN = "bench-plain"
"""The instance with srprov's overlay as it is without options."""
_APPLY_S, _READY_S = 300, 30


@dataclass
class Ends:
    """The near end of a way, and where the far one is."""

    client: Shell
    target: Target


@dataclass
class Site:
    """The lab's first two robots, a folder for files, and what ends the shells."""

    lab: Lab
    folder: Path
    stack: ExitStack
    ports: int = 21000

    def ask(self, robot: int, script: str) -> str:
        """Run a shell script on the first robot (0) or the second (1)."""
        return self.lab.enter(self.lab.robots[robot][0], script).strip()

    def ends(self, containers: tuple[str, str], address: str) -> Ends:
        """Open a shell in both containers, or on both robots; start the servers, and wait until the far ones answer.

        Raises:
            Trouble: They do not.
        """
        client, server = (self._shell(robot, container) for robot, container in enumerate(containers))
        self.ports += 2
        mtu = int(client.run("cat /sys/class/net/eth0/mtu")[1])
        target = Target(address, self.ports, self.ports + 1, mtu)
        server.run(servers(target))
        deadline = time.monotonic() + _READY_S
        while client.run(f"timeout 3 iperf3 -c {address} -p {target.iperf3} -n 1K")[0]:
            if time.monotonic() > deadline:
                raise Trouble(f"{address} does not answer within {_READY_S} s")
            time.sleep(0.2)
        return Ends(client, target)

    def _shell(self, robot: int, container: str) -> Shell:
        words = ["docker", "exec", "-i", container, "sh"] if container else ["sh"]
        return self.stack.enter_context(opened(labs.shell(SITE.name, self.lab.robots[robot][0], words)))

    def plain(self, name: str, network: str) -> tuple[str, str]:
        """Start a container of the same image on both robots, without srprov; give their names."""
        for robot in (0, 1):
            image = f"$(docker inspect -f '{{{{.Image}}}}' {_names(PLAIN)[robot]})"
            self.ask(robot, f"docker run -d --name {name} --network {network} {image} sleep infinity")
        return name, name

    def address(self, container: str) -> str:
        """Return the address of a container on the second robot."""
        form = "{{range .NetworkSettings.Networks}}{{.IPAddress}} {{end}}"
        return self.ask(1, f"docker inspect -f '{form}' {container}").split()[0]


def bring_up(site: Site, way: str) -> Ends:
    """Make a way; srprov's overlay must be the first, since the image of all containers comes with it.

    Raises:
        Trouble: It cannot be had; the message says why.
    """
    return MAKERS[way](site)


def _native(site: Site) -> Ends:
    return site.ends(("", ""), site.lab.robots[1][1])


def _host(site: Site) -> Ends:
    return site.ends(site.plain("bench-host", "host"), site.lab.robots[1][1])


def _overlay(site: Site) -> Ends:
    return _applied(site, PLAIN, {})


def _wireguard(site: Site) -> Ends:
    return _applied(site, "bench-wireguard", {"encryption": "wireguard"})


def _swarm(site: Site) -> Ends:
    """Make the first robot a manager, let the second join, and attach a plain container of each to one overlay."""
    own = [address for _, address in site.lab.robots]
    site.ask(0, f"docker swarm init --advertise-addr {own[0]} --listen-addr {own[0]}")
    token = site.ask(0, "docker swarm join-token -q worker")
    site.ask(1, f"docker swarm join --token {token} --advertise-addr {own[1]} --listen-addr {own[1]} {own[0]}:2377")
    site.ask(0, "docker network create -d overlay --attachable --subnet 10.99.0.0/24 bench-swarm")
    names = site.plain("bench-swarm", "bench-swarm")
    return site.ends(names, site.address(names[1]))


def _applied(site: Site, name: str, network: Mapping[str, Any]) -> Ends:
    """Apply an experiment with a service on each robot."""
    folder = site.folder / name
    folder.mkdir()
    (folder / "end.cdf").write_text(yaml.safe_dump(CDF))
    services = {f"end{number}": {"cdf": "end.cdf", "robot": site.lab.robots[number][0]} for number in (0, 1)}
    experiment = {"edf": 1, "name": name, "services": services, **({"network": dict(network)} if network else {})}
    (folder / "experiment.edf").write_text(yaml.safe_dump(experiment))
    words = ("-m", "srprov", "apply", "experiment.edf", "-i", str(site.lab.inventory), "--yes", "--settle", "0")
    argv = (sys.executable, *words, "--runs", "runs")
    done = subprocess.run(argv, cwd=folder, capture_output=True, text=True, timeout=_APPLY_S, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error:" in line] or ["no word of an error"]
        raise Trouble(f"srprov apply: exit {done.returncode}: {errors[0].strip()}")
    return site.ends(_names(name), site.address(_names(name)[1]))


def _names(instance: str) -> tuple[str, str]:
    return f"srprov.{instance}.end0", f"srprov.{instance}.end1"


MAKERS: Mapping[str, Callable[[Site], Ends]] = {
    "overlay": _overlay,
    "native": _native,
    "host": _host,
    "wireguard": _wireguard,
    "swarm": _swarm,
}
