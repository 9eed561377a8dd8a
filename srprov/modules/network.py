"""Docker bridge networks: the robot's end of the overlay.

Each
robot's engine has the whole subnet, with a gateway address of its own; addresses are given by the controller, so no
two engines hand out the same.

Source: Docker Engine API 1.41, "Create a network"; bridge driver options.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ipaddress import IPv4Address, IPv4Network
from typing import Any

import msgspec

from srprov.modules.differences import compared
from srprov.modules.module import CONFIG_HASH, INSTANCE, LABEL_FILTER, SOURCE, Module, Names, canonical, digest
from srprov.modules.params import ParameterError, check_ipv4
from srprov.resource import Action, Change, Difference, Observed, State
from srprov.untrusted import integer, mappings, string, string_map
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Reply, Run, quote

_VNI = "srprov.vni"
_PORT = "srprov.port"
_PREFIX = "srpb"
_BRIDGE_OPTION = "com.docker.network.bridge.name"
_MTU_OPTION = "com.docker.network.driver.mtu"
_COMPARED = ("subnet", "gateway", "mtu", "bridge", "vni", "port")


class NetworkParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a network."""

    instance: str
    source: str
    bridge: str
    """Name of the interface."""
    subnet: str
    gateway: str
    mtu: int
    vni: int
    port: int

    def __post_init__(self) -> None:
        """Refuse a bridge's address that is none of its network's, or in another spelling than one."""
        check_ipv4(self.gateway, "gateway")
        try:
            network = IPv4Network(self.subnet)
        except ValueError as error:
            raise ParameterError("subnet", f"subnet: '{self.subnet[:40]}' is no IPv4 network") from error
        if IPv4Address(self.gateway) not in network or self.gateway in (str(network[0]), str(network[-1])):
            raise ParameterError("gateway", f"gateway: {self.gateway} is no robot's in {self.subnet}")


class NetworkModule(Module[NetworkParams]):
    """The module of kind `network`."""

    kind = "network"
    params = NetworkParams
    common = True
    on_overlay = True
    rebuilds_users = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled networks."""
        return (EngineQuery(path="/networks", params=(("filters", LABEL_FILTER),)),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read options, addresses and labels."""
        found = []
        for item in mappings(replies[0].json() if replies[0].ok else None):
            labels, options = string_map(item.get("Labels")), string_map(item.get("Options"))
            ipam = item.get("IPAM")
            pools = mappings(ipam.get("Config")) if isinstance(ipam, Mapping) else []
            pool: Mapping[str, Any] = pools[0] if pools else {}
            if INSTANCE not in labels:
                continue
            state = {
                "id": string(item.get("Id")),
                "hash": labels.get(CONFIG_HASH, ""),
                "source": labels.get(SOURCE, ""),
                "vni": integer(labels.get(_VNI, "")),
                "port": integer(labels.get(_PORT, "")),
                "bridge": options.get(_BRIDGE_OPTION, ""),
                "mtu": integer(options.get(_MTU_OPTION, "")),
                "subnet": string(pool.get("Subnet")),
                "gateway": string(pool.get("Gateway")),
            }
            name = string(item.get("Name"))
            found.append(Observed(module="network", name=name, instance=labels[INSTANCE], state=state))
        return tuple(found)

    def check(self, name: str, want: NetworkParams, found: State | None) -> Change | None:
        """Compare field by field: Docker cannot change a network, only make it anew."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=(_create(name, want),))
        differing = [
            f"{key} is {found[key]}, not {getattr(want, key)}" for key in _COMPARED if found[key] != getattr(want, key)
        ]
        if not differing:
            return None
        commands = (*_remove(name, found), _create(name, want))
        return Change(action=Action.REPLACE, cause="; ".join(differing), before=found, commands=commands)

    def differences(self, want: NetworkParams, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
        """Compare field by field: the list of networks says all of it."""
        return compared({key: str(found[key]) for key in _COMPARED}, _values(want))

    def between(self, old: NetworkParams, new: NetworkParams) -> tuple[Difference, ...]:
        """Compare field by field."""
        return compared(_values(old), _values(new))

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove by name."""
        return _remove(found.name, found.state)

    def is_own(self, name: str, want: NetworkParams, names: Names) -> bool:
        """Compare names and owner; whether subnet and VNI may be used is a question to the robots."""
        owner = (want.instance, want.source) == (names.instance, names.source)
        return owner and (name, want.bridge) == (names.network, names.bridge)

    def made_after_removal_of(self, other: str) -> bool:
        """Wait for what holds addresses and bridges of a network that goes."""
        return other in ("container", "vxlan")


def _values(want: NetworkParams) -> dict[str, str]:
    return {key: str(getattr(want, key)) for key in _COMPARED}


def _create(name: str, want: NetworkParams) -> Command:
    body = {
        "Name": name,
        "CheckDuplicate": True,
        "Driver": "bridge",
        "IPAM": {"Config": [{"Subnet": want.subnet, "Gateway": want.gateway}]},
        "Options": {_BRIDGE_OPTION: want.bridge, _MTU_OPTION: str(want.mtu)},
        "Labels": {
            INSTANCE: want.instance,
            SOURCE: want.source,
            CONFIG_HASH: network_hash(msgspec.structs.asdict(want)),
            _VNI: str(want.vni),
            _PORT: str(want.port),
        },
    }
    return EngineCall(method="POST", path="/networks/create", body=canonical(body), accept=(201,))


def _remove(name: str, found: State) -> tuple[Command, ...]:
    # 404: somebody was faster
    remove = EngineCall(method="DELETE", path=f"/networks/{name}", accept=(204, 404))
    return (remove, *_leftover_bridge(found))


def _leftover_bridge(found: State) -> tuple[Command, ...]:
    """Delete the bridge that Docker leaves: one that was there before its network is somebody else's to Docker.

    So it is after the engine crashed between the two, and the next apply made the network on the bridge that was left.
    """
    bridge = string(found.get("bridge"))
    if not bridge.startswith(_PREFIX):
        return ()
    name = quote(bridge)
    return (
        Run(script=f"ip link show dev {name} type bridge 2>/dev/null | grep -q . || exit 0; ip link del dev {name}"),
    )


def network_hash(params: Mapping[str, Any]) -> str:
    """Return the hash of what a container on the network depends on; part of each container's own hash."""
    return digest([params[key] for key in ("bridge", "mtu", "subnet")], 16)
