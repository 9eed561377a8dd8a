"""The four measures of the paper: what is run for each, and what its output says.

The paper used netperf, which Debian does not have. TCP_RR and UDP_RR are qperf's `tcp_lat` and `udp_lat` with messages
of one byte, as netperf's: a transaction is one message each way. sockperf would do too, but its messages have 14 bytes
or more, and it sleeps for 2 s before each run. TCP_STREAM and UDP_STREAM are iperf3's; UDP counts what the receiver
got, as in the paper.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

from benchmarks.network.link import Link
from benchmarks.provisioning.robots import Trouble

MEASURES = ("TCP_RR", "UDP_RR", "TCP_STREAM", "UDP_STREAM")
UNITS = {"TCP_RR": "1/s", "UDP_RR": "1/s", "TCP_STREAM": "Mbit/s", "UDP_STREAM": "Mbit/s"}
CONTROL = "reno"
"""TCP's congestion control: defaults differ, and a container may choose this one on every machine."""
LONGEST_S = 8
UDP_HEADERS = 28
"""Of IPv4 and UDP."""
_OFFERED = 1.25
"""Times the link's rate that UDP_STREAM sends, so that the link is the limit."""
_STREAM_S = 0.4
"""How long a stream over a limited link lasts, about; over the other, a second."""
_OMITTED_S = 1
"""Of a TCP stream over a limited link, not counted: its slow start. The paper's streams lasted ten seconds."""


@dataclass(frozen=True)
class Target:
    """Where the servers of both programs listen."""

    address: str
    iperf3: int
    qperf: int
    mtu: int
    """Of the client's interface."""


def servers(target: Target) -> str:
    """Return the shell command that starts both servers in the background."""
    return (
        f"iperf3 -s -p {target.iperf3} >/dev/null 2>&1 & "
        f"while :; do qperf -lp {target.qperf}; sleep 0.2; done >/dev/null 2>&1 &"
    )


def command(measure: str, target: Target, link: Link) -> str:
    """Return the shell command of one measurement."""
    if measure.endswith("_RR"):
        test = "tcp_lat" if measure == "TCP_RR" else "udp_lat"
        return f"timeout {LONGEST_S} qperf {target.address} -lp {target.qperf} -t 1 -m 1 -uu --precision 7 -v {test}"
    base = f"timeout {LONGEST_S} iperf3 -J -c {target.address} -p {target.iperf3} {_length(measure, link)}"
    if measure == "TCP_STREAM":
        return f"{base} -C {CONTROL}" + (f" -O {_OMITTED_S}" if link.rate_mbit else "")
    rate = f"{link.rate_mbit * _OFFERED:.0f}M" if link.rate_mbit else "0"
    return f"{base} -u -b {rate} -l {target.mtu - UDP_HEADERS}"


def _length(measure: str, link: Link) -> str:
    if not link.rate_mbit:
        return "-t 1"
    offered = _OFFERED if measure == "UDP_STREAM" else 1.0
    return f"-n {link.rate_mbit * 1e6 / 8 * offered * _STREAM_S:.0f}"


def value(measure: str, code: int, said: str) -> float:
    """Return transactions a second, or Mbit/s, of what a program printed.

    Raises:
        Trouble: It failed, or its output is not what is known of it.
    """
    if code:
        raise Trouble(f"{measure}: exit {code}: {said.strip()[-300:]}")
    if measure.endswith("_RR"):
        found = re.search(r"msg_rate\s*=\s*([\d.]+) /sec", said)
        if not found:
            raise Trouble(f"{measure}: {said.strip()[-300:]}")
        return float(found[1]) / 2  # it counts the messages of both directions
    try:  # a warning may come first
        return float(json.loads(said[said.index("{") :])["end"]["sum_received"]["bits_per_second"]) / 1e6
    except (ValueError, KeyError, TypeError) as error:
        raise Trouble(f"{measure}: {said.strip()[-300:]}") from error
