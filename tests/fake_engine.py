"""A Docker Engine in memory that speaks the API's JSON, and refuses what a real one refuses.

Takes the requests that modules make, changes its own state, gives statuses and bodies of API 1.41. What it does not
know is an AssertionError: a test must not pass because the fake was lenient.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote

from srprov.wire import EngineCall, EngineQuery, Reply


@dataclass
class Behaviour:
    """How a service's process behaves."""

    exits: int | None = None
    """Ends with this code by itself, `lives` looks after its start; None: runs on."""
    lives: int = 0
    """Times that the container is listed or inspected before it exits; 0: it is dead when somebody looks first."""
    healthy_after: int = 0
    """Inspections until it is healthy; -1: it becomes unhealthy."""
    log: str = ""


_ASIDE = ("HostConfig", "NetworkingConfig")
"""What of a create request is no part of the configuration that the engine tells."""


@dataclass
class Container:
    """One container; `body` is the create request."""

    name: str
    body: dict[str, Any]
    state: str = "created"
    code: int = 0
    looks: int = 0
    inspections: int = 0

    @property
    def service(self) -> str:
        """The service that its label names."""
        return str(self.body.get("Labels", {}).get("srprov.service", ""))


def identity(text: str) -> str:
    """Return 64 hex digits, as Docker's ids are."""
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass
class Engine:
    """The engine's objects by name. `bridges` is told of bridges that networks make and remove."""

    host: str
    exists: Callable[[str], bool]
    """Tells whether a path is on the robot: bind mounts need that."""
    add_bridge: Callable[[str, int], None]
    del_bridge: Callable[[str], None]
    started: Callable[[Container], None]
    api: str = "1.41"
    containers: dict[str, Container] = field(default_factory=dict)
    networks: dict[str, dict[str, Any]] = field(default_factory=dict)
    volumes: dict[str, dict[str, str]] = field(default_factory=dict)
    data: dict[str, str] = field(default_factory=dict)
    """Volume -> what is in it."""
    images: dict[str, dict[str, str]] = field(default_factory=dict)
    behaviours: dict[str, Behaviour] = field(default_factory=dict)
    unpullable: set[str] = field(default_factory=set)
    down: bool = False
    late: bool = False
    """It is there, and answers no question in time."""
    unreadable: set[str] = field(default_factory=set)
    """Paths of answers that are longer than is read."""

    # -- reading -------------------------------------------------------------------------------------------------------

    def query(self, query: EngineQuery) -> Reply:
        """Answer a GET."""
        if self.down:
            return Reply(status=0, ok=False, err="the Docker Engine did not answer within 20 s")
        if self.late:
            return Reply(status=504, ok=False, err="the Docker Engine did not answer within 20 s")
        if query.path in self.unreadable:
            said = f"the Docker Engine's answer to {query.path} cannot be read: too long"
            return Reply(status=200, ok=False, err=said)
        path, filters = query.path, json.loads(dict(query.params).get("filters", "{}"))
        wanted = filters.get("label", [])
        if path == "/_ping":
            assert query.headers, "its body says nothing"
            return _answer({"api-version": self.api, "server": "Docker/20.10.24 (linux)"})
        if path == "/info":
            info = {
                "LoggingDriver": "json-file",
                "ServerVersion": "20.10.24",
                "DockerRootDir": "/var/lib/docker",
                "Driver": "overlay2",
                "SecurityOptions": ["name=seccomp"],
            }
            return _answer(info)
        if path == "/version":
            return _answer({"Version": "20.10.24", "ApiVersion": self.api, "GoVersion": "go1.19.8"})
        if path == "/containers/json":
            every = dict(query.params).get("all") == "true"
            assert every or not wanted, "a stopped container counts too"
            shown = [c for c in self.containers.values() if _has(c.body.get("Labels"), wanted)]
            shown = [c for c in shown if every or c.state == "running"]
            if volume := filters.get("volume", [""])[0]:
                shown = [c for c in shown if any(one["Name"] == volume for one in _mounted(c.body))]
            return _answer([self._listed(one) for one in shown])
        if path == "/networks":
            return _answer([_network(n, b) for n, b in self.networks.items() if _has(b.get("Labels"), wanted)])
        if path == "/volumes":
            named = filters.get("name", [""])[0]
            listed = [_volume(n, labels) for n, labels in self.volumes.items() if _has(labels, wanted) and named in n]
            return _answer({"Volumes": listed or None, "Warnings": None})
        if path.startswith("/volumes/"):
            name = path.removeprefix("/volumes/")
            there = name in self.volumes
            return _answer(_volume(name, self.volumes[name])) if there else _error(404, "no such volume")
        if path == "/images/json":
            return _answer([_image(name, labels) for name, labels in self.images.items()])
        if path.startswith("/images/") and path.endswith("/history"):
            return _answer([])
        if path.startswith("/images/") and path.endswith("/json"):
            return _answer({"Config": {"OnBuild": None, "Cmd": ["sh"], "Env": ["PATH=/bin"]}})  # also a build's base
        if path.startswith("/containers/") and path.endswith("/json"):
            return self._inspect(unquote(path.split("/")[2]))
        raise AssertionError(f"the fake engine knows no GET {path}")

    def told(self, kind: str, name: str) -> Reply:
        """Answer `docker inspect` of what lies where, in the form that is asked for before a removal."""
        if kind == "volume":
            place = f"/var/lib/docker/volumes/{name}/_data"
            told: dict[str, Any] | None = {"Driver": "local", "Mountpoint": place} if name in self.volumes else None
        else:
            one, place = self.containers.get(name), f"/var/lib/docker/overlay2/{identity(name)}/diff"
            told = one and {
                "Id": identity(name),
                "State": {"Running": one.state == "running", "Dead": one.state == "dead"},
                "GraphDriver": {"Name": "overlay2", "Data": {"UpperDir": place}},
                "Mounts": _mounted(one.body),
                "HostConfig": {},
            }
        err = "" if told else f"Error: No such {kind}: {name}"
        return Reply(status=0 if told else 1, ok=bool(told), out=json.dumps(told), err=err)

    def having(self, volume: str) -> Reply:
        """List the containers that have a volume."""
        having = [c for c in self.containers.values() if any(one["Name"] == volume for one in _mounted(c.body))]
        return Reply(status=0, out="".join(f"{identity(one.name)} /{one.name} has\n" for one in having))

    def run_foreign(self, name: str) -> None:
        """Run a container that is nobody's of ours, as somebody might by hand."""
        self.containers[name] = Container(name, {"Image": "redis", "HostConfig": {}, "Labels": {"app": "x"}}, "running")

    def _listed(self, one: Container) -> dict[str, Any]:
        self._tick(one)
        one.looks += 1
        mode = one.body["HostConfig"].get("NetworkMode", "default")
        ends = one.body.get("NetworkingConfig", {}).get("EndpointsConfig", {})
        networks = {
            name: {
                "IPAMConfig": end.get("IPAMConfig"),
                "Links": None,
                "Aliases": None,
                "NetworkID": identity(name),
                "EndpointID": identity(one.name + name) if one.state == "running" else "",
                "Gateway": "",
                "IPAddress": end["IPAMConfig"]["IPv4Address"] if one.state == "running" else "",
                "IPPrefixLen": 20,
                "MacAddress": one.body.get("MacAddress") or end.get("MacAddress", ""),
                "DriverOpts": None,
            }
            for name, end in ends.items()
        } or {mode: {"IPAMConfig": None, "IPAddress": ""}}
        return {
            "Id": identity(one.name),
            "Names": ["/" + one.name],
            "Image": one.body["Image"],
            "ImageID": "sha256:" + identity(one.body["Image"]),
            "Mounts": _mounted(one.body),
            "Command": " ".join(one.body.get("Cmd") or ["sh"]),
            "Created": 1700000000,
            "Ports": _published(one),
            "Labels": one.body.get("Labels", {}),
            "State": one.state,
            "Status": self._status(one),
            "HostConfig": {"NetworkMode": mode},
            "NetworkSettings": {"Networks": networks},
        }

    def _status(self, one: Container) -> str:
        if one.state == "running":
            health = self.health(one)
            shown = {"starting": " (health: starting)"}.get(health, f" ({health})" if health else "")
            return "Up 2 seconds" + shown
        if one.state == "exited":
            return f"Exited ({one.code}) 3 seconds ago"
        return {
            "created": "Created",
            "paused": "Up 5 minutes (Paused)",
            "restarting": f"Restarting ({one.code}) 2 seconds ago",
            "dead": "Dead",
            "removing": "Removal In Progress",
        }[one.state]

    def health(self, one: Container) -> str:
        """Return what its health check says, or nothing."""
        if "Healthcheck" not in one.body or one.state != "running":
            return ""
        after = self.behaviours.get(one.service, Behaviour()).healthy_after
        if after < 0:
            return "unhealthy"
        return "healthy" if one.inspections >= after else "starting"

    def _tick(self, one: Container) -> None:
        """A process that ends by itself is seen to have ended only by looking."""
        behaviour = self.behaviours.get(one.service)
        if behaviour and behaviour.exits is not None and one.state == "running" and one.looks >= behaviour.lives:
            one.state, one.code = "exited", behaviour.exits

    def _inspect(self, name: str) -> Reply:
        one = self.containers.get(name)
        if one is None:
            return _error(404, f"No such container: {name}")
        self._tick(one)
        one.looks += 1
        one.inspections += 1
        state: dict[str, Any] = {
            "Status": one.state,
            "Running": one.state == "running",
            "Paused": one.state == "paused",
            "Restarting": one.state == "restarting",
            "Dead": one.state == "dead",
            "ExitCode": one.code,
            "FinishedAt": "2026-11-22T10:00:00.5Z" if one.state == "exited" else "0001-01-01T00:00:00Z",
        }
        if health := self.health(one):
            log = [{"ExitCode": 0 if health == "healthy" else 1, "Output": "connection refused\n"}]
            state["Health"] = {"Status": health, "FailingStreak": 0, "Log": log}
        ends = self._listed(one)["NetworkSettings"]
        host = {
            "ShmSize": 67108864,
            "IpcMode": "private",
            "Runtime": "runc",
            "PidsLimit": None,
            **one.body["HostConfig"],
        }
        filled = {"Hostname": identity(name)[:12], "WorkingDir": "", "User": "", "Cmd": ["sh"], "Entrypoint": None}
        config = {**filled, **{key: value for key, value in one.body.items() if key not in _ASIDE}}
        config["Env"] = [*(one.body.get("Env") or []), "PATH=/bin"]
        about = {"Config": config, "HostConfig": host, "NetworkSettings": ends}
        return _answer({"Id": identity(name), "Name": "/" + name, "State": state, **about})

    # -- changing ------------------------------------------------------------------------------------------------------

    def call(self, call: EngineCall) -> Reply:
        """Do what a POST or DELETE asks."""
        if self.down:
            return Reply(status=0, ok=False, err="the Docker Engine did not answer within 20 s")
        reply = self._do(call)
        return Reply(status=reply.status, out=reply.out, err=reply.err, ok=reply.status in call.accept)

    def _do(self, call: EngineCall) -> Reply:
        params = dict(call.params)
        body = json.loads(call.body) if call.body else {}
        parts = call.path.strip("/").split("/")
        match [call.method, *parts]:
            case ["POST", "networks", "create"]:
                return self._create_network(body)
            case ["DELETE", "networks", name]:
                return self._delete_network(name)
            case ["POST", "volumes", "create"]:
                self.volumes.setdefault(body["Name"], body["Labels"])
                return _answer(_volume(body["Name"], body["Labels"]), 201)
            case ["DELETE", "volumes", name]:
                return self._delete_volume(name)
            case ["POST", "images", "create"]:
                return self._pull(params["fromImage"], params["tag"])
            case ["POST", "build"]:
                assert call.blob, "a build needs its context"
                self.images[params["t"]] = {}
                return Reply(status=200, out="Successfully tagged")
            case ["DELETE", "images", *name]:
                gone = self.images.pop("/".join(name), None)
                return _answer([{"Untagged": "/".join(name)}]) if gone is not None else _error(404, "No such image")
            case ["POST", "containers", "create"]:
                return self._create(params["name"], body)
            case ["POST", "containers", name, verb]:
                one = self.containers.get(name)
                return self._verb(one, verb) if one else _error(404, f"No such container: {name}")
            case ["DELETE", "containers", name]:
                assert params["force"] == "true"
                return (
                    Reply(status=204) if self.containers.pop(name, None) else _error(404, f"No such container: {name}")
                )
        raise AssertionError(f"the fake engine knows no {call.method} {call.path}")

    def _create_network(self, body: dict[str, Any]) -> Reply:
        name, subnet = body["Name"], body["IPAM"]["Config"][0]["Subnet"]
        if name in self.networks:
            return _error(409, f"network with name {name} already exists")
        if subnet in [other["IPAM"]["Config"][0]["Subnet"] for other in self.networks.values()]:
            return _error(403, "Pool overlaps with other one on this address space")
        options = body["Options"]
        mtu = int(options["com.docker.network.driver.mtu"])
        self.networks[name] = body
        self.add_bridge(options["com.docker.network.bridge.name"], mtu)
        return _answer({"Id": identity(name), "Warning": ""}, 201)

    def _delete_network(self, name: str) -> Reply:
        if name not in self.networks:
            return _error(404, f"network {name} not found")
        if any(self._attached(c, name) and c.state in ("running", "paused") for c in self.containers.values()):
            return _error(403, f"error while removing network: network {name} has active endpoints")
        self.del_bridge(self.networks.pop(name)["Options"]["com.docker.network.bridge.name"])
        return Reply(status=204)

    def _delete_volume(self, name: str) -> Reply:
        if name not in self.volumes:
            return _error(404, f"get {name}: no such volume")
        for one in self.containers.values():
            if any(m["Type"] == "volume" and m["Source"] == name for m in one.body["HostConfig"].get("Mounts", [])):
                return _error(409, f"remove {name}: volume is in use - [{identity(one.name)}]")
        del self.volumes[name]
        self.data.pop(name, None)
        return Reply(status=204)

    def rename_data(self, half: str, name: str) -> str:
        """Do what `mv -T` does with the folders of two volumes; return what it complains of."""
        if half not in self.volumes or name not in self.volumes:
            return "Error: no such volume"
        if self.data.get(name):
            return "mv: cannot move: Directory not empty"
        self.data[name] = self.data.pop(half, "")
        return ""

    def _pull(self, repository: str, tag: str) -> Reply:
        name = f"{repository}{'@' if ':' in tag else ':'}{tag}"
        if name in self.unpullable:
            return _error(404, f"manifest for {name} not found: manifest unknown")
        self.images[name] = {}
        return Reply(status=200, out=f"Status: Downloaded newer image for {name}")

    def _create(self, name: str, body: dict[str, Any]) -> Reply:
        host = body["HostConfig"]
        if name in self.containers:
            return _error(409, f'Conflict. The container name "/{name}" is already in use by container')
        if body["Image"] not in self.images:
            return _error(404, f"No such image: {body['Image']}")
        if host["NetworkMode"] == "host" and "Hostname" in body:
            return _error(400, "conflicting options: hostname and the network mode")
        for mount in host.get("Mounts", []):
            if mount["Type"] == "bind" and not self.exists(mount["Source"]):
                return _error(
                    400, f'invalid mount config for type "bind": bind source path does not exist: {mount["Source"]}'
                )
            if mount["Type"] == "volume":
                self.volumes.setdefault(mount["Source"], {})
        self.containers[name] = Container(name, body)
        return _answer({"Id": identity(name), "Warnings": []}, 201)

    def _verb(self, one: Container, verb: str) -> Reply:
        alive = one.state in ("running", "paused", "restarting")
        if verb == "start":
            return Reply(status=304) if one.state == "running" else self._start(one)
        if verb == "stop":
            if alive:
                one.state, one.code = "exited", 137
            return Reply(status=204 if alive else 304)
        if verb == "unpause":
            if one.state != "paused":
                return _error(500, f"Container {one.name} is not paused")
            one.state = "running"
            return Reply(status=204)
        if verb == "restart":
            one.state = "exited"
            return self._start(one)
        raise AssertionError(f"the fake engine knows no {verb}")

    def _start(self, one: Container) -> Reply:
        for name, end in one.body.get("NetworkingConfig", {}).get("EndpointsConfig", {}).items():
            if name not in self.networks:
                return _error(404, f"network {name} not found")
            if any(
                other is not one
                and other.state == "running"
                and self._address(other, name) == end["IPAMConfig"]["IPv4Address"]
                for other in self.containers.values()
            ):
                return _error(403, "Address already in use")
        for other in self.containers.values():
            taken = _ports(one.body) & _ports(other.body)
            if other is not one and other.state == "running" and taken:
                return _error(500, f"Bind for 0.0.0.0:{min(taken)} failed: port is already allocated")
        one.state, one.code, one.looks, one.inspections = "running", 0, 0, 0
        self.started(one)
        self._tick(one)
        return Reply(status=204)

    @staticmethod
    def _address(one: Container, network: str) -> str:
        end = one.body.get("NetworkingConfig", {}).get("EndpointsConfig", {}).get(network)
        return str(end["IPAMConfig"]["IPv4Address"]) if end else ""

    @staticmethod
    def _attached(one: Container, network: str) -> bool:
        return network in one.body.get("NetworkingConfig", {}).get("EndpointsConfig", {})


def _ports(body: Mapping[str, Any]) -> set[str]:
    bindings = body["HostConfig"].get("PortBindings", {})
    return {binding["HostPort"] for several in bindings.values() for binding in several}


def _published(one: Container) -> list[dict[str, Any]]:
    bindings = one.body["HostConfig"].get("PortBindings", {}) if one.state == "running" else {}
    return [
        {
            "IP": binding["HostIp"] or "0.0.0.0",
            "PrivatePort": int(inside.split("/")[0]),
            "PublicPort": int(binding["HostPort"]),
            "Type": inside.split("/")[1],
        }
        for inside, several in bindings.items()
        for binding in several
    ]


def _has(labels: Mapping[str, str] | None, wanted: list[str]) -> bool:
    return all(one in (labels or {}) for one in wanted)


def _mounted(body: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the volumes of a container as an engine lists them."""
    mounts = [one for one in body["HostConfig"].get("Mounts", []) if one["Type"] == "volume"]
    return [
        {"Type": "volume", "Name": one.get("Source", ""), "Destination": one["Target"], "RW": not one.get("ReadOnly")}
        for one in mounts
    ]


def _network(name: str, body: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "Name": name,
        "Id": identity(name),
        "Created": "2023-11-14T22:13:20.0Z",
        "Scope": "local",
        "Driver": body["Driver"],
        "EnableIPv6": False,
        "IPAM": {"Driver": "default", "Options": None, "Config": body["IPAM"]["Config"]},
        "Internal": False,
        "Attachable": False,
        "Ingress": False,
        "ConfigFrom": {"Network": ""},
        "ConfigOnly": False,
        "Containers": {},
        "Options": body["Options"],
        "Labels": body.get("Labels", {}),
    }


def _volume(name: str, labels: Mapping[str, str]) -> dict[str, Any]:
    point = f"/var/lib/docker/volumes/{name}/_data"
    return {
        "Name": name,
        "Driver": "local",
        "Mountpoint": point,
        "Labels": labels or None,
        "Options": None,
        "Scope": "local",
    }


def _image(name: str, labels: Mapping[str, str]) -> dict[str, Any]:
    digests = [name] if "@" in name else []
    return {
        "Containers": -1,
        "Created": 1700000000,
        "Id": "sha256:" + identity(name),
        "Labels": labels or None,
        "ParentId": "",
        "RepoDigests": digests or None,
        "RepoTags": ["<none>:<none>"] if digests else [name],
        "SharedSize": -1,
        "Size": 4261550,
        "VirtualSize": 4261550,
    }


def _answer(value: object, status: int = 200) -> Reply:
    return Reply(status=status, out=json.dumps(value))


def _error(status: int, message: str) -> Reply:
    return Reply(status=status, out=json.dumps({"message": message}), err=message, ok=False)
