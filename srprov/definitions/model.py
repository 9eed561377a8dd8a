"""The values that user files become: Inventory, Experiment, Service; what a container is, is in `containermodel`.

Everything here is validated, merged (a service's fields over its CDF's, a CDF's over the one it extends) and in one
unit (bytes, seconds). Nothing here can read a file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec

from srprov.definitions.containermodel import VXLAN_PORT, ContainerDefinition, Requirements, Runtime
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import Diagnostic, Location
from srprov.secret import Secret, Vault

_NOWHERE = Location("")
VERSION_CONTROL = frozenset(
    {
        *(".git", ".hg", ".svn", ".bzr", ".jj", ".sl", ".pijul", "_darcs", "CVS", "_MTN"),
        *(".fslckout", "_FOSSIL_", ".repo", ".dvc"),
    }
)
"""Where version control keeps, beside a project's files, what is its user's: addresses with tokens.

All those that Debian or their authors ship; the last two are for many repositories at once, and for data.
"""
VERSION_CONTROL_IN_ANY_CASE = frozenset(map(str.casefold, VERSION_CONTROL))


def makes_repository(name: str, *, folder: bool) -> bool:
    """Return whether a folder, or anything else, of this name may make the folder that holds it a repository.

    Settings of one name programs, which run here as soon as git is asked for its status, as many prompts of shells do.
    A folder with a file `HEAD` may be one by itself; a disk may take names in any case.
    """
    return name.casefold() in VERSION_CONTROL_IN_ANY_CASE or (name.casefold() == "head" and not folder)


def repository_in(parts: Sequence[str], *, folder: bool, first: int = 0) -> int | None:
    """Return which of a path's names, from `first` on, is the first that makes a repository, or None.

    `folder` says whether what the whole path leads to is a folder; all above it are.
    """
    every = range(first, len(parts))
    return next((at for at in every if makes_repository(parts[at], folder=folder or at < every[-1])), None)


EXPORTED, NO_REGISTRY = "srprov-", "srprov.invalid"
"""What stands before an experiment's name where it is exported: as `nav`, it would be given what others call so. And
where images come from that are built then: a name that nobody can have, RFC 6761."""


class Host(msgspec.Struct, frozen=True, kw_only=True):
    """One robot of the inventory, with what srprov reads of its variables."""

    name: str
    address: str
    """`ansible_host`, else the name; ssh_config may map it further."""
    port: int | None = None
    user: str | None = None
    identity_file: str | None = None
    password: Secret | None = None
    become: bool = False
    """`ansible_become`; a user other than root is raised by sudo in any case."""
    become_password: Secret | None = None
    """What sudo is told when it asks."""
    connection: str = "ssh"
    """`ssh` or `local`"""
    ssh_options: tuple[tuple[str, str], ...] = ()
    """`-o` options of `ansible_ssh_common_args` and its kin, names in lower case, in order."""
    tags: tuple[str, ...] = ()
    slots: int | None = None
    underlay: str | None = None
    """Interface or address that other robots reach."""
    devices: tuple[str, ...] = ()
    bandwidth_mbit: float | None = None
    pid: str = ""
    """Persistent identifier of the instrument, such as a DOI or a handle."""
    site: str = ""
    """Where it stands, when it is reached by a worker there."""
    groups: tuple[str, ...] = ()
    location: Location = _NOWHERE


BUILDERS = "builders"
"""The group of an inventory whose hosts build images for others."""


class Inventory(msgspec.Struct, frozen=True, kw_only=True):
    """The robots: hosts by name (sorted), groups by name."""

    hosts: Mapping[str, Host]
    groups: Mapping[str, tuple[str, ...]]
    source: str = ""
    own_files: tuple[str, ...] = ()
    """Real paths of files with passwords, and of keys: the user's own, also where they lie beside an EDF."""
    named: bool = True
    """Whether the user named all files of it himself; else a stranger's project may have put robots into groups."""
    strange_record: str = ""
    """One of its files, of another machine's record: it says only where robots are."""


class Service(msgspec.Struct, frozen=True, kw_only=True):
    """One service of the experiment: a CDF or an image, with everything merged."""

    name: str
    cdf: str = ""
    """Key into the containers mapping (absolute path of the CDF); empty when `image` is given."""
    image: str = ""
    cost: float = 10.0
    """The paper's alpha, 0..100."""
    requires: Requirements = msgspec.field(default_factory=Requirements)
    """CDF's and EDF's together: both must hold."""
    runtime: Runtime = msgspec.field(default_factory=Runtime)
    """CDF's defaults with the EDF's on top."""
    network: str = "overlay"
    """`overlay`, `host`, `both` or `none`"""
    depends_on: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """service -> `started`, `healthy` or `completed`"""
    robot: str = ""
    """A pin, or empty."""
    replicas: int = 1
    """How many of it run; more than one become services of their own, see `expand`."""
    per_robot: tuple[str, ...] | None = None
    """Tags: one instance runs on each robot that has them all, and takes no slot. None: an ordinary service."""
    profiles: tuple[str, ...] = ()
    """It is wanted when the user names one of them; empty: always."""
    instance_of: str = ""
    """The name in the EDF, when this is one of several instances of it."""
    secrets: tuple[SecretUse, ...] = ()
    by_cdf: frozenset[str] = frozenset()
    """Volumes that its CDF alone names, not the EDF."""
    same_cdf: frozenset[str] = frozenset()
    """Services of the EDF with its CDF, itself and those of profiles that are not wanted among them: of one author."""
    data_on: str = ""
    """The robot that has its data, when it stays there for that; empty: it has none, or may leave it."""
    platforms: Mapping[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Image that it needs -> the platforms that it is there for, such as `linux/arm64/v8`, where that is known."""
    location: Location = _NOWHERE


class Weights(msgspec.Struct, frozen=True, kw_only=True):
    """The paper's deltas; they sum to 1."""

    cpu: float = 0.25
    memory: float = 0.25
    swap: float = 0.25
    bandwidth: float = 0.25


class Placement(msgspec.Struct, frozen=True, kw_only=True):
    """How robots are chosen."""

    slots_per_robot: int = 1
    fairness: float = 0.0
    sticky: bool = True
    bandwidth_reference_mbit: float = 1000.0


class NetworkSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What the EDF asks of the overlay; None where srprov decides."""

    subnet: str | None = None
    mtu: int | None = None
    vni: int | None = None
    port: int = VXLAN_PORT
    persist: bool = False
    """A unit of systemd restores the robots' links when they boot."""
    discovery: str = "multicast"
    """`multicast`, `static-peers`, `discovery-server`, `ros1` or `zenoh`"""
    discovery_servers: tuple[str, ...] = ()
    """The services that are asked with the last three, in the EDF's order."""
    encryption: str = "none"
    """`none` or `wireguard`"""


class Pool(msgspec.Struct, frozen=True, kw_only=True):
    """Services that may run together on one robot, in one slot, at the discounted sum of their costs; or apart."""

    name: str
    """As given, else its services joined by `+`."""
    services: tuple[str, ...]
    """In name order."""
    discount: float = 1.0
    """Their summed cost is multiplied by this when they run together; more than 0, at most 1."""


class Experiment(msgspec.Struct, frozen=True, kw_only=True):
    """One EDF, with services in name order."""

    name: str
    file: str
    """Absolute path of the EDF."""
    folder: str
    services: Mapping[str, Service]
    home: str = ""
    """The folder without links, as it was when the EDF was read: later, a link may stand for it or lie above it."""
    text: str = ""
    """The EDF as it was read."""
    secrets: Mapping[str, SecretSource] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    playbooks: tuple[Playbook, ...] = ()
    """Those that come with the EDF, in its order."""
    outside: tuple[tuple[str, str], ...] = ()
    """(service, path of the controller) of what it reads or ships from outside of its folder."""
    read_outside: frozenset[str] = frozenset()
    """Those of these paths that were read: records have them, whether or not the service is wanted."""
    files: tuple[str, ...] = ()
    """Absolute paths of the EDF, its CDFs, env_files and playbooks, but for what comes from git repositories."""
    contents: Mapping[str, bytes] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Of these, what was read: later, something else may be there."""
    remote: tuple[tuple[str, str, str], ...] = ()
    """(service, address, branch, tag or commit) of its CDFs in git repositories, those that are extended too."""
    environment: tuple[tuple[str, str], ...] = ()
    """(service, variable) of what it takes from the controller's environment."""
    variables: tuple[str, ...] = ()
    """All variables without which it cannot be read, those of services that are not wanted too."""
    same_robot: tuple[tuple[str, ...], ...] = ()
    different_robot: tuple[tuple[str, ...], ...] = ()
    """Groups of which no two services run on one robot."""
    pools: tuple[Pool, ...] = ()
    weights: Weights = msgspec.field(default_factory=Weights)
    placement: Placement = msgspec.field(default_factory=Placement)
    network: NetworkSettings = msgspec.field(default_factory=NetworkSettings)
    description: str = ""
    authors: tuple[str, ...] = ()
    metadata: Mapping[str, Any] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    trials: TrialDefinitions | None = None
    """What it says of trials, if anything."""


class Definitions(msgspec.Struct, frozen=True, kw_only=True):
    """All that was read. `unsupported` lists what validates but was not fetched: plan and apply refuse it."""

    experiment: Experiment
    containers: Mapping[str, ContainerDefinition]
    unsupported: tuple[Diagnostic, ...] = ()
    locked: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Full name of an image with its tag -> the digest that a lock has for it."""
    platforms: Mapping[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Image by its digest -> the platforms that it is there for, such as `linux/arm64/v8`, where that is known."""
    notes: tuple[str, ...] = ()
    """What the user should know of them, for the plan."""
    variables: Vault = msgspec.field(default_factory=Vault)
    """The values that come from the controller's environment, but for those too short to be hidden."""
