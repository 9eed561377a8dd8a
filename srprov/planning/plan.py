"""The plan as a value: what will be done, in which order, and why.

Equal inputs give equal plans, and equal plans give byte-equal text and JSON: nothing in here holds a time, a random
id or the order of a set.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.definitions.secretmodel import SecretSource
from srprov.planning.policy import Permission
from srprov.resource import Action, Change, Difference, Need, Observed, Resource, resource_id
from srprov.wire import Command, CopyImage, CopyVolume, EngineCall, Put, Run, SendData

ASKED = frozenset({"instance", "source", "assignment", "permissions", "secrets", "playbooks", "data", "notes"})
"""What of a plan's JSON says what is asked for, and where things go: it follows from no secret's value."""


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """One node of the plan."""

    number: int
    host: str
    module: str
    name: str
    change: Change
    needs: tuple[int, ...] = ()
    """Steps that must have succeeded first."""
    waits: tuple[Need, ...] = ()
    """Conditions of resources that must hold first, e.g. a container that must be healthy."""
    want: Resource | None = None
    """What should be true; None for a removal."""
    found: Observed | None = None
    """What is removed, or what an order is about; None otherwise."""
    differences: tuple[Difference, ...] = ()
    """Which values it changes, as far as that is known; only shown."""
    makes: str = ""
    """What it makes, in words, by what is wanted (`planning.brought`); only shown."""
    order: str = ""
    """A user's `stop`, `start` or `restart` of what is there, which is in no plan that is made or read."""

    @property
    def id(self) -> str:
        """The resource's address."""
        return resource_id(self.host, self.module, self.name)

    @property
    def service(self) -> str:
        """The service that the step is about, or empty."""
        one = self.want or self.found
        return one.service if one else ""

    @property
    def commands(self) -> tuple[Command, ...]:
        """What is done, in order."""
        return self.change.commands


class PlaybookUse(msgspec.Struct, frozen=True, kw_only=True):
    """A playbook that is not srprov's own and was part of the plan."""

    name: str
    file: str
    place: str
    """`before` or `after` srprov's own, from the experiment; `added` or `replaces`, from the user's folder."""

    @property
    def how(self) -> str:
        """Say in words what it does to srprov's own playbooks."""
        if self.place in ("before", "after"):
            return f"{self.place} srprov's own, from the experiment"
        word = "replaces srprov's own" if self.place == "replaces" else "added"
        return f"{word}, from {self.file}"


class DataMove(msgspec.Struct, frozen=True, kw_only=True):
    """A service that goes to another robot than its data is on."""

    service: str
    volume: str
    source: str
    target: str
    how: str = ""
    """`move`, `leave`, or empty: the user has not said, so it is not done."""

    @property
    def text(self) -> str:
        """Say what becomes of the data."""
        if self.how == "move":
            return f"data of {self.service} ({self.volume}) is copied from {self.source} to {self.target}"
        undecided = "" if self.how else "; --data move or --data leave says what is wanted"
        return (
            f"data of {self.service} stays on {self.source} ({self.volume}), and {self.service} starts without it on "
            f"{self.target}{undecided}"
        )


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """All steps for one instance, numbered from 1 in an order that respects what they need."""

    instance: str
    source: str
    steps: tuple[Step, ...]
    unchanged: int = 0
    """Resources that are right already."""
    assignment: Mapping[str, str] = msgspec.field(default_factory=dict)
    cost: float = 0.0
    costs: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Per service."""
    permissions: tuple[Permission, ...] = ()
    secrets: tuple[SecretSource, ...] = ()
    """Where the values come from that services get; the values are nowhere in a plan."""
    playbooks: tuple[PlaybookUse, ...] = ()
    data: tuple[DataMove, ...] = ()
    notes: tuple[str, ...] = ()
    unreachable: Mapping[str, str] = msgspec.field(default_factory=dict)
    leads: Mapping[str, Mapping[str, str]] = msgspec.field(default_factory=dict)
    """Robot -> path that a new container there mounts -> where that leads: it is made while that is so. In no file."""
    chosen: bool = False
    """The placement was a choice: some service that is new might have gone elsewhere. In no plan file."""

    @property
    def empty(self) -> bool:
        """True when everything is right already."""
        return not self.steps

    def counts(self) -> dict[str, int]:
        """Return the number of steps per action."""
        return {action.name.lower(): sum(s.change.action is action for s in self.steps) for action in Action}


def plan_json(plan: Plan) -> dict[str, Any]:
    """Return the plan file's content: JSON values only, in a fixed order."""
    return {
        "plan": 1,
        "instance": plan.instance,
        "source": plan.source,
        "assignment": dict(sorted(plan.assignment.items())),
        "cost": round(plan.cost, 6),
        "permissions": [{"kind": p.kind, "service": p.service, "what": p.what} for p in plan.permissions],
        "secrets": {source.name: secret_json(source) for source in plan.secrets},
        "playbooks": [{"name": p.name, "file": p.file, "place": p.place} for p in plan.playbooks],
        "data": [msgspec.structs.asdict(move) for move in plan.data],
        "notes": list(plan.notes),
        "unreachable": dict(sorted(plan.unreachable.items())),
        "unchanged": plan.unchanged,
        "counts": plan.counts(),
        "steps": [step_json(step) for step in plan.steps],
    }


def secret_json(source: SecretSource) -> dict[str, Any]:
    """Return where a secret comes from: `{"env": …}`, `{"file": …}` or `{"command": […], "folder": …}`."""
    if source.command:
        return {"command": list(source.command), "folder": source.folder}
    return {"env": source.env} if source.env else {"file": source.file}


def step_json(step: Step) -> dict[str, Any]:
    """Return one step as JSON, as `plan --json` shows it; a plan file adds what it takes to do it."""
    return {
        "number": step.number,
        "robot": step.host,
        "module": step.module,
        "name": step.name,
        "action": step.change.action.name.lower(),
        "cause": step.change.cause,
        **({"makes": step.makes} if step.makes else {}),
        "destructive": step.change.destructive,
        "needs": list(step.needs),
        "waits": [{"id": need.id, "condition": need.condition} for need in step.waits],
        "commands": [command_json(command) for command in step.commands],
        # plan files of older versions have none
        **({"differences": [difference_json(one) for one in step.differences]} if step.differences else {}),
    }


def difference_json(one: Difference) -> dict[str, Any]:
    """Return one changed value as JSON: old and new, or a note, or the lines of a diff."""
    if one.note:
        return {"field": one.field, "note": one.note}
    if one.diff:
        return {"field": one.field, "diff": list(one.diff)}
    return {"field": one.field, "old": one.old, "new": one.new}


def command_json(command: Command) -> dict[str, Any]:
    """Return one command as JSON; bytes appear by length and digest."""
    if isinstance(command, Run):
        return {"run": command.script}
    if isinstance(command, Put):
        size = len(command.content)
        mode = f"{command.mode:04o}"
        if command.secret:
            return {"put": command.path, "secret": command.secret, "mode": mode, "in_place": command.in_place}
        return {
            "put": command.path,
            "bytes": size,
            "sha256": command.digest(),
            "mode": mode,
            "in_place": command.in_place,
        }
    if isinstance(command, CopyImage):
        return {
            "copy_image": command.image,
            "from": command.source_host,
            "id": command.id,
            "way": command.way,
            "base": command.base,
            "runs": list(command.runs),
        }
    if isinstance(command, CopyVolume):
        return {"copy_volume": command.volume, "into": command.into, "from": command.source_host}
    if isinstance(command, SendData):
        return {"send_data": command.sha256, "url": command.url}
    assert isinstance(command, EngineCall)
    request: dict[str, Any] = {"engine": command.method, "path": command.path, "params": dict(command.params)}
    if command.body:
        request["body"] = command.body
    if command.blob:
        request |= {"bytes": len(command.blob), "sha256": hashlib.sha256(command.blob).hexdigest()}
    return request
