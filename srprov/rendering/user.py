"""A user's playbook and one robot's context -> its resources, or every problem at its line of the playbook.

Takes what `definitions.playbook` has read; the keys in its text carry their places, so what it renders to is told
there. What a field means decides its type, as in every file that users write: `mode: 0644` is text. Touches nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from srprov.codes import Code
from srprov.data import schema as shipped_schema
from srprov.definitions.playbook import check_item
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.template import unmarked
from srprov.definitions.template_check import VARIABLES
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.modules.module import Module
from srprov.modules.params import ParameterError
from srprov.rendering.environment import TAG
from srprov.rendering.limited import LONGEST_TEXT, Rendered
from srprov.rendering.render import build
from srprov.resource import Resource
from srprov.untrusted import parse_json
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq, Source

_MOST_VALUES = 20_000
"""Of what a playbook comes to for one robot."""
_UNDEFINED = re.compile(r"'(\w+)' is undefined")


def render_user(
    playbook: Playbook,
    context: Mapping[str, Any],
    rendered: Rendered,
    *,
    modules: Mapping[str, Module[Any]],
    blobs: Mapping[str, bytes],
) -> list[Resource]:
    """Return the resources of one playbook for the robot of a context; `modules` and `blobs` as for `render`.

    Raises:
        DefinitionError: With all that is wrong, each at its place.
    """
    root = _root(playbook, context["host"], rendered)
    items = root.items if isinstance(root, Seq) else ()
    findings = Findings()
    if root is not None and not isinstance(root, Seq):
        raise DefinitionError([_problem(playbook, 1, f"a playbook is a list of resources, not {nodes.kind(root)}")])
    found = [_resource(item, playbook, context, modules, blobs, findings) for item in items]
    if findings.problems:
        raise DefinitionError(findings.problems)
    return [resource for resource in found if resource is not None]


def _root(playbook: Playbook, host: str, rendered: Rendered) -> Node | None:
    if rendered.fault:
        unknown = _UNDEFINED.search(rendered.fault)
        hint = did_you_mean(unknown[1], VARIABLES) if unknown else ""
        raise DefinitionError(
            [_problem(playbook, rendered.line, f"for robot {host}: {rendered.fault}", hint, Code.RENDERED)]
        )
    try:
        with allowance(LONGEST_TEXT, _MOST_VALUES):
            return loader.parse(rendered.text, playbook.source.file)
    except DefinitionError as error:
        first = error.problems[0]
        message = f"renders to broken YAML for robot {host}: {first.message}; there: {first.excerpt.strip()[:80]}"
        raise DefinitionError([_problem(playbook, 1, message, code=Code.RENDERED)]) from error


def _problem(playbook: Playbook, line: int, message: str, hint: str = "", code: Code = Code.PLAYBOOK) -> Diagnostic:
    excerpt = playbook.source.excerpt(line)
    column = len(excerpt) - len(excerpt.lstrip()) + 1
    return Diagnostic(Location(playbook.source.file, line, column), message, "", excerpt, hint, code=code)


def _resource(
    item: Node,
    playbook: Playbook,
    context: Mapping[str, Any],
    modules: Mapping[str, Module[Any]],
    blobs: Mapping[str, bytes],
    findings: Findings,
) -> Resource | None:
    """Return the resource of an item, or add what is wrong with it."""
    if not isinstance(item, Map):
        findings.extend([_problem(playbook, 1, f"an item is a map, not {nodes.kind(item)}")])
        return None
    found = Findings()
    try:
        plain = _placed(item, playbook.source)
    except ValueError as error:  # of a substitution's value
        findings.add(Scalar(playbook.source, *_place(item), ""), f"a value cannot be used: {error}", code=Code.RENDERED)
        return None
    check_item(plain, found)
    if found.problems:
        findings.extend(found.problems)
        return None
    kind = next(iter(plain.entries))
    rules = shipped_schema("playbook")["$defs"][kind]["properties"]
    nodes_of = {unmarked(key)[0]: value for key, value in item.entries.items()}
    written = {key: _value(value, rules[key]) for key, value in nodes_of.items() if not key.startswith("x-")}
    name, needs = written.pop(kind), written.pop("needs", [])
    place = plain.keys[kind]
    source = f"{playbook.source.file}:{place.line}:{place.column}"
    try:
        made = build(kind, name, written, needs, host=context["host"], modules=modules, blobs=blobs, source=source)
    except ParameterError as error:
        findings.add(plain.keys.get(error.key, place), str(error), code=Code.PLAYBOOK)
        return None
    if wrong := modules[kind].misplaced(name, made.params, context):
        message, hint = wrong
        findings.add(place, message, (), hint, code=Code.PLAYBOOK)
    return made


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


def _place(item: Map) -> tuple[int, int]:
    _, line, column = unmarked(next(iter(item.entries), ""))
    return line or 1, column or 1


def _filled(node: Node, key: Scalar) -> Node:
    if isinstance(node, Scalar):
        if node.tag == TAG:
            return nodes.from_json(parse_json(node.text), key.source, key.line, key.column)
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
        value = parse_json(node.text)
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
