"""The plan as a file that can be applied later: everything that the run needs, and what must not have moved by then.

`dump` gives JSON text, `load` reads it back to the same plan; bytes (build contexts, shipped files) stand once
each, in base64, under their sha256. A fingerprint per robot holds values, not only a hash, so that a refusal can
name what moved.

Equal plans give byte-equal files. Source of the idea: a saved plan is a contract, as in OpenTofu.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from srprov import names
from srprov.definitions.secretmodel import SecretSource
from srprov.errors import Location, UsageError
from srprov.modules import MODULES
from srprov.modules.params import read_params
from srprov.planning.fingerprint import lasting
from srprov.planning.plan import DataMove, Plan, PlaybookUse, Step, command_json, plan_json, secret_json, step_json
from srprov.planning.policy import Permission
from srprov.resource import Action, Change, Need, Observed, Resource
from srprov.untrusted import parse_json
from srprov.wire import Command, CopyImage, CopyVolume, EngineCall, Put, Run

FORMAT = 1
MAX_CHARACTERS = 96 * 1024 * 1024
"""A plan holds build contexts and shipped files in base64; reading it takes three times as much memory."""

Fingerprints = Mapping[str, Mapping[str, Any]]
"""Robot -> what must not have moved, as nested JSON values."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PlanFile:
    """A plan with what it was made from and what it relies on."""

    plan: Plan
    fingerprints: Fingerprints
    inputs: Mapping[str, str] = field(default_factory=dict)
    """File name -> text, of the definitions that it was made from."""
    made_by: str = ""
    """srprov's version."""


def dump(saved: PlanFile) -> str:
    """Return the file's text."""
    return json.dumps(document(saved), indent=2, sort_keys=False, ensure_ascii=True) + "\n"


def document(saved: PlanFile, *, with_blobs: bool = True) -> dict[str, Any]:
    """Return the file's content as JSON values; without blobs it is for reading only."""
    blobs: dict[str, bytes] = {}
    shown = {
        **plan_json(saved.plan),
        "format": FORMAT,
        "srprov": saved.made_by,
        "costs": {service: round(cost, 6) for service, cost in sorted(saved.plan.costs.items())},
        "secrets": _secrets_out(saved.plan),
        "steps": [_step_out(step, blobs) for step in saved.plan.steps],
        "fingerprints": saved.fingerprints,
        "inputs": dict(sorted(saved.inputs.items())),
    }
    if with_blobs:
        shown["blobs"] = {sha: base64.b64encode(blobs[sha]).decode("ascii") for sha in sorted(blobs)}
    return shown


def load(text: str, name: str) -> PlanFile:
    """Read a file's text.

    Raises:
        UsageError: It is no plan, it is of another format, or its bytes do not match their digests.
    """
    try:
        read = parse_json(text, max_characters=MAX_CHARACTERS)
        if not isinstance(read, dict) or read.get("format") != FORMAT:
            raise UsageError(
                f"{name} is not a plan of format {FORMAT}", hint="make one with `srprov plan -o plan.json`"
            )
        return _load(read, name)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        hint = "make it again with `srprov plan -o plan.json`"
        raise UsageError(f"{name} is no plan that can be applied: {error!r}", hint=hint) from error


def is_plan(text: str) -> bool:
    """Return whether a file's text is meant as a plan. An EDF may be JSON too, which is YAML; it says `edf`."""
    if not text.lstrip().startswith("{"):
        return False
    try:
        read = parse_json(text, max_characters=MAX_CHARACTERS)
    except ValueError:
        return '"plan":' in text[:200]  # cut off, perhaps; `load` says so
    return isinstance(read, dict) and "edf" not in read


def _load(read: Mapping[str, Any], name: str) -> PlanFile:
    blobs = {sha: base64.b64decode(data, validate=True) for sha, data in read["blobs"].items()}
    for sha, data in blobs.items():
        if hashlib.sha256(data).hexdigest() != sha:
            raise UsageError(f"{name}: the bytes of {sha[:12]} were changed", hint="make the plan again")
    plan = Plan(
        instance=names.checked("instance", read["instance"]),
        source=read["source"],
        steps=tuple(_step_in(step, blobs) for step in read["steps"]),
        unchanged=read["unchanged"],
        assignment=read["assignment"],
        cost=read["cost"],
        costs=read["costs"],
        permissions=tuple(Permission(**one) for one in read["permissions"]),
        secrets=tuple(_secret_in(name, one) for name, one in read["secrets"].items()),
        playbooks=tuple(PlaybookUse(**one) for one in read.get("playbooks", ())),
        data=tuple(DataMove(**one) for one in read["data"]),
        notes=tuple(read["notes"]),
        unreachable=read["unreachable"],
    )
    return PlanFile(plan=plan, fingerprints=read["fingerprints"], inputs=read["inputs"], made_by=read["srprov"])


def _secret_in(name: str, value: Mapping[str, Any]) -> SecretSource:
    words = tuple(value.get("command", ()))
    kinds = {"env": value.get("env", ""), "file": value.get("file", ""), "folder": value.get("folder", "")}
    file, line, column = value["at"]
    return SecretSource(name=name, command=words, location=Location(file, line, column), **kinds)


def _secrets_out(plan: Plan) -> dict[str, Any]:
    """Return where secrets come from, with the place in the EDF, for whoever applies the file and has no such value."""
    shown = {}
    for source in plan.secrets:
        at = source.location
        shown[source.name] = {**secret_json(source), "at": [at.file, at.line, at.column]}
    return shown


def _step_out(step: Step, blobs: dict[str, bytes]) -> dict[str, Any]:
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
    if blob := getattr(want.params, "blob", None):
        _keep(blob, blobs)
    needs = [{"id": need.id, "condition": need.condition} for need in want.needs]
    return {"params": want.written, "needs": needs, "source": want.source}


def _keep(data: bytes, blobs: dict[str, bytes]) -> None:
    blobs[hashlib.sha256(data).hexdigest()] = data


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


def _step_in(value: Mapping[str, Any], blobs: Mapping[str, bytes]) -> Step:
    host, module, name = value["robot"], value["module"], value["name"]
    want, found = value["want"], value["found"]
    change = Change(
        action=Action[value["action"].upper()],
        cause=value["cause"],
        destructive=value["destructive"],
        before=value["before"],
        commands=tuple(_command_in(command, blobs) for command in value["commands"]),
    )
    return Step(
        number=value["number"],
        host=host,
        module=module,
        name=name,
        change=change,
        needs=tuple(value["needs"]),
        waits=tuple(Need(**need) for need in value["waits"]),
        want=_want_in(want, blobs, host, module, name) if want else None,
        found=Observed(module=module, name=name, **found) if found else None,
    )


def _want_in(value: Mapping[str, Any], blobs: Mapping[str, bytes], host: str, module: str, name: str) -> Resource:
    return Resource(
        host=host,
        module=module,
        name=name,
        params=read_params(MODULES[module].params, value["params"], blobs),
        written=value["params"],
        needs=tuple(Need(**need) for need in value["needs"]),
        source=value["source"],
    )


def _command_in(value: Mapping[str, Any], blobs: Mapping[str, bytes]) -> Command:
    timeout = float(value["timeout_s"])
    if "run" in value:
        return Run(script=value["run"], timeout_s=timeout)
    if "put" in value:
        secret, in_place = value.get("secret", ""), value["in_place"]
        content, mode = b"" if secret else blobs[value["sha256"]], int(value["mode"], 8)
        return Put(path=value["put"], content=content, secret=secret, mode=mode, in_place=in_place, timeout_s=timeout)
    if "copy_image" in value:
        return CopyImage(image=value["copy_image"], source_host=value["from"], timeout_s=timeout)
    if name := value.get("copy_volume"):
        return CopyVolume(volume=name, into=value["into"], source_host=value["from"], timeout_s=timeout)
    return EngineCall(
        method=value["engine"],
        path=value["path"],
        params=tuple(value["params"].items()),
        body=value.get("body", ""),
        blob=blobs[value["sha256"]] if "sha256" in value else b"",
        accept=tuple(value["accept"]),
        stream=value["stream"],
        timeout_s=timeout,
    )


def differences(before: object, now: object, path: str = "") -> list[str]:
    """Name what moved between two fingerprints, e.g. `resources container:srprov.a.b state: was running`."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        moved: list[str] = []
        for key in sorted({*before, *now}, key=str):
            moved += differences(before.get(key), now.get(key), f"{path} {key}" if path else str(key))
        return moved
    return [] if before == now else [f"{path}: was {_short(before)}, is {_short(now)}"]


def _short(value: object) -> str:
    if value is None:
        return "not there"
    text = json.dumps(value, sort_keys=True) if not isinstance(value, str) else value
    return text if len(text) <= 80 else text[:77] + "..."
