"""Programs that ask on every link, where containers answer: found among a robot's processes, judged by their files."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from srprov.facts.every_link import EVERY_LINK, every_link
from srprov.facts.model import HostFacts, Link
from srprov.wire import Reply
from tests.readonly import shell_violations

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))
FACTS = HostFacts(
    name="r1",
    underlay_link="wlan0",
    links=(
        Link(name="docker0", kind="bridge", addresses=("172.17.0.1/16",)),
        Link(name="eth0", addresses=("10.0.0.1/24",)),
        Link(name="eth1"),
        Link(name="eth2;reboot", addresses=("10.0.2.1/24",)),
        Link(name="lo", addresses=("127.0.0.1/8",)),
        Link(name="veth1", addresses=("10.0.3.1/24",)),
        Link(name="wlan0", addresses=("10.0.1.1/24",)),
    ),
)
AVAHI = "[server]\n#allow-interfaces=eth0\nuse-ipv4=yes\n{}\n[publish]\ndisable-publishing=no\n"
DENY = "denyinterfaces veth* docker0 srpb* srpv* br-*"
LLMNR = "   7: 00000000:14EB 00000000:0000 07 00000000:00000000 00:00000000 00000000   995        0 1 2 0 0\n"


class Robot:
    """A made-up /proc, /etc and /run, of which the script is asked as shells of robots run it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for folder in ("proc/net", "etc/avahi", "run/dhcpcd"):
            (root / folder).mkdir(parents=True)
        self._spaces(root / "proc/self")

    def runs(self, number: int, name: str, uid: int = 0, apart: str = "") -> None:
        """Have a process, perhaps with a namespace apart."""
        process = self.root / f"proc/{number}"
        self._spaces(process, apart)
        (process / "comm").write_text(f"{name}\n")
        (process / "status").write_text(f"Name:\t{name}\nUid:\t{uid}\t{uid}\t{uid}\t{uid}\nGid:\t1\t1\t1\t1\n")

    def has(self, path: str, content: str) -> None:
        """Have a file."""
        (self.root / path).write_text(content)

    def says(self, shell: tuple[str, ...] = SHELLS[0]) -> str:
        """Return what the script prints."""
        command = EVERY_LINK.command
        for folder in ("/proc/", "/etc/", "/run/"):
            command = command.replace(folder, f"{self.root}{folder}")
        done = subprocess.run([*shell, command], capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return done.stdout

    def bad(self, shell: tuple[str, ...] = SHELLS[0]) -> dict[str, str]:
        """Return the remedy of each program that is to be told."""
        judged = every_link(Reply(status=0, out=self.says(shell)), FACTS)
        return {name: remedy for name, right, _, remedy in judged if not right}

    def _spaces(self, process: Path, apart: str = "") -> None:
        (process / "ns").mkdir(parents=True)
        for kind in ("net", "pid"):
            ours = self.root / kind
            ours.touch()
            if kind == apart:
                (process / "ns" / kind).touch()
            else:
                os.link(ours, process / "ns" / kind)


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """Return a robot with programs that ask nobody."""
    made = Robot(tmp_path)
    made.runs(1, "systemd")
    made.runs(23, "avahi-daemon-x")
    made.has("proc/net/udp", "  sl  local_address rem_address   st tx_queue\n")
    return made


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_each_program_that_asks_on_every_link_is_told(robot: Robot, shell: tuple[str, ...]) -> None:
    """All three as Debian installs them, with the robot's own links in what is to be written."""
    assert robot.says(shell) == "" and robot.bad(shell) == {}
    robot.runs(40, "avahi-daemon", 104)
    robot.runs(41, "avahi-daemon", 104)
    robot.has("etc/avahi/avahi-daemon.conf", AVAHI.format(""))
    robot.runs(50, "dhcpcd")
    robot.has("run/dhcpcd/pid", "50\n")
    robot.runs(60, "systemd-resolve", 995)
    robot.has("proc/net/udp", LLMNR)

    assert robot.says(shell).split() == ["avahi-daemon", "dhcpcd", "llmnr", "systemd-resolve"]
    bad = robot.bad(shell)
    assert list(bad) == ["avahi", "resolved", "dhcpcd"]
    assert "allow-interfaces=wlan0,eth0 below" in bad["avahi"]
    assert "LLMNR=no" in bad["resolved"]
    assert DENY in bad["dhcpcd"]


@pytest.mark.parametrize("apart", ["net", "pid"])
def test_programs_of_containers_do_not_count(robot: Robot, apart: str) -> None:
    robot.runs(40, "avahi-daemon", apart=apart)
    robot.runs(50, "dhcpcd", apart=apart)
    robot.has("run/dhcpcd/pid", "50\n")
    assert robot.says() == ""


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("allow-interfaces=eth0", False),
        ("  Allow-Interfaces=eth0, wlan0", False),
        ("allow-interfaces=", True),
        ("allow-interfaces=eth0\nallow-interfaces=", True),
        ("allow-interfaces=eth0,docker0", True),
        ("allow-interfaces=br-0123456789ab", True),
        ("allow-interfaces=br-lan", False),
        ("deny-interfaces=docker0,veth0", True),
        ("#allow-interfaces=eth0", True),
        ("%allow-interfaces=eth0", True),
    ],
)
def test_avahi_is_kept_by_a_list_of_what_is_allowed(
    robot: Robot, shell: tuple[str, ...], line: str, told: bool
) -> None:
    robot.runs(40, "avahi-daemon")
    robot.has("etc/avahi/avahi-daemon.conf", AVAHI.format(line))
    assert ("avahi" in robot.bad(shell)) is told


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (DENY, False),
        ("denyinterfaces veth*,docker0,srp*\n\tdenyinterfaces br-*  # of Docker", False),
        ("denyinterfaces veth*", True),
        ("denyinterfaces docker0 # veth* srp* br-*", True),
        (f"# {DENY}", True),
        ("allowinterfaces eth0 wlan0", False),
        ("allowinterfaces *", True),
        (f"allowinterfaces *\n{DENY}", False),
        ("allowinterfaces eth* veth*\ndenyinterfaces veth*", False),
        (f"interface wlan0\nstatic ip_address=10.0.0.9/24\n{DENY}", True),
        (f"interface\n{DENY}", True),
        (f" ssid lab\n{DENY}", True),
        (f"profile lab\n{DENY}", True),
        (f"{DENY}\ninterface wlan0\nallowinterfaces *", False),
        (f"interface_order wlan0\n{DENY}", False),
        ("denyinterfaces [z-a] [! *[", True),
    ],
)
def test_dhcpcd_is_kept_by_what_holds_for_all_links(
    robot: Robot, shell: tuple[str, ...], lines: str, told: bool
) -> None:
    """What stands below `interface` and the like it reads for that link alone, where it does nothing."""
    robot.runs(50, "dhcpcd")
    robot.has("run/dhcpcd.pid", "50\n")
    robot.has("etc/dhcpcd.conf", f"duid\nauthtoken 1 0 forever hunter2\n{lines}\n")
    assert ("dhcpcd" in robot.bad(shell)) is told
    assert "hunter2" not in robot.says(shell)


def test_the_question_only_reads() -> None:
    assert shell_violations(EVERY_LINK.command) == []


def test_a_dhcpcd_for_one_link_asks_there_alone(robot: Robot) -> None:
    robot.runs(50, "dhcpcd")
    robot.has("run/dhcpcd/eth0.pid", "50\n")
    assert robot.says() == ""


@pytest.mark.parametrize("path", ["proc/net/udp", "proc/net/udp6"])
def test_resolved_asks_where_it_has_the_port_of_llmnr(robot: Robot, path: str) -> None:
    """Another port of its own is none, nor is that port of another program, or of another host."""
    robot.runs(60, "systemd-resolve", 995)
    far = LLMNR.replace("14EB 00000000:0000", "0035 00000000:14EB")
    robot.has(path, LLMNR.replace("14EB", "0035") + LLMNR.replace(" 995 ", " 104 ") + far)
    assert robot.says() == "systemd-resolve\n" and robot.bad() == {}
    robot.has(path, LLMNR)
    assert list(robot.bad()) == ["resolved"]


def test_the_uplink_of_a_robot_is_not_denied() -> None:
    reply = Reply(status=0, out="dhcpcd\n")
    facts = HostFacts(name="r1", underlay_link="br-lan")
    *_, (name, right, _, remedy) = every_link(reply, facts)
    assert (name, right) == ("dhcpcd", False)
    assert "srpv* br-????????????`" in remedy


@pytest.mark.parametrize("out", ["", "x" * 10**6, "\n" * 10**6, "\x1b[2J", "allow-interfaces=" + "a," * 10**6])
def test_a_robot_that_says_anything_else_is_told_nothing(out: str) -> None:
    judged = list(every_link(Reply(status=0, out=out), HostFacts(name="r1")))
    assert all(right for _, right, _, _ in judged)


@pytest.mark.parametrize("value", ["*a" * 10**5, "?*" * 10**5, "[" * 10**5, "\x1b[2J"])
def test_what_a_robot_writes_stands_in_no_remedy(value: str) -> None:
    said = f"avahi-daemon\ndhcpcd\nallow-interfaces=docker0,{value}\ndenyinterfaces {value}\n"
    judged = list(every_link(Reply(status=0, out=said), HostFacts(name="r1")))
    assert [name for name, right, _, _ in judged if not right] == ["avahi", "dhcpcd"]
    assert all(len(found + remedy) < 400 and (found + remedy).isprintable() for _, _, found, remedy in judged)
