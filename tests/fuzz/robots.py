"""What robots say to each single question: a real answer, and what reads a mutated one."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

from srprov.controller.digests import _digest
from srprov.definitions.model import Host
from srprov.facts.host import parse_host
from srprov.facts.placements import parse_placements
from srprov.facts.probes import PROBES
from srprov.facts.taken import taken_ports
from srprov.modules import MODULES
from srprov.modules.module import STATE_ROOT
from srprov.modules.observe import _check
from srprov.modules.vxlan import VxlanParams
from srprov.probing.firewall import may_match, parse_rules
from srprov.robot_answers import TooManyError
from srprov.transport.image_there import read_target, second_look
from srprov.trials.cgroup import group, mounts
from srprov.trials.files import by_file
from srprov.trials.hosts import MOUNTINFO
from srprov.trials.hosts import read as read_host
from srprov.wire import Reply
from tests.unit.facts.robot_outputs import COMPUTER, ETH0, INFO, PI, VXLAN, replies

Use = Callable[[Path, bytes], None]
_ID, _KEY = "a" * 64, "A" * 42 + "A="
_OURS = {"srprov.instance": "hello", "srprov.service": "a"}
_LINKS = json.dumps(
    [ETH0, {**VXLAN, "master": "srpb7"}, {**VXLAN, "ifname": "srpw12345678a"},
     {"ifname": "srpb7", "linkinfo": {"info_kind": "bridge", "info_data": {"mcast_snooping": 1}}}]
)  # fmt: skip
_TUNNEL = (
    "netns srpw12345678\nlinks "
    + json.dumps([{"ifname": "lo", "ifalias": "srprov:a", "addr_info": [{"scope": "global", "local": "10.0.0.1"}]},
                  {"ifname": "srpw12345678a", "mtu": 1400, "flags": ["UP"]}])
    + '\nroutes [{"dst": "10.0.0.2", "dev": "srpw12345678a"}]\nclock 100\n'
    + f"show public-key\nsrpw12345678a\t{_KEY}\nshow listen-port\nsrpw12345678a\t51820\n"
    + f"show endpoints\nsrpw12345678a\t{_KEY}\t192.0.2.1:5\nshow allowed-ips\nsrpw12345678a\t{_KEY}\t10.0.0.2/32\n"
    + f"show latest-handshakes\nsrpw12345678a\t{_KEY}\t99\n"
)  # fmt: skip
_RULES = (
    "table inet srpv12345678 {\n\tchain in-1 {\n\t\ttype filter hook input priority 0; policy accept;\n"
    '\t\tudp dport 4789 comment "srprov:hello:srpv12345678:abcdef01:1/4" drop\n\t}\n}\n*raw\n:srpv12345678-in - [0:0]\n'
    "-A PREROUTING -m comment --comment x -j ACCEPT\n"
    '-A srpv12345678-in -m comment --comment "srprov:hello:srpv12345678:abcdef01:1/4" -j DROP\n'
)
_CONTAINER = {
    "Id": _ID, "Names": ["/srprov.hello.a"], "Image": "x", "State": "exited", "Status": "Exited (0) 3 minutes ago",
    "Labels": {**_OURS, "srprov.config-parts": "image=1,b=2", "srprov.stop-grace": "10"},
    "NetworkSettings": {"Networks": {"n": {"IPAddress": "10.0.0.2"}}},
}  # fmt: skip
_NETWORK = {
    "Name": "srprov.hello", "Id": "x", "Labels": _OURS, "Options": {"a": "b"},
    "IPAM": {"Config": [{"Subnet": "10.0.0.0/24", "Gateway": "10.0.0.1"}]},
}  # fmt: skip
_VOLUME = {
    "Name": "srprov.hello.a",
    "CreatedAt": "2026-01-01T00:00:00Z",
    "Labels": _OURS,
    "Mountpoint": "/var/lib/docker/volumes/x/_data",
}
_IMAGE = {"Id": f"sha256:{_ID}", "RepoTags": ["a:1"], "RepoDigests": [f"a@sha256:{_ID}"], "Labels": _OURS}
_LIMITS = (
    f'/var/lib/docker/containers/{_ID}/hostconfig.json:"Memory":5\n'
    f'/var/lib/docker/containers/{_ID}/hostconfig.json:"RestartPolicy":{{"Name":"always","MaximumRetryCount":0\n'
)
_THINGS: Mapping[str, tuple[str, ...]] = {
    "container": (json.dumps([_CONTAINER]), _LIMITS),
    "network": (json.dumps([_NETWORK]),),
    "volume": (json.dumps({"Volumes": [_VOLUME]}),),
    "image": (json.dumps([_IMAGE]),),
    "file": (f"{_ID}  ./hello/placement.json\n",),
    "unit": (f"enabled {_ID}  srprov-hello.service\n",),
    "tree": ("/var/lib/srprov/hello/trees/abc\n",),
    "data": (f"/var/lib/srprov/hello/data/{_ID} there\n",),
    "secret": (f"400 ./hello/secrets/a\n{_ID}  ./hello/secrets/a\n",),
    "vxlan": (
        _LINKS,
        json.dumps([{"ifname": "srpv7", "entries": [{"mac": "0", "dst": "192.0.2.1", "master": "srpb7"}]}]),
    ),
    "vxlan_filter": (_RULES,),
    "wireguard": (_LINKS, _TUNNEL),
    "wireguard_peers": (_LINKS, _TUNNEL),
    "wireguard_routes": (_LINKS, _TUNNEL),
}
"""Kind -> what a robot answers to each of its questions."""
_HOST = (
    "Filesystem 1024-blocks Used Available Capacity Mounted on\n/dev/a 100 50 50 50% /\n"
    "/proc/stat:cpu  1 2 3 4 5 6 7 8\n"
    "/proc/stat:cpu0 1 2\n/proc/meminfo:MemAvailable: 5 kB\n"
    f"{MOUNTINFO}:30 23 0:26 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw\n/disks:/sys/block/sda/device\n"
    "/proc/uptime:1.0 2.0\n/proc/net/dev:  eth0: 1 2 3 4 5 6 7 8 9 10\n/proc/diskstats: 8 0 sda 1 2 3 4 5 6 7 8 9\n"
    "/sys/class/thermal/thermal_zone0/temp:40000\n/timesyncd:yes\n"
    "/chrony:A29FC801,192.0.2.1,4,1763.1,0.1,0.2,0.3,1,2,3,0.4,0.5,64,Normal\n/proc/5/cgroup:0::/docker/a\n"
)
_FIREWALL = (
    "## iptables-save\n*filter\n:INPUT DROP [1:2]\n[1:2] -A INPUT -s 192.0.2.0/24 -p udp --dport 4789 -j DROP\n## nft\n"
    "table inet x {\nchain y {\ntype filter hook input priority 0; policy drop;\ncounter packets 5 bytes 9 drop\n"
    "ip saddr 192.0.2.1 counter packets 1 bytes 2 reject\n}\n}\n"
)
_RECORD = {
    "instance": "hello", "serial": 3, "source": "x", "subnet": "10.0.0.0/24", "mtu": 1400, "port": 4789, "vni": 5,
    "services": {"a": {"ip": "10.0.0.2", "mac": "2", "network": "overlay", "robot": "r1"}},
    "robots": {"r1": {"gateway": "10.0.0.1", "vtep": "192.0.2.1"}},
}  # fmt: skip
_PORTS = 'tcp LISTEN 0 128 0.0.0.0:22 0.0.0.0:* users:(("sshd",pid=1,fd=3))\nudp UNCONN 0 0 [::1%lo]:53 *:*\n'
_SHARED = json.dumps([{"Names": ["/a"], "Ports": [{"PublicPort": 5, "Type": "tcp", "IP": "::"}], "Labels": _OURS}])
_DISTRIBUTION = {"Descriptor": {"digest": f"sha256:{_ID}"}, "Platforms": [{"os": "linux", "architecture": "amd64"}]}
_INSPECTED = {"Id": f"sha256:{_ID}", "Architecture": "amd64", "RootFS": {"Layers": [f"sha256:{_ID}"]}}


def _said(content: bytes) -> str:
    return content.decode("utf-8", "replace")


def _thing(kind: str, at: int) -> Use:
    """Return what reads a kind's answers, one of them another; then compares what there is with what is wanted."""

    def use(_folder: Path, content: bytes) -> None:
        said = [_said(content) if index == at else text for index, text in enumerate(_THINGS[kind])]
        try:
            found = MODULES[kind].parse([Reply(status=200, out=text) for text in said])
        except TooManyError:
            return  # that robot's failure
        for one in found:
            try:
                _check(one)
            except ValueError:  # that robot's failure
                continue
            assert isinstance(one.name, str) and isinstance(one.instance, str)
            json.dumps({key: str(value) for key, value in one.state.items()})
            if kind == "vxlan":
                want = VxlanParams(
                    instance="a", vni=1, local="192.0.2.1", port=4789, bridge="b", mtu=1400,
                    fdb=(("00:00:00:00:00:00", "192.0.2.2"),),
                )  # fmt: skip
                change = MODULES[kind].check(one.name, want, one.state)
                assert change is None or len(change.cause) < 300_000

    return use


def _probe(name: str) -> Use:
    def use(_folder: Path, content: bytes) -> None:
        parse_host(Host(name="r1", address="r1"), replies({**COMPUTER, name: _said(content)}), None)

    return use


def _counters(_folder: Path, content: bytes) -> None:
    read_host(_said(content))
    files = by_file(_said(content))
    group(5, files.get("/proc/5/cgroup", ()), mounts(files.get(MOUNTINFO, ())))


def _target(_folder: Path, content: bytes) -> None:
    for at in range(3):
        said = [json.dumps(INFO), json.dumps([_IMAGE]), json.dumps(_INSPECTED)]
        said[at] = _said(content)
        info, listed, inspected = (Reply(status=200, out=one) for one in said)
        second = second_look([info, listed])
        read_target([info, listed], [Reply(status=0, out=said[2]), *[inspected] * (len(second) - 1)])


def _rules(_folder: Path, content: bytes) -> None:
    for one in parse_rules(_said(content))[:50]:
        may_match(one, ())
        assert one.text.isprintable()


def _records(_folder: Path, content: bytes) -> None:
    with contextlib.suppress(TooManyError):  # whoever asks the robot says so of it
        parse_placements(Reply(status=200, out=_said(content)))


def _plain(read: Callable[[Reply], object]) -> Use:
    def use(_folder: Path, content: bytes) -> None:
        read(Reply(status=200, out=_said(content)))

    return use


def answers() -> Mapping[str, tuple[tuple[str, ...], Use]]:
    """Return name -> real answers, and what is done with a mutated one."""
    both = {
        one.name: tuple(dict.fromkeys(text for text in (COMPUTER.get(one.name), PI.get(one.name)) if text))
        for one in PROBES
    }
    nobody = Reply(status=200, out="[]")
    return {
        **{f"robot {name}": (texts, _probe(name)) for name, texts in both.items() if texts},
        **{
            f"robot {kind} {at}": ((text,), _thing(kind, at))
            for kind, texts in _THINGS.items()
            for at, text in enumerate(texts)
        },
        "robot counters": ((_HOST,), _counters),
        "robot firewall": ((_FIREWALL,), _rules),
        "robot records": ((f"{STATE_ROOT}/hello/placement.json:{json.dumps(_RECORD)}\n",), _records),
        "robot ports": ((_PORTS,), _plain(lambda reply: taken_ports([reply, nobody]))),
        "robot published": ((_SHARED,), _plain(lambda reply: taken_ports([nobody, reply]))),
        "robot digest": ((json.dumps(_DISTRIBUTION),), _plain(_digest)),
        "robot images": ((json.dumps(INFO), json.dumps([_IMAGE]), json.dumps(_INSPECTED)), _target),
    }
