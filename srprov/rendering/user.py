"""A user's playbook and one robot's context -> its resources, or every problem at its line of the playbook.

Takes what `definitions.playbook` has read; the keys in its text carry their places, so what it renders to is told
there. What a field means decides its type, as in every file that users write: `mode: 0644` is text. Touches nothing.
"""

from __future__ import annotations

import functools
import json
import re
import traceback
from collections.abc import Mapping
from typing import Any

from jinja2 import Template, TemplateError

from srprov.data import schema as shipped_schema
from srprov.definitions.playbook import check_item
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.template import unmarked
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.rendering.environment import TAG, environment
from srprov.resource import Condition, Need, Resource
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq, Source

_FILE_FOLDER_MODULES = ("file", "tree", "secret")
_FAILURES = (
    TemplateError, TypeError, ValueError, ArithmeticError, LookupError, AttributeError, RecursionError, SyntaxError,
)  # fmt: skip
"""What expressions raise, and what compiling does with too many nested blocks."""
_UNDEFINED = re.compile(r"'(\w+)' is undefined")


def render_user(playbook: Playbook, context: Mapping[str, Any], blobs: Mapping[str, bytes]) -> list[Resource]:
    """Render one playbook for the robot of a context.

    Raises:
        DefinitionError: With all that is wrong, each at its place.
    """
    root = _rendered(playbook, context)
    items = root.items if isinstance(root, Seq) else ()
    findings = Findings()
    if root is not None and not isinstance(root, Seq):
        raise DefinitionError([_problem(playbook, 1, f"a playbook is a list of resources, not {nodes.kind(root)}")])
    found = [_resource(item, playbook, context, blobs, findings) for item in items]
    if findings.problems:
        raise DefinitionError(findings.problems)
    return [resource for resource in found if resource is not None]


@functools.lru_cache(maxsize=256)
def _template(text: str) -> Template:
    """Compile a playbook, once for all robots."""
    return environment().from_string(text)


def _rendered(playbook: Playbook, context: Mapping[str, Any]) -> Node | None:
    host = context["host"]
    try:
        text = _template(playbook.marked).render(**context)
    except _FAILURES as error:
        unknown = _UNDEFINED.search(str(error))
        hint = did_you_mean(unknown[1], context) if unknown else ""
        raise DefinitionError([_problem(playbook, _line(error), f"for robot {host}: {error}", hint)]) from error
    try:
        return loader.parse(text, playbook.source.file)
    except DefinitionError as error:
        first = error.problems[0]
        message = f"renders to broken YAML for robot {host}: {first.message}; there: {first.excerpt.strip()[:80]}"
        raise DefinitionError([_problem(playbook, 1, message)]) from error


def _line(error: BaseException) -> int:
    """Return the line of the template in which an expression failed; Jinja2 writes it into the traceback."""
    if isinstance(line := getattr(error, "lineno", None), int):
        return line
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == "<template>"]
    return lines[-1] or 1 if lines else 1


def _problem(playbook: Playbook, line: int, message: str, hint: str = "") -> Diagnostic:
    excerpt = playbook.source.excerpt(line)
    column = len(excerpt) - len(excerpt.lstrip()) + 1
    return Diagnostic(Location(playbook.source.file, line, column), message, "", excerpt, hint)


def _resource(
    item: Node, playbook: Playbook, context: Mapping[str, Any], blobs: Mapping[str, bytes], findings: Findings
) -> Resource | None:
    """Return the resource of an item, or add what is wrong with it."""
    if not isinstance(item, Map):
        findings.extend([_problem(playbook, 1, f"an item is a map, not {nodes.kind(item)}")])
        return None
    plain, found = _placed(item, playbook.source), Findings()
    check_item(plain, found)
    if found.problems:
        findings.extend(found.problems)
        return None
    kind = next(iter(plain.entries))
    rules = shipped_schema("playbook")["$defs"][kind]["properties"]
    written = {unmarked(key)[0]: value for key, value in item.entries.items()}
    params = {key: _value(value, rules[key]) for key, value in written.items() if not key.startswith("x-")}
    name, needs = params.pop(kind), params.pop("needs", [])
    place = plain.keys[kind]
    if wrong := _not_ours(kind, name, params, context):
        findings.add(place, *wrong)
    if "blob" in params:
        if params["blob"] not in blobs:
            findings.add(plain.keys["blob"], "there is no such blob", (), "name one that the variables give")
        params["blob"] = blobs.get(params["blob"], b"")
    wanted = tuple(_need(one, context["host"]) for one in needs)
    source = f"{playbook.source.file}:{place.line}:{place.column}"
    return Resource(host=context["host"], module=kind, name=name, params=params, needs=wanted, source=source)


def _placed(item: Map, source: Source) -> Map:
    """Return an item as it is checked: substitutions as what they hold, each at the place of its key."""
    entries: dict[str, Node] = {}
    keys: dict[str, Scalar] = {}
    for key, value in item.entries.items():
        name, line, column = unmarked(key)
        keys[name] = Scalar(source, line or 1, column or 1, name)
        entries[name] = _filled(value, keys[name])
    first = next(iter(keys.values()), None)
    return Map(source, first.line if first else 1, first.column if first else 1, entries, keys, item.tag)


def _filled(node: Node, key: Scalar) -> Node:
    if isinstance(node, Scalar):
        if node.tag == TAG:
            return nodes.from_json(json.loads(node.text), key.source, key.line, key.column)
        return Scalar(key.source, key.line, key.column, node.text, node.plain, node.tag)
    if isinstance(node, Seq):
        return Seq(key.source, key.line, key.column, tuple(_filled(one, key) for one in node.items), node.tag)
    entries = {unmarked(name)[0]: _filled(value, key) for name, value in node.entries.items()}
    keys = {name: Scalar(key.source, key.line, key.column, name) for name in entries}
    return Map(key.source, key.line, key.column, entries, keys, node.tag)


def _value(node: Node, rule: Mapping[str, Any]) -> Any:  # noqa: ANN401 - a JSON value
    """Return a node as the value that its field takes; the schema has said that it is one."""
    kinds = {one.get("type") for one in rule.get("anyOf", [rule])}
    if isinstance(node, Scalar) and node.tag == TAG:
        value = json.loads(node.text)
        return str(value) if kinds == {"string"} and isinstance(value, int | float) else value
    if isinstance(node, Seq):
        inner: Mapping[str, Any] = next((one["items"] for one in rule.get("anyOf", [rule]) if "items" in one), {})
        return [_value(one, inner) for one in node.items]
    if isinstance(node, Map):
        return {unmarked(key)[0]: _value(value, {}) for key, value in node.entries.items()}
    whole, flag, number = nodes.as_int(node), nodes.as_bool(node), nodes.as_number(node)
    if kinds & {"string"} or (kinds == {None} and "enum" in rule):
        return node.text
    if flag is not None and kinds & {"boolean", None}:
        return flag
    if nodes.is_null(node):
        return None
    return node.text if number is None else number if whole is None else whole


def _not_ours(
    kind: str, name: str, params: Mapping[str, Any], context: Mapping[str, Any]
) -> tuple[str, tuple[()], str] | None:
    """Say why a resource would be another instance's, or nobody's: it would never be found again, nor removed."""
    instance, folder = context["instance"], context["folder"]
    if params.get("instance", instance) != instance:
        return f"the {kind} '{name}' would belong to another instance", (), "write instance: {{ instance }}"
    home = folder if kind != "secret" else folder.replace("/var/lib/", "/run/", 1)
    if kind in _FILE_FOLDER_MODULES and not name.startswith(home + "/"):
        hint = 'write {{ folder ~ "/name" }}; a command can copy it elsewhere'
        return f"the {kind} '{name}' is not in the instance's folder {home}", (), hint
    if kind == "secret" and params["name"] not in {one["name"] for one in context["secrets"]}:
        return f"no service on this robot uses a secret '{params['name']}'", (), "list it under a service's 'secrets'"
    rest = name[len(home) + 1 :]
    if kind == "file" and ("/" in rest or rest in ("", ".", "..") or "\n" in rest or "\\" in rest):
        return f"the file '{name}' is not directly in {home}", (), "files of an instance lie side by side"
    return None


def _need(value: Any, host: str) -> Need:  # noqa: ANN401 - text or a map, as the schema says
    identity = value["id"] if isinstance(value, Mapping) else value
    condition = value.get("condition") if isinstance(value, Mapping) else None
    full = identity if "/" in identity.split(":", 1)[0] else f"{host}/{identity}"
    return Need(full, condition or Condition.PRESENT.value)
