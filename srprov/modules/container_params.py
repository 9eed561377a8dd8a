"""What a playbook says of a container: Compose's words, merged from CDF and EDF, and its place in the network."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal

import msgspec

from srprov.definitions.containermodel import Runtime
from srprov.modules import run_limits
from srprov.modules.params import ParameterError, check_ipv4, check_mac
from srprov.published import ranges
from srprov.untrusted import MOST_OF_ONE

_API = re.compile(r"(?:[0-9]{1,3}(?:\.[0-9]{1,4}){0,2})?")
KEPT = frozenset({"ROS_STATIC_PEERS"})
"""Variables whose values are no part of a container's hash, nor of what a plan tells: others would be hidden there."""


class NetworkPlace(msgspec.Struct, frozen=True, kw_only=True):
    """Where the container is in the network; all but the mode are for `overlay` only, and for `both` its address."""

    mode: Literal["overlay", "host", "both", "none"]
    """`both` is the host's network to the engine; its address on the overlay is on the robot's bridge."""
    name: str | None = None
    ip: str | None = None
    mac: str | None = None
    hash: str | None = None
    """Of what it depends on in the network."""

    def __post_init__(self) -> None:
        """Refuse an address in another spelling than one."""
        if self.ip:
            check_ipv4(self.ip, "network.ip")
        if self.mac:
            check_mac(self.mac, "network.mac")


class ContainerParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a container."""

    instance: str
    source: str
    service: str
    image: str
    hostname: str
    job: bool
    """It ends by itself."""
    run: Runtime
    """Without mounts."""
    mounts: tuple[Mapping[str, Any], ...]
    """In the engine's form."""
    network: NetworkPlace
    api: str
    """The version of the engine's API."""
    made_with: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Variables of which a container keeps the values that it was made with: other ones make it no other container."""
    log_driver: str = ""
    """The engine's default; empty: not known."""
    taken: tuple[str, ...] = ()
    """Variables whose values the controller's environment gave, and ELSEWHERE where a file from outside of the
    experiment's folder had a part in it: somebody allowed that, for this container and for no later plan."""

    def __post_init__(self) -> None:
        """Refuse what the engine's form cannot be made of."""
        if self.network.mode == "overlay" and not all((self.network.name, self.network.ip, self.network.mac)):
            raise ParameterError("network", "network: an overlay needs 'name', 'ip' and 'mac'")
        if self.network.mode == "both" and not self.network.ip:
            raise ParameterError("network", "network: both needs 'ip'")
        if self.network.mac and self.network.mode != "overlay":
            raise ParameterError("network", "network: only who is on the overlay has a 'mac'")
        if self.network.ip and self.network.mode not in ("overlay", "both"):
            raise ParameterError("network", f"network: {self.network.mode} has no 'ip'")
        if not _API.fullmatch(self.api):
            raise ParameterError("api", f"api: '{self.api[:40]}' is no version of an engine's API")
        if self.run.mounts:
            raise ParameterError("run", "run: mounts stand beside it, in the engine's form")
        if strange := sorted(self.made_with.keys() - KEPT):
            raise ParameterError("made_with", f"made_with: no container keeps {strange[0][:60]!r}")
        if any(not one or one.split() != [one] for one in self.taken):  # words of a label
            raise ParameterError("taken", "taken: no variable has such a name")
        if wrong := next(run_limits.broken(self.run), ""):
            raise ParameterError("run", f"run.{wrong}")
        if not run_limits.HOSTNAME.fullmatch(self.hostname):
            raise ParameterError("hostname", f"hostname: {self.hostname[:60]!r} is no host's name")
        for mount in self.mounts:
            if not (isinstance(mount.get("Type"), str) and isinstance(mount.get("Target"), str)):
                raise ParameterError("mounts", "mounts: each needs 'Type' and 'Target'")
            if "\0" in f"{mount.get('Source')}{mount['Target']}":  # where they lead is asked by a shell
                raise ParameterError("mounts", "mounts: no path holds a NUL")
        if len(msgspec.json.encode(self, enc_hook=dict)) > MOST_OF_ONE:  # of a read-only map JSON knows nothing
            most = f"more than {MOST_OF_ONE >> 10} KiB, which is all that is read of one container"
            raise ParameterError("mounts", f"mounts, and all else that is said of it, take {most}")

    def publishes(self) -> str:
        """Return which ports of the robot it takes, all of them, such as `; publishes 8080:80/tcp`, or nothing."""
        if self.network.mode != "overlay" or not self.run.ports:
            return ""
        return f"; publishes {', '.join(ranges(self.run.ports))}"
