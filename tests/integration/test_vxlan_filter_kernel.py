"""The scripts of vxlan filters on a real kernel, with nftables, with either iptables, and with none of them.

Needs root. A robot that lacks a program is a namespace whose scripts find only links to the programs that it has.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.modules import MODULES
from srprov.modules.vxlan_rules import closed_first, rules_hash
from srprov.resource import Observed
from srprov.wire import Query, Reply, Run
from tests.resources import resource

PROGRAMS = ("nft", "xtables-nft-multi", "xtables-legacy-multi")
pytestmark = [
    pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces need root"),
    pytest.mark.skipif(not all(map(shutil.which, PROGRAMS)), reason="needs nft and both iptables"),
]
MODULE = MODULES["vxlan_filter"]
NAME = "srpv00000001"
PARAMS: dict[str, Any] = {
    "instance": "hello", "vni": 1048577, "port": 4789, "local": "192.0.2.1", "peers": ["192.0.2.2", "192.0.2.3"],
}  # fmt: skip
HASH = rules_hash(PARAMS["vni"], PARAMS["port"], PARAMS["local"], PARAMS["peers"])
SIX: dict[str, Any] = {**PARAMS, "local": "2001:db8::1", "peers": ["2001:db8::2"]}


class Robot:
    """A network namespace, a shell, and some of the programs for rules."""

    def __init__(self, name: str, folder: Path, shell: str) -> None:
        self.name, self.folder, self.shell = name, folder, shell
        for program in ("grep", "sed", "cat"):
            self.has(program, program)

    def has(self, name: str, program: str) -> None:
        """Give it a program, under a name."""
        found = shutil.which(program)
        assert found is not None
        (self.folder / name).symlink_to(found)

    def has_iptables(self, program: str) -> None:
        for family in ("ip", "ip6"):
            for end in ("", "-save", "-restore"):
                self.has(f"{family}tables{end}", program)

    def run(self, script: str, *, path: str = "") -> Reply:
        """Run a script there, in a shell that finds only what the robot has."""
        shell = [str(shutil.which(word)) if at == 0 else word for at, word in enumerate(self.shell.split())]
        command = [str(shutil.which("nsenter")), f"--net=/run/netns/{self.name}", *shell, "-c", script]
        env = {"PATH": path or str(self.folder)}
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=env, check=False)
        return Reply(status=done.returncode, out=done.stdout, err=done.stderr, ok=done.returncode == 0)

    def see(self) -> Observed | None:
        (query,) = (one for one in MODULE.queries() if isinstance(one, Query))
        reply = self.run(query.command)
        assert reply.ok and not reply.err, reply
        found = MODULE.parse([reply])
        return next(iter(found), None)

    def make(self, params: dict[str, Any]) -> Reply:
        """Do what is due; where that succeeded, nothing is due then."""
        want, found = resource("vxlan_filter", NAME, params), self.see()
        change = MODULE.check(NAME, want.params, found.state if found else None)
        assert change is not None
        (command,) = change.commands
        assert isinstance(command, Run)
        reply, after = self.run(command.script), self.see()
        assert not reply.ok or (after is not None and MODULE.check(NAME, want.params, after.state) is None), reply
        return reply

    def rules(self) -> str:
        """Give all that the kernel has of us, by programs that the robot may lack."""
        every = "nft list ruleset; iptables-nft-save; iptables-legacy-save; ip6tables-legacy-save"
        text = self.run(every, path=os.environ["PATH"]).out
        return "\n".join(line for line in text.splitlines() if "srpv" in line or "srprov" in line)


@pytest.fixture(params=["dash", "busybox sh"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Robot]:
    """Return a namespace without programs for rules, once with each shell that robots have."""
    if not shutil.which(request.param.split()[0]):
        pytest.skip(f"{request.param} is not installed")
    name = f"srtest{os.getpid()}"
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        yield Robot(name, tmp_path, request.param)
    finally:
        subprocess.run(["ip", "netns", "del", name], check=True)


@pytest.mark.parametrize("program", PROGRAMS)
def test_rules_are_made_found_replaced_and_removed(robot: Robot, program: str) -> None:
    """With each program, other members and another IP version too; nothing of ours is left in the end."""
    if program == "nft":
        robot.has("nft", "nft")
    else:
        robot.has_iptables(program)
    for params in (PARAMS, {**PARAMS, "peers": ["192.0.2.2"]}, {**PARAMS, "peers": []}, SIX):
        assert robot.make(params).ok
    found = robot.see()
    assert found is not None
    assert found.state["by"] == ["nftables" if program == "nft" else "iptables"]
    for command in (*MODULE.removal(found), *MODULE.removal(found)):
        assert isinstance(command, Run)
        assert robot.run(command.script).ok, "also when it is gone already"
    assert robot.see() is None
    assert robot.rules() == ""


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_is_left_of_rules_that_somebody_flushed_is_found_mended_and_removed(robot: Robot, program: str) -> None:
    """Tables and chains without a rule let everybody in: no link is made with them, and destroy takes them away."""
    if program == "nft":
        robot.has("nft", "nft")
        flush = f"nft flush table inet {NAME}; nft flush table bridge {NAME}"
    else:
        robot.has_iptables(program)
        flush = "iptables -t raw -F"
    assert robot.make(PARAMS).ok
    assert robot.run(closed_first(NAME, HASH)).ok
    for one in ({"port": 4790}, {"vni": 5}, {"peers": ["192.0.2.2"]}, {"local": "192.0.2.9"}):
        other = {**PARAMS, **one}
        wanted = rules_hash(other["vni"], other["port"], other["local"], other["peers"])
        assert not robot.run(closed_first(NAME, wanted)).ok, "they close another overlay"
    for mended in (True, False):
        assert robot.run(flush).ok
        assert not robot.run(closed_first(NAME, HASH)).ok
        found = robot.see()
        assert found is not None and found.instance == ""
        if mended:
            assert robot.make(PARAMS).ok
            assert robot.run(closed_first(NAME, HASH)).ok
        else:
            (command,) = MODULE.removal(found)
            assert isinstance(command, Run) and robot.run(command.script).ok
    assert robot.see() is None
    assert robot.rules() == ""


def test_a_rule_that_accepts_all_counts_in_its_own_family_alone(robot: Robot) -> None:
    """One of iptables says nothing of what ip6tables lets in."""
    robot.has_iptables("xtables-legacy-multi")
    assert robot.make(SIX).ok
    assert robot.run("iptables -t raw -I PREROUTING -j ACCEPT").ok
    found = robot.see()
    assert found is not None and not found.state["passed"]
    assert robot.run("ip6tables -t raw -I PREROUTING -j ACCEPT").ok
    found = robot.see()
    assert found is not None and found.state["passed"]


def test_rules_of_iptables_give_way_to_nftables(robot: Robot) -> None:
    """Who installs nftables later gets its rules with the next change, and those of iptables are removed."""
    robot.has_iptables("xtables-legacy-multi")
    assert robot.make(PARAMS).ok
    robot.has("nft", "nft")
    assert robot.make({**PARAMS, "peers": ["192.0.2.2"]}).ok
    found = robot.see()
    assert found is not None
    assert found.state["by"] == ["nftables"]
    assert "srpv00000001-in" not in robot.rules()


def test_a_robot_without_either_is_refused_in_words(robot: Robot) -> None:
    reply = robot.make(PARAMS)
    assert not reply.ok
    assert "neither nft nor iptables works here; apt-get install nftables" in reply.err


def test_looking_makes_no_table(robot: Robot) -> None:
    """A question changes nothing: the old iptables would make the table that it is asked for."""
    robot.has_iptables("xtables-legacy-multi")
    assert robot.see() is None
    assert robot.run("cat /proc/net/ip_tables_names").out == ""
