"""Playbook texts and one robot's context -> its resources.

Takes the texts by name (in name order), a context of plain values, and blobs by digest; gives `Resource`s. An item
of a playbook is a mapping whose first key names a module, with the resource's name as its value; `needs` lists
`module:name` on the same robot or `robot/module:name`, each a text or `{id, condition}`. Parameters are read once, by
the types that their module declares; bytes are named by their digest.

Touches only the cache of compiled playbooks (`compiled.py`). Facts and definition files are values here and are never
rendered again as templates.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from jinja2 import Template, TemplateError

from srprov.codes import Code
from srprov.errors import RenderError
from srprov.modules.module import Module
from srprov.modules.params import ParameterError, check_text, read_params
from srprov.rendering import compiled
from srprov.rendering.environment import load
from srprov.resource import Condition, Need, Resource


def render(
    playbooks: Mapping[str, str],
    host: str,
    context: Mapping[str, Any],
    *,
    modules: Mapping[str, Module[Any]],
    blobs: Mapping[str, bytes],
) -> tuple[Resource, ...]:
    """Render all playbooks for one robot.

    Args:
        playbooks: file name -> text.
        host: the robot's name.
        context: values that the playbooks read.
        modules: kind -> module.
        blobs: sha256 -> bytes, for parameters that are bytes.

    Raises:
        RenderError: An undefined value, a broken YAML, an unknown module, parameters that its module cannot take, or
            two resources with one id.
    """
    resources: dict[str, Resource] = {}
    for name in sorted(playbooks):
        template = _template(name, playbooks[name])
        for number, item in enumerate(_items(template, name, host, context), start=1):
            resource = _resource(item, host, modules, blobs, f"{name}, item {number}")
            if resource.id in resources:
                raise RenderError(
                    f"{resource.source}: {resource.id} stands twice",
                    hint="give each resource one place",
                    code=Code.TWICE,
                )
            resources[resource.id] = resource
    return tuple(resources.values())


@functools.lru_cache(maxsize=256)
def _template(name: str, text: str) -> Template:
    """Compile a playbook, once for all robots."""
    try:
        return compiled.template(name, text)
    except TemplateError as error:
        line = getattr(error, "lineno", None) or 1
        raise RenderError(f"{name}:{line}: {error.message}", hint="correct the template", code=Code.TEMPLATE) from error


def _items(template: Template, name: str, host: str, context: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    try:
        text = template.render(**context)
    except (TemplateError, TypeError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
        raise RenderError(
            f"playbook {name}, robot {host}: {error}", hint="check the names in the template", code=Code.RENDERED
        ) from error
    try:
        items = load(text) or []
    except (yaml.YAMLError, ValueError) as error:
        raise RenderError(
            f"playbook {name}, robot {host} renders to broken YAML: {error}", code=Code.RENDERED
        ) from error
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise RenderError(f"playbook {name}, robot {host}: a playbook is a list of resources", code=Code.PLAYBOOK)
    return items


def _resource(
    item: Mapping[str, Any], host: str, modules: Mapping[str, Module[Any]], blobs: Mapping[str, bytes], source: str
) -> Resource:
    kind = str(next(iter(item), ""))
    if kind not in modules:
        known = ", ".join(sorted(modules))
        message = f"{source}: the first key of an item names its module, '{kind}' is none"
        raise RenderError(message, hint=f"known: {known}", code=Code.PLAYBOOK)
    written = {key: value for key, value in item.items() if key not in (kind, "needs")}
    name, needs = item[kind], item.get("needs") or []
    if not isinstance(name, str) or not name:
        raise RenderError(
            f"{source}: {name!r} is no name of a {kind}", hint="write the resource's name as text", code=Code.PLAYBOOK
        )
    if not isinstance(needs, list):
        raise RenderError(f"{source}: needs is a list", hint="write needs: [module:name]", code=Code.PLAYBOOK)
    for need in needs:
        _check_need(need, source)
    try:
        return build(kind, name, written, needs, host=host, modules=modules, blobs=blobs, source=source)
    except ParameterError as error:
        hint = "`srprov schema playbook` explains the parameters of every module"
        raise RenderError(f"{source}: {kind} {name!r}: {error}", hint=hint, code=Code.PLAYBOOK) from error


def _check_need(value: object, source: str) -> None:
    identity, condition = value, Condition.PRESENT.value
    if isinstance(value, Mapping):
        identity, condition = value.get("id"), value.get("condition", condition)
    if not isinstance(identity, str) or condition not in [one.value for one in Condition]:
        raise RenderError(
            f"{source}: {value!r} is no need",
            hint="write module:name or {id: …, condition: healthy}",
            code=Code.PLAYBOOK,
        )


def build(
    kind: str,
    name: str,
    written: Mapping[str, Any],
    needs: Sequence[Any],
    *,
    host: str,
    modules: Mapping[str, Module[Any]],
    blobs: Mapping[str, bytes],
    source: str,
) -> Resource:
    """Return the resource of an item whose name and needs have been checked.

    Raises:
        ParameterError: Its module cannot take a parameter, or a robot its name.
    """
    return Resource(
        host=host,
        module=kind,
        name=check_text(name, "its name"),
        params=read_params(modules[kind].params, written, blobs),
        written=written,
        needs=tuple(_need(need, host) for need in needs),
        source=source,
    )


def _need(value: Any, host: str) -> Need:  # noqa: ANN401 - text or a map
    stated = value if isinstance(value, Mapping) else {"id": value}
    identity = stated["id"]
    # a robot's name never holds a colon, a resource's name may hold a slash
    full = identity if "/" in identity.split(":", 1)[0] else f"{host}/{identity}"
    return Need(full, stated.get("condition", Condition.PRESENT.value))
