"""The probes, run by real shells on this machine, against what psutil says of it."""

import ipaddress
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest

from srprov.definitions.model import Host
from srprov.facts.answers import parse_files, parse_traffic
from srprov.facts.host import host_queries, later_query, parse_host
from srprov.facts.model import HostFacts
from srprov.wire import Query, Reply

IP = shutil.which("ip", path="/usr/sbin:/sbin:/usr/bin:/bin")
# Debian's busybox prefers its own `ip`, which knows no JSON; on a robot with busybox `ip` is iproute2's, from PATH.
SHELLS = {"dash": ["dash"], "busybox": ["busybox", "sh"]}
PRELUDE = f'ip() {{ {IP} "$@"; }}\n'

pytestmark = pytest.mark.skipif(IP is None or not psutil.LINUX, reason="needs Linux and iproute2")


def ask(shell: list[str], query: object, prelude: str = PRELUDE) -> Reply:
    if not isinstance(query, Query):
        return Reply(status=0, err="no engine here", ok=False)
    # the way of a robot: one shell that reads its script from standard input
    done = subprocess.run(shell, input=prelude + query.command, capture_output=True, text=True, timeout=30)
    assert done.stderr == "", query.command
    return Reply(status=done.returncode, out=done.stdout, err=done.stderr, ok=done.returncode == 0)


def unusable() -> set[str]:
    """Return the IPv6 addresses that the kernel does not use yet, or no more, of which psutil says nothing."""
    deprecated, failed, tentative = 0x20, 0x08, 0x40  # linux/if_addr.h
    lines = Path("/proc/net/if_inet6").read_text().splitlines()
    entries = [(fields[0], int(fields[4], 16)) for fields in map(str.split, lines)]
    return {
        str(ipaddress.ip_address(bytes.fromhex(address)))
        for address, flags in entries
        if flags & (deprecated | failed | tentative)
    }


def all_links() -> dict[str, tuple[int, set[str]]]:
    """Return each interface's MTU and the IP addresses in use, by its name, at this moment, as psutil has them."""
    addresses, omitted = psutil.net_if_addrs(), unusable()
    return {
        name: (
            stats.mtu,
            {
                entry.address.split("%")[0]
                for entry in addresses.get(name, ())
                if entry.family in (socket.AF_INET, socket.AF_INET6)
            }
            - omitted,
        )
        for name, stats in psutil.net_if_stats().items()
    }


class Seen(NamedTuple):
    """What the probes said, and the interfaces just before and just after."""

    facts: HostFacts
    before: dict[str, tuple[int, set[str]]]
    after: dict[str, tuple[int, set[str]]]


@pytest.fixture(scope="module", params=SHELLS)
def seen(request: pytest.FixtureRequest) -> Seen:
    shell = SHELLS[request.param]
    if shutil.which(shell[0]) is None:
        pytest.skip(f"{shell[0]} is not installed")
    before, now = all_links(), time.time()
    replies = [ask(shell, query) for query in host_queries()]
    later = ask(shell, later_query(replies))
    facts = parse_host(Host(name="here", address="localhost"), replies, None, now=now, later=later)
    return Seen(facts, before, all_links())


@pytest.fixture(scope="module")
def facts(seen: Seen) -> HostFacts:
    return seen.facts


def test_processors_and_memory(facts: HostFacts) -> None:
    memory, swap = psutil.virtual_memory(), psutil.swap_memory()
    assert facts.cpus == psutil.cpu_count()
    assert facts.memory_total == memory.total
    assert facts.memory_available == pytest.approx(memory.available, rel=0.2)
    assert facts.swap_total == swap.total
    assert facts.load1 == pytest.approx(psutil.getloadavg()[0], abs=2.0)


def test_links(seen: Seen) -> None:
    """Other programs change interfaces at any time; what is there before and after is there in between."""
    links = {link.name: link for link in seen.facts.links}
    assert "lo" in links
    for name in links.keys() & seen.before.keys() & seen.after.keys():
        (mtu, first), (mtu_after, last) = seen.before[name], seen.after[name]
        assert links[name].mtu in (mtu, mtu_after)
        told = {address.split("/")[0] for address in links[name].addresses}
        assert first & last <= told <= first | last


def test_identity(facts: HostFacts) -> None:
    assert facts.hostname == socket.gethostname()
    assert abs(facts.clock_offset_s) < 2
    assert facts.arch
    assert facts.kernel
    assert facts.docker_problem == "no engine here"


def test_disk(facts: HostFacts) -> None:
    assert facts.disk_total == pytest.approx(psutil.disk_usage("/").total, rel=0.2)


def test_the_address_where_ssh_came_in_is_found_behind_sudo() -> None:
    identity = host_queries()[0]
    assert isinstance(identity, Query)
    # what sudo does: an ancestor still has the variable, the shell has SUDO_USER only
    script = f"env -u SSH_CONNECTION SUDO_USER=robot dash <<'EOF'\n{identity.command}\nEOF\n:"
    environment = {"SSH_CONNECTION": "10.0.0.1 50022 10.0.0.5 22", "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
    done = subprocess.run(["dash", "-c", script], env=environment, capture_output=True, text=True, timeout=30)
    assert "connection 10.0.0.1 50022 10.0.0.5 22\n" in done.stdout
    assert "user robot\n" in done.stdout


def moment() -> tuple[float, int]:
    """Return a time, and what has been sent through loopback until then, as psutil counts."""
    return time.monotonic(), psutil.net_io_counters(pernic=True)["lo"].bytes_sent


@pytest.mark.parametrize("shell", SHELLS.values(), ids=SHELLS)
def test_traffic_is_what_passed_between_two_readings(shell: list[str]) -> None:
    """10 MB through loopback in a known time, as psutil counts them too, around the robot's readings and in between."""
    if shutil.which(shell[0]) is None:
        pytest.skip(f"{shell[0]} is not installed")
    around = [moment()]
    first = [ask(shell, query) for query in host_queries()]
    between = [moment()]
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as sender:
        taken, _ = server.accept()
        for _ in range(100):
            sender.sendall(bytes(100_000))
            left = 100_000
            while left:
                left -= len(taken.recv(left))
        taken.close()
    between.append(moment())
    later = ask(shell, later_query(first))
    around.append(moment())
    here = Host(name="here", address="127.0.0.1")
    said = parse_traffic("\n".join([*counters(first), later.out]))["lo"]
    (least_s, least), (most_s, most) = ([b - a for a, b in zip(*two, strict=True)] for two in (between, around))
    assert least >= 10_000_000
    # the robot's clock counts in hundredths of a second
    assert least / (most_s + 0.02) <= said.sent_bps <= most / max(least_s - 0.02, 0.01)
    assert parse_host(here, first, None).traffic_mbit == 0.0, "one reading tells nothing"


STRANGE = ("lots", "7", "1.2.3", "1.x", "")
"""What no kernel says of its uptime."""


@pytest.mark.parametrize("shell", SHELLS.values(), ids=SHELLS)
@pytest.mark.parametrize(
    ("first", "now", "pause"),
    [
        ("100.00", "100.00", 0.2), ("100.00", "100.05", 0.15), ("99.95", "100.14", 0.01), ("8.09", "8.19", 0.1),
        ("8.09", "8.29", 0), ("8.00", "9999999.09", 0), ("100.00", "3.00", 0.2),
        *[("100.00", uptime, 0.2) for uptime in STRANGE],
    ],
)  # fmt: skip
def test_a_robot_waits_for_what_is_missing_of_the_pause_and_no_longer(
    shell: list[str], first: str, now: str, pause: float, tmp_path: Path
) -> None:
    if shutil.which(shell[0]) is None:
        pytest.skip(f"{shell[0]} is not installed")
    (tmp_path / "uptime").write_text(f"{now} 1.00\n" if now else "")
    files = Reply(status=0, out=f"/proc/uptime:{first} 1.00\n", err="", ok=True)
    query = later_query([Reply(status=0, out="", err="", ok=True), files])
    script = f"sleep() {{ echo slept $1; }}\n{query.command}".replace("/proc/uptime", str(tmp_path / "uptime"))
    done = subprocess.run(shell, input=script, capture_output=True, text=True, timeout=30)
    assert done.stderr == ""
    slept = [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("slept")]
    assert slept == ([pause] if pause else [])


def counters(replies: list[Reply]) -> list[str]:
    """Return the first reading, from the replies of the files."""
    files = next(parse_files(reply.out) for reply in replies if "/proc/uptime:" in reply.out)
    return [*files["/proc/uptime"], *files["/proc/net/dev"]]
