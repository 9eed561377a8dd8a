"""What makes trials one experiment, and what of it has changed when a run is gone on with. Pure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.controller.trial_plan import TrialPlan
from srprov.errors import visible
from srprov.modules import MODULES
from srprov.modules.container_body import parts_of
from srprov.modules.container_params import ContainerParams
from srprov.resource import Observed, Resource
from srprov.secret import redacted
from srprov.untrusted import mapping

_LONGEST = 200
"""Characters of a value that are shown; of a longer one it is a hash."""
_FREE = ("repetitions", "retries", "max_failures", "pause_s", "prompt", "exclude", "include")
"""Settings that may change: which trials there are, and what is between them."""
_NOTHING = "nothing"

_IMAGE_ID = ": image id"

Sameness = Mapping[str, str]
"""What it is about -> its value as JSON, or a hash of it."""


def sameness(
    plan: TrialPlan, facts: Mapping[str, Mapping[str, str]], there: Mapping[str, Sequence[Observed]]
) -> Sameness:
    """Return what must be the same in all trials of a run.

    Args:
        plan: What is planned.
        facts: Robot -> what of it counts, in words.
        there: Robot -> what is there; of it the images count: a tag may lead to another one by now.
    """
    given = plan.given
    ids = {(host, one.name): one.state["id"] for host, some in there.items() for one in some if one.module == "image"}
    found: dict[str, object] = {}
    for one in containers_of(plan):
        found |= _of_service(one, {parameter.name for parameter in given.parameters})
        if image := ids.get((one.host, one.params.image)):
            found[f"{one.service}{_IMAGE_ID}"] = image
        found |= {f"{one.host}: {what}": value for what, value in facts.get(one.host, {}).items()}
    found |= {f"{service}: depends_on": dict(needs) for service, needs in plan.needs.items() if needs}
    found |= dict(_of_robots(plan.base.desired))
    settings = msgspec.to_builtins(given.settings)
    found |= {f"trials: {key}": _stated(value) for key, value in settings.items() if key not in _FREE}
    for metric in given.metrics:
        fields = _stated(msgspec.to_builtins(replace(metric, name="", description="")))
        found |= {f"metrics: {metric.name} {key}": value for key, value in mapping(fields).items()}
    found |= {
        f"results: {service}": [msgspec.to_builtins(one) for one in some] for service, some in given.results.items()
    }
    found |= {f"parameters: {one.name}": one.services or "all services" for one in given.parameters}
    return {str(key): _text(value) for key, value in mapping(redacted(found)).items()}


def containers_of(plan: TrialPlan) -> list[Resource]:
    """Return the containers of trials, and those that are kept over all of them."""
    return [*plan.services, *(one for one in plan.base.desired if isinstance(one.params, ContainerParams))]


def as_far_as_known(now: Sameness, before: Sameness) -> Sameness:
    """Return what is so now; an image that is on no robot yet counts as the one that was there, until it is pulled."""
    return {**{key: value for key, value in before.items() if key.endswith(_IMAGE_ID)}, **now}


def _of_service(one: Resource, swept: set[str]) -> dict[str, object]:
    assert isinstance(one.params, ContainerParams)
    parts = parts_of(one.params)
    environment = one.params.run.environment.items()
    return {
        **{f"{one.service}: {part}": value for part, value in parts.items() if part != "environment"},
        **{f"{one.service}: environment {name}": value for name, value in environment if name not in swept},
        f"{one.service}: robot": one.host,
    }


def _of_robots(desired: Sequence[Resource]) -> Iterator[tuple[str, object]]:
    """Return what users' playbooks do on robots; what srprov makes for itself follows from the rest."""
    for one in desired:
        module = MODULES[one.module]
        if module.same_in_trials and not module.is_plumbing(one.name):
            yield f"{one.host}: {one.module} {one.name}", dict(one.written)


def _stated(value: object) -> object:
    """Return a value without fields that say nothing; a number says something."""
    if isinstance(value, Mapping):
        return {key: _stated(item) for key, item in value.items() if item is not None and item not in ("", ())}
    return [_stated(item) for item in value] if isinstance(value, tuple) else value


def _text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, sort_keys=True, ensure_ascii=False)
    return text if len(text) <= _LONGEST else f"sha256 {hashlib.sha256(text.encode()).hexdigest()[:16]}"


def differences(before: Sameness, now: Sameness) -> Sequence[str]:
    """Return a line for each thing that is not as it was."""
    changed = sorted(key for key in before.keys() | now.keys() if before.get(key) != now.get(key))
    return [visible(f"{key}: {before.get(key, _NOTHING)} -> {now.get(key, _NOTHING)}") for key in changed]
