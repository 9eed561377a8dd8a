"""A robot's network links and files in memory, driven by the very scripts that modules give.

`Kernel` runs the few forms of `ip` and `bridge` that a vxlan resource uses and prints what the real tools print;
`Disk` knows `Put`, and the scripts that unpack a tree and remove a path. What they do not know is an AssertionError.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import shlex
import tarfile
from dataclasses import dataclass, field
from typing import Any

from srprov.modules.module import MEMORY_ROOT, STATE_ROOT
from srprov.wire import Put, Reply


@dataclass
class Link:
    """One interface."""

    name: str
    kind: str
    mtu: int = 1500
    up: bool = False
    master: str = ""
    alias: str = ""
    vni: int = 0
    local: str = ""
    port: int = 0
    learning: bool = True
    port_learning: bool = True
    snooping: int = 1
    mac: str = "32:c9:e1:a4:4d:e8"
    services: frozenset[str] = frozenset()
    """Addresses with the label of services."""
    notifies: bool = False
    source_ports: tuple[int, int] = (0, 0)


@dataclass
class Kernel:
    """Links by name, and the forwarding entries of VXLANs as (device, MAC, destination)."""

    address: str
    links: dict[str, Link] = field(default_factory=dict)
    fdb: set[tuple[str, str, str]] = field(default_factory=set)
    bridge_fdb: set[tuple[str, str]] = field(default_factory=set)
    """Static entries of bridges, by port and MAC."""
    found: set[str] = field(default_factory=set)
    """Bridges that were there before their network: the engine never removes them."""
    filters: dict[str, list[str]] = field(default_factory=dict)
    """Name of a VXLAN filter -> its rules in nftables."""

    def add_bridge(self, name: str, mtu: int) -> None:
        """What the engine does when it makes a network."""
        if name in self.links:
            self.found.add(name)
            return
        self.links[name] = Link(name, "bridge", mtu=mtu, up=True)

    def del_bridge(self, name: str) -> None:
        """What the engine does when it removes one: its ports stay, without a master."""
        if name in self.found:
            return
        self.links.pop(name, None)
        for link in self.links.values():
            link.master = "" if link.master == name else link.master

    def reboot(self) -> None:
        """Links that nobody makes anew are gone; the engine makes its bridges again."""
        bridges = [link for link in self.links.values() if link.kind == "bridge"]
        self.links = {link.name: Link(link.name, "bridge", mtu=link.mtu, up=True) for link in bridges}
        self.fdb, self.bridge_fdb = set(), set()
        self.filters = {}

    def show_filters(self) -> str:
        """Print what the query of filters prints."""
        return "".join("\n".join([f"table bridge {name} {{", *rules, "}\n"]) for name, rules in self.filters.items())

    def filter(self, script: str) -> bool:
        """Run a script of a filter, with an nft that works; return whether it was one."""
        given, piped, _ = script.partition("' | nft -f -")
        if not piped:
            return False
        text = given.partition("printf %s '")[2]
        (name,) = set(re.findall(r"delete table \w+ (\w+)", text))
        rules = [line.strip() for line in text.splitlines() if "comment" in line]
        self.filters.pop(name, None)
        self.filters |= {name: rules} if rules else {}
        return True

    def show_addresses(self) -> str:
        """Print `ip -j -d addr show`."""
        first: list[dict[str, Any]] = [
            {
                "ifindex": 2,
                "ifname": "eth0",
                "flags": ["BROADCAST", "MULTICAST", "UP", "LOWER_UP"],
                "mtu": 1500,
                "link_type": "ether",
                "address": "52:54:00:00:00:01",
                "addr_info": [{"family": "inet", "local": self.address, "prefixlen": 24, "scope": "global"}],
            }
        ]
        rest = [self._json(i, link) for i, link in enumerate(self.links.values(), start=3)]
        return json.dumps(first + rest)

    def show_fdb(self) -> str:
        """Print the forwarding entries: ours, and those that the kernel makes by itself."""
        shown: dict[str, list[dict[str, Any]]] = {name: [] for name, one in self.links.items() if one.kind == "vxlan"}
        for link in self.links.values():
            if link.master and link.name in shown:
                own = {"mac": "32:c9:e1:a4:4d:e8", "flags": [], "master": link.master}
                shown[link.name].append({**own, "state": "permanent"})
        for device, mac in sorted(self.bridge_fdb):
            if device in shown and (master := self.links[device].master):
                shown[device].append({"mac": mac, "flags": [], "master": master, "state": "static"})
        for device, mac, dst in sorted(self.fdb):
            shown.setdefault(device, []).append({"mac": mac, "dst": dst, "flags": ["self"], "state": "permanent"})
        return json.dumps([*({"ifname": name, "entries": some} for name, some in shown.items()), {}])

    def _json(self, index: int, link: Link) -> dict[str, Any]:
        flags = ["BROADCAST", "MULTICAST", *(["UP", "LOWER_UP"] if link.up else [])]
        shown: dict[str, Any] = {"ifindex": index, "ifname": link.name, "flags": flags, "mtu": link.mtu}
        shown |= {"master": link.master} if link.master else {}
        data: dict[str, Any] = {"mcast_snooping": link.snooping, "stp_state": 0}
        if link.kind == "vxlan":
            local = {"local6" if ":" in link.local else "local": link.local}
            data = {"id": link.vni, **local, "port": link.port, "learning": link.learning, "ttl": 0, "ageing": 300}
            data["port_range"] = dict(zip(("low", "high"), link.source_ports, strict=True))
        port = {"info_slave_kind": "bridge", "info_slave_data": {"learning": link.port_learning}} if link.master else {}
        shown |= {"linkinfo": {"info_kind": link.kind, "info_data": data, **port}, "link_type": "ether"}
        label = {"family": "inet", "prefixlen": 32, "scope": "global", "label": f"{link.name}:s"}
        shown |= {"address": link.mac, "addr_info": [{**label, "local": one} for one in sorted(link.services)]}
        return shown | ({"ifalias": link.alias} if link.alias else {})

    @staticmethod
    def calls(script: str) -> list[str]:
        """Return the calls of a script, those of a batch one by one."""
        single = re.sub(
            r"^printf %s '(.*?)' \| (\w+)[^\n]* -batch - \|\| exit$",
            lambda batch: "\n".join(f"{batch[2]} {call}" for call in batch[1].splitlines()),
            script,
            flags=re.DOTALL | re.MULTILINE,
        )
        return [line.removesuffix(" || exit") for line in single.splitlines()]

    def run(self, line: str) -> str:
        """Run one call of a script; give what it complains, or nothing."""
        if line.endswith(">> /var/log/srprov.log"):
            return ""
        words = shlex.split(line)
        match words:
            case ["case", "$({", "nft", "list", "table", "bridge", name, *_]:
                return "" if name in self.filters else "no rules close the overlay"
            case ["ip", "link", "show", "dev", name, ">/dev/null", "2>&1", "||", "exit", "0;", *rest]:
                return self.run(shlex.join(rest)) if name in self.links else ""
            case ["ip", "link", "show", "dev", name, "type", kind, "2>/dev/null", "|", "grep", "-q", ".", "||", *rest]:
                there = name in self.links and self.links[name].kind == kind and rest[:2] == ["exit", "0;"]
                return self.run(shlex.join(rest[2:])) if there else ""
            case ["ip", "link", "del", "dev", name]:
                if self.links.pop(name, None) is None:
                    return f'Cannot find device "{name}"'
                self.fdb = {entry for entry in self.fdb if entry[0] != name}
                self.bridge_fdb = {entry for entry in self.bridge_fdb if entry[0] != name}
                self.found.discard(name)
                return ""
            case ["ip", "link", "add", name, "type", "vxlan", "id", vni, "local", ip, "dstport", port, *rest]:
                assert [rest[0], rest[-1], len(rest)] == ["srcport", "nolearning", 4], rest
                vxlans = [(one.vni, one.port) for one in self.links.values() if one.kind == "vxlan"]
                same = (int(vni), int(port)) in vxlans
                if name in self.links or same:
                    return "RTNETLINK answers: File exists"
                ports = (int(rest[1]), int(rest[2]))
                self.links[name] = Link(
                    name, "vxlan", vni=int(vni), local=ip, port=int(port), learning=False, source_ports=ports
                )
                return ""
            case ["ip", "link", "set", "dev", name, *rest] if name in self.links:
                return self._set(self.links[name], rest)
            case ["ip", "addr", verb, *rest]:
                return self._address(verb, rest)
            case ["echo", "1", path] if (name := path.split("/")[-2]) and path.endswith("/arp_notify"):
                if name not in self.links:
                    return f"cannot create {path}: Directory nonexistent"
                self.links[name].notifies = True
                return ""
            case ["bridge", *rest]:
                return self._fdb(" ".join(rest))
        if words[:4] == ["ip", "link", "set", "dev"]:
            return f'Cannot find device "{words[4]}"'
        raise AssertionError(f"the fake kernel knows no {line!r}")

    def _set(self, link: Link, words: list[str]) -> str:
        match words:
            case ["alias", alias]:
                link.alias = alias
            case ["mtu", mtu, "master", master, "up"]:
                if master not in self.links:
                    return f'Error: argument "{master}" is wrong: Device does not exist'
                if master != link.master:
                    link.port_learning = True
                    self.bridge_fdb = {entry for entry in self.bridge_fdb if entry[0] != link.name}
                link.mtu, link.master, link.up = int(mtu), master, True
            case ["type", "bridge_slave", "learning", "off", "fdb_flush"] if link.master:
                link.port_learning = False
            case ["type", "bridge", "mcast_snooping", value]:
                link.snooping = int(value)
            case ["address", mac]:
                assert link.notifies, "the addresses would not be announced"
                link.mac = mac
            case _:
                raise AssertionError(f"the fake kernel knows no ip link set {words}")
        return ""

    def _address(self, verb: str, words: list[str]) -> str:
        name = words[words.index("dev") + 1]
        if name not in self.links:
            return f'Cannot find device "{name}"'
        link, one = self.links[name], words[0].removesuffix("/32")
        match (verb, words):
            case ("flush", ["dev", _, "label", label]) if label == f"{name}:s":
                link.services = frozenset()
            case ("replace", [_, "dev", _, "label", label]) if label == f"{name}:s":
                link.services |= {one}
            case ("del", [_, "dev", _]):
                if one not in link.services:
                    return "RTNETLINK answers: Cannot assign requested address"
                link.services -= {one}
            case _:
                raise AssertionError(f"the fake kernel knows no ip addr {verb} {words}")
        return ""

    def _fdb(self, line: str) -> str:
        match line.split():
            case ["fdb", verb, mac, "dev", device, "dst", dst, "self", *_]:
                if device not in self.links:
                    return f'Cannot find device "{device}"'
                if verb == "del":
                    if (device, mac, dst) not in self.fdb:
                        return "RTNETLINK answers: No such file or directory"
                    self.fdb.discard((device, mac, dst))
                elif verb == "append":
                    self.fdb.add((device, mac, dst))
                elif verb == "replace":
                    self.fdb = {e for e in self.fdb if e[:2] != (device, mac)} | {(device, mac, dst)}
                else:
                    raise AssertionError(line)
                return ""
            case ["fdb", verb, mac, "dev", device, "master", *_]:
                there = (device, mac) in self.bridge_fdb
                if device not in self.links or not self.links[device].master or (verb == "del" and not there):
                    return "RTNETLINK answers: No such file or directory"
                self.bridge_fdb ^= {(device, mac)} if there == (verb == "del") else set()
                return ""
        raise AssertionError(f"the fake kernel knows no bridge {line!r}")


@dataclass
class Disk:
    """Files by path, and shipped trees by path with the names in them. Folders are where something lies in them."""

    files: dict[str, bytes] = field(default_factory=dict)
    modes: dict[str, int] = field(default_factory=dict)
    inodes: dict[str, int] = field(default_factory=dict)
    trees: dict[str, tuple[str, ...]] = field(default_factory=dict)
    shipped: dict[str, bytes] = field(default_factory=dict)
    """Files in trees by path."""
    serial: int = 0
    marks: set[str] = field(default_factory=set)
    """Paths outside our folders that a user's command made."""

    def command(self, words: list[str]) -> int:
        """Run the few programs that commands and their checks use in tests; give the exit code."""
        match words:
            case ["sh", "-c", text]:
                codes = [self.command(shlex.split(part)) for part in text.split(" && ")]
                return next((code for code in codes if code), 0)
            case ["test", "-e", path]:
                return 0 if path in self.marks or path in self.files else 1
            case ["touch", path]:
                self.marks.add(path)
                return 0
            case ["modprobe", "uvcvideo"]:
                self.marks.add("/dev/video0")
                return 0
            case ["cmp", "-s", one, other]:
                return int(self.files.get(one) is None or self.files.get(one) != self.files.get(other))
            case ["true"]:
                return 0
            case ["exit", code]:
                return int(code)
        raise AssertionError(f"the fake robot knows no program {words}")

    def put(self, put: Put) -> None:
        """Write a file as `Put.script` does."""
        if not (put.in_place and put.path in self.files):
            self.serial += 1
            self.inodes[put.path] = self.serial
        self.files[put.path], self.modes[put.path] = put.content, put.mode
        self.files.pop(put.path + ".part", None)

    def exists(self, path: str) -> bool:
        """Return whether a path is there; what is not below our root is the robot's own and is there."""
        if not path.startswith((STATE_ROOT + "/", MEMORY_ROOT + "/")):
            return True
        inside = {f"{tree}/{name}" for tree, names in self.trees.items() for name in names}
        return path in self.files or path in self.trees or path in inside

    def hashes(self) -> str:
        """Print what the query of file resources prints."""
        lines = []
        for path, content in sorted(self.files.items()):
            short = path.removeprefix(STATE_ROOT + "/")
            if path.startswith(STATE_ROOT + "/") and short.count("/") == 1 and not path.endswith(".part"):
                lines.append(f"{hashlib.sha256(content).hexdigest()}  {path}\n")
        return "".join(lines)

    def secrets(self) -> str:
        """Print what the query of secrets prints."""
        at = re.compile(re.escape(MEMORY_ROOT) + r"/([^/]+/secrets/[^/]+)")
        mine = {match[1]: path for path in sorted(self.files) if (match := at.fullmatch(path))}
        modes = [f"{self.modes[path]:o} ./{short}\n" for short, path in mine.items()]
        shas = [f"{hashlib.sha256(self.files[path]).hexdigest()}  ./{short}\n" for short, path in mine.items()]
        return "".join([*modes, *shas])

    def forget(self) -> None:
        """What a reboot does to files in memory."""
        for path in [path for path in self.files if path.startswith(MEMORY_ROOT + "/")]:
            self._remove(path)

    def list_trees(self) -> str:
        """Print what the query of tree resources prints."""
        at = re.compile(re.escape(STATE_ROOT) + r"/[^/]+/trees/[^/]+")
        return "".join(f"{path}\n" for path in sorted({*self.files, *self.trees}) if at.fullmatch(path))

    def contents(self, command: str) -> str | None:
        """Print what the queries for old contents print; None when it is none of those."""
        words, every = shlex.split(command), {**self.files, **self.shipped}
        match words:
            case ["head", "-c", size, path, *_] | ["[", "-d", _, "]", "||", "head", "-c", size, path, *_]:
                return every.get(path, b"")[: int(size)].decode("utf-8", "replace")
            case ["find", path, "-type", "f", "-exec", "sha256sum", *_]:
                there = {one for one in every if one == path or one.startswith(path + "/")}
                return "".join(f"{hashlib.sha256(every[one]).hexdigest()}  {one}\n" for one in sorted(there))
        return None

    def maker(self, command: str) -> str:
        """Print the part of a placement record that says who made the instance."""
        record = self.files.get(next(word for word in shlex.split(command) if word.endswith("/placement.json")))
        return "".join(re.findall(r'"source":"(?:[^"\\]|\\.)*"', record.decode())[:1]) if record else ""

    def records(self) -> str:
        """Print placement records, as grep does."""
        records = [(p, c.decode()) for p, c in sorted(self.files.items()) if p.endswith("/placement.json")]
        return "".join(f"{path}:{text}\n" for path, text in records)

    def run(self, script: str) -> str | None:
        """Run a script of a file or tree resource; None when it is none of those, else what it complains."""
        words = shlex.split(script)
        if words[:2] == ["timeout", "-k"]:
            code = self.command(words[4 : words.index("</dev/null;")])
            return f"exit {code}" if code else ""
        if words[:2] == ["rm", "-rf"] and words[3:6] == ["||", "exit", "1;"]:
            self._remove(words[2])
            return ""
        if words[:2] == ["rm", "-rf"] and "tar" in words:
            final, tar = words[-1], words[words.index("-xf") + 1]
            assert words[-2] == final + ".part" and tar == final + ".tar"
            if tar not in self.files:
                return f"tar: {tar}: Cannot open: No such file or directory"
            with tarfile.open(fileobj=io.BytesIO(self.files[tar])) as archive:
                self.trees[final] = tuple(sorted(archive.getnames()))
                self.shipped |= {
                    f"{final}/{one.name}": file.read() for one in archive if (file := archive.extractfile(one))
                }
            self._remove(tar)
            return ""
        return None

    def _remove(self, path: str) -> None:
        for mapping in (self.files, self.modes, self.inodes, self.trees, self.shipped):
            for one in [p for p in mapping if p == path or p.startswith(path + "/")]:
                del mapping[one]  # type: ignore[attr-defined]


def shell_reply(complaint: str, out: str = "") -> Reply:
    """Return the reply of a shell: failed when it complained."""
    return Reply(status=1 if complaint else 0, out=out, err=complaint, ok=not complaint)
