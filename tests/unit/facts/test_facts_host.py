"""One robot's facts, from what real robots answer."""

import json
import subprocess
from pathlib import Path

import pytest
from msgspec.structs import replace
from robot_outputs import (
    BUSYBOX,
    COMPUTER,
    DOCKER0,
    ETH0,
    INFO,
    LATER,
    LO,
    PI,
    PING,
    ROUTES,
    VXLAN,
    WLAN0,
    replies,
)

from srprov.definitions.model import Host
from srprov.facts.answers import parse_files
from srprov.facts.host import docker_arch, host_queries, parse_host, with_closer
from srprov.facts.links import parse_hidden
from srprov.facts.placements import parse_placements
from srprov.facts.probes import FILES
from srprov.facts.spelled import HOSTS, MOST_LINES, read_spelled
from srprov.robot_answers import TooManyError
from srprov.session import Measures
from srprov.wire import EngineQuery, Query, Reply

HOST = Host(name="robot1", address="robot1.example")
KIB = 1024


def test_the_questions_are_one_batch_with_the_engine_in_it() -> None:
    plain = host_queries()
    assert [q.path for q in plain if isinstance(q, EngineQuery)] == ["/_ping", "/info"]
    assert sum(isinstance(q, Query) for q in plain) <= 12
    assert "date" in plain[0].command


@pytest.mark.parametrize("robot", [COMPUTER, PI, BUSYBOX])
@pytest.mark.parametrize("later", [LATER, None])
@pytest.mark.parametrize("ping", [PING, None])
def test_a_closer_look_gives_what_one_look_at_everything_would(
    robot: dict[str, str], later: Reply | None, ping: object
) -> None:
    every = replies(robot, ping)
    wanted = parse_host(HOST, every, None, now=1795223385.25, later=later)
    first = parse_host(HOST, every[:-1], None, now=1795223385.25)
    assert with_closer(first, every, later) == wanted
    assert first != wanted or ping is None
    assert with_closer(first, every[:-1], None) == first


def test_a_computer() -> None:
    facts = parse_host(HOST, replies(COMPUTER), None, now=1795223385.25, later=LATER)
    assert (facts.name, facts.hostname, facts.arch, facts.cpus, facts.load1) == ("robot1", "vm", "amd64", 2, 0.17)
    assert (facts.memory_total, facts.memory_available) == (24684096 * KIB, 24307996 * KIB)
    assert (facts.swap_total, facts.swap_free) == (0, 0)
    assert (facts.kernel, facts.os) == ("6.1.0-37-amd64", "Debian GNU/Linux 12 (bookworm)")
    assert facts.processor == "11th Gen Intel(R) Core(TM) i5-1135G7 @ 2.40GHz"
    assert facts.board == "Intel(R) Client Systems NUC11TNHi5"
    assert facts.machine_id == "0f1e2d3c4b5a69788796a5b4c3d2e1f0"
    assert facts.usb == ("046d:0825 Webcam C270", "10c4:ea60")
    assert facts.serials == ("046d:0825 B1DA5A20",)
    assert facts.docker is not None
    assert (facts.docker.version, facts.docker.api_version) == ("20.10.24+dfsg1", "1.41")
    assert (facts.docker.root, facts.docker.storage_driver) == ("/var/lib/docker", "overlay2")
    assert not facts.docker.rootless
    assert facts.docker_problem == ""
    assert (facts.disk_total, facts.disk_free) == (1000000 * KIB, 500000 * KIB)
    assert (facts.underlay_link, facts.underlay_address, facts.underlay_mtu) == ("eth0", "192.0.2.2", 1400)
    assert (facts.speed_mbit, facts.traffic_mbit) == (1000.0, 20.0)
    assert facts.routes == ("0.0.0.0/0", "172.17.0.0/16", "192.0.2.0/24")
    assert facts.relies_on == ("192.0.2.1",)
    assert facts.devices == ("/dev/kvm", "/dev/net/tun", "/dev/rplidar", "/dev/video0")
    assert facts.tags == ("amd64", "camera")
    assert facts.clock_offset_s == 2.25
    assert (facts.user, facts.privileged, facts.slots) == ("root", True, 1)


def test_what_a_robot_relies_on() -> None:
    """Its SSH client, its gateways, name servers and time servers; neither names nor loopback."""
    files = """\
/etc/resolv.conf:# nameserver 10.9.9.9
/etc/resolv.conf:nameserver 10.0.0.53
/run/systemd/resolve/resolv.conf:nameserver 127.0.0.53
/etc/chrony/chrony.conf:pool 2.debian.pool.ntp.org iburst
/etc/chrony/chrony.conf:server 10.0.0.123 iburst
/etc/systemd/timesyncd.conf:NTP=10.0.0.124 time.lab 10.0.0.125
/etc/os-release:nameserver 10.8.8.8
"""
    routes = [{"dst": "10.5.0.0/16", "nexthops": [{"gateway": "10.0.0.2"}, {"gateway": "nonsense"}]}]
    identity = "connection ::ffff:10.0.0.77 5 ::ffff:10.0.0.5 22\n"
    robot = {**PI, "identity": identity, "files": files, "routes": json.dumps(routes)}
    relies_on = parse_host(HOST, replies(robot), None).relies_on
    last = ("10.0.0.2", "10.0.0.53", "10.0.0.77", "10.0.0.123", "10.0.0.124", "10.0.0.125")
    assert relies_on == last


def test_a_robots_own_files_say_what_it_calls_things() -> None:
    """Comments, names that are none, addresses of one interface, and homes that are no plain path are left out."""
    facts = parse_host(HOST, replies(PI), None)
    assert facts.hosts == ("127.0.0.1 localhost", "127.0.1.1 turtle7", "10.0.0.9 camera.lab camera", "fd00::9 camera6")
    assert facts.homes == ("pi:/home/pi", "root:/root")
    assert (facts.home("pi"), facts.home("nobody"), facts.hosts_cut) == ("/home/pi", "", False)


def test_a_long_hosts_file_is_read_to_its_limit_which_is_said(tmp_path: Path) -> None:
    """What a robot sends of a list of half a million names ends soon after what is read."""
    many = tmp_path / "hosts"
    many.write_text("".join(f"10.0.0.1 a{number}\n" for number in range(50_000)))
    words = ["sh", "-c", FILES.command.replace(HOSTS, str(many))]
    out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    said = read_spelled(parse_files(out.replace(str(many), HOSTS)))
    assert (len(said.hosts), said.hosts_cut) == (MOST_LINES, True)
    assert out.count(str(many)) < 2 * MOST_LINES + 1


def test_links_say_what_the_overlay_must_know() -> None:
    links = {link.name: link for link in parse_host(HOST, replies(COMPUTER), None).links}
    assert list(links) == ["docker0", "eth0", "lo", "srpv7"]
    assert links["eth0"].addresses == ("192.0.2.2/24", "fd00::2/64", "fe80::fc:ff:fe00:1/64")
    assert (links["eth0"].mtu, links["eth0"].speed_mbit, links["eth0"].kind) == (1400, 1000.0, "")
    vxlan = links["srpv7"]
    assert (vxlan.kind, vxlan.vni, vxlan.port, vxlan.alias) == ("vxlan", 77, 4789, "srprov:hello")


def test_a_raspberry_pi_on_wifi() -> None:
    facts = parse_host(HOST, replies(PI), None, now=1795223388.25)
    assert (facts.arch, facts.cpus, facts.load1) == ("arm64", 4, 1.52)
    assert (facts.swap_total, facts.swap_free) == (102396 * KIB, 51198 * KIB)
    assert (facts.underlay_link, facts.underlay_address) == ("wlan0", "10.0.0.5")
    assert facts.speed_mbit == 72.2
    assert facts.clock_offset_s == 0
    assert facts.tags == tuple(
        sorted(
            ["arm64", "audio", "camera", "gpio", "gpu", "i2c", "joystick", "raspberrypi", "rt", "serial", "spi", "wifi"]
        )
    )
    assert facts.user == "pi"


def test_wifi_without_a_known_speed() -> None:
    facts = parse_host(HOST, replies({**PI, "wireless": "wireless wlan0\n"}), None)
    assert facts.speed_mbit == 0
    assert "wifi" in facts.tags


def test_a_board_that_only_decodes_video_has_no_camera() -> None:
    devices = "dev /dev/video10\ndev /dev/video13\n"
    assert "camera" not in parse_host(HOST, replies({**PI, "devices": devices}), None).tags


def test_a_jetson() -> None:
    model = "/proc/device-tree/model:NVIDIA Jetson Orin Nano Developer Kit\0\n/sys/kernel/realtime:1\n"
    robot = {**PI, "files": model, "devices": "dev /dev/nvhost-gpu\n"}
    tags = parse_host(HOST, replies(robot), None).tags
    assert {"jetson", "gpu", "nvidia", "rt"} <= set(tags)
    assert "raspberrypi" not in tags


@pytest.mark.parametrize(
    ("machine", "bits", "arch"),
    [
        ("aarch64", "32", "arm"),
        ("aarch64", "64", "arm64"),
        ("aarch64", "", "arm64"),
        ("x86_64", "32", "386"),
        ("armv7l", "32", "arm"),
        ("riscv64", "32", "riscv64"),
    ],
)
def test_a_32_bit_system_on_a_64_bit_kernel_runs_32_bit_containers(machine: str, bits: str, arch: str) -> None:
    identity = f"clock 1.0\nmachine {machine}\nbits {bits}\nid uid=0(root) gid=0(root)\n"
    assert parse_host(HOST, replies({**PI, "identity": identity}), None).arch == arch


BINFMT = "/proc/sys/fs/binfmt_misc/qemu-"


@pytest.mark.parametrize(
    ("lines", "arch", "emulates", "runs"),
    [
        (
            "aarch64:enabled aarch64:flags:_POF arm:enabled arm:flags:_OCF",
            "amd64",
            ("arm", "arm64"),
            "amd64 386 arm arm64",
        ),
        ("aarch64:flags:_POCF aarch64:enabled", "amd64", ("arm64",), "amd64 386 arm64"),
        ("aarch64:enabled aarch64:flags:_PO", "amd64", (), "amd64 386"),  # no emulator inside of a container
        ("aarch64:disabled aarch64:flags:_F", "amd64", (), "amd64 386"),
        ("x86_64:enabled x86_64:flags:_F aarch64:enabled aarch64:flags:_F", "arm64", ("amd64",), "arm64 arm amd64"),
        ("alpha:enabled alpha:flags:_F aarch64:enabled aarch64:flags:_f", "amd64", (), "amd64 386"),
    ],
)
def test_an_emulator_counts_where_containers_have_it_too(
    lines: str, arch: str, emulates: tuple[str, ...], runs: str
) -> None:
    files = "".join(f"{BINFMT}{word.replace('flags:_', 'flags: ')}\n" for word in lines.split())
    machine = {"amd64": "x86_64", "arm64": "aarch64"}[arch]
    identity = f"clock 1.0\nmachine {machine}\nbits 64\nid uid=0(root) gid=0(root)\n"
    facts = parse_host(HOST, replies({**PI, "identity": identity, "files": files}), None)
    assert (facts.arch, facts.emulates, " ".join(facts.runs)) == (arch, emulates, runs)


def test_a_board_says_what_it_is_where_its_processor_has_no_name() -> None:
    facts = parse_host(HOST, replies(PI), None)
    assert (facts.processor, facts.board) == ("", "Raspberry Pi 4 Model B Rev 1.4")
    assert (facts.machine_id, facts.usb, facts.serials) == ("", (), ("board 10000000a1b2c3d4",))


def test_busybox_knows_no_fractions_of_a_second() -> None:
    facts = parse_host(HOST, replies(BUSYBOX, None), None, now=1795223387.0)
    assert facts.clock_offset_s == 0.5
    assert (facts.arch, facts.privileged, facts.user) == ("arm", False, "robot")
    assert facts.docker is None
    assert facts.docker_problem == "no Docker Engine listens on /var/run/docker.sock"
    assert facts.disk_free == 82215012 * KIB


@pytest.mark.parametrize(
    ("ping", "problem"),
    [
        ({}, "the engine answered 200"),
        ([], "the engine answered 200"),
        ({"api-version": "../../etc"}, "the engine answered 200"),
        ({"api-version": 3}, "the engine answered 200"),
    ],
)
def test_an_engine_that_talks_nonsense_is_none(ping: object, problem: str) -> None:
    facts = parse_host(HOST, replies(COMPUTER, ping), None)
    assert (facts.docker, facts.docker_problem) == (None, problem)


def test_without_info_the_headers_tell_the_version_and_the_configuration_the_folder() -> None:
    disk = "root /data/docker\n" + COMPUTER["disk"] + "/dev/vdc1 2000 500 1000 50% /data\n"
    facts = parse_host(HOST, replies({**COMPUTER, "disk": disk})[:-1], None)
    assert facts.docker is not None
    assert (facts.docker.version, facts.docker.api_version) == ("20.10.24+dfsg1", "1.41")
    assert (facts.docker.storage_driver, facts.docker.rootless) == ("", False)
    assert facts.disk_total == 2000 * KIB
    whole = parse_host(HOST, replies({**COMPUTER, "disk": disk}, info={**INFO, "DockerRootDir": "/"}), None)
    assert whole.disk_total != 2000 * KIB, "the engine knows better than its configuration"


@pytest.mark.parametrize(
    ("server", "version"),
    [
        ("Docker/27.1.2 (linux)", "27.1.2"),
        ("Docker/27", "27"),
        ("nginx", ""),
        (None, ""),
        (7, ""),
        ("a/b\x1b[31m c", "b[31m"),
    ],
)
def test_what_calls_itself_an_engine(server: object, version: str) -> None:
    docker = parse_host(HOST, replies(COMPUTER, {"api-version": "1.41", "server": server})[:-1], None).docker
    assert docker is not None
    assert docker.version == version


def test_a_rootless_engine_with_its_data_elsewhere() -> None:
    info = {**INFO, "SecurityOptions": ["name=rootless"], "DockerRootDir": "/home/robot/.local/share/docker"}
    disk = COMPUTER["disk"] + "/dev/vdc1 2000 500 1000 50% /home\n"
    facts = parse_host(HOST, replies({**COMPUTER, "disk": disk}, info=info), None)
    assert facts.docker is not None
    assert facts.docker.rootless
    assert facts.disk_total == 2000 * KIB


def test_the_inventory_wins_and_adds() -> None:
    host = replace(HOST, tags=("lidar", "amd64"), slots=3, devices=("/dev/ttyS3",), bandwidth_mbit=54.0, user="robot")
    facts = parse_host(host, replies(COMPUTER), None)
    assert facts.tags == ("amd64", "camera", "lidar")
    assert "/dev/ttyS3" in facts.devices
    assert (facts.slots, facts.speed_mbit) == (3, 54.0)
    assert parse_host(HOST, replies(COMPUTER), None).slots == 1


def test_the_controller_itself_is_measured_by_psutil() -> None:
    measures = Measures(
        cpus=8,
        load1=2.0,
        memory_total=100,
        memory_available=60,
        swap_total=10,
        swap_free=5,
        link_speed_mbit={"eth0": 2500.0, "lo": 0.0},
    )
    facts = parse_host(HOST, replies(COMPUTER), measures)
    assert (facts.cpus, facts.load1, facts.memory_total, facts.memory_available) == (8, 2.0, 100, 60)
    assert (facts.swap_total, facts.swap_free, facts.speed_mbit) == (10, 5, 2500.0)


def test_processors_come_from_sys_where_cpuinfo_numbers_none() -> None:
    files = "/sys/devices/system/cpu/online:0-3,6\n"
    assert parse_host(HOST, replies({**COMPUTER, "cpus": "0\n", "files": files}), None).cpus == 5


def test_an_old_kernel_without_memavailable() -> None:
    files = "".join(line for line in COMPUTER["files"].splitlines(True) if "MemAvailable" not in line)
    facts = parse_host(HOST, replies({**COMPUTER, "files": files}), None)
    assert facts.memory_available == (24337516 + 8880 + 94972) * KIB


def test_absurd_numbers_are_kept_in_bounds() -> None:
    files = """\
/proc/loadavg:99999999999 nan inf
/proc/meminfo:MemTotal: 1000 kB
/proc/meminfo:MemAvailable: 999999999999999999 kB
/proc/meminfo:SwapTotal: -5 kB
/proc/meminfo:SwapFree: 7 kB
/sys/class/net/eth0/speed:4294967295
"""
    facts = parse_host(HOST, replies({**COMPUTER, "files": files, "cpus": "123456789\n"}), None)
    assert facts.load1 == 100_000.0
    assert facts.memory_available == facts.memory_total == 1000 * KIB
    assert (facts.swap_total, facts.swap_free) == (0, 0)
    assert facts.cpus == 4096
    assert facts.speed_mbit == 0


def test_nothing_at_all_is_still_a_robot() -> None:
    facts = parse_host(HOST, [], None, now=5.0)
    assert (facts.name, facts.cpus, facts.docker, facts.clock_offset_s) == ("robot1", 1, None, 0.0)
    assert facts.docker_problem
    assert not facts.privileged


def test_control_characters_never_come_through() -> None:
    files = '/proc/sys/kernel/hostname:\x1b[31mred\u202e\x07\n/etc/os-release:PRETTY_NAME="x\x1b]0;t\x07"\n'
    facts = parse_host(HOST, replies({**COMPUTER, "files": files}), None)
    assert facts.hostname == "[31mred"
    assert facts.os == "x]0;t"


def test_one_file_cannot_speak_for_another() -> None:
    files = "/etc/os-release:NAME=x\x0c/proc/loadavg:55.0 1 1\n/proc/loadavg:1.0 1 1\n"
    assert parse_host(HOST, replies({**COMPUTER, "files": files}), None).load1 == 1.0


@pytest.mark.parametrize(
    ("machine", "arch"),
    [
        ("x86_64", "amd64"),
        ("AMD64", "amd64"),
        ("aarch64", "arm64"),
        ("armv7l", "arm"),
        ("armv6l", "arm"),
        ("i686", "386"),
        ("riscv64", "riscv64"),
        ("loongarch64", "loongarch64"),
        ("", ""),
        ("a b", ""),
        ("$(x)", ""),
    ],
)
def test_architectures_by_dockers_names(machine: str, arch: str) -> None:
    assert docker_arch(machine) == arch


UP = ["UP"]
BRIDGE = {"ifname": "br-0123456789ab", "flags": UP, "addr_info": [{"local": "172.18.0.1", "prefixlen": 16}]}
VPN = {"ifname": "tun0", "flags": UP, "mtu": 1420, "addr_info": [{"local": "10.9.0.2", "prefixlen": 24}]}
SIX = {"ifname": "eth6", "flags": UP, "mtu": 1500, "addr_info": [{"local": "2001:db8::7", "prefixlen": 64}]}
LINKLOCAL = {"ifname": "eth9", "flags": UP, "addr_info": [{"local": "169.254.3.4", "prefixlen": 16}]}


@pytest.mark.parametrize(
    ("wish", "connection", "address", "reached", "links", "routes", "expected"),
    [
        pytest.param(
            None, "ssh", "r", "192.0.2.2", [LO, ETH0, VPN], ROUTES, ("eth0", "192.0.2.2"), id="where SSH reached it"
        ),
        pytest.param(None, "ssh", "r", "::ffff:10.9.0.2", [ETH0, VPN], ROUTES, ("tun0", "10.9.0.2"), id="IPv4 in IPv6"),
        pytest.param(None, "ssh", "r", "2001:db8::7", [ETH0, SIX], ROUTES, ("eth6", "2001:db8::7"), id="IPv6"),
        pytest.param(
            None, "ssh", "r", "fe80::fc:ff:fe00:1", [ETH0], ROUTES, ("eth0", "192.0.2.2"), id="link-local IPv6"
        ),
        pytest.param(
            None, "ssh", "r", "127.0.0.1", [LO, ETH0], ROUTES, ("eth0", "192.0.2.2"), id="through a tunnel to loopback"
        ),
        pytest.param(
            None, "ssh", "r", "172.17.0.1", [DOCKER0, ETH0], ROUTES, ("eth0", "192.0.2.2"), id="never Docker's"
        ),
        pytest.param(
            None, "ssh", "r", "172.18.0.1", [BRIDGE, ETH0], ROUTES, ("eth0", "192.0.2.2"), id="never Docker's bridge"
        ),
        pytest.param(None, "ssh", "r", "10.77.0.1", [VXLAN, ETH0], ROUTES, ("eth0", "192.0.2.2"), id="never ours"),
        pytest.param(
            None, "ssh", "10.9.0.2", "", [ETH0, VPN], ROUTES, ("tun0", "10.9.0.2"), id="the inventory's address"
        ),
        pytest.param(
            None, "local", "r", "10.9.0.2", [ETH0, VPN], ROUTES, ("eth0", "192.0.2.2"), id="local: not the user's SSH"
        ),
        pytest.param(None, "ssh", "r", "", [ETH0], [], ("eth0", "192.0.2.2"), id="no route, one interface"),
        *(
            pytest.param(
                None, "ssh", "r", one, [{**ETH0, "addr_info": [{"local": one, "prefixlen": 8}]}], [], ("", ""), id=one
            )
            for one in ("0.0.0.0", "255.255.255.255", "240.0.0.1", "::", "::1", "::ffff:127.0.0.1", "127.0.0.2")
        ),
        pytest.param(None, "ssh", "r", "", [ETH0, VPN], [], ("", ""), id="no route, two interfaces"),
        pytest.param(None, "ssh", "r", "169.254.3.4", [LINKLOCAL], [], ("eth9", "169.254.3.4"), id="no DHCP"),
        pytest.param("tun0", "ssh", "r", "192.0.2.2", [ETH0, VPN], ROUTES, ("tun0", "10.9.0.2"), id="wish: interface"),
        pytest.param(
            "10.9.0.2", "ssh", "r", "192.0.2.2", [ETH0, VPN], ROUTES, ("tun0", "10.9.0.2"), id="wish: address"
        ),
        pytest.param("10.9.0.2/24", "ssh", "r", "", [ETH0, VPN], ROUTES, ("tun0", "10.9.0.2"), id="wish: with prefix"),
        pytest.param("wlan7", "ssh", "r", "192.0.2.2", [ETH0], ROUTES, ("", ""), id="wish: not there"),
        pytest.param("lo", "ssh", "r", "192.0.2.2", [LO, ETH0], ROUTES, ("", ""), id="wish: loopback"),
    ],
)
def test_underlay(
    wish: str | None,
    connection: str,
    address: str,
    reached: str,
    links: list[object],
    routes: list[object],
    expected: tuple[str, str],
) -> None:
    host = Host(name="r", address=address, underlay=wish, connection=connection)
    identity = f"clock 1.0\nmachine x86_64\nid uid=0(root)\nconnection 1.1.1.1 5 {reached} 22\n"
    robot = {**COMPUTER, "identity": identity, "links": json.dumps(links), "routes": json.dumps(routes)}
    facts = parse_host(host, replies(robot), None)
    assert (facts.underlay_link, facts.underlay_address) == expected


def test_the_better_default_route_wins() -> None:
    routes = [{"dst": "default", "dev": "wlan0", "metric": 600}, {"dst": "default", "dev": "eth0", "metric": 100}]
    robot = {**BUSYBOX, "links": json.dumps([ETH0, WLAN0]), "routes": json.dumps(routes)}
    assert parse_host(HOST, replies(robot), None).underlay_link == "eth0"


def test_a_radio_counts_both_directions_and_a_cable_the_busier() -> None:
    shared = {**COMPUTER, "wireless": "wireless eth0\n"}
    assert parse_host(HOST, replies(shared), None, later=LATER).traffic_mbit == 30.0
    assert parse_host(HOST, replies(COMPUTER), None, later=LATER).traffic_mbit == 20.0
    assert parse_host(HOST, replies(COMPUTER), None).traffic_mbit == 0.0


def test_a_failed_command_still_counts_with_what_it_said() -> None:
    answers = replies(COMPUTER)
    answers[0] = Reply(status=1, out=answers[0].out, err="x", ok=False)
    assert parse_host(HOST, answers, None).arch == "amd64"


def test_the_overlays_of_docker_swarm_are_seen_where_it_keeps_them() -> None:
    """Their VNIs are taken on the robot, which shows no link of them: packets went into another overlay."""
    one = {"ifname": "vxlan0", "mtu": 1450, "linkinfo": {"info_kind": "vxlan", "info_data": {"id": 4097, "port": 4789}}}
    other = {**one, "ifname": "br0", "linkinfo": {"info_kind": "bridge"}}
    found = parse_hidden(f"{json.dumps([one])}\nnonsense\n{json.dumps([other, one])}\n")
    assert [(link.name, link.vni, link.port, link.up) for link in found] == [
        ("swarm-1", 4097, 4789, False), ("swarm-3", 4097, 4789, False),
    ]  # fmt: skip
    assert parse_hidden("") == ()


def test_no_record_hides_those_of_other_instances() -> None:
    """The first million characters of all were read: whose name came first could have its robots forget the others."""

    def line(instance: str, length: int) -> str:
        record = {"instance": instance, "serial": 1, "services": {"a": {"ip": "x" * length, "robot": "r1"}}}
        return f"/var/lib/srprov/{instance}/placement.json:{json.dumps(record)}\n"

    said = Reply(status=0, out=line("0", 1_100_000) + line("hello", 10))
    assert set(parse_placements(said)) == {"0", "hello"}
    with pytest.raises(TooManyError, match=r"more than 4 MiB; the longest is /var/lib/srprov/0/placement\.json"):
        parse_placements(Reply(status=0, out=line("0", 4_200_000) + line("hello", 10)))
    with pytest.raises(TooManyError):
        parse_placements(Reply(status=0, out="x\n" * 9000 + line("hello", 10)))
