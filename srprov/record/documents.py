"""What a run was given and what it decided, as the files of its folder.

Takes values of the other rooms; gives JSON values and text. The inventory is written anew from what srprov read of it,
passwords as `***`: a copy of the user's files would hold whatever else they keep there.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import functools
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from shlex import quote
from typing import Any

import msgspec

from srprov.definitions.model import Host, Inventory
from srprov.execution import Event
from srprov.facts.document import facts_document
from srprov.facts.model import Snapshot
from srprov.planning.plan import Plan, plan_json
from srprov.planning.planfile import PlanFile, document
from srprov.planning.text import plan_text
from srprov.record.folder import Sink, in_lines
from srprov.record.input_places import inputs
from srprov.record.memory import note_inventory
from srprov.record.plain import fields_of, plain
from srprov.resource import Resource
from srprov.secret import MASK, redacted

_LIBRARIES = ("click", "docker", "fabric", "jinja2", "jsonschema", "numpy", "ortools", "paramiko", "psutil", "pyyaml",
              "requests", "rich", "urllib3")  # fmt: skip


class RunInputs(msgspec.Struct, frozen=True, kw_only=True):
    """What is recorded before the first act."""

    verb: str
    owner: str
    """user@host of the controller"""
    version: str
    """srprov's"""
    plan: Plan
    file: PlanFile
    """The plan as `plan -o` writes it."""
    inventory: Inventory
    snapshot: Snapshot | None = None
    assignment: object = None
    """The decision with its costs and reasons, when this run made one."""
    desired: Sequence[Resource] = ()
    files: Mapping[str, str] | None = None
    """Path -> text of the definition files with all that they name; None: those of the plan's file."""
    decided: Mapping[str, Any] | None = None
    """What else than files and facts led to the placement, when this run decided it."""


def run_id(plan: Plan, now: dt.datetime) -> str:
    """Return `<utc>-<instance>-<first 8 of the plan's hash>`."""
    digest = hashlib.sha256(json.dumps(plan_json(plan), sort_keys=True).encode()).hexdigest()
    return f"{now.astimezone(dt.timezone.utc):%Y%m%dT%H%M%SZ}-{plan.instance}-{digest[:8]}"


def write_inputs(folder: Sink, run: RunInputs, commit: Callable[[], object] = lambda: None) -> None:
    """Hand everything that is known before the first act to the folder's writer.

    `commit` gives what a repository has of the definition files; it is asked when the writer comes to it.
    """
    begun = dt.datetime.now(dt.timezone.utc)
    folder.put_json("environment.json", lambda: environment(run, begun, commit()))
    folder.put("plan.txt", lambda: plan_text(run.plan, commands=True))
    folder.put_json("plan.json", lambda: document(run.file))
    folder.put_json("assignment.json", lambda: decision(run.plan, run.assignment))
    if run.snapshot is not None:
        found = run.snapshot
        folder.put_json("facts.json", lambda: facts_record(found, run.decided))
    folder.put_json("inputs/inventory.yml", lambda: _own_inventory(run.inventory))
    for name, text in inputs(run.file.inputs if run.files is None else run.files):
        folder.put(f"inputs/{name}", lambda text=text: text)  # type: ignore[misc]
    of_robots: dict[str, list[Resource]] = {}
    shared: dict[str, str] = {}
    for resource in run.desired:
        of_robots.setdefault(resource.host, []).append(resource)
        if resource.module == "file" and (sha256 := resource.written.get("blob")) and sha256 not in shared:
            shared[sha256] = resource.params.text
    for sha256, text in sorted(shared.items()):
        folder.put(f"rendered/shared/{sha256}", lambda text=text: text)  # type: ignore[misc]
    for host, mine in sorted(of_robots.items()):
        folder.put_json(f"rendered/{host.replace('/', '_')}.yml", lambda mine=mine: rendered(mine))  # type: ignore[misc]


_WHEN_ASKED = frozenset({"matrix", "why_not", "runner_up"})
"""Parts of a decision that follow from the facts: `assign --facts --explain` shows them."""
_REASONS = frozenset({"runner_up"})
"""What is left out of a small one: `report` shows the rest."""
_SMALL = 2500
"""Pairs of services and robots: their costs take some 50 KB, and milliseconds beside the run."""


def facts_record(found: Snapshot, decided: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the robots' facts, and what else `assign --facts` needs to decide as this run did."""
    document = facts_document(found.facts, found.unreachable)
    return document if decided is None else {**document, "decided": plain(decided)}


def decision(plan: Plan, assignment: object) -> dict[str, Any]:
    """Return who runs what, what it costs, and, when it was decided in this run, all that led to it."""
    return {
        "assignment": dict(sorted(plan.assignment.items())),
        "costs": {service: round(cost, 6) for service, cost in sorted(plan.costs.items())},
        "cost": round(plan.cost, 6),
        **({"decision": plain(_known(assignment))} if assignment is not None else {}),
    }


def _known(assignment: object) -> dict[str, object]:
    """Return a decision without what is worked out only when somebody asks why; a small one has the costs of all."""
    matrix: Mapping[str, Mapping[str, object]] = getattr(assignment, "matrix", {})
    robots = len(next(iter(matrix.values()), ()))
    left_out = _REASONS if len(matrix) * robots <= _SMALL else _WHEN_ASKED
    kept = {name: getattr(assignment, name) for name in fields_of(assignment) if name not in left_out}
    # a mapping that works out its values when they are asked for is asked for all of them
    return {name: dict(value) if isinstance(value, Mapping) else value for name, value in kept.items()}


def environment(run: RunInputs, begun: dt.datetime, source: object) -> dict[str, Any]:
    """Return who ran what with which versions; `source` is what a repository has of it, None if nobody knows."""
    return {
        "verb": run.verb,
        "instance": run.plan.instance,
        "begun": begun.isoformat(timespec="seconds"),
        "owner": run.owner,
        "srprov": run.version,
        **this_machine(),
        **({"source": source} if source is not None else {}),
    }


@functools.lru_cache(maxsize=1)
def this_machine() -> dict[str, Any]:
    """Return this machine's Python, platform and libraries; worth calling early, as it takes a few milliseconds."""
    system = os.uname()
    return {
        "python": sys.version.split()[0],
        "platform": f"{system.sysname}-{system.release}-{system.machine}",
        "libraries": _versions(),
    }


def _versions() -> dict[str, str]:
    """Return installed libraries' versions, by the names of their folders: importlib.metadata takes 20 ms to say it.

    Source: the specification of installed distributions, `NAME-VERSION.dist-info`.
    """
    found: dict[str, str] = {}
    for folder in sys.path:
        with contextlib.suppress(OSError):
            for entry in os.listdir(folder or "."):
                name, dash, version = entry.removesuffix(".dist-info").partition("-")
                if dash and entry.endswith(".dist-info") and name.lower() in _LIBRARIES:
                    found.setdefault(name.lower(), version)
    return dict(sorted(found.items()))


def _own_inventory(inventory: Inventory) -> object:
    """Return the inventory for a record, and remember that it is the user's own word: a record may be anybody's."""
    document = redacted(inventory_document(inventory))
    if inventory.named:
        note_inventory(in_lines(document) + "\n")
    return document


def inventory_document(inventory: Inventory) -> dict[str, Any]:
    """Return the lab as an Ansible inventory of what srprov read; JSON is YAML."""
    hosts = {name: _host(host) for name, host in sorted(inventory.hosts.items())}
    groups = {name: members for name, members in sorted(inventory.groups.items()) if name not in ("all", "ungrouped")}
    children = {name: {"hosts": {host: None for host in members}} for name, members in groups.items()}
    return {"all": {"hosts": hosts, **({"children": children} if children else {})}}


def _host(host: Host) -> dict[str, Any]:
    options = [(name, MASK if name == "proxycommand" else value) for name, value in host.ssh_options]
    values = {
        "ansible_host": host.address,
        "ansible_port": host.port,
        "ansible_user": host.user,
        "ansible_ssh_private_key_file": host.identity_file,
        "ansible_password": MASK if host.password else None,
        "ansible_become": host.become or None,
        "ansible_become_password": MASK if host.become_password else None,
        "ansible_connection": host.connection if host.connection != "ssh" else None,
        "ansible_ssh_common_args": " ".join(f"-o {quote(f'{name}={value}')}" for name, value in options) or None,
        "srprov_tags": list(host.tags) or None,
        "srprov_slots": host.slots,
        "srprov_underlay": host.underlay,
        "srprov_devices": list(host.devices) or None,
        "srprov_bandwidth_mbit": host.bandwidth_mbit,
        "srprov_pid": host.pid or None,
        "srprov_site": host.site or None,
    }
    return {key: value for key, value in values.items() if value is not None}


def rendered(mine: Sequence[Resource]) -> list[dict[str, Any]]:
    """Return what should be true on one robot, as a playbook has it; JSON is YAML."""
    return [
        {
            one.module: one.name,
            **one.written,
            "needs": [{"id": n.id, "condition": n.condition} for n in one.needs],
        }
        for one in mine
    ]


def event_json(event: Event) -> dict[str, Any]:
    """Return one event as `--events` and events.jsonl have it; the time is when this is called."""
    return {
        "time": round(time.time(), 3),
        "event": event.kind,
        "robot": event.host,
        "step": event.step.number if event.step else None,
        "id": event.step.id if event.step else None,
        "outcome": event.outcome.value if event.outcome else None,
        "text": event.text,
        "duration_s": round(event.duration_s, 3),
    }
