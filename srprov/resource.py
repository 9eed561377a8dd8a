"""The values that modules, rendering, planning and execution share: Resource, Observed, State, Change, Difference.

A `Resource` is one thing that should be true on one robot. A `State` is what was found of it. A `Change` is the
difference, with its cause in words and the commands that end it. All are values; none can talk to a robot.

What runs a service has a parameter `service`, and a `service` in the state that was found of it.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.wire import Command

State = Mapping[str, Any]
"""What a module found of one resource: JSON values only."""


class Action(enum.Enum):
    """What a step does; the value is its symbol in every plan."""

    CREATE = "+"
    UPDATE = "~"
    REPLACE = "±"
    DELETE = "-"
    RUN = "!"


class Condition(enum.Enum):
    """What must hold of a resource before one that needs it is touched."""

    PRESENT = "present"
    STARTED = "started"
    HEALTHY = "healthy"
    COMPLETED = "completed"
    AFTER = "after"
    """Only the order: of playbooks that stand one after the other. What is needed so is no reason to act again."""


def resource_id(host: str, module: str, name: str) -> str:
    """Return the address of a resource, e.g. `robot1/container:srprov.hello.a`."""
    return f"{host}/{module}:{name}"


class Need(msgspec.Struct, frozen=True, order=True):
    """One resource that must be right first, on this robot or on another."""

    id: str
    condition: str = Condition.PRESENT.value


class Resource(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that should be true on one robot."""

    host: str
    module: str
    name: str
    params: Any
    """Its module's dataclass of parameters."""
    written: Mapping[str, Any]
    """The parameters as the playbook wrote them, as JSON values, for plan files and records; never a secret's value."""
    needs: tuple[Need, ...] = ()
    source: str = ""
    """Playbook and item, for error messages."""

    @property
    def id(self) -> str:
        """The resource's address."""
        return resource_id(self.host, self.module, self.name)

    @property
    def service(self) -> str:
        """The service that it runs, or empty."""
        return getattr(self.params, "service", "")


class Observed(msgspec.Struct, frozen=True, kw_only=True):
    """One resource of ours found on a robot."""

    module: str
    name: str
    instance: str
    """The owner; empty for what is looked at but owned by nobody of ours (an image pulled by its name)."""
    state: State

    @property
    def service(self) -> str:
        """The service that it runs, or empty."""
        return str(self.state.get("service", ""))


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """One value that a change gives another one: as text, for people and for review; nothing is done by it."""

    field: str
    """As the user writes it, e.g. `environment.RATE`."""
    old: str | None = None
    """None: not set."""
    new: str | None = None
    """None: not set."""
    note: str = ""
    """Instead of values: that they are secret, or why they are not shown."""
    diff: tuple[str, ...] = ()
    """Instead of values: lines of a unified diff, for the content of a file."""


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """The difference between what should be and what is."""

    action: Action
    cause: str
    """In words: "image digest differs", never "changed"."""
    destructive: bool = False
    """Data is lost with it."""
    before: State | None = None
    commands: tuple[Command, ...] = ()
    """What makes it right, in order."""
