"""Two sites in network namespaces: the robots of one are reached from there alone, and none from where srprov runs.

`ctl` has a bridge, the way to both sites, and no route to the lab; each site has a cable to that bridge and one to the
lab's, and routes that lead nowhere for the robots of the other. A real Dask scheduler runs in `ctl`, a real
`srprov worker` in each site.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from srprov.lab.machine import run
from tests.clusters import Cluster, cluster
from tests.lab.conftest import BEGUN, COMMAND_LIMIT_S, NAME, ROOT, Done, Lab

WAYS = {"ctl": "198.18.7.1", "west": "198.18.7.2", "east": "198.18.7.3"}
"""Addresses on the bridge of `ctl`: of the range for benchmarks between networks (RFC 2544)."""


class TwoSites:
    """The namespaces, the cluster, and an inventory that says who is where."""

    def __init__(self, lab: Lab, cluster: Cluster, folder: Path, sites: dict[str, Sequence[str]]) -> None:
        self.lab, self.cluster, self.folder, self.sites = lab, cluster, folder, sites
        whole = yaml.safe_load(lab.inventory.read_text(encoding="utf-8"))["all"]
        hosts = {
            robot: {**whole["hosts"][robot], "srprov_site": site} for site, robots in sites.items() for robot in robots
        }
        self.inventory = folder / "sites.yml"
        self.inventory.write_text(yaml.safe_dump({"all": {"hosts": hosts, "vars": whole.get("vars", {})}}))
        self.addresses = {robot: str(host["ansible_host"]) for robot, host in hosts.items()}

    def inside(self, where: str) -> list[str]:
        """Return the words before a command that runs in a namespace."""
        return ["nsenter", f"--net=/run/netns/{namespace(where)}"]

    def cache(self, site: str) -> Path:
        """Return where a site keeps what came."""
        return self.folder / f"cache-{site}"

    def start(self, site: str) -> None:
        """Start a site's worker."""
        env = {"XDG_CACHE_HOME": str(self.cache(site)), "PYTHONPATH": str(ROOT)}
        self.cluster.start_worker(site, "--host", WAYS[site], inside=self.inside(site), env=env)

    def srprov(self, *words: str, engine: bool = True) -> Done:
        """Run srprov where no robot is reached, through the cluster unless told otherwise."""
        run = self.begin(*words, engine=engine)
        out, err = run.communicate(timeout=COMMAND_LIMIT_S)
        return Done(run.returncode, out, err)

    def begin(self, *words: str, engine: bool = True) -> subprocess.Popen[str]:
        """Start it and go on."""
        verb, *rest = words
        through = ["--engine", self.cluster.address] if engine else []
        begun = subprocess.Popen(
            [*self.inside("ctl"), sys.executable, "-m", "srprov", verb, *through, *rest],
            cwd=self.folder, env={**os.environ, **self.cluster.env, "PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        BEGUN.append(begun)
        return begun

    def bytes_to(self, site: str) -> tuple[int, int]:
        """Return what went to a site so far, and what came from there, by the kernel's word on its cable in `ctl`."""
        words = [*self.inside("ctl"), "sh", "-c", f"cat /proc/net/dev | grep {site}:"]
        counters = subprocess.run(words, capture_output=True, text=True, check=True).stdout.partition(":")[2].split()
        return int(counters[8]), int(counters[0])


def namespace(where: str) -> str:
    """Return the name of a namespace; each process of tests has its own."""
    return f"{NAME}-{where}"


@contextlib.contextmanager
def two_sites(lab: Lab, folder: Path, west: Sequence[str], east: Sequence[str]) -> Iterator[TwoSites]:
    """Give two sites with their workers; everything is gone afterwards."""
    sites = {"west": west, "east": east}
    with contextlib.ExitStack() as stack, cluster(folder) as dask:
        made = TwoSites(lab, dask, folder, sites)
        for where in WAYS:
            run(["ip", "netns", "add", namespace(where)])
            stack.callback(run, ["ip", "netns", "del", namespace(where)])
            run([*made.inside(where), "ip", "link", "set", "lo", "up"])
        run([*made.inside("ctl"), "ip", "link", "add", "ways", "type", "bridge"])
        run([*made.inside("ctl"), "ip", "addr", "add", f"{WAYS['ctl']}/24", "dev", "ways"])
        run([*made.inside("ctl"), "ip", "link", "set", "ways", "up"])
        for number, site in enumerate(sites):
            _connect(made, site, number)
        dask.start_scheduler(WAYS["ctl"], made.inside("ctl"))
        for site in sites:
            made.start(site)
        yield made


def _connect(made: TwoSites, site: str, number: int) -> None:
    """Give a site its two cables, and no way to the robots of the other."""
    lan = made.lab.site.subnet_of(1)
    ctl, inside = made.inside("ctl"), made.inside(site)
    run(["ip", "link", "add", site, "netns", namespace("ctl"), "type", "veth", "peer", "way", "netns", namespace(site)])
    run([*ctl, "ip", "link", "set", site, "master", "ways", "up"])
    run([*inside, "ip", "addr", "add", f"{WAYS[site]}/24", "dev", "way"])
    run([*inside, "ip", "link", "set", "way", "up"])
    cable = f"sites{os.getpid() % 100000}{number}"
    run(["ip", "link", "add", cable, "type", "veth", "peer", "lab", "netns", namespace(site)])
    run(["ip", "link", "set", cable, "master", made.lab.site.bridge_of(1), "up"])
    run([*inside, "ip", "addr", "add", f"{lan[-10 - number]}/{lan.prefixlen}", "dev", "lab"])
    run([*inside, "ip", "link", "set", "lab", "up"])
    for other, robots in made.sites.items():
        for robot in robots if other != site else ():
            run([*inside, "ip", "route", "add", "blackhole", f"{made.addresses[robot]}/32"])
