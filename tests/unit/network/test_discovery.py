"""What containers get so that middleware finds its peers."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree

import pytest

from srprov.definitions.containermodel import Runtime
from srprov.definitions.model import Experiment, NetworkSettings
from srprov.network.discovery import Discovery, discovery_of
from srprov.network.layout import layout
from srprov.network.model import Overlay
from tests.unit.assignment.worlds import experiment, service
from tests.unit.network.test_layout import lab

PLACED = {"a": "r1", "b": "r2", "c": "r3", "d": "r3"}


def world(discovery: str, *servers: str, **environment: str) -> tuple[Experiment, Overlay]:
    """Return an experiment with a service of each network, and its overlay; `a` has the variables."""
    settings = NetworkSettings(discovery=discovery, discovery_servers=servers)
    services = (
        service("a", runtime=Runtime(environment=environment)),
        service("b"),
        service("c", network="both"),
        service("d", network="host"),
    )
    what = experiment(*services, network=settings)
    return what, layout(what, PLACED, lab())


def found(what: Experiment, overlay: Overlay, name: str = "a") -> Discovery:
    return discovery_of(what, overlay, what.services[name])


def addresses(text: str, tag: str) -> list[str]:
    """Return the addresses in elements of a kind, whatever the namespace."""
    elements = [one for one in ElementTree.fromstring(text).iter() if one.tag.rpartition("}")[2] == tag]
    return [one.get("Address") or (one.text or "").strip() for one in elements]


def test_multicast_needs_nothing() -> None:
    """Multicast needs nothing."""
    assert all(found(*world("multicast"), name) == Discovery() for name in PLACED)


def test_static_peers_are_all_services_on_the_overlay_in_the_form_of_each_middleware() -> None:
    """Static peers are all services on the overlay, in the form of each middleware."""
    what, overlay = world("static-peers")
    one, peers = found(what, overlay), sorted(overlay.addresses.values())
    assert len(peers) == 3
    assert addresses(one.files["cyclonedds.xml"], "Peer") == peers
    assert addresses(one.files["cyclonedds.xml"], "AllowMulticast") == ["false"]
    assert addresses(one.files["fastdds.xml"], "address") == peers
    assert one.made_with == {"ROS_STATIC_PEERS": ";".join(peers)}
    assert one.environment == {
        "CYCLONEDDS_URI": "file:///etc/srprov/cyclonedds.xml",
        "FASTDDS_DEFAULT_PROFILES_FILE": "/etc/srprov/fastdds.xml",
        "FASTRTPS_DEFAULT_PROFILES_FILE": "/etc/srprov/fastdds.xml",
    }
    assert found(what, overlay, "b") == one
    assert found(what, overlay, "d") == Discovery(), "it is not on the overlay"


def test_a_service_that_shares_its_robots_network_is_told_its_own_address() -> None:
    """Of the robot's interfaces, only that address is the overlay's; and no memory is shared with others there."""
    what, overlay = world("static-peers")
    both = found(what, overlay, "c").files
    assert f'NetworkInterface address="{overlay.addresses["c"]}"' in both["cyclonedds.xml"]
    assert addresses(both["fastdds.xml"], "address")[0] == overlay.addresses["c"]
    assert addresses(both["fastdds.xml"], "type") == ["UDPv4"]
    assert addresses(found(what, overlay).files["fastdds.xml"], "type") == ["UDPv4", "SHM"]


def test_what_the_user_sets_stays() -> None:
    """A variable of the user's is not replaced, and a file that nobody is pointed to is not there."""
    one = found(*world("static-peers", CYCLONEDDS_URI="file:///mine.xml", ROS_STATIC_PEERS="10.0.0.1"))
    assert "CYCLONEDDS_URI" not in one.environment and list(one.files) == ["fastdds.xml"] and not one.made_with
    assert list(found(*world("ros1", "b", ROS_HOSTNAME="a")).environment) == ["ROS_MASTER_URI"]
    assert found(*world("zenoh", "b", ZENOH_CONFIG="/mine", ZENOH_CONFIG_OVERRIDE="x=1")) == Discovery()


def test_ros_1_has_the_masters_name_and_each_nodes_own_address() -> None:
    """ROS 1 has the masters name and each nodes own address."""
    what, overlay = world("ros1", "b")
    for name in "abc":
        variables = found(what, overlay, name).environment
        assert variables == {"ROS_MASTER_URI": "http://b:11311", "ROS_IP": overlay.addresses[name]}


@pytest.mark.parametrize("kind", ["discovery-server", "zenoh"])
def test_servers_get_nothing_and_all_others_ask_them(kind: str) -> None:
    """Servers get nothing, and all others ask them."""
    what, overlay = world(kind, "c", "b")
    assert found(what, overlay, "b") == found(what, overlay, "c") == Discovery()
    one = found(what, overlay)
    if kind == "zenoh":
        config = json.loads(one.files["zenoh.json5"])
        assert config["connect"]["endpoints"] == ["tcp/c:7447", "tcp/b:7447"]
        assert config["scouting"]["multicast"]["enabled"] is False
        assert one.environment["ZENOH_CONFIG_OVERRIDE"] == 'connect/endpoints=["tcp/c:7447", "tcp/b:7447"]'
    else:
        ends = ";".join(f"{overlay.addresses[name]}:11811" for name in "cb")
        assert one == Discovery(environment={"ROS_DISCOVERY_SERVER": ends})


def test_the_name_of_a_server_that_runs_several_times_stands_for_all_of_them() -> None:
    """The instances of a server are servers too, and clients ask each."""
    settings = NetworkSettings(discovery="discovery-server", discovery_servers=("s",))
    some = (service("s-1", instance_of="s"), service("s-2", instance_of="s"), service("a"))
    what = experiment(*some, network=settings)
    overlay = layout(what, {"s-1": "r1", "s-2": "r2", "a": "r3"}, lab())
    assert found(what, overlay, "s-1") == Discovery()
    ends = [f"{overlay.addresses[name]}:11811" for name in ("s-1", "s-2")]
    assert found(what, overlay).environment == {"ROS_DISCOVERY_SERVER": ";".join(ends)}
