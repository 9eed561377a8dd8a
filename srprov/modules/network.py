"""Docker bridge networks: the robot's end of the overlay.

Wanted parameters: `instance`, `source`, `bridge` (interface name), `subnet`, `gateway`, `mtu`, `vni`, `port`. Each
robot's engine has the whole subnet, with a gateway address of its own; addresses are given by the controller, so no
two engines hand out the same.

Source: Docker Engine API 1.41, "Create a network"; bridge driver options.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from srprov.modules.module import (
    CONFIG_HASH,
    INSTANCE,
    LABEL_FILTER,
    SOURCE,
    as_int,
    as_labels,
    as_list,
    as_text,
    canonical,
    digest,
)
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Reply, Run, quote

_VNI = "srprov.vni"
_PORT = "srprov.port"
_PREFIX = "srpb"
_BRIDGE_OPTION = "com.docker.network.bridge.name"
_MTU_OPTION = "com.docker.network.driver.mtu"


class NetworkModule:
    """The module of kind `network`."""

    kind = "network"

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled networks."""
        return (EngineQuery(path="/networks", params=(("filters", LABEL_FILTER),)),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read options, addresses and labels."""
        found = []
        for item in as_list(replies[0].json() if replies[0].ok else None):
            labels, options = as_labels(item.get("Labels")), as_labels(item.get("Options"))
            ipam = item.get("IPAM")
            pools = as_list(ipam.get("Config")) if isinstance(ipam, Mapping) else []
            pool: Mapping[str, Any] = pools[0] if pools else {}
            if INSTANCE not in labels:
                continue
            state = {
                "id": as_text(item.get("Id")),
                "hash": labels.get(CONFIG_HASH, ""),
                "source": labels.get(SOURCE, ""),
                "vni": as_int(labels.get(_VNI, "")),
                "port": as_int(labels.get(_PORT, "")),
                "bridge": options.get(_BRIDGE_OPTION, ""),
                "mtu": as_int(options.get(_MTU_OPTION, "")),
                "subnet": as_text(pool.get("Subnet")),
                "gateway": as_text(pool.get("Gateway")),
            }
            name = as_text(item.get("Name"))
            found.append(Observed(module="network", name=name, instance=labels[INSTANCE], state=state))
        return tuple(found)

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Compare field by field: Docker cannot change a network, only make it anew."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there")
        differing = [
            key for key in ("subnet", "gateway", "mtu", "bridge", "vni", "port") if found[key] != want.params[key]
        ]
        if not differing:
            return None
        cause = "; ".join(f"{key} is {found[key]}, not {want.params[key]}" for key in differing)
        return Change(action=Action.REPLACE, cause=cause, before=found)

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Create; a replacement removes first, after the containers on it."""
        params = want.params
        body = {
            "Name": want.name,
            "CheckDuplicate": True,
            "Driver": "bridge",
            "IPAM": {"Config": [{"Subnet": params["subnet"], "Gateway": params["gateway"]}]},
            "Options": {_BRIDGE_OPTION: params["bridge"], _MTU_OPTION: str(params["mtu"])},
            "Labels": {
                INSTANCE: params["instance"],
                SOURCE: params["source"],
                CONFIG_HASH: network_hash(params),
                _VNI: str(params["vni"]),
                _PORT: str(params["port"]),
            },
        }
        create = EngineCall(method="POST", path="/networks/create", body=canonical(body), accept=(201,))
        remove = EngineCall(method="DELETE", path=f"/networks/{want.name}", accept=(204, 404))
        if change.action is not Action.REPLACE:
            return (create,)
        return (remove, *_leftover_bridge(change.before), create)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove by name; 404 is fine, somebody was faster."""
        remove = EngineCall(method="DELETE", path=f"/networks/{found.name}", accept=(204, 404))
        return (remove, *_leftover_bridge(found.state))


def _leftover_bridge(found: State | None) -> tuple[Command, ...]:
    """Delete the bridge that Docker leaves: one that was there before its network is somebody else's to Docker.

    So it is after the engine crashed between the two, and the next apply made the network on the bridge that was left.
    """
    bridge = as_text(found.get("bridge")) if found else ""
    if not bridge.startswith(_PREFIX):
        return ()
    name = quote(bridge)
    return (
        Run(script=f"ip link show dev {name} type bridge 2>/dev/null | grep -q . || exit 0; ip link del dev {name}"),
    )


def network_hash(params: Mapping[str, Any]) -> str:
    """Return the hash of what a container on the network depends on; part of each container's own hash."""
    return digest([params[key] for key in ("bridge", "mtu", "subnet")], 16)
