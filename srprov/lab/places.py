"""Where a lab keeps what it makes, and how its parts are named and addressed.

Several labs can be up on one machine. Each keeps what it has below folders of its own and on a
bridge of its own, so `lab down` knows where to look even after a killed run: `run` (state, keys; gone
after a reboot of the machine) and `disks` (one folder per robot); `CACHE` (images, kept) is shared.
The lab without a name has number 0. A lab with a name gets a number when it is brought up (sites.py).
"""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network
from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError

CACHE = Path("/var/cache/srprov-lab")
NAMED = "srprov-labs"
"""Folder and cgroup that hold those of all labs with names."""
RUN = Path("/run")
LIB = Path("/var/lib")
NAMED_RUN = RUN / NAMED

REGISTRY_PORT = 5000
FIRST_HOST = 10
MOST_ROBOTS = 200
MOST_NUMBER = 99
"""The subnets of labs with names are 10.213.1.0/24 to 10.213.99.0/24."""
LANS = (1, 2)
"""Networks of a lab. The second one is there only with robots on it; the controller routes between them."""
LONGEST_NAME = 20


class Site(msgspec.Struct, frozen=True):
    """One lab's place on this machine.

    Attributes:
        name: Of the lab; empty for the lab without a name.
        number: What its bridge and addresses are made of; None while a lab with a name is down.
    """

    name: str = ""
    number: int | None = 0

    @property
    def tag(self) -> str:
        """The comment of every firewall rule of this lab."""
        return f"srprov-lab-{self.name}" if self.name else "srprov-lab"

    @property
    def group(self) -> Path:
        """The lab's cgroup and the name of its folders, relative to what holds them."""
        return Path(NAMED, self.name) if self.name else Path("srprov-lab")

    @property
    def run(self) -> Path:
        """State and keys."""
        return RUN / self.group

    @property
    def disks(self) -> Path:
        """One folder per robot."""
        return LIB / self.group

    @property
    def key(self) -> Path:
        """The private key that every robot of this lab lets in."""
        return self.run / "id_ed25519"

    @property
    def known_hosts(self) -> Path:
        """The robots' host keys."""
        return self.run / "known_hosts"

    @property
    def inventory(self) -> Path:
        """The inventory, relative to where `lab up` is run."""
        return Path("inventory", f"lab-{self.name}.yml" if self.name else "lab.yml")

    @property
    def title(self) -> str:
        """The lab in a message: `the lab` or `the lab NAME`."""
        return f"the lab {self.name}" if self.name else "the lab"

    @property
    def command(self) -> str:
        """The words before a verb, for messages: `srprov lab` or `srprov lab --name NAME`."""
        return f"srprov lab --name {self.name}" if self.name else "srprov lab"

    @property
    def bridge(self) -> str:
        """The bridge with the controller and every robot of the first LAN on it."""
        return self.bridge_of(1)

    @property
    def subnet(self) -> IPv4Network:
        """The network of the bridge."""
        return self.subnet_of(1)

    @property
    def controller(self) -> IPv4Address:
        """This machine's address on the bridge."""
        return self.subnet.network_address + 1

    def bridge_of(self, lan: int) -> str:
        """Return the bridge of a LAN."""
        return f"srlab{self._number}" + (f"-lan{lan}" if lan > 1 else "")

    def subnet_of(self, lan: int) -> IPv4Network:
        """Return the network of a LAN's bridge; the controller has the first address of it."""
        return subnet(self._number, lan)

    def subnet6_of(self, lan: int) -> IPv6Network:
        """Return the IPv6 network of a LAN's bridge, for robots that have IPv6; likewise."""
        return IPv6Network(f"fd73:7270:6c61:{self.subnet_of(lan).network_address.packed[2]:x}::/64")

    @property
    def link_prefix(self) -> str:
        """How the controller's ends of the robots' cables begin."""
        return f"srlab{self._number or ''}-r"

    def link(self, robot: str) -> str:
        """Return the controller's end of the robot's cable."""
        return f"{self.link_prefix}{robot_number(robot)}"

    def address(self, robot: str, lan: int = 1) -> IPv4Address:
        """Return the robot's address on the bridge of its LAN; `robot` must be a robot's name."""
        return self.subnet_of(lan).network_address + _host(robot)

    def address6(self, robot: str, lan: int = 1) -> IPv6Address:
        """Return likewise the IPv6 address that a robot with IPv6 has."""
        return self.subnet6_of(lan).network_address + _host(robot)

    def mac(self, last: int, lan: int = 1) -> str:
        """Return an address that stays the same over reboots, so that nobody's ARP cache goes stale."""
        return f"02:73:72:00:{self.subnet_of(lan).network_address.packed[2]:02x}:{last:02x}"

    def disk(self, robot: str) -> Path:
        """Return the robot's disk: kept by kill and restart, removed with the robot."""
        return self.disks / robot

    @property
    def _number(self) -> int:
        assert self.number is not None, f"{self.title} is down"
        return self.number


def subnet(number: int, lan: int = 1) -> IPv4Network:
    """Return the network of a LAN of the lab with this number."""
    return IPv4Network(f"10.213.{number + (lan - 1) * (MOST_NUMBER + 1)}.0/24")


def _host(robot: str) -> int:
    """Return which address of its subnet a robot has."""
    number = robot_number(robot)
    if number is None:
        raise ValueError(f"{robot} is not the name of a lab robot")
    return FIRST_HOST + number


def check_name(name: str) -> str:
    """Return the name of a lab; UsageError unless it is fit for folders, cgroups and firewall rules."""
    if not re.fullmatch(rf"([a-z0-9][a-z0-9-]{{0,{LONGEST_NAME - 1}}})?", name):
        what = f"{name!r} cannot be the name of a lab"
        hint = f"take at most {LONGEST_NAME} of a-z, 0-9 and -, the first not -"
        raise UsageError(what, hint=hint, code=Code.NAME)
    return name


def robot_name(number: int) -> str:
    """Return `robot7` for 7."""
    return f"robot{number}"


def robot_number(name: str) -> int | None:
    """Return 7 for `robot7`; None for a name that no robot of a lab can have."""
    found = re.fullmatch(r"robot([1-9][0-9]{0,2})", name)
    number = int(found[1]) if found else 0
    return number if 1 <= number <= MOST_ROBOTS else None
