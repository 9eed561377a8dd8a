"""The cable between two robots of the lab made like the paper's Wi-Fi: a rate that both directions share, and a delay.

The paper names no rate. Its tables give one: mean = deviation / CV, so 97 Mbit/s for TCP, 102 Mbit/s for UDP, and 446
and 434 transactions a second. A bucket of 105 Mbit/s for both directions together, with Ethernet's 14 bytes counted,
carries as much: 105 * 1448 / (1514 + 66 / 2) = 98 of TCP, with an acknowledgement for each two segments, and
105 * 1472 / 1514 = 102 of UDP. 1 / 446 s is 2.24 ms for both ways.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.provisioning.robots import Trouble
from srprov.lab.places import Site

IFB, BRIDGE, TAPS = "srbn-ifb", "srbn-br", ("srbn-a", "srbn-b")
BURST_BYTES, QUEUE_MS = 16384, 50


@dataclass(frozen=True)
class Link:
    """What the cable between two robots is like."""

    rate_mbit: float
    """For both directions together; 0 for as fast as the machine is."""
    delay_us: int
    """One way, on top of what the lab needs."""

    @property
    def words(self) -> str:
        """What a table's head says."""
        if not self.rate_mbit:
            return "as fast as the machine is"
        return f"{self.rate_mbit:g} Mbit/s for both directions together, {self.delay_us / 1000:g} ms of delay each way"


LINKS = {"limited": Link(105, 1020), "full": Link(0, 0)}


@contextlib.contextmanager
def shaped(site: Site, first: str, second: str, link: Link) -> Iterator[None]:
    """Let the cable between two robots be like that for a while."""
    if not link.rate_mbit:
        yield
        return
    ends = (site.link(first), site.link(second))
    with _late(site.bridge, ends[1], link.delay_us):
        _unshare(ends)
        try:
            _share(ends, link.rate_mbit)
            yield
        finally:
            _unshare(ends)


def _share(ends: tuple[str, str], rate_mbit: float) -> None:
    """Lead what both robots send through one token bucket."""
    _run("ip", "link", "add", IFB, "type", "ifb")
    _run("ip", "link", "set", IFB, "up")
    bucket = f"tbf rate {rate_mbit * 1000:.0f}kbit burst {BURST_BYTES} latency {QUEUE_MS}ms"
    _run("tc", "qdisc", "add", "dev", IFB, "root", *bucket.split())
    for end in ends:
        _run("tc", "qdisc", "add", "dev", end, "clsact")
        through = f"protocol all u32 match u32 0 0 action mirred egress redirect dev {IFB}"
        _run("tc", "filter", "add", "dev", end, "ingress", *through.split())


def _unshare(ends: tuple[str, str]) -> None:
    for words in (*(["tc", "qdisc", "del", "dev", end, "clsact"] for end in ends), ["ip", "link", "del", IFB]):
        subprocess.run(words, capture_output=True, timeout=30, check=False)  # it may not be there


@contextlib.contextmanager
def _late(bridge: str, end: str, delay_us: int) -> Iterator[None]:
    """Put the delay between a robot's cable and the lab's bridge."""
    program = (sys.executable, str(Path(__file__).with_name("delay.py")), *TAPS, str(delay_us))
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True) as cable:
        try:
            assert cable.stdout is not None
            if cable.stdout.readline() != b"ready\n":
                raise Trouble("the program that delays frames did not start")
            subprocess.run(
                ["ip", "link", "del", BRIDGE], capture_output=True, timeout=30, check=False
            )  # of a killed run
            _run("ip", "link", "add", BRIDGE, "type", "bridge")
            for device, master in ((TAPS[0], BRIDGE), (TAPS[1], bridge), (end, BRIDGE)):
                _run("ip", "link", "set", device, "master", master, "up")
            _run("ip", "link", "set", BRIDGE, "up")
            yield
        finally:
            _run("ip", "link", "set", end, "master", bridge)
            subprocess.run(["ip", "link", "del", BRIDGE], capture_output=True, timeout=30, check=False)
            cable.communicate(timeout=10)  # its standard input ends, and so does it


def _run(*words: str) -> None:
    subprocess.run(words, check=True, timeout=30)
