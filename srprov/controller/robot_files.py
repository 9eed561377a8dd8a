"""The files of an instance on a robot: the record of the whole placement, hosts files, and what middleware is told.

Takes what contexts are made of; gives files as the playbooks state them. Pure. Most are the same on all robots and name
all of them: these are made once, and a long one is named by its hash, so that it stands once in plan files and records.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srprov.controller.render_inputs import RenderInputs
from srprov.controller.services import discovery_path, hosts_path, with_robots_network
from srprov.definitions.hostnames import GATEWAY
from srprov.definitions.model import Service
from srprov.hashing import sha256_of
from srprov.modules.module import STATE_ROOT, canonical
from srprov.network.discovery import discovery_of
from srprov.network.hosts import HostsFile

_RECORD = "placement.json"
_LONG = 4096
"""Characters: a shorter text is easier to read where it is used."""


def record_path(instance: str) -> str:
    """Return where a robot keeps the placement record."""
    return f"{STATE_ROOT}/{instance}/{_RECORD}"


def is_record_path(path: str) -> bool:
    """Return whether a path is that of a placement record, of whatever instance."""
    return path.endswith(f"/{_RECORD}")


class RobotFiles:
    """The files of all robots of one instance."""

    def __init__(self, inputs: RenderInputs, blobs: dict[str, bytes]) -> None:
        """Take what they are made of, and where the bytes of long ones are added by their sha256."""
        self._inputs, self._blobs = inputs, blobs
        self._digests: dict[str, str] = {}
        """Text -> its hash; robots share one text, so that it is looked at once."""
        names = {one.name: name for one in inputs.experiment.services.values() if (name := one.runtime.hostname)}
        self._hosts = HostsFile(inputs.overlay, names)
        self._record = canonical(inputs.record) + "\n"

    def of(self, host: str, services: Sequence[Service]) -> list[dict[str, Any]]:
        """Return the record, and for a robot that runs something what its services find on disk."""
        inputs, instance = self._inputs, self._inputs.instance
        files = {f"{STATE_ROOT}/{instance}/hosts": self._common(self._hosts.text)} if services else {}
        for service in services:
            own = inputs.snapshot.facts[host].hosts if with_robots_network(service) else ()
            # what a container with the robot's network calls its robot is itself
            robot = inputs.overlay.gateways.get(host, "") if service.network == "overlay" else "127.0.0.1"
            extra = [(name, robot if at == GATEWAY else at) for name, at in service.runtime.extra_hosts]
            if extra or with_robots_network(service):
                text = self._hosts.with_more(extra, own)
                files[hosts_path(instance, service)] = (
                    self._common(text) if text is self._hosts.text else {"content": text}
                )
            for name, text in discovery_of(inputs.experiment, inputs.overlay, service).files.items():
                stated = {"content": text} if service.network == "both" else self._common(text)
                files[discovery_path(instance, service, name)] = stated
        mode = {"mode": "0644", "in_place": True}
        record = {"path": record_path(instance), **self._common(self._record), **mode, "in_place": False}
        return [*({"path": path, **stated, **mode} for path, stated in files.items()), record]

    def _common(self, text: str) -> dict[str, str]:
        """Return the content of a file that all robots have, with its hash if it is long."""
        if len(text) <= _LONG:
            return {"content": text}
        if text not in self._digests:
            data = text.encode()
            self._digests[text] = sha256_of(data)
            self._blobs[self._digests[text]] = data
        return {"content": text, "blob": self._digests[text]}
