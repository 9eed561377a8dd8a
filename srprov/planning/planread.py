"""A plan file's text -> PlanFile: every value by its type, and nothing in it that `dump` would not write.

Touches nothing. What a plan file may lead to is decided in `controller.authority` and `controller.saved`; here it only
becomes values.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence

from srprov import names
from srprov.codes import Code
from srprov.definitions.secretmodel import SecretSource, is_gone_by
from srprov.errors import Location, UsageError
from srprov.modules import MODULES, RUNNING
from srprov.modules.params import read_params
from srprov.planning.plan import Plan, Step
from srprov.planning.planfile import FORMAT, MAX_CHARACTERS, PlanFile, differences, document, pieces
from srprov.planning.plankeys import CommandKeys, DifferenceKeys, Document, SecretKeys, StepKeys, WantKeys
from srprov.resource import Action, Change, Condition, Difference, Need, Observed, Resource
from srprov.untrusted import parse_json
from srprov.wire import Command, CopyImage, CopyVolume, EngineCall, Put, Run, SendData

_MOST_NAMED = 8
"""Differences that an error names."""
_LONGEST_SOURCE = 5000
"""Characters: a path has 4096 bytes. Robots have it in their records, and with each container and volume."""
_AGAIN = "make it again with `srprov plan -o plan.json`"


def load(text: str, name: str) -> PlanFile:
    """Read a file's text.

    Raises:
        UsageError: It is no plan, it is of another format, its bytes do not match their digests, or it holds what
            `dump` does not write; it names what.
    """
    try:
        read = parse_json(text, max_characters=MAX_CHARACTERS)
        if not isinstance(read, dict) or read.get("format") != FORMAT:
            raise UsageError(f"{name} is not a plan of format {FORMAT}", hint=_AGAIN, code=Code.NO_PLAN)
        saved = _plan_file(read_params(Document, read, {}))
        same = _is_made_of(text, pieces(saved))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{name} is no plan that can be applied: {error!r}", hint=_AGAIN, code=Code.NO_PLAN) from error
    if not same:
        changed = differences({**read, "blobs": None}, document(saved)) or ["its form is not that of `srprov plan -o`"]
        raise UsageError(
            f"{name} was changed since `srprov plan -o` wrote it:\n{named(changed)}",
            hint=_AGAIN,
            code=Code.PLAN_CHANGED,
        )
    return saved


def _is_made_of(text: str, parts: Iterable[str]) -> bool:
    """Return whether a text is its parts one after the other; both are not in memory at once."""
    at = 0
    for part in parts:
        if not text.startswith(part, at):
            return False
        at += len(part)
    return at == len(text)


def named(changed: Sequence[str]) -> str:
    """Return differences as lines of an error, the first few of them."""
    more = [f"and {len(changed) - _MOST_NAMED} more"] if len(changed) > _MOST_NAMED else []
    return "\n".join(f"  {line}" for line in (*changed[:_MOST_NAMED], *more))


def is_plan(text: str) -> bool:
    """Return whether a file's text is meant as a plan. An EDF may be JSON too, which is YAML; it says `edf`."""
    if not text.lstrip().startswith("{"):
        return False
    try:
        read = parse_json(text, max_characters=MAX_CHARACTERS)
    except ValueError:
        return '"plan":' in text[:200]  # cut off, perhaps; `load` says so
    return isinstance(read, dict) and "edf" not in read


def _plan_file(read: Document) -> PlanFile:
    blobs = {sha: base64.b64decode(data, validate=True) for sha, data in read.blobs.items()}
    for sha, data in blobs.items():
        if hashlib.sha256(data).hexdigest() != sha:
            raise ValueError(f"the bytes of {sha[:12]} were changed")
    if len(read.source) > _LONGEST_SOURCE:
        raise ValueError(f"its source is longer than {_LONGEST_SOURCE} characters")
    plan = Plan(
        instance=names.checked("instance", read.instance),
        source=read.source,
        steps=tuple(_step(step, blobs) for step in read.steps),
        unchanged=read.unchanged,
        assignment={
            names.checked("service", service): names.checked("robot", robot)
            for service, robot in read.assignment.items()
        },
        cost=read.cost,
        costs=read.costs,
        permissions=read.permissions,
        secrets=tuple(_secret(name, one) for name, one in read.secrets.items()),
        playbooks=read.playbooks,
        data=read.data,
        notes=read.notes,
        unreachable={names.checked("robot", robot): why for robot, why in read.unreachable.items()},
    )
    also = tuple(_resource(one.robot, one.module, one.name, one, blobs) for one in read.also_wanted)
    return PlanFile(
        plan=plan,
        fingerprints=read.fingerprints,
        also_wanted=also,
        contexts={tag: blobs[sha] for tag, sha in read.contexts.items()},
        limit=read.limit,
        targets=read.targets,
        inputs=read.inputs,
        made_by=read.srprov,
        proof=read.proof,
    )


def _secret(name: str, read: SecretKeys) -> SecretSource:
    if not (read.env or read.file or read.command):
        raise ValueError(f"the secret {name[:60]!r} comes from nowhere")
    if is_gone_by(read.env):
        raise ValueError(f"the secret {name[:60]!r} is {read.env[:60]}, a variable that srprov itself goes by")
    return SecretSource(
        name=name, env=read.env, file=read.file, command=read.command, folder=read.folder, location=Location(*read.at)
    )


def _step(read: StepKeys, blobs: Mapping[str, bytes]) -> Step:
    want, found = read.want, read.found
    if read.module not in MODULES:
        raise ValueError(f"step {read.number} is of a kind that there is not: {read.module[:60]!r}")
    _check_needs(read.waits)
    change = Change(
        action=Action[read.action.upper()],
        cause=read.cause,
        destructive=read.destructive,
        before=read.before,
        commands=tuple(_command(command, blobs) for command in read.commands),
    )
    return Step(
        number=read.number,
        host=read.robot,
        module=read.module,
        name=read.name,
        change=change,
        needs=read.needs,
        waits=read.waits,
        want=_resource(read.robot, read.module, read.name, want, blobs) if want else None,
        found=Observed(module=read.module, name=read.name, instance=found.instance, state=found.state)
        if found
        else None,
        differences=tuple(_difference(one) for one in read.differences),
        makes=read.makes,
    )


def _difference(read: DifferenceKeys) -> Difference:
    return Difference(field=read.field, old=read.old, new=read.new, note=read.note, diff=read.diff)


def _check_needs(needs: Sequence[Need]) -> None:
    for need in needs:
        condition = Condition(need.condition)  # raises ValueError
        robot, _, rest = need.id.partition("/")
        kind, _, name = rest.partition(":")
        waited = condition not in (Condition.PRESENT, Condition.AFTER)
        if not (robot and name) or kind not in (RUNNING if waited else MODULES):
            raise ValueError(f"nothing can wait for {need.id[:60]!r} to be {need.condition}")


def _resource(host: str, module: str, name: str, read: WantKeys, blobs: Mapping[str, bytes]) -> Resource:
    _check_needs(read.needs)
    return Resource(
        host=host,
        module=module,
        name=name,
        params=read_params(MODULES[module].params, read.params, blobs),
        written=read.params,
        needs=read.needs,
        source=read.source,
    )


def _command(read: CommandKeys, blobs: Mapping[str, bytes]) -> Command:
    if read.put:
        return Put(
            path=read.put,
            content=b"" if read.secret else blobs[read.sha256],
            secret=read.secret,
            mode=int(read.mode, 8),
            in_place=read.in_place,
            timeout_s=read.timeout_s,
        )
    if read.copy_image:
        what = {"image": read.copy_image, "source_host": read.from_, "id": read.id, "way": read.way, "base": read.base}
        return CopyImage(**what, runs=read.runs, timeout_s=read.timeout_s)
    if read.copy_volume:
        return CopyVolume(volume=read.copy_volume, into=read.into, source_host=read.from_, timeout_s=read.timeout_s)
    if read.send_data:
        return SendData(sha256=read.send_data, url=read.url, timeout_s=read.timeout_s)
    if read.run is not None:
        return Run(script=read.run, timeout_s=read.timeout_s)
    return EngineCall(
        method=read.engine,
        path=read.path,
        params=tuple(read.params.items()),
        body=read.body,
        blob=blobs[read.sha256] if read.sha256 else b"",
        accept=read.accept,
        stream=read.stream,
        timeout_s=read.timeout_s,
    )
