"""An overlay is closed: what does not come from a member's kernel reaches nobody, and destroy leaves no rule."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from tests.lab.conftest import Lab, busybox, causes, edf, only_the_record, part_of_lab
from tests.lab.injection import TOOL
from tests.lab.looks import begin_on, ids

pytestmark = pytest.mark.lab

MEMBERS = ("robot1", "robot2")
STRANGER = "robot3"
MAC = "02:00:00:00:00:77"
OWN_RULES = """
iptables -t raw -A PREROUTING -p udp --dport 9 -j DROP
iptables -A INPUT -p udp --dport 9 -m comment --comment mine -j DROP
ip6tables -t raw -A PREROUTING -p udp --dport 9 -j DROP
nft 'table inet mine { chain in { type filter hook input priority 0; policy accept; udp dport 10 counter accept; }; }'
"""
"""A firewall that a robot has from before, of both kinds."""
NO_OWN_RULES = """
iptables -t raw -D PREROUTING -p udp --dport 9 -j DROP
iptables -D INPUT -p udp --dport 9 -m comment --comment mine -j DROP
ip6tables -t raw -D PREROUTING -p udp --dport 9 -j DROP
nft delete table inet mine
"""
STATE = """
ip -o -d link | sed 's/^[0-9]*: //; s/[a-z_]*_timer *[0-9.]*//g'
ip rule; ip -6 rule; ip route show table all | grep -v fe80:
docker network ls --format '{{.Name}} {{.Driver}}'; nft -s list ruleset
{ iptables-save; ip6tables-save; } | sed 's/^#.*//; s/ \\[.*//'; find /proc/sys/net -type f | sort
grep -s . /proc/sys/net/ipv4/ip_forward /proc/sys/net/ipv4/conf/*/rp_filter /proc/sys/net/bridge/*
"""
"""What a robot's network is, in words: links, rules, routes, Docker networks, firewall, names and values of sysctls."""


@dataclass
class Closed:
    """Two members with one service each, a robot that is none, and another experiment on a member and that robot."""

    lab: Lab
    words: tuple[str, ...]
    before: dict[str, set[str]]

    def inside(self, robot: str, container: str, *words: str) -> list[str]:
        """Give a command in the network of a container."""
        pid = self.lab.inspect(robot, container)["State"]["Pid"]
        return ["nsenter", "-t", str(pid), "-n", "python3", "-c", TOOL, *words]

    def link(self, robot: str) -> dict[str, Any]:
        """Give a member's VXLAN link by the kernel's word."""
        found = json.loads(self.lab.shell(robot, "ip", "-j", "-d", "link", "show", "type", "vxlan").out)
        (one,) = (each for each in found if each.get("ifalias") == "srprov:closed")
        assert isinstance(one, dict)
        return one

    def vni(self, instance: str) -> str:
        """Give an instance's VNI by the label of its network."""
        label = '{{index .Labels "srprov.vni"}}'
        return self.lab.shell(STRANGER, "docker", "network", "inspect", "-f", label, f"srprov.{instance}").out.strip()

    def vtep(self, robot: str) -> str:
        return str(self.link(robot)["linkinfo"]["info_data"]["local"])

    def dropped(self) -> int:
        """Give how many packets our rules have dropped on the members."""
        script = "nft list ruleset 2>/dev/null; iptables-save -c -t raw"
        found = 0
        for robot in MEMBERS:
            for line in self.lab.shell(robot, "sh", "-c", script).out.splitlines():
                count = re.search(r"counter packets (\d+) .* drop comment|^\[(\d+):.* -j DROP", line)
                if count and "srprov:closed:" in line:
                    found += int(count[1] or count[2])
        return found

    def seen(self, *tries: tuple[str, list[str]]) -> dict[str, list[str]]:
        """Have robots try to send, then the members' containers themselves; give what each container saw."""
        listeners = {
            robot: begin_on(self.lab, robot, *self.inside(robot, f"srprov.closed.s{robot[-1]}", "listen"))
            for robot in MEMBERS
        }
        for one in listeners.values():
            assert one.stdout is not None and one.stdout.readline() == "ready\n"
        for robot, words in tries:
            self.lab.shell(robot, *words)
        for robot in MEMBERS:
            for word in (f"friend on {robot}", "end"):
                self.lab.shell(robot, *self.inside(robot, f"srprov.closed.s{robot[-1]}", "plain", word, MAC))
        return {robot: finished(one) for robot, one in listeners.items()}

    def attempts(self, *ways: str) -> tuple[set[str], list[tuple[str, list[str]]]]:
        """Give the words that others try to send to both members, and each one's robot and command."""
        data = self.link("robot1")["linkinfo"]["info_data"]
        head = (MAC, str(data["id"]), str(data["port"]))
        rest = (*head, ",".join(self.vtep(robot) for robot in MEMBERS))
        any_port = ",".join(way for way in ways if "low" not in way)
        user = ["setpriv", "--reuid=1000", "--regid=1000", "--clear-groups", "python3", "-c", TOOL]
        gateway = self.lab.inspect("robot1", "bridged")["NetworkSettings"]["Gateway"]
        forged = ("forged", "forged", *head, self.vtep("robot1"), self.vtep("robot2"))
        tries = [
            (STRANGER, ["python3", "-c", TOOL, "udp", "stranger", *rest, ",".join(ways)]),
            # it is a member of the other experiment, as robot1 is
            (STRANGER, ["python3", "-c", TOOL, "udp", "neighbour", *rest, ",".join(ways), self.vni("other")]),
            ("robot1", self.inside("robot1", "bridged", "udp", "bridged", *rest, ",".join(ways))),
            ("robot1", self.inside("robot1", "srprov.other.s1", "udp", "other", *rest, ",".join(ways))),
            ("robot1", [*user, "udp", "user", *rest, any_port]),
            ("robot1", self.inside("robot1", "bridged", *forged)),
            # an address of the robot on the bridge that the packet comes from
            ("robot1", self.inside("robot1", "bridged", "forged", "gateway", *head, gateway, self.vtep("robot2"))),
        ]
        words = {f"{who} {way}" for who in ("stranger", "neighbour", "bridged", "other") for way in ways}
        return words | {f"user {way}" for way in any_port.split(",")} | {"forged", "gateway"}, tries

    def claim(self) -> tuple[str, list[str]]:
        """Give what has a container of another experiment taken for whom a member's packets are for."""
        port = str(self.link("robot1")["linkinfo"]["info_data"]["port"])
        return "robot1", self.inside("robot1", "srprov.other.s1", "claim", port, self.vtep("robot2"))

    def apply(self) -> dict[str, Any]:
        done = self.lab.srprov("apply", *self.words, "--yes", "--settle", "0", "--json")
        assert done.code == 0, done
        assert isinstance(done.json, dict)
        return done.json

    def plan(self) -> dict[str, str]:
        done = self.lab.srprov("plan", *self.words, "--json")
        assert done.code == 0, done
        return causes(done.json)

    def destroy(self) -> None:
        done = self.lab.srprov("destroy", *self.words, "--yes")
        assert done.code == 0, done


def finished(listener: subprocess.Popen[str]) -> list[str]:
    """Give what a listener saw up to its end."""
    out, err = listener.communicate(timeout=120)
    assert listener.returncode == 0, err
    return [line for line in out.splitlines() if line != "end"]


def state(lab: Lab, robot: str) -> set[str]:
    return set(lab.shell(robot, "sh", "-c", STATE).out.splitlines())


@pytest.fixture(scope="module")
def closed(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Closed]:
    """Bring up the other experiment and a container on Docker's own bridge; the robots have firewalls of their own."""
    lab, folder = lab_of_module, tmp_path_factory.mktemp("closed")
    other, path = folder / "other.edf", folder / "closed.edf"
    other.write_text(edf("other", {"s1": busybox(robot="robot1"), "s3": busybox(robot=STRANGER)}), encoding="utf-8")
    path.write_text(edf("closed", {f"s{robot[-1]}": busybox(robot=robot) for robot in MEMBERS}), encoding="utf-8")
    inventory = part_of_lab(lab, [*MEMBERS, STRANGER], folder / "lab.yml")
    done = lab.srprov("apply", str(other), "-i", inventory, "--yes", "--settle", "0")
    assert done.code == 0, done
    lab.shell("robot1", "docker", "run", "-d", "--name", "bridged", "busybox", "sleep", "86400")
    for robot in MEMBERS:
        lab.shell(robot, "sh", "-ec", OWN_RULES)
    yield Closed(lab, (str(path), "-i", inventory), {robot: state(lab, robot) for robot in MEMBERS})
    for robot in MEMBERS:
        lab.shell(robot, "sh", "-c", "[ ! -e /usr/sbin/nft.away ] || mv /usr/sbin/nft.away /usr/sbin/nft")
        lab.shell(robot, "sh", "-c", NO_OWN_RULES)


def test_only_members_get_frames_into_the_overlay(closed: Closed) -> None:
    """Whoever else sends, with the right VNI and addresses, is delivered to nobody, is counted, and the rules are why.

    Without the rules all are delivered; then the plan names that, and the next apply closes it, no container touched.
    """
    closed.apply()
    before, (words, tries) = closed.dropped(), closed.attempts("any", "low", "segment", "low segment")
    assert closed.seen(*tries) == {"robot1": ["friend on robot2"], "robot2": ["friend on robot1"]}
    assert closed.dropped() - before >= 2 * len(words) - 2

    link = closed.link("robot1")["ifname"]
    for robot in MEMBERS:
        closed.lab.shell(robot, "sh", "-c", f"nft delete table bridge {link}; nft delete table inet {link}")
    opened = closed.seen(*tries)
    friends = {f"friend on {robot}" for robot in MEMBERS}
    assert {word for seen in opened.values() for word in seen} == words | friends
    was = ids(closed.lab, MEMBERS, "closed")
    missing = "create: not there: any host could send into the overlay"
    assert closed.plan() == {f"{robot}/vxlan_filter:{link}": missing for robot in MEMBERS}
    assert closed.apply()["changed"] == 2
    assert closed.plan() == {}
    assert ids(closed.lab, MEMBERS, "closed") == was
    closed.destroy()
    for robot in MEMBERS:
        assert state(closed.lab, robot) ^ closed.before[robot] == set()
    assert closed.lab.leftovers("robot2") == only_the_record("other")


def test_a_robot_that_cannot_close_an_overlay_is_named_with_the_reason(closed: Closed) -> None:
    """Without nft and iptables `doctor` says it, and its service goes nowhere: 8, and nothing is done."""
    lab, hidden = closed.lab, ("nft", "iptables-save", "iptables")
    for one in hidden:
        lab.shell("robot2", "mv", f"/usr/sbin/{one}", f"/usr/sbin/{one}.away")
    try:
        warned = lab.srprov("doctor", *closed.words[1:], "--limit", "robot2", "--json")
        refused = lab.srprov("apply", *closed.words, "--yes")
    finally:
        for one in hidden:
            lab.shell("robot2", "mv", f"/usr/sbin/{one}.away", f"/usr/sbin/{one}")
    (check,) = [one for one in warned.json["robots"]["robot2"] if one["check"] == "rules"]
    assert check["verdict"] == "failed" and "nftables" in check["remedy"]
    assert refused.code == 8, refused
    assert "robot2: neither nft nor iptables, to keep others out of the overlay" in refused.err
    assert lab.leftovers("robot2") == only_the_record("other")


def test_robots_without_nftables_are_closed_by_iptables(closed: Closed) -> None:
    """The same senders are kept out, rules that go by a reload are named and made again, and nothing is left."""
    for robot in MEMBERS:
        closed.lab.shell(robot, "mv", "/usr/sbin/nft", "/usr/sbin/nft.away")
    closed.apply()
    before, (words, tries) = closed.dropped(), closed.attempts("any", "low")
    assert closed.seen(*tries, closed.claim()) == {"robot1": ["friend on robot2"], "robot2": ["friend on robot1"]}
    assert closed.dropped() - before >= 2 * len(words) - 2
    link = closed.link("robot1")["ifname"]
    closed.lab.shell("robot2", "sh", "-ec", f"iptables -t raw -F {link}-in; iptables -t raw -I PREROUTING -j ACCEPT")
    ((name, cause),) = closed.plan().items()
    assert name == f"robot2/vxlan_filter:{link}"
    assert re.fullmatch(r"update: \d of \d+ rules are gone; a rule of iptables before it accepts all packets", cause)
    assert closed.apply()["changed"] == 1
    assert closed.plan() == {}
    closed.lab.shell("robot2", "iptables", "-t", "raw", "-D", "PREROUTING", "-j", "ACCEPT")
    closed.destroy()
    for robot in MEMBERS:
        closed.lab.shell(robot, "mv", "/usr/sbin/nft.away", "/usr/sbin/nft")
        assert state(closed.lab, robot) ^ closed.before[robot] == set()


def test_nobody_else_gets_what_members_send(closed: Closed) -> None:
    """A container that asked from the overlay's port is handed no answers; with iptables, the test before shows it."""
    # what robots sent each other while it was made is forgotten first, as after a pause
    remember = "net.netfilter.nf_conntrack_udp_timeout{,_stream}="
    closed.lab.shell("robot1", "bash", "-c", f"sysctl -w {remember}1")
    closed.apply()
    closed.lab.shell("robot1", "bash", "-c", f"sleep 3; sysctl -w {remember}30")
    assert closed.seen(closed.claim()) == {"robot1": ["friend on robot2"], "robot2": ["friend on robot1"]}
    closed.destroy()
