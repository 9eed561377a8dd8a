"""The scripts of vxlan resources on a real kernel, in a network namespace that lives as long as one test.

Needs root and iproute2. `nsenter --net` runs the scripts, since `ip netns exec` would mount another /sys.
"""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.modules import MODULES
from srprov.modules.vxlan_rules import rules_hash
from srprov.resource import Action, Change, Resource
from srprov.robot_answers import TooManyError
from srprov.wire import Query, Reply, Run
from tests.resources import resource

pytestmark = [
    pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces need root"),
    pytest.mark.skipif(not all(map(shutil.which, ("ip", "bridge", "nsenter"))), reason="needs iproute2 and nsenter"),
    pytest.mark.skipif(shutil.which("nft") is None, reason="needs nft"),
]

MODULE = MODULES["vxlan"]
FLOOD = "00:00:00:00:00:00"
PARAMS: dict[str, Any] = {
    "instance": "hello",
    "vni": 1048577,
    "local": "192.0.2.1",
    "port": 4789,
    "bridge": "srpb00000001",
    "mtu": 1450,
    "fdb": [[FLOOD, "192.0.2.2"], [FLOOD, "192.0.2.3"], ["02:aa:bb:cc:dd:01", "192.0.2.2"]],
}


class Robot:
    """One network namespace with an underlay and a bridge, as Docker makes it."""

    def __init__(self, name: str, shell: tuple[str, ...]) -> None:
        self.name, self.shell = name, shell

    def sh(self, script: str) -> Reply:
        """Run a script there."""
        command = ["nsenter", f"--net=/run/netns/{self.name}", *self.shell, "-c", script]
        done = subprocess.run(command, capture_output=True, text=True, timeout=30)
        return Reply(status=done.returncode, out=done.stdout, err=done.stderr, ok=done.returncode == 0)

    def see(self) -> dict[str, Any]:
        """Return the states of all links of ours by name."""
        queries = [query for query in MODULE.queries() if isinstance(query, Query)]
        return {one.name: one for one in MODULE.parse([self.sh(query.command) for query in queries])}

    def check(self, want: Resource) -> Change | None:
        """Ask the module what is due."""
        found = self.see().get(want.name)
        return MODULE.check(want.name, want.params, found.state if found else None)

    def make(self, want: Resource) -> Change:
        """Do what is due, and check that nothing is due then."""
        change = self.check(want)
        assert change is not None
        params = want.params
        rules = rules_hash(params.vni, params.port, params.local, {vtep for _, vtep in params.fdb})
        mark = f"srprov:{params.instance}:{want.name}:{rules}:1/1"
        rule = f'table bridge {want.name} {{ chain one {{ counter comment "{mark}"; }}; }}'
        assert self.sh(f"nft '{rule}'").ok, "a link is made only where its rules are"
        for command in change.commands:
            assert isinstance(command, Run)
            reply = self.sh(command.script)
            assert reply.ok, reply.err
        assert self.check(want) is None
        return change


@pytest.fixture(params=["dash", "busybox sh"])
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    """Return a namespace, once with each shell that robots have."""
    shell = tuple(request.param.split())
    if not shutil.which(shell[0]):
        pytest.skip(f"{shell[0]} is not installed")
    name = f"srtest{secrets.token_hex(4)}"
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        made = Robot(name, shell)
        setup = made.sh(
            "set -e; ip link set lo up; ip link add under0 type veth peer name under1; ip link set under1 up; "
            "ip addr add 192.0.2.1/24 dev under0; ip addr add 2001:db8::1/64 dev under0 nodad; ip link set under0 up; "
            "ip link add srpb00000001 mtu 1450 type bridge; ip link set srpb00000001 up"
        )
        if "Unknown device type" in setup.err or "not supported" in setup.err:
            pytest.skip("this kernel has no veth or bridge")
        assert setup.ok, setup.err
        yield made
    finally:
        subprocess.run(["ip", "netns", "del", name], check=True)


def link(name: str = "srpv00000001", **params: Any) -> Resource:
    """Return the wanted link."""
    return resource("vxlan", name, {**PARAMS, **params})


def test_a_link_is_made(robot: Robot) -> None:
    """Creating makes the link with alias, bridge, MTU and all entries; what the kernel then shows is right."""
    assert robot.see() == {}
    assert robot.make(link()).action is Action.CREATE
    state = robot.see()["srpv00000001"].state
    assert state["fdb"] == PARAMS["fdb"]
    assert (state["bridge"], state["mtu"], state["up"]) == ("srpb00000001", 1450, True)
    assert (state["snooping"], state["learning"], state["port_learning"]) == (False, False, False)
    assert state["bridge_fdb"] == ["02:aa:bb:cc:dd:01"]


def test_what_a_bridge_learned_of_a_link_is_forgotten(robot: Robot) -> None:
    """A bridge that learned where a service was, as those of older versions do, learns no more and has forgotten it."""
    robot.make(link())
    learn = (
        "ip link set dev srpv00000001 type bridge_slave learning on; bridge fdb add 02:aa:bb:cc:dd:03 dev srpv00000001"
    )
    assert robot.sh(f"{learn} master dynamic").ok
    robot.make(link())
    assert "02:aa:bb:cc:dd:03" not in robot.sh("bridge fdb show").out


def test_what_a_bridge_learned_of_containers_is_not_asked_for(robot: Robot) -> None:
    """A container sends from any MAC: the robot said nothing that could be read any more, and no verb went on there."""
    robot.make(link())
    assert robot.sh(
        "ip link add veth0 type veth peer name veth1; ip link set veth1 up; ip link set veth0 master srpb00000001 up"
    ).ok
    learn = "printf 'fdb add 06:00:00:00:%02x:%02x dev veth0 master dynamic\\n' $((n / 256)) $((n % 256))"
    assert robot.sh(f"for n in $(seq 3000); do {learn}; done | bridge -batch -").ok
    assert robot.sh("bridge -j fdb show").out.count('"mac":"06:00:00:00:') == 3000
    asked = [robot.sh(query.command) for query in MODULE.queries() if isinstance(query, Query)]
    assert robot.see()["srpv00000001"].state["fdb"] == PARAMS["fdb"] and "06:00:00:00:" not in asked[1].out


def test_links_that_cannot_be_read_do_not_pass_for_gone(robot: Robot) -> None:
    robot.make(link())
    asked = [robot.sh(query.command) for query in MODULE.queries() if isinstance(query, Query)]
    for place in (0, 1):
        cut = [replace(one, out=one.out[:-9]) if n == place else one for n, one in enumerate(asked)]
        with pytest.raises(TooManyError, match="cannot be read"):
            MODULE.parse(cut)


def test_a_link_whose_rules_are_not_there_does_not_come_up(robot: Robot) -> None:
    """A table that lost its rules drops nothing."""
    want = link()
    assert robot.sh(f"nft add table bridge {want.name}").ok
    change = robot.check(want)
    assert change is not None
    command = change.commands[-1]
    assert isinstance(command, Run)
    done = robot.sh(command.script)
    assert (done.ok, done.err) == (False, "no rules close the overlay\n")
    assert not robot.sh(f"ip -o link show {want.name} up").out


def test_a_link_over_ipv6_is_made(robot: Robot) -> None:
    """Underlay addresses may be IPv6."""
    fdb = [[FLOOD, "2001:db8::2"], ["02:aa:bb:cc:dd:01", "2001:db8::2"]]
    assert robot.make(link(local="2001:db8::1", mtu=1430, fdb=fdb)).action is Action.CREATE


def test_a_link_alone_has_no_entries(robot: Robot) -> None:
    """An instance on one robot has a link without any peer."""
    robot.make(link(fdb=[]))
    assert robot.see()["srpv00000001"].state["fdb"] == []


@pytest.mark.parametrize(
    ("params", "cause"),
    [
        (
            {"fdb": [*PARAMS["fdb"], [FLOOD, "192.0.2.4"], ["02:aa:bb:cc:dd:02", "192.0.2.4"]]},
            "FDB: 2 to add, 0 to remove",
        ),
        ({"fdb": PARAMS["fdb"][1:2]}, "FDB: 0 to add, 2 to remove"),
        ({"fdb": []}, "FDB: 0 to add, 3 to remove"),
        ({"fdb": [*PARAMS["fdb"][:2], ["02:aa:bb:cc:dd:01", "192.0.2.3"]]}, "FDB: 1 to add, 1 to remove"),
        ({"fdb": [[FLOOD, "192.0.2.9"], ["02:aa:bb:cc:dd:09", "192.0.2.9"]]}, "FDB: 2 to add, 3 to remove"),
        ({"mtu": 1400}, "MTU is 1450, not 1400"),
    ],
)
def test_a_link_is_changed_in_place(robot: Robot, params: dict[str, Any], cause: str) -> None:
    """Entries that come, go or move and another MTU are set in place: the link keeps its index."""
    robot.make(link())
    index = robot.sh("cat /proc/net/dev_snmp6/srpv00000001 | head -1").out
    change = robot.make(link(**params))
    assert (change.action, change.cause) == (Action.UPDATE, cause)
    assert robot.sh("cat /proc/net/dev_snmp6/srpv00000001 | head -1").out == index


@pytest.mark.parametrize(
    ("drift", "cause"),
    [
        ("ip link set dev srpv00000001 down", "link is down"),
        ("ip link set dev srpv00000001 nomaster", "bridge is not set, not srpb00000001; multicast snooping is on"),
        ("ip link set dev srpb00000001 type bridge mcast_snooping 1", "multicast snooping is on"),
        ("ip link set dev srpv00000001 mtu 1300", "MTU is 1300, not 1450"),
        ("bridge fdb del 02:aa:bb:cc:dd:01 dev srpv00000001 dst 192.0.2.2 self", "FDB: 1 to add, 0 to remove"),
        ("bridge fdb append 00:00:00:00:00:00 dev srpv00000001 dst 192.0.2.66 self", "FDB: 0 to add, 1 to remove"),
        ("bridge fdb replace 02:aa:bb:cc:dd:01 dev srpv00000001 dst 192.0.2.66 self", "FDB: 1 to add, 1 to remove"),
        ("ip link set dev srpv00000001 type bridge_slave learning on", "the bridge learns what is behind it"),
        ("bridge fdb del 02:aa:bb:cc:dd:01 dev srpv00000001 master", "the bridge's FDB: 1 to add, 0 to remove"),
        ("bridge fdb add 02:aa:bb:cc:dd:02 dev srpv00000001 master static", "the bridge's FDB: 0 to add, 1 to remove"),
        ("ip link del srpb00000001; ip link add srpb00000001 type bridge; ip link set srpb00000001 up", "bridge is"),
    ],
)
def test_drift_is_mended(robot: Robot, drift: str, cause: str) -> None:
    """What somebody changed by hand is seen and set right in place."""
    robot.make(link())
    assert robot.sh(drift).ok
    change = robot.make(link())
    assert change.action is Action.UPDATE
    assert change.cause.startswith(cause)


@pytest.mark.parametrize(
    "params", [{"vni": 77}, {"local": "192.0.2.7"}, {"port": 8472}, {"instance": "other"}, {"vni": 77, "fdb": []}]
)
def test_what_the_kernel_cannot_change_is_made_anew(robot: Robot, params: dict[str, Any]) -> None:
    """Another VNI, address, port or owner makes a new link under the old name."""
    robot.make(link())
    assert robot.make(link(**params)).action is Action.REPLACE


def test_a_link_that_learns_is_made_anew(robot: Robot) -> None:
    """A link of our name that somebody made with learning on is replaced."""
    robot.sh(
        "ip link add srpv00000001 type vxlan id 1048577 local 192.0.2.1 dstport 4789 srcport 768 1023; "
        "ip link set srpv00000001 alias srprov:hello"
    )
    change = robot.make(link())
    assert (change.action, change.cause) == (Action.REPLACE, "learning is on")


def test_a_half_made_link_is_made_anew(robot: Robot) -> None:
    """A link without alias and entries, as a cut connection leaves it, is replaced."""
    robot.sh("ip link add srpv00000001 type vxlan id 1048577 local 192.0.2.1 dstport 4789 nolearning")
    assert robot.make(link()).action is Action.REPLACE


def test_a_failure_in_the_middle_is_a_failure(robot: Robot) -> None:
    """A script that cannot do all ends with a status that is not 0: nothing is done silently by half."""
    change = robot.check(link(bridge="srpbmissing"))
    assert change is not None
    for want in (link(bridge="srpbmissing"), link(fdb=[[FLOOD, "no-address"]])):
        change = robot.check(want)
        assert change is not None
        (command,) = change.commands
        assert isinstance(command, Run)
        assert not robot.sh(command.script).ok


def test_a_link_is_removed_with_its_entries(robot: Robot) -> None:
    """Removal takes the link and its entries, and is fine when it is gone already."""
    robot.make(link())
    found = robot.see()["srpv00000001"]
    (command,) = MODULE.removal(found)
    assert isinstance(command, Run)
    for _ in range(2):
        assert robot.sh(command.script).ok
        assert robot.see() == {}
    assert "192.0.2.2" not in robot.sh("bridge fdb show").out


def test_two_instances_stand_side_by_side(robot: Robot) -> None:
    """Links of two instances and one of a stranger do not meet: each sees its own."""
    robot.sh("ip link add srpb00000002 type bridge; ip link set srpb00000002 up")
    robot.sh("ip link add other0 type vxlan id 5 dstport 1")
    robot.make(link())
    robot.make(link("srpv00000002", instance="second", vni=1048578, bridge="srpb00000002", fdb=[[FLOOD, "192.0.2.8"]]))
    assert robot.check(link()) is None
    seen = robot.see()
    assert {name: one.instance for name, one in seen.items()} == {"srpv00000001": "hello", "srpv00000002": "second"}
