"""What a kind of resource says of itself: the base class Module, and helpers that several kinds share.

A module knows how to ask (`queries`), how to read the answers (`parse`), what is missing and which commands make it
right (`check`), and which take it away (`removal`). It never sees a connection. `check` is the only definition of
"already right": it is asked when planning, again before the first act on a robot, and again after.

What else planning, rendering and execution must know of a kind is a trait: an attribute or method of Module with a
default, so that a module names only what is special about it, and a new kind is in no table of another room.

Touches nothing.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Generic, Protocol, runtime_checkable

import msgspec

from srprov.definitions.model import Service
from srprov.modules.params import P
from srprov.resource import Change, Difference, Observed, State
from srprov.wire import AnyQuery, Command, EngineQuery, Query, Reply

INSTANCE = "srprov.instance"
SERVICE = "srprov.service"
CONFIG_HASH = "srprov.config-hash"
CONFIG_PARTS = "srprov.config-parts"
SOURCE = "srprov.source"
STOP_GRACE = "srprov.stop-grace"
TAKEN = "srprov.taken"

STATE_ROOT = "/var/lib/srprov"
"""Where rendered files live on a robot: STATE_ROOT/<instance>/."""
OWN_HOSTS = "-robot.own"
"""How the name of a hosts file ends that has the robot's own lines too; no service has a dot in its name."""
DISCOVERY_FILE = r"(cyclonedds|fastdds)(-[A-Za-z0-9_][A-Za-z0-9_.-]*)?\.xml|zenoh(-[A-Za-z0-9_][A-Za-z0-9_.-]*)?\.json5"
"""What files are called that tell middleware where its peers are, as a regular expression."""
MEMORY_ROOT = "/run/srprov"
"""Where secrets live on a robot, in memory: MEMORY_ROOT/<instance>/secrets/."""


class Names(msgspec.Struct, frozen=True, kw_only=True):
    """What srprov's own playbooks name on robots for one instance."""

    instance: str
    source: str
    bridge: str
    link: str
    network: str
    tunnel: str
    """The network namespace of an encrypted overlay."""
    vteps: frozenset[str]
    """The robots' underlay addresses."""


class Module(ABC, Generic[P]):
    """One kind of resource, with parameters of the dataclass P."""

    kind: str
    params: type[P]

    holds_data = False
    """Its removal loses data: it is removed only when the user asks for that."""
    shared = False
    """Other instances may use it too: it is never removed for one of them."""
    shares_round_trip = False
    """What makes one right is one short script or file for the shell, which may share a round trip with others.

    Not for a kind with `Probing`: whether a step of one came true is asked by itself.
    """
    rebuilds_users = False
    """It cannot be replaced while it is in use: what needs it is removed before and made again after."""
    common = False
    """Robots have it for the experiment as a whole: their ends of the overlay, hosts files, the placement record."""
    on_overlay = False
    """It is a part of the overlay, or joined to it: the overlay is tried after one was changed."""
    same_in_trials = False
    """What a user's playbook states of one must be the same in all trials of a run."""
    root = ""
    """The names are paths below root/<instance>/; empty: they are no paths."""

    def keeps(self, found: State) -> bool:
        """Return whether one that was found holds data, which is removed only when the user asks for that."""
        return self.holds_data

    def left_alone(self, want: P, found: State) -> str:
        """Return, in words, how one that was found differs from the wanted one where no plan changes it; or nothing."""
        return ""

    def taken_from(self, want: P) -> str:
        """Return the robot whose resource of the same name a wanted one replaces, or nothing.

        It is made once nothing runs there that might change the data, and the other one is removed after what needs
        this one was made.
        """
        return ""

    def is_copy(self, want: P, found: State) -> bool:
        """Return whether one that was found is the whole copy that is wanted, so that its source may be removed."""
        return False

    def informed(self, name: str, host: str, want: P, there: Mapping[str, Collection[Observed]]) -> P:
        """Return a wanted one with what only robots can say, such as their public keys.

        No playbook states it and no plan file holds it. `there` is what was found on every robot in reach, or during a
        run what was found of the kinds that it changes.
        """
        return want

    @abstractmethod
    def queries(self) -> tuple[AnyQuery, ...]:
        """Return what to ask to see every resource of this kind that is ours, of all instances."""

    @abstractmethod
    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return what the replies to `queries` say, in the same order; garbage gives nothing, never an error.

        A name belongs to one thing on a robot, over all instances.
        """

    @abstractmethod
    def check(self, name: str, want: P, found: State | None) -> Change | None:
        """Return what is missing, with the commands that make it right; None when it is right. Nothing found is not."""

    @abstractmethod
    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Return the commands that take it away; ValueError refuses the answers of a robot with such a name."""

    def is_plumbing(self, name: str) -> bool:
        """Return whether one is what srprov makes for itself, so that a plan names it only when it is asked to."""
        return False

    def old_queries(self, name: str, want: P, found: State) -> tuple[AnyQuery, ...]:
        """Return what to ask to see which values of one that was found a change would replace; none if it is right."""
        return ()

    def differences(self, want: P, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
        """Return which values of one that was found differ from the wanted ones.

        `replies` are those to `old_queries`; none where the robot did not answer, or was not asked.
        """
        return ()

    def between(self, old: P, new: P) -> tuple[Difference, ...]:
        """Return which values of two wanted ones differ."""
        return ()

    def removed_before(self, other: str) -> bool:
        """Return whether its removals on a robot come before those of another kind."""
        return False

    def removed_after_making(self, other: str, *, here: bool) -> bool:
        """Return whether its removals come after changes of another kind: of those on its robot (`here`), or others."""
        return False

    def made_after_removal_of(self, other: str) -> bool:
        """Return whether one is made or changed only after all of another kind that must go from the robot are gone."""
        return False

    def stands_on(self, found: State) -> Collection[tuple[str, str]]:
        """Return kind and name of what one that was found is attached to on its robot."""
        return ()

    def stranded(self, want: P, found: State, others: Mapping[tuple[str, str], State]) -> str:
        """Return, in words, what is gone that one was made on, so that an update cannot make it right; or nothing.

        `others` are all on its robot, by kind and name.
        """
        return ""

    def is_own(self, name: str, want: P, names: Names) -> bool:
        """Return whether srprov's own playbooks could state this: all that an EDF leads to without a playbook.

        A plan file may come from a stranger. What is not of that form needs the permission `playbook` there, so that a
        kind that says nothing of itself does.
        """
        return False

    def service_of(self, name: str, want: P) -> Service | None:
        """Return what an EDF states that leads to one: in a plan file it needs the permissions of that."""
        return None

    def misplaced(self, name: str, want: P, context: Mapping[str, Any]) -> tuple[str, str] | None:
        """Return why one in a user's playbook would not be the instance's, and what to write instead.

        Such a resource would never be found again, nor removed. `context` is what the playbook is rendered with.
        """
        instance = context["instance"]
        if getattr(want, "instance", instance) != instance:
            return f"the {self.kind} '{name}' would belong to another instance", "write instance: {{ instance }}"
        if self.root and not name.startswith(f"{self.root}/{instance}/"):
            hint = 'write {{ folder ~ "/name" }}; a command can copy it elsewhere'
            return f"the {self.kind} '{name}' is not in the instance's folder {self.root}/{instance}", hint
        return None


@runtime_checkable
class Probing(Protocol):
    """A kind whose resources cannot be found by looking around, only by asking for one that is wanted."""

    def probes(self, name: str, want: Any, /) -> tuple[Query, ...]:  # noqa: ANN401 - its own parameters
        """Return what to ask to see whether this one is right."""

    def probed(self, name: str, want: Any, replies: Sequence[Reply], /) -> Observed:  # noqa: ANN401 - its own parameters
        """Return what the replies to `probes` say; owned by nobody, so that nothing is ever removed for it."""


@runtime_checkable
class Running(Protocol):
    """A kind whose resources run a process: others can wait for it, it may end, and it has a log."""

    def status_query(self, name: str, /) -> EngineQuery:
        """Return what to ask to see how the process of one is."""

    def reached(self, name: str, condition: str, reply: Reply, /) -> tuple[bool, str]:
        """Return whether a condition holds by the reply to `status_query`, and why it never will, or nothing."""

    def amiss(self, want: Any, found: State, /) -> str:  # noqa: ANN401 - a kind's own parameters
        """Return what is wrong with the process of one that was found, if only its user can judge it; else nothing.

        A job that failed may have left what a second run would spoil, and a service may be unhealthy for a reason. So
        no plan starts either again: it says so.
        """

    def order(self, found: Observed, verb: str, /) -> tuple[Command, ...]:
        """Return the commands of a user's `stop`, `start` or `restart`; none when it is so already."""

    def ordered(self, found: State, verb: str, /) -> str:
        """Return why a `stop`, `start` or `restart` that was done has not come true, or nothing."""

    def log_query(self, name: str, lines: int, /) -> Query:
        """Return what to ask to see the last lines of the log."""


def canonical(value: object) -> str:
    """Return the one JSON text of a value: sorted keys, no spaces."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(value: object, length: int = 64) -> str:
    """Return the sha256 of a JSON value in hex, shortened to `length` digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()[:length]


LABEL_FILTER = canonical({"label": [INSTANCE]})
"""Docker's filter for everything that carries our instance label."""
