"""Peers of an encrypted overlay: whose keys are believed, and what is right."""

from __future__ import annotations

from typing import Any

import pytest

from srprov.execution.told import told
from srprov.modules import MODULES
from srprov.modules.module import Names
from srprov.modules.params import ParameterError
from srprov.modules.wireguard_peers import WireguardPeersParams, host_of
from srprov.planning.steps import due_step, informed
from srprov.resource import Change, Observed
from srprov.wire import Run
from tests.resources import resource

NAME = "srpw00000001a"
KEYS = {
    "r1": "ist5JzQhPrbERv01glU6YwO0rratpcwFOeTTSdh5BUM=",
    "r2": "pr5po3Nrrai33LHR5591VdG1Nva70jJ19jkW3Z2gxz8=",
    "r3": "6m8n2d44NI3kZEHvrJtZ2Wkmk/jjQz6+DGTyex2LpGc=",
}
PEERS = [["r2", "192.0.2.2:20000", "10.128.0.2"], ["r3", "192.0.2.3:20000", "10.128.0.3"]]
MODULE = MODULES["wireguard_peers"]
WANT = resource("wireguard_peers", NAME, {"instance": "hello", "peers": PEERS}, host="r1")


def interface(key: str, name: str = NAME) -> Observed:
    return Observed(module="wireguard", name=name, instance="hello", state={"public": key})


def said(**keys: str) -> dict[str, tuple[Observed, ...]]:
    """Return what robots in reach say of their interfaces; an empty key means that there is none yet."""
    return {robot: (interface(key),) if key else () for robot, key in keys.items()}


def state(*peers: tuple[str, str, str], lively: tuple[str, ...] = ()) -> dict[str, Any]:
    return {"peers": [list(one) for one in peers], "status": list(lively)}


R2, R3 = (KEYS["r2"], "192.0.2.2:20000", "10.128.0.2/32"), (KEYS["r3"], "192.0.2.3:20000", "10.128.0.3/32")


def check(found: dict[str, Any] | None, **keys: str) -> Change | None:
    return MODULE.check(NAME, informed(WANT, said(**(keys or KEYS))).params, found)


def script(change: Change | None) -> str:
    assert change is not None
    (command,) = change.commands
    assert isinstance(command, Run)
    return command.script


def test_each_peer_may_send_from_its_own_address_alone() -> None:
    change = check(None)
    assert script(change) == (
        f"ip netns exec srpw00000001 wg set {NAME}"
        f" peer {KEYS['r3']} endpoint 192.0.2.3:20000 allowed-ips 10.128.0.3/32"
        f" peer {KEYS['r2']} endpoint 192.0.2.2:20000 allowed-ips 10.128.0.2/32"
    )
    assert check(state(R2, R3)) is None


def test_a_key_that_is_to_be_made_is_named_by_its_robot_and_never_taken_for_one() -> None:
    assert "'<public key of r3>'" in script(check(None, r1=KEYS["r1"], r2=KEYS["r2"], r3=""))
    assert check(state(R2, R3), r1=KEYS["r1"], r2=KEYS["r2"], r3="") is not None


def test_a_key_that_two_robots_claim_is_believed_of_neither_and_the_others_go_on() -> None:
    """Who says another's key would cut that one off, or get what is meant for it."""
    assert check(None, r1=KEYS["r1"], r2=KEYS["r2"], r3=KEYS["r2"]) is not None
    assert script(check(None, r1=KEYS["r1"], r2=KEYS["r2"], r3=KEYS["r2"])) == ":"
    assert check(state(R2, R3), r1=KEYS["r1"], r2=KEYS["r2"], r3=KEYS["r2"]) is None


def test_who_says_this_robots_key_is_named_with_it() -> None:
    text = script(check(None, r1=KEYS["r1"], r2=KEYS["r1"], r3=KEYS["r3"]))
    assert "peer '<one public key, which r2 and r1 both say is theirs>' endpoint" in text
    assert KEYS["r1"] not in text and KEYS["r3"] in text


def test_a_stranger_and_an_old_key_are_removed() -> None:
    """A peer that nobody is any more, and a key that a robot does not have any more, may not send."""
    old = ("vIKKzQhPrbERv01glU6YwO0rratpcwFOeTTSdh5BUM0=", "192.0.2.3:20000", "10.128.0.3/32")
    change = check(state(R2, old))
    assert change is not None and change.cause == "1 to add, 1 to remove"
    assert f"peer {old[0]} remove" in script(change)


def test_a_robot_out_of_reach_stays_where_it_was_heard_last() -> None:
    """WireGuard follows a peer that sends from another address or port."""
    roamed = (KEYS["r3"], "192.0.2.77:41000", "10.128.0.3/32")
    assert check(state(R2, roamed), r1=KEYS["r1"], r2=KEYS["r2"]) is None


def test_who_says_the_key_of_a_robot_out_of_reach_does_not_get_its_place() -> None:
    text = script(check(state(R2, R3), r1=KEYS["r1"], r2=KEYS["r3"]))
    assert "peer '<public key of r2, which says one that is another robot'\"'\"'s>' endpoint" in text
    assert KEYS["r3"] not in text


def test_what_is_there_for_a_robot_out_of_reach_stays() -> None:
    assert check(state(R2, R3), r1=KEYS["r1"], r2=KEYS["r2"]) is None
    assert check(state(R2), r1=KEYS["r1"], r2=KEYS["r2"]) is None


def test_a_peer_that_is_spoken_with_may_have_moved() -> None:
    moved = (R2[0], "192.0.2.77:20000", R2[2])
    assert check(state(moved, R3, lively=(KEYS["r2"],))) is None
    assert check(state(moved, R3)) is not None
    elsewhere = (R2[0], R2[1], "0.0.0.0/0")
    assert check(state(elsewhere, R3, lively=(KEYS["r2"],))) is not None


def test_keys_that_were_made_meanwhile_are_put_in_when_the_step_is_done() -> None:
    step = due_step(informed(WANT, said(r1="", r2="", r3="")), None)
    assert step is not None

    now = told(step, {}, said(**KEYS))

    assert "<public key" in script(step.change)
    assert KEYS["r2"] in script(now.change)
    assert MODULE.check(NAME, now.want.params if now.want else None, state(R2, R3)) is None


def test_a_step_that_does_not_follow_any_more_stays_as_it_was() -> None:
    """So that it is refused as stale."""
    step = due_step(informed(WANT, said(r1="", r2="", r3="")), None)
    assert step is not None
    stranger = Observed(module="wireguard_peers", name=NAME, instance="", state=state(("x", "y", "z")))
    assert told(step, {("wireguard_peers", NAME): stranger}, said(**KEYS)) is step


def test_no_playbook_and_no_plan_file_can_state_a_key() -> None:
    with pytest.raises(ParameterError):
        resource("wireguard_peers", NAME, {"instance": "hello", "peers": PEERS, "keys": KEYS})
    assert isinstance(WANT.params, WireguardPeersParams)
    assert WANT.params.keys == {}


def test_an_endpoint_is_an_address_of_either_version() -> None:
    assert [host_of(one) for one in ("192.0.2.1:20000", "[2001:db8::1]:20000")] == ["192.0.2.1", "2001:db8::1"]


@pytest.mark.parametrize(
    "peer",
    [
        ["r2", "192.0.2.2:20000", "0.0.0.0/0,10.128.0.2"],
        ["r2", "192.0.2.2:20000", "10.128.0.2,10.128.0.3"],
        ["r2", "192.0.2.2:20000", "fd00::1"],
        ["r2", "192.0.2.2", "10.128.0.2"],
        ["r2", "192.0.2.2:x", "10.128.0.2"],
        ["r2", "example.org:20000", "10.128.0.2"],
        ["r2", "[fe80::1%eth0]:20000", "10.128.0.2"],
        ["r2", "192.0.2.2:20000\n", "10.128.0.2"],
    ],
)
def test_a_peer_that_says_more_than_its_own_address_is_refused(peer: list[str]) -> None:
    """In a playbook, or in a plan file that somebody changed: it could send as other robots."""
    with pytest.raises(ParameterError):
        resource("wireguard_peers", NAME, {"instance": "hello", "peers": [peer]}, host="r1")
    six = ["r2", "[2001:db8::2]:20000", "10.128.0.2"]
    assert resource("wireguard_peers", NAME, {"instance": "hello", "peers": [six]}, host="r1").params.peers


@pytest.mark.parametrize(
    ("name", "port", "own"),
    [
        (NAME, 20_000, True), (NAME, 29_998, True), (NAME, 20_001, False), (NAME, 30_000, False), (NAME, 2375, False),
        (NAME[:-1] + "b", 20_001, True), (NAME[:-1] + "b", 20_000, False), ("lo", 20_000, False), ("", 20_000, False),
    ],
)  # fmt: skip
def test_an_interface_has_a_port_of_its_own_alone(name: str, port: int, own: bool) -> None:
    """A plan file could take any port from 1024 on of each robot, and no line of the plan named it."""
    values = {"instance": "hello", "address": "10.128.0.1", "port": port, "mtu": 1380}
    want = resource("wireguard", name, values, host="r1").params
    none = dict.fromkeys(("source", "bridge", "link", "network"), "")
    names = Names(instance="hello", tunnel=NAME[:-1], vteps=frozenset(), **none)
    assert MODULES["wireguard"].is_own(name, want, names) is own


def test_peers_are_sent_to_at_ports_of_interfaces_alone() -> None:
    with pytest.raises(ParameterError, match="is no IP address with a port"):
        resource("wireguard_peers", NAME, {"instance": "hello", "peers": [["r2", "192.0.2.2:53", "10.128.0.2"]]})
