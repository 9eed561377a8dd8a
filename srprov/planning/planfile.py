"""The plan as a file that can be applied later: everything that the run needs, and what must not have moved by then.

`dump` gives JSON text, `planread.load` reads it back to the same plan; bytes (build contexts, shipped files) stand once
each, in base64, under their sha256. A fingerprint per robot holds values, not only a hash, so that a refusal can
name what moved.

Commands, needs and permissions stand in it for whoever reviews it. Whoever applies it derives them again, from what is
wanted and from the robots as they are then: `controller.saved`.

Equal plans give byte-equal files. Source of the idea: a saved plan is a contract, as in OpenTofu.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from srprov.errors import visible
from srprov.hashing import sha256_of
from srprov.planning.fingerprint import lasting
from srprov.planning.plan import Plan, Step, command_json, plan_json, secret_json, step_json
from srprov.resource import Resource
from srprov.wire import Command, EngineCall, Put

FORMAT = 2
MAX_CHARACTERS = 96 * 1024 * 1024
"""A plan holds build contexts and shipped files in base64; reading it takes three times as much memory."""

Fingerprints = Mapping[str, Mapping[str, Any]]
"""Robot -> what must not have moved, as nested JSON values."""


class PlanFile(msgspec.Struct, frozen=True, kw_only=True):
    """A plan with what it was made from and what it relies on."""

    plan: Plan
    fingerprints: Fingerprints
    also_wanted: tuple[Resource, ...] = ()
    """What should be true on the plan's robots and was, when it was made; no step is about it."""
    contexts: Mapping[str, bytes] = msgspec.field(default_factory=dict)
    """Tag -> build context, of the images that are built for its services, wherever one comes from in this plan."""
    limit: tuple[str, ...] = ()
    """The robots that were chosen, where steps of others were left out."""
    targets: tuple[str, ...] = ()
    """The services that were chosen, where steps on others were left out."""
    inputs: Mapping[str, str] = msgspec.field(default_factory=dict)
    """File name -> text, of the definitions that it was made from."""
    made_by: str = ""
    """srprov's version."""
    proof: str = ""
    """What only the controller that wrote it can make: `controller.plan_proof`."""


def dump(saved: PlanFile) -> str:
    """Return the file's text.

    Raises:
        ValueError: It would be too large to be read again.
    """
    blobs: dict[str, bytes] = {}
    _document(saved, blobs)
    too_large = sum(len(blob) for blob in blobs.values()) * 4 // 3 > MAX_CHARACTERS  # known before it is encoded
    text = "" if too_large else "".join(pieces(saved))
    if too_large or len(text) > MAX_CHARACTERS:
        raise ValueError(f"the plan's file would be larger than {MAX_CHARACTERS >> 20} MiB")
    return text


def pieces(saved: PlanFile) -> Iterator[str]:
    """Return the file's text in pieces: everything but bytes, then those one after the other."""
    blobs: dict[str, bytes] = {}
    shown = {**_document(saved, blobs), "blobs": {}}
    head, _, tail = json.dumps(shown, indent=2, sort_keys=False, ensure_ascii=True).rpartition("{}")
    yield head
    before = "{\n"
    for sha in sorted(blobs):
        yield f'{before}    "{sha}": "{base64.b64encode(blobs[sha]).decode("ascii")}"'
        before = ",\n"
    yield ("\n  }" if blobs else "{}") + tail + "\n"


def document(saved: PlanFile) -> dict[str, Any]:
    """Return the file's content as JSON values without bytes, for reading."""
    return _document(saved, {})


def _document(saved: PlanFile, blobs: dict[str, bytes]) -> dict[str, Any]:
    return {
        **plan_json(saved.plan),
        "format": FORMAT,
        "srprov": saved.made_by,
        "costs": {service: round(cost, 6) for service, cost in sorted(saved.plan.costs.items())},
        "secrets": _secrets_out(saved.plan),
        "steps": [step_out(step, blobs) for step in saved.plan.steps],
        "also_wanted": [_also_out(resource, blobs) for resource in saved.also_wanted],
        "contexts": {tag: _keep(data, blobs) for tag, data in sorted(saved.contexts.items())},
        "limit": list(saved.limit),
        **({"targets": list(saved.targets)} if saved.targets else {}),
        "fingerprints": saved.fingerprints,
        "inputs": dict(sorted(saved.inputs.items())),
        "proof": saved.proof,
    }


def _secrets_out(plan: Plan) -> dict[str, Any]:
    """Return where secrets come from, with the place in the EDF, for whoever applies the file and has no such value."""
    shown = {}
    for source in plan.secrets:
        at = source.location
        shown[source.name] = {**secret_json(source), "at": [at.file, at.line, at.column]}
    return shown


def step_out(step: Step, blobs: dict[str, bytes]) -> dict[str, Any]:
    """Return a step as JSON values; its bytes are added to `blobs`."""
    return {
        **step_json(step),
        "before": lasting(step.change.before) if step.change.before is not None else None,
        "commands": [_command_out(command, blobs) for command in step.commands],
        "want": _want_out(step.want, blobs),
        "found": {"instance": step.found.instance, "state": lasting(step.found.state)} if step.found else None,
    }


def _want_out(want: Resource | None, blobs: dict[str, bytes]) -> dict[str, Any] | None:
    if want is None:
        return None
    return _stated(want, blobs)


def _also_out(want: Resource, blobs: dict[str, bytes]) -> dict[str, Any]:
    return {"robot": want.host, "module": want.module, "name": want.name, **_stated(want, blobs)}


def _stated(want: Resource, blobs: dict[str, bytes]) -> dict[str, Any]:
    if blob := getattr(want.params, "blob", None):
        _keep(blob, blobs)
    needs = [{"id": need.id, "condition": need.condition} for need in want.needs]
    return {"params": want.written, "needs": needs, "source": want.source}


def _keep(data: bytes, blobs: dict[str, bytes]) -> str:
    """Add bytes to those of the file and return their sha256."""
    digest = sha256_of(data)
    blobs[digest] = data
    return digest


def _command_out(command: Command, blobs: dict[str, bytes]) -> dict[str, Any]:
    """Return the command as `plan --json` shows it, with what else it takes to do it."""
    shown = {**command_json(command), "timeout_s": command.timeout_s}
    if isinstance(command, Put) and not command.secret:
        _keep(command.content, blobs)
    if isinstance(command, EngineCall):
        if command.blob:
            _keep(command.blob, blobs)
        shown |= {"accept": list(command.accept), "stream": command.stream}
    return shown


def differences(before: object, now: object, path: str = "") -> list[str]:
    """Name what moved between two fingerprints, e.g. `resources container:srprov.a.b state: was running`."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        moved: list[str] = []
        for key in sorted({*before, *now}, key=str):
            moved += differences(before.get(key), now.get(key), f"{path} {key}" if path else str(key))
        return moved
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = list(zip(before, now, strict=True))
        if all(isinstance(one, Mapping) for pair in pairs for one in pair):
            return [line for index, pair in enumerate(pairs) for line in differences(*pair, f"{path} {index}")]
    # a robot's words, as a line of an error
    return [] if before == now else [visible(f"{path}: was {_short(before)}, is {_short(now)}")]


def _short(value: object) -> str:
    if value is None:
        return "not there"
    text = json.dumps(value, sort_keys=True) if not isinstance(value, str) else value
    return text if len(text) <= 80 else text[:77] + "..."
