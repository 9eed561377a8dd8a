"""A lab's policy: what no flag allows. Read from the machine's and the user's own folder, never from a project's.

`with_limits` gives containers the limits that a lab wants them to have; `enforce` refuses a plan that goes beyond what
all policies allow. Everything is looked at in the plan itself, so a plan from a file is held to the same.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.stated import definition_of
from srprov.definitions.containermodel import Runtime
from srprov.definitions.dockerfile import images_of, unclear
from srprov.definitions.labpolicy import LabPolicy, load
from srprov.definitions.model import Definitions, Inventory, Service
from srprov.errors import RefusedError
from srprov.image_reference import BUILT, BUNDLED, parse_reference
from srprov.modules.container_params import ContainerParams
from srprov.modules.image import ImageParams
from srprov.planning.plan import Plan, Step
from srprov.planning.policy import KINDS, Permission, of_image

Policies = tuple[LabPolicy, ...]
NAME = "policy.yml"
_HINT = "no flag changes that; who keeps the policy can"
_UNNAMED = "groups of an inventory that you did not name do not count for a policy: if you trust it, name it with -i"
_IN_IMAGES = ("outside", "env", "git")
"""What goes into an image is sent to the robot that builds it."""


class _Amount(msgspec.Struct, frozen=True):
    """One thing that a policy limits, as a container has it."""

    field: str
    shown: Callable[[float], str]


_AMOUNTS: Mapping[str, _Amount] = {
    "memory": _Amount("mem_limit", lambda number: f"{number / (1 << 20):g} MiB of memory"),
    "cpus": _Amount("cpus", lambda number: f"{number:g} CPUs"),
    "pids": _Amount("pids_limit", lambda number: f"{number:g} processes"),
}


def read_policies(user_folder: Path, machine: Path) -> tuple[LabPolicy, ...]:
    """Return the policies that there are: each must allow what is done, so the stricter wins.

    Raises:
        DefinitionError: One cannot be read, or is wrong.
    """
    found = (load(str(folder / NAME), KINDS) for folder in (machine, user_folder))
    return tuple(policy for policy in found if policy is not None)


def narrowed(allowed: Collection[str], policies: Sequence[LabPolicy]) -> frozenset[str]:
    """Return the kinds that a user allows and some robot may be asked for.

    Raises:
        RefusedError: The user names a kind that a policy allows for no robot at all.
    """
    left = frozenset(KINDS) if "all" in allowed else frozenset(allowed)
    for policy in policies:
        if policy.kinds is not None:
            anywhere = frozenset().union(*policy.kinds.values())
            if forbidden := sorted(set(allowed) - {"all"} - anywhere):
                raise _refusal(policy, policy.kinds_line, f"{', '.join(forbidden)} on any robot")
            left &= anywhere
    return left if policies else frozenset(allowed)


def with_limits(definitions: Definitions, policies: Sequence[LabPolicy]) -> Definitions:
    """Return the definitions in which each container has a limit wherever a policy has one."""
    defaults = {}
    for what, amount in _AMOUNTS.items():
        given = [policy.limits[what] for policy in policies if what in policy.limits]
        wishes = [wish for limit in given if (wish := limit.default or limit.most)]
        if wishes:
            defaults[amount.field] = min([*wishes, *(limit.most for limit in given if limit.most)])
    if not defaults:
        return definitions
    experiment = definitions.experiment
    services = {
        name: replace(service, runtime=_filled(service.runtime, defaults))
        for name, service in experiment.services.items()
    }
    return replace(definitions, experiment=replace(experiment, services=services))


def _filled(run: Runtime, defaults: Mapping[str, float]) -> Runtime:
    memory = run.mem_limit or int(defaults.get("mem_limit", 0))
    return replace(
        run,
        mem_limit=memory,
        # an engine takes no reservation beyond the limit
        mem_reservation=min(run.mem_reservation, memory or run.mem_reservation),
        cpus=run.cpus or defaults.get("cpus", 0.0),
        pids_limit=run.pids_limit or int(defaults.get("pids_limit", 0)),
    )


def enforce(plan: Plan, inventory: Inventory, policies: Sequence[LabPolicy]) -> None:
    """Refuse a plan that a policy does not allow.

    Raises:
        RefusedError: Names the first thing, and the policy's file and line.
    """
    for policy in policies:
        for permission in plan.permissions if policy.kinds is not None else ():
            for robot in _robots(plan, permission, inventory):
                if not allows(policy, permission.kind, robot, inventory):
                    what = f"{permission.kind} on {robot} ({permission.service}: {permission.what})"
                    raise _refusal(policy, policy.kinds_line, what, _HINT if inventory.named else _UNNAMED)
        for step in plan.steps:
            forbidden = _built_there(step, policy, inventory)
            for line, what in (*forbidden, *_too_much(step, policy), *_from_elsewhere(step, policy)):
                raise _refusal(policy, line, what)


def allows(policy: LabPolicy, kind: str, robot: str, inventory: Inventory) -> bool:
    """Return whether a policy lets a robot be asked for a kind; groups are what the user's own inventory says."""
    host = inventory.hosts.get(robot)
    kinds = policy.kinds_of(host.groups if host and inventory.named else ())
    return kinds is None or kind in kinds


def _built_there(step: Step, policy: LabPolicy, inventory: Inventory) -> Iterator[tuple[int, str]]:
    """Yield what a build asks of its robot, which need be none that runs the image: the engine there does it."""
    params = step.want.params if step.want else None
    if policy.kinds is None or not isinstance(params, ImageParams) or params.source != "build":
        return
    cdf = definition_of(step.name, _dockerfile(params.blob or b""))
    for asked in of_image(Service(name=step.name, cdf=step.name), {step.name: cdf}):
        if not allows(policy, asked.kind, step.host, inventory):
            yield policy.kinds_line, f"{asked.kind} on {step.host}, which builds {step.name} ({asked.what})"


def _robots(plan: Plan, permission: Permission, inventory: Inventory) -> list[str]:
    """Return the robots that a permission is about: its service's, else all that the plan is about.

    A playbook may have the name of a service, and states what it likes on any robot.
    """
    if permission.kind != "playbook" and permission.service in plan.assignment:
        builders = _builders(plan, permission.service) if permission.kind in _IN_IMAGES else set()
        return sorted({plan.assignment[permission.service], *builders})
    everywhere = {*plan.assignment.values(), *(step.host for step in plan.steps)}
    return sorted(everywhere or inventory.hosts)


def _builders(plan: Plan, service: str) -> set[str]:
    """Return the robots that build a service's image, and all that build where a plan does not say which it has."""
    wants = [step.want for step in plan.steps if step.want]
    images = {one.params.image for one in wants if one.service == service and isinstance(one.params, ContainerParams)}
    builds = [one for one in wants if isinstance(one.params, ImageParams) and one.params.source == "build"]
    return {one.host for one in builds if not images or one.name in images}


def _too_much(step: Step, policy: LabPolicy) -> Iterator[tuple[int, str]]:
    params = step.want.params if step.want else None
    if not isinstance(params, ContainerParams):
        return
    for what, limit in policy.limits.items():
        amount = _AMOUNTS[what]
        has = getattr(params.run, amount.field)
        if limit.most and not 0 < has <= limit.most:
            wish = amount.shown(has) if has > 0 else f"{what} without a limit"
            yield limit.line, f"{wish} for {step.name} on {step.host}, only {amount.shown(limit.most)}"
    most = policy.limits["memory"].most if "memory" in policy.limits else 0
    if most and params.run.shm_size > most:
        yield policy.limits["memory"].line, f"shm_size of {params.run.shm_size} bytes for {step.name} on {step.host}"


def _from_elsewhere(step: Step, policy: LabPolicy) -> Iterator[tuple[int, str]]:
    if policy.registries is None:
        return
    for name in _images(step):
        if not _comes_from(name, policy.registries):
            known = ", ".join(policy.registries) or "none"
            yield policy.registries_line, f"the image {name} on {step.host}: its registry is not among {known}"


def _images(step: Step) -> Iterable[str]:
    """Return the images that a step takes from a registry, or that its container runs."""
    params = step.want.params if step.want else None
    if isinstance(params, ContainerParams):
        built = params.image.startswith(BUILT) and not params.image.startswith(BUNDLED)
        return () if built else (params.image,)  # what is built here is looked at below
    if not isinstance(params, ImageParams) or params.source == "copy":
        return ()
    return (step.name,) if params.source in ("pull", "cache") else images_of(_dockerfile(params.blob or b""))


@functools.lru_cache(maxsize=64)  # each policy asks for it twice, and a context may be large
def _dockerfile(context: bytes) -> str:
    """Return the Dockerfile of a build's context; a variable for one that srprov did not write: nothing passes."""
    from srprov.images.tag import read_context  # not needed where nothing is built

    text = read_context(context)[1]
    return text if text and unclear(text) is None else "FROM $NOTHING"


def _comes_from(name: str, registries: Iterable[str]) -> bool:
    try:
        reference = parse_reference(name)
    except ValueError:
        return False  # a variable stands in it, or an id: nobody knows
    whole = f"{reference.domain}/{reference.path}"
    return any(whole == one or whole.startswith(f"{one}/") for one in registries)


def _refusal(policy: LabPolicy, line: int, what: str, hint: str = _HINT) -> RefusedError:
    return RefusedError(f"{policy.file}:{line} does not allow {what}", hint=hint, code=Code.LAB_POLICY)
