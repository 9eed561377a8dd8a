"""How middleware finds its peers: what a service's container gets for the EDF's `network.discovery`. Pure.

Takes the experiment and its Overlay; gives variables and files. The files are mounted and rewritten in place, so that a
new peer restarts nobody. That a participant which runs has read an older list does no harm: whoever is new
announces itself to all others, and they answer.

Source: Cyclone DDS, "Discovery configuration"; Fast DDS, "Initial peers", "Disabling all multicast traffic" and
"Discovery Server"; ROS 2, "Improved dynamic discovery"; ROS 1, "Environment variables"; Zenoh, "Configuration".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import msgspec

from srprov.definitions.model import Experiment, Service
from srprov.network.layout import ON_OVERLAY
from srprov.network.model import Overlay

FOLDER = "/etc/srprov"
"""Where containers find the files."""
_ROS_MASTER, _DISCOVERY_SERVER, _ZENOH_ROUTER = 11311, 11811, 7447
"""The ports that these programs have by default."""
_SHARED_MEMORY = "<transport_descriptor><transport_id>shm</transport_id><type>SHM</type></transport_descriptor>"
_PARTICIPANTS = 32
"""Processes with DDS in one container that others look for; each is one more packet per peer."""


class Discovery(msgspec.Struct, frozen=True, kw_only=True):
    """What one container gets, beside what the user says; empty where multicast does it."""

    environment: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    made_with: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Variables that list peers: a container keeps those that it was made with."""
    files: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Name of a file in `FOLDER` -> its text."""


def discovery_of(experiment: Experiment, overlay: Overlay, service: Service) -> Discovery:
    """Return what a service gets: nothing, if it is not on the overlay; and no variable that the user has set."""
    if service.network not in ON_OVERLAY or service.name not in overlay.addresses:
        return Discovery()
    settings, given = experiment.network, service.runtime.environment
    own = overlay.addresses[service.name] if service.network == "both" else ""
    serves = {service.name, service.instance_of} & set(settings.discovery_servers)
    match settings.discovery:
        case "static-peers":
            return _static_peers(tuple(sorted(overlay.addresses.values())), own, given)
        case "ros1":
            variables = _ros1(settings.discovery_servers[0], overlay.addresses[service.name], given)
        case "discovery-server" if not serves:
            servers = [f"{one}:{_DISCOVERY_SERVER}" for one in _addresses(settings.discovery_servers, overlay)]
            variables = {"ROS_DISCOVERY_SERVER": ";".join(servers)} if servers else {}
        case "zenoh" if not serves:
            return _zenoh([f"tcp/{name}:{_ZENOH_ROUTER}" for name in settings.discovery_servers], given)
        case _:
            variables = {}
    return Discovery(environment=_unset(variables, given))


def _unset(variables: Mapping[str, str], given: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in variables.items() if name not in given}


def _addresses(names: tuple[str, ...], overlay: Overlay) -> list[str]:
    """Return the addresses of services in the order of their names; a name may stand for several instances."""
    some = [overlay.aliases.get(name) or (overlay.names.get(name, ""),) for name in names]
    return [one for addresses in some for one in addresses if one]


def _ros1(master: str, address: str, given: Mapping[str, str]) -> dict[str, str]:
    own = {} if "ROS_HOSTNAME" in given else {"ROS_IP": address}  # of the two, ROS would take the name
    return {"ROS_MASTER_URI": f"http://{master}:{_ROS_MASTER}", **own}


def _zenoh(endpoints: list[str], given: Mapping[str, str]) -> Discovery:
    config = {"connect": {"endpoints": endpoints}, "scouting": {"multicast": {"enabled": False}}}
    by_file = _unset({"ZENOH_CONFIG": f"{FOLDER}/zenoh.json5"}, given)
    ros = _unset({"ZENOH_CONFIG_OVERRIDE": f"connect/endpoints={json.dumps(endpoints)}"}, given)
    return Discovery(
        environment={**by_file, **ros},
        files={"zenoh.json5": json.dumps(config, indent=2) + "\n"} if by_file else {},
    )


def _static_peers(peers: tuple[str, ...], own: str, given: Mapping[str, str]) -> Discovery:
    """Return the same list of peers for each DDS; `own` is the address of a service that shares its robot's network."""
    cyclone = _unset({"CYCLONEDDS_URI": f"file://{FOLDER}/cyclonedds.xml"}, given)
    # the first name is that of Fast DDS 2 and older
    names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
    fast = _unset(dict.fromkeys(names, f"{FOLDER}/fastdds.xml"), given)
    files = {"cyclonedds.xml": _cyclone(peers, own)} if cyclone else {}
    files |= {"fastdds.xml": _fast(peers, own)} if fast else {}
    # ROS_AUTOMATIC_DISCOVERY_RANGE stays: with LOCALHOST, ROS 2 would add transports of its own to those of the profile
    made_with = _unset({"ROS_STATIC_PEERS": ";".join(peers)}, given)
    return Discovery(environment={**cyclone, **fast}, made_with=made_with, files=files)


@lru_cache(maxsize=2)
def _cyclone(peers: tuple[str, ...], own: str) -> str:
    interface = f'\n      <Interfaces><NetworkInterface address="{own}"/></Interfaces>' if own else ""
    listed = "\n".join(f'        <Peer Address="{one}"/>' for one in peers)
    return f"""\
<CycloneDDS xmlns="https://cdds.io/config">
  <Domain Id="any">
    <General>{interface}
      <AllowMulticast>false</AllowMulticast>
    </General>
    <Discovery>
      <ParticipantIndex>auto</ParticipantIndex>
      <MaxAutoParticipantIndex>{_PARTICIPANTS - 1}</MaxAutoParticipantIndex>
      <Peers>
{listed}
      </Peers>
    </Discovery>
  </Domain>
</CycloneDDS>
"""


@lru_cache(maxsize=2)
def _fast(peers: tuple[str, ...], own: str) -> str:
    """Return a profile: with shared memory inside a container, and without it where robots' containers would meet."""
    only = f"\n      <interfaceWhiteList><address>{own}</address></interfaceWhiteList>" if own else ""
    memory = "" if own else f"\n    {_SHARED_MEMORY}"
    use = "" if own else "<transport_id>shm</transport_id>"
    listed = "\n".join(f"          <locator><udpv4><address>{one}</address></udpv4></locator>" for one in peers)
    return f"""\
<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>udp</transport_id>
      <type>UDPv4</type>
      <maxInitialPeersRange>{_PARTICIPANTS}</maxInitialPeersRange>{only}
    </transport_descriptor>{memory}
  </transport_descriptors>
  <participant profile_name="srprov" is_default_profile="true">
    <rtps>
      <builtin>
        <metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList>
        <initialPeersList>
{listed}
        </initialPeersList>
      </builtin>
      <userTransports><transport_id>udp</transport_id>{use}</userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>
    </rtps>
  </participant>
</profiles>
"""
