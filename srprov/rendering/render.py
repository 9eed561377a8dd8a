"""Playbook texts and one robot's context -> its resources.

Takes the texts by name (in name order), a context of plain values, and blobs by digest; gives `Resource`s. An item
of a playbook is a mapping whose first key names a module, with the resource's name as its value; `needs` lists
`module:name` on the same robot or `robot/module:name`, each a text or `{id, condition}`. A parameter `blob` names
its bytes by digest.

Touches nothing. Facts and definition files are values here and are never rendered again as templates.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import yaml
from jinja2 import TemplateError

from srprov.errors import RenderError
from srprov.rendering.environment import check_whole_values, environment
from srprov.resource import Condition, Need, Resource

_CONDITIONS = {condition.value for condition in Condition}


def render(
    playbooks: Mapping[str, str],
    host: str,
    context: Mapping[str, Any],
    *,
    modules: Collection[str],
    blobs: Mapping[str, bytes],
) -> tuple[Resource, ...]:
    """Render all playbooks for one robot.

    Args:
        playbooks: file name -> text.
        host: the robot's name.
        context: values that the playbooks read.
        modules: kinds that exist.
        blobs: sha256 -> bytes, for parameters named `blob`.

    Raises:
        RenderError: An undefined value, a broken YAML, an unknown module, or two resources with one id.
    """
    env = environment()
    resources: dict[str, Resource] = {}
    for name in sorted(playbooks):
        check_whole_values(env, playbooks[name], name)
        for number, item in enumerate(_items(env.from_string(playbooks[name]), name, host, context), start=1):
            resource = _resource(item, host, modules, blobs, f"{name}, item {number}")
            if resource.id in resources:
                raise RenderError(f"{resource.source}: {resource.id} stands twice", hint="give each resource one place")
            resources[resource.id] = resource
    return tuple(resources.values())


def _items(template: Any, name: str, host: str, context: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:  # noqa: ANN401 - jinja2's Template is untyped here
    try:
        text = template.render(**context)
    except (TemplateError, TypeError, ValueError) as error:
        raise RenderError(f"playbook {name}, robot {host}: {error}", hint="check the names in the template") from error
    try:
        items = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)) or []  # noqa: S506 - both are safe loaders
    except yaml.YAMLError as error:
        raise RenderError(f"playbook {name}, robot {host} renders to broken YAML: {error}") from error
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise RenderError(f"playbook {name}, robot {host}: a playbook is a list of resources")
    return items


def _resource(
    item: Mapping[str, Any], host: str, modules: Collection[str], blobs: Mapping[str, bytes], source: str
) -> Resource:
    kind = str(next(iter(item), ""))
    if kind not in modules:
        known = ", ".join(sorted(modules))
        raise RenderError(f"{source}: the first key of an item names its module, '{kind}' is none", hint=f"known: {known}")
    params = {key: value for key, value in item.items() if key not in (kind, "needs")}
    if "blob" in params:
        params["blob"] = blobs[params["blob"]]
    needs = tuple(_need(need, host, source) for need in item.get("needs") or ())
    return Resource(host=host, module=kind, name=str(item[kind]), params=params, needs=needs, source=source)


def _need(value: object, host: str, source: str) -> Need:
    identity, condition = value, Condition.PRESENT.value
    if isinstance(value, Mapping):
        identity, condition = value.get("id"), value.get("condition", condition)
    if not isinstance(identity, str) or condition not in _CONDITIONS:
        raise RenderError(f"{source}: {value!r} is no need", hint="write module:name or {id: …, condition: healthy}")
    # a robot's name never holds a colon, a resource's name may hold a slash
    full = identity if "/" in identity.split(":", 1)[0] else f"{host}/{identity}"
    return Need(full, str(condition))
