"""A bad cable: what robots with `rate_mbit` and `loss_percent` have between their eth0 and the bridge.

The rate is a token bucket at each end (`tc tbf`). Packets are lost where they arrive, in the
robot's own firewall and on the bridge: a firewall that drops what is being sent tells the sender.
Everything goes with the link, but for one firewall rule of this machine, which is found by its
name.
"""

from __future__ import annotations

from pathlib import Path

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab.machine import find, run, succeeds
from srprov.lab.places import Site
from srprov.lab.spec import Robot

QUEUE_MS = 50
"""What waits longer than this for its turn is dropped, as in a modem."""


def spoil(site: Site, robot: Robot, init: int) -> None:
    """Make the cable of the robot with this PID 1 as bad as its options say."""
    name, rate_mbit, loss_percent = robot.name, robot.rate_mbit, robot.loss_percent
    inside = ["nsenter", f"--net=/proc/{init}/ns/net", "--"]
    if rate_mbit:
        burst = max(6000, int(rate_mbit * 1e6 / 8 / 100))
        bucket = ["tbf", "rate", f"{rate_mbit * 1000:.0f}kbit", "burst", str(burst), "latency", f"{QUEUE_MS}ms"]
        run(["tc", "qdisc", "add", "dev", site.link(name), "root", *bucket])
        run([*inside, "tc", "qdisc", "add", "dev", "eth0", "root", *bucket])
    if loss_percent:
        _let_bridge_ask_firewall(site.bridge_of(robot.lan))
        run([*inside, "iptables", "-w", "-t", "mangle", "-I", "PREROUTING", *_loses(site, "-i eth0", loss_percent)])
        arriving = _loses(site, f"-m physdev --physdev-in {site.link(name)}", loss_percent)
        run(["iptables", "-w", "-t", "mangle", "-I", "PREROUTING", *arriving])


def _loses(site: Site, where: str, percent: float) -> list[str]:
    chance = f"-m statistic --mode random --probability {percent / 100:.6f}"
    return f"{where} {chance} -m comment --comment {site.tag} -j DROP".split()


def _let_bridge_ask_firewall(bridge: str) -> None:
    """The bridge shows its frames to iptables; the setting goes with the bridge."""
    setting = Path(f"/sys/class/net/{bridge}/bridge/nf_call_iptables")
    try:
        setting.write_text("1")
    except OSError as error:
        raise LabError(
            "loss_percent: the bridge cannot ask iptables", hint="modprobe br_netfilter", code=Code.LAB_MACHINE
        ) from error


def repair(site: Site, name: str | None = None) -> None:
    """Take away the rules of this robot's cable, or of all cables of the lab."""
    if find("iptables-save") is None:
        return
    for line in run(["iptables-save", "-t", "mangle"]).splitlines():
        words = line.split()
        ours = words[:2] == ["-A", "PREROUTING"] and site.tag in words and "--physdev-in" in words
        if ours and (name is None or site.link(name) in words):
            succeeds(["iptables", "-w", "-t", "mangle", "-D", *words[1:]])
