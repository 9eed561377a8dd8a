"""`network.encryption: wireguard` on real robots: what is on the wire, who gets in, what stays, and what new keys cost.

The captures are this machine's own, of the cables of the lab's bridge; frames are injected from this machine, which is
on that bridge and no member.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import socket
import struct
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, causes, changed, edf, part_of_lab
from tests.lab.looks import address_of, ids, reached, wait_until

pytestmark = pytest.mark.lab

HOMES = {"web": "robot1", "client": "robot2", "extra": "robot3"}
ROBOTS = sorted(HOMES.values())
WORD = b"a word that everybody on the wire could read"
ETH_P_ALL = 3
VXLAN_PORT = 4789
INJECTED = 5


@dataclass
class Capture:
    """What passed on cables of robots, as it was on the wire."""

    frames: list[bytes] = field(default_factory=list)

    def udp_ports(self) -> set[int]:
        """Give the destination ports of UDP over IPv4."""
        return {struct.unpack_from("!H", one, 2)[0] for one in self._udp()}

    def vnis(self) -> set[int]:
        """Give the overlays whose VXLAN packets passed as they are."""
        vxlan = [one for one in self._udp() if struct.unpack_from("!H", one, 2)[0] == VXLAN_PORT]
        return {int.from_bytes(one[12:15], "big") for one in vxlan}

    def _udp(self) -> list[bytes]:
        """Give UDP over IPv4, from its own header on."""
        udp = [frame for frame in self.frames if frame[12:14] == b"\x08\x00" and frame[23] == socket.IPPROTO_UDP]
        return [frame[14 + 4 * (frame[14] & 15) :] for frame in udp]

    def holds(self, what: bytes) -> bool:
        return any(what in frame for frame in self.frames)


@contextlib.contextmanager
def capturing(lab: Lab, robots: Sequence[str]) -> Iterator[Capture]:
    """Capture all frames on the cables of robots, by packet(7)."""
    capture, over = Capture(), threading.Event()
    sockets = []
    for robot in robots:
        one = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 2**20)
        one.bind((lab.site.link(robot), ETH_P_ALL))
        one.settimeout(0.1)
        sockets.append(one)

    def read(one: socket.socket) -> None:
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                capture.frames.append(one.recv(65_535))

    threads = [threading.Thread(target=read, args=(one,)) for one in sockets]
    for thread in threads:
        thread.start()
    try:
        yield capture
    finally:
        over.set()
        for thread in threads:
            thread.join()
        for one in sockets:
            one.close()


class Site:
    """One experiment that tests share: it runs, encrypted, from the first test on."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.folder = lab, folder
        self.inventory = part_of_lab(lab, ROBOTS, folder / "lab.yml")
        (folder / "www").mkdir()
        (folder / "www" / "word").write_bytes(WORD)

    def edf(self, encryption: str) -> str:
        """Write the experiment; give its path."""
        web = busybox("busybox", "httpd", "-f", "-p", "8080", "-h", "/www", volumes=["./www:/www:ro"])
        services = {"web": web, "client": busybox(), "extra": busybox()}
        placed = {name: {**one, "robot": HOMES[name]} for name, one in services.items()}
        path = self.folder / "experiment.edf"
        path.write_text(edf("hidden", placed, network={"encryption": encryption}), encoding="utf-8")
        return str(path)

    def apply(self, *more: str, encryption: str = "wireguard") -> Any:
        done = self.lab.srprov("apply", self.edf(encryption), "-i", self.inventory, "-y", "--settle", "0", "--json",
                               *more)  # fmt: skip
        assert done.code == 0, done
        return done.json

    def address(self, service: str) -> str:
        return address_of(self.lab, HOMES[service], f"srprov.hidden.{service}")

    def asked(self) -> bytes:
        """Let the client ask the web server for its word."""
        ask = ("timeout", "5", "wget", "-q", "-O", "-", "http://web:8080/word")
        return self.lab.shell("robot2", "docker", "exec", "srprov.hidden.client", *ask).out.encode()

    def inside(self, robot: str, *words: str) -> str:
        """Run a command in a robot's namespace of the instance."""
        (netns,) = self.lab.shell(robot, "ls", "/run/netns").out.split()
        return self.lab.shell(robot, "ip", "netns", "exec", netns, *words).out

    def keys(self) -> set[str]:
        return {line.split()[1] for robot in ROBOTS for line in self.inside(robot, "wg", "show", "all",
                                                                            "public-key").splitlines()}  # fmt: skip

    def processes(self, robot: str) -> list[str]:
        """Give the process ids of a robot's wireguard-go, by its own /proc; those that ended are not among them."""
        script = "grep -lz ^wireguard-go /proc/[0-9]*/cmdline 2>/dev/null; true"
        return re.findall(r"/proc/(\d+)/", self.lab.shell(robot, "sh", "-c", script).out)


@pytest.fixture(scope="module")
def site(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Site:
    """Give the experiment; its first apply is the first test's."""
    return Site(lab_of_module, tmp_path_factory.mktemp("encryption"))


@dataclass(frozen=True)
class Target:
    """A service, as a stranger would have to know it."""

    vni: int
    mac: str
    ip: str
    source: str
    """Of another service."""


def target(site: Site) -> Target:
    """Give what reaches the web server, from the client."""
    links = json.loads(site.lab.shell("robot1", "ip", "-j", "-d", "link", "show", "type", "vxlan").out)
    (link,) = [one for one in links if one]
    (network,) = site.lab.inspect("robot1", "srprov.hidden.web")["NetworkSettings"]["Networks"].values()
    vni = link["linkinfo"]["info_data"]["id"]
    return Target(vni, network["MacAddress"], network["IPAddress"], site.address("client"))


def checksum(data: bytes) -> int:
    total = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def inject(lab: Lab, robot: str, to: Target) -> None:
    """Send a robot five VXLAN packets with an echo request for a service in them, from this machine."""
    icmp = struct.pack("!BBHHH", 8, 0, 0, 1, 1) + b"from a stranger!"
    icmp = icmp[:2] + struct.pack("!H", checksum(icmp)) + icmp[4:]
    ends = socket.inet_aton(to.source) + socket.inet_aton(to.ip)
    head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(icmp), 1, 0, 64, 1, 0) + ends
    head = head[:10] + struct.pack("!H", checksum(head)) + head[12:]
    frame = bytes.fromhex(to.mac.replace(":", "")) + bytes.fromhex("020000000001") + b"\x08\x00" + head + icmp
    vxlan = struct.pack("!II", 0x08000000, to.vni << 8)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(INJECTED):
            stranger.sendto(vxlan + frame, (str(lab.site.address(robot)), VXLAN_PORT))


def echoes(lab: Lab) -> int:
    """Give how many echo requests the web server's own network was asked, by its kernel's word."""
    pid = lab.inspect("robot1", "srprov.hidden.web")["State"]["Pid"]
    said = lab.shell("robot1", "cat", f"/proc/{pid}/net/snmp").out
    names, values = (line.split() for line in said.splitlines() if line.startswith("Icmp:"))
    return int(values[names.index("InEchos")])


def test_an_encrypted_experiment_shows_nothing_on_the_wire(site: Site) -> None:
    """The word of a web server is on the wire without encryption, and is not with it; a second apply changes nothing.

    The first apply is without: so the capture is shown to see what there is to see, and the change to be made. And when
    its rules are removed by hand, what a stranger injects is delivered: so an injection is shown to be one.
    """
    lab = site.lab
    site.apply(encryption="none")
    with capturing(lab, ["robot1", "robot2"]) as plain:
        assert site.asked() == WORD
    assert plain.holds(WORD)
    assert VXLAN_PORT in plain.udp_ports() and target(site).vni in plain.vnis()
    to, before = target(site), echoes(lab)
    inject(lab, "robot1", to)
    assert site.asked() == WORD  # which came after it
    assert echoes(lab) == before
    tables = "nft -j list tables | grep -o 'srpv[0-9a-f]*' | sort -u"
    name = lab.shell("robot1", "sh", "-c", tables).out.strip()
    lab.shell("robot1", "sh", "-ec", f"nft delete table inet {name}; nft delete table bridge {name}")
    inject(lab, "robot1", to)
    wait_until(lambda: echoes(lab) == before + INJECTED, 5, "what is injected where no rule is")

    site.apply()
    with capturing(lab, ["robot1", "robot2"]) as hidden:
        assert site.asked() == WORD
        addresses = {site.address(service) for service in HOMES}
        assert reached(lab, "robot3", "srprov.hidden.extra", addresses) == addresses
    assert hidden.frames
    assert not hidden.holds(WORD)
    assert not any(hidden.holds(socket.inet_aton(address)) for address in addresses)
    assert to.vni not in hidden.vnis(), "another experiment of the same lab may have an overlay that is not encrypted"
    ports = {int(port) for robot in ROBOTS for port in re.findall(r"\t(\d+)$", site.inside(robot, "wg", "show", "all",
             "listen-port"), re.MULTILINE)}  # fmt: skip
    assert len(ports) == 1
    assert ports <= hidden.udp_ports()

    assert changed(site.apply()) == set()
    probed = lab.srprov("probe", site.edf("wireguard"), "-i", site.inventory)
    assert probed.code == 0, probed


def test_containers_take_packets_as_large_as_their_mtu(site: Site) -> None:
    """A ping of the overlay's MTU that must not be cut arrives, from every robot at every other; nothing is cut."""
    lab = site.lab
    for service, robot in HOMES.items():
        pid = lab.inspect(robot, f"srprov.hidden.{service}")["State"]["Pid"]
        show = ("nsenter", "-t", str(pid), "-n", "ip", "-j", "link", "show", "eth0")
        mtu = json.loads(lab.shell(robot, *show).out)[0]["mtu"]
        assert mtu == 1500 - 76 - 50
        for other in HOMES.keys() - {service}:
            size = str(mtu - 28)
            ping = ("ping", "-c", "1", "-W", "2", "-M", "do", "-s", size, site.address(other))
            lab.shell(robot, "nsenter", "-t", str(pid), "-n", *ping)


def test_a_stranger_on_the_lan_is_not_let_in(site: Site) -> None:
    """A frame that an open overlay would deliver is not; the robot listens on no VXLAN port at all."""
    lab = site.lab
    to, before = target(site), echoes(lab)
    with capturing(lab, ["robot1"]) as capture:
        inject(lab, "robot1", to)
        wait_until(lambda: capture.holds(b"from a stranger!"), 5, "the injected frame on the robot's cable")
    assert site.asked() == WORD  # which came after it
    assert echoes(lab) == before
    assert f":{VXLAN_PORT} " not in lab.shell("robot1", "ss", "-Hlun").out


def test_what_encrypts_is_mended_when_its_process_was_killed(site: Site) -> None:
    """Without its process nobody is reached; `status` and a plan say so, and its file is applied, with no key in it."""
    lab = site.lab
    before = ids(lab, ROBOTS, "hidden")
    (process,) = site.processes("robot2")
    lab.shell("robot2", "kill", "-9", process)
    wait_until(lambda: not site.processes("robot2"), 5, "the end of the process")
    assert reached(lab, "robot3", "srprov.hidden.extra", [site.address("client")]) == set()

    seen = lab.srprov("status", "-i", site.inventory, "--instance", "hidden", "--json").json
    assert [(one["robot"], one["kind"], one["problem"]) for one in seen["links"]] == [
        ("robot2", "wireguard", "missing")
    ]
    kept = str(site.folder / "plan.json")
    plan = lab.srprov("plan", site.edf("wireguard"), "-i", site.inventory, "--json", "-o", kept).json

    assert {one.split(":")[0] for one in causes(plan)} == {
        "robot2/wireguard", "robot2/wireguard_routes", *(f"{robot}/wireguard_peers" for robot in ROBOTS),
    }  # fmt: skip
    assert "public key of robot2" in Path(kept).read_text(encoding="utf-8")
    done = lab.srprov("apply", kept, "-i", site.inventory, "-y", "--settle", "0")
    assert done.code == 0, done
    addresses = {site.address(service) for service in HOMES}
    assert reached(lab, "robot3", "srprov.hidden.extra", addresses) == addresses
    assert ids(lab, ROBOTS, "hidden") == before
    assert changed(site.apply()) == set()


def test_keys_change_under_load_without_loss(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """While two containers speak, every robot gets a new key; none of their packets is lost, and no old key stays."""
    lab = site.lab
    before, old = ids(lab, ROBOTS, "hidden"), site.keys()
    pid = lab.inspect("robot2", "srprov.hidden.client")["State"]["Pid"]
    # a handshake that waits for a processor holds 128 packets back, and drops more
    ping = f"nsenter -t {pid} -n ping -D -i 0.04 -w 250 {site.address('web')}"
    process = lab.shell("robot2", "sh", "-c", f"{ping} >/tmp/load 2>&1 </dev/null & echo $!").out.strip()
    report = site.apply("--rotate-keys")
    lab.shell("robot2", "kill", "-INT", process)
    load = wait_until(lambda: re.search("(?s).*packet loss", lab.shell("robot2", "cat", "/tmp/load").out), 5, "its end")

    replies = re.findall(r"^\[([0-9.]+)\] .* bytes from .* icmp_seq=(\d+)", load[0], re.MULTILINE)
    times = [float(at) for at, _ in replies]
    gap = max(later - earlier for earlier, later in itertools.pairwise(times))
    with capsys.disabled():
        sys.stderr.write(f"\nkeys of 3 robots changed: {len(times)} replies, longest gap {1000 * gap:.0f} ms\n")
    # the one that was under way when ping was ended has no reply
    assert [int(number) for _, number in replies] == list(range(1, len(replies) + 1)), load[0][-300:]
    assert len(replies) >= 10
    new = site.keys()
    assert len(new) == len(ROBOTS)
    assert old.isdisjoint(new)
    assert {one.partition("/")[2].partition(":")[0] for one in changed(report)} == {
        "wireguard", "wireguard_peers", "wireguard_routes",
    }  # fmt: skip
    assert ids(lab, ROBOTS, "hidden") == before
    assert changed(site.apply()) == set()


def test_destroy_leaves_no_interface_key_or_process(site: Site) -> None:
    """Robots are as before: no link, namespace, socket, file, open port or process."""
    lab = site.lab
    done = lab.srprov("destroy", site.edf("wireguard"), "-i", site.inventory, "-y")
    assert done.code == 0, done
    for robot in ROBOTS:
        assert lab.leftovers(robot) == NOTHING
        assert site.processes(robot) == []
        assert not re.search(r":2\d{4} ", lab.shell(robot, "ss", "-Hlun").out)


def test_a_robot_that_cannot_encrypt_is_named_with_the_reason(site: Site) -> None:
    """Without wireguard-go, `doctor` warns of it, and its service goes nowhere: 8, and nothing is done."""
    lab = site.lab
    lab.shell("robot2", "mv", "/usr/bin/wireguard-go", "/usr/bin/hidden-go")
    try:
        warned = lab.srprov("doctor", "-i", site.inventory, "--limit", "robot2", "--json")
        refused = lab.srprov("apply", site.edf("wireguard"), "-i", site.inventory, "-y")
        plain = lab.srprov("plan", site.edf("none"), "-i", site.inventory)
    finally:
        lab.shell("robot2", "mv", "/usr/bin/hidden-go", "/usr/bin/wireguard-go")
    (check,) = [one for one in warned.json["robots"]["robot2"] if one["check"] == "wireguard"]
    assert (warned.code, check["verdict"]) == (0, "warning")
    assert "wireguard-go" in check["remedy"]
    assert refused.code == 8, refused
    assert "robot2: no WireGuard (neither its kernel has it, nor has it wireguard-go)" in refused.err
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING] * len(ROBOTS)
    assert plain.code == 0, plain
