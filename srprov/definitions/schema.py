"""Document and JSON Schema -> problems at their lines.

Takes a root node and a schema's kind; adds to `Findings`. Touches srprov's own schemas. jsonschema walks a shadow of
the document in which a scalar is its source text and still knows its node, so a scalar is "string", "integer" or
"boolean" when the schema asks for that, as formats demand.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from typing import Any

from srprov.codes import Code
from srprov.definitions import schema_cache
from srprov.errors import DefinitionError
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

MOST_BYTES = 2 * 1024 * 1024
MOST_ENTRIES = 1000
"""Of one list or map."""
MOST_VALUES = 20_000
"""Of one document."""


class Text(str):
    """A scalar's source text that still knows its node."""

    node: Scalar


def check(root: Node, kind: str, findings: Findings, path: Path = ()) -> None:
    """Add every way in which a document breaks a schema; `path` is where `root` stands in its document.

    Raises:
        DefinitionError: It is too large to be checked; with what was found before.
    """
    from srprov.data import schema_text

    _check_size(root, findings)
    about = "\0".join((schema_cache.code(), kind, schema_text(kind.partition("/")[0]), _canonical(root)))
    digest = hashlib.sha256(about.encode("utf-8", "surrogatepass")).hexdigest()
    if schema_cache.is_known(digest):
        return
    from srprov.definitions.schema_errors import add_problem

    faults = 0
    for faults, error in enumerate(_validator(kind).iter_errors(_shadow(root)), start=1):  # noqa: B007 - counted
        add_problem(error, root, path, findings)
    if not faults:
        schema_cache.add(digest)


def _check_size(root: Node, findings: Findings) -> None:
    """Refuse what would take long: checks compare entries of a list with each other, and jsonschema is slow."""
    count, left = 0, [root]
    while left:
        node = left.pop()
        inside: Collection[Node] = node.items if isinstance(node, Seq) else ()
        inside = node.entries.values() if isinstance(node, Map) else inside
        count += len(inside)
        what = f"holds {len(inside)} entries; {MOST_ENTRIES} are the most" if len(inside) > MOST_ENTRIES else ""
        if what or count > MOST_VALUES:
            told = what or f"the document holds more than {MOST_VALUES} values"
            raise DefinitionError([*findings.problems, nodes.problem(node, told, code=Code.TOO_LARGE)])
        left.extend(inside)


def _canonical(node: Node) -> str:
    """Return everything that a schema asks of a document, in one text."""
    if isinstance(node, Map):
        return "{" + ",".join(f"{key!r}:{_canonical(value)}" for key, value in node.entries.items()) + "}"
    if isinstance(node, Seq):
        return "[" + ",".join(_canonical(item) for item in node.items) + "]"
    return f"{'p' if node.plain else 'q'}{node.text!r}"


def check_tags(node: Node, findings: Findings, allowed: frozenset[str], path: Path = ()) -> None:
    """Add every tag that means nothing; `!replace` may stand before a map or list whose key is in `allowed`."""
    key = next((part for part in reversed(path) if isinstance(part, str)), "")
    fits = node.tag == "!replace" and key in allowed and path[-1:] == (key,) and not isinstance(node, Scalar)
    if node.tag and not fits:
        hint = "'!replace' stands before a map or list that would otherwise be merged" if node.tag == "!replace" else ""
        findings.add(node, f"the tag '{node.tag[:60]}' means nothing here", path, hint, code=Code.WRONG_VALUE)
    if isinstance(node, Map):
        for name, value in node.entries.items():
            if not name.startswith("x-"):
                check_tags(value, findings, allowed, (*path, name))
    elif isinstance(node, Seq):
        for index, item in enumerate(node.items):
            check_tags(item, findings, allowed, (*path, index))


def _shadow(node: Node) -> Any:  # noqa: ANN401 - what jsonschema walks
    if isinstance(node, Map):
        return {key: _shadow(value) for key, value in node.entries.items()}
    if isinstance(node, Seq):
        return [_shadow(item) for item in node.items]
    text = Text(node.text)
    text.node = node
    return text


@cache
def _validator(kind: str) -> Any:  # noqa: ANN401 - a class that jsonschema makes
    """Return what holds a document to a schema, or with `name/part` to one of its definitions."""
    from jsonschema import Draft202012Validator, TypeChecker, validators

    from srprov.data import schema

    types: dict[str, Any] = {
        "object": lambda _, value: isinstance(value, dict),
        "array": lambda _, value: isinstance(value, list),
        "string": lambda _, value: (
            isinstance(value, str) and not (isinstance(value, Text) and nodes.is_null(value.node))
        ),
        "integer": lambda _, value: _is_text(value) and nodes.as_int(value.node) is not None,
        "number": lambda _, value: _is_text(value) and nodes.as_number(value.node) is not None,
        "boolean": lambda _, value: _is_text(value) and nodes.as_bool(value.node) is not None,
        "null": lambda _, value: _is_text(value) and nodes.is_null(value.node),
    }
    keywords: dict[str, Any] = {name: _bound(name) for name in _BOUNDS} | {"const": _const, "pattern": pattern}
    extended: Any = validators.extend(  # type: ignore[no-untyped-call]  # jsonschema does not type it
        Draft202012Validator, validators=keywords, type_checker=TypeChecker(types)
    )
    name, _, part = kind.partition("/")
    whole = schema(name)
    return extended({"$ref": f"#/$defs/{part}", "$defs": whole["$defs"]} if part else whole)


def _is_text(value: object) -> bool:
    return isinstance(value, Text)


_BOUNDS: Mapping[str, tuple[str, Any]] = {
    "minimum": ("less than", lambda value, limit: value < limit),
    "maximum": ("more than", lambda value, limit: value > limit),
    "exclusiveMinimum": ("not more than", lambda value, limit: value <= limit),
    "exclusiveMaximum": ("not less than", lambda value, limit: value >= limit),
}


def _bound(name: str) -> Any:  # noqa: ANN401 - a keyword function of jsonschema
    from jsonschema import ValidationError

    words, breaks = _BOUNDS[name]

    def keyword(validator: Any, limit: float, instance: Any, _schema: Any) -> Iterator[ValidationError]:  # noqa: ANN401
        if validator.is_type(instance, "number") and breaks(nodes.as_number(instance.node), limit):
            yield ValidationError(f"{instance} is {words} {limit}")

    return keyword


def pattern(validator: Any, wanted: str, instance: Any, _schema: Any) -> Iterator[Any]:  # noqa: ANN401
    """Hold a text to a pattern as ECMAScript does, in which `$` is the end alone; Python's fits before a line feed too.

    All patterns of our schemas have their `$` at the end, or none.
    """
    from jsonschema import ValidationError

    exact = wanted.removesuffix("$") + r"\Z" if wanted.endswith("$") else wanted
    if validator.is_type(instance, "string") and not re.search(exact, instance):
        yield ValidationError(f"{str(instance)!r} does not match {wanted!r}")


def _const(_validator: Any, wanted: Any, instance: Any, _schema: Any) -> Iterator[Any]:  # noqa: ANN401
    from jsonschema import ValidationError

    found = nodes.as_int(instance.node) if isinstance(wanted, int) and isinstance(instance, Text) else instance
    if found != wanted:
        yield ValidationError(f"expected {wanted}" + (f", not {instance}" if isinstance(instance, str) else ""))
