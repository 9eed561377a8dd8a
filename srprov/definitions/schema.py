"""Document and JSON Schema -> problems at their lines.

Takes a root node and a schema's kind; adds to `Findings`. Touches srprov's own schemas. jsonschema walks a shadow of
the document in which a scalar is its source text and still knows its node, so a scalar is "string", "integer" or
"boolean" when the schema asks for that, as formats demand; the errors are then told in the user's words, at the key
or value that is meant.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any

from srprov.definitions import schema_cache
from srprov.errors import did_you_mean
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_WORDS = {"object": "a map", "array": "a list", "string": "text", "integer": "a whole number", "number": "a number"}
_WORDS |= {"boolean": "true or false"}


class Text(str):
    """A scalar's source text that still knows its node."""

    node: Scalar


def check(root: Node, kind: str, findings: Findings, path: Path = ()) -> None:
    """Add every way in which a document breaks a schema; `path` is where `root` stands in its document."""
    from srprov.data import schema_text

    about = "\0".join((schema_cache.code(), kind, schema_text(kind.partition("/")[0]), _canonical(root)))
    digest = hashlib.sha256(about.encode("utf-8", "surrogatepass")).hexdigest()
    if schema_cache.is_known(digest):
        return
    faults = 0
    for faults, error in enumerate(_validator(kind).iter_errors(_shadow(root)), start=1):  # noqa: B007 - counted
        _tell(error, root, path, findings)
    if not faults:
        schema_cache.remember(digest)


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
        findings.add(node, f"the tag '{node.tag[:60]}' means nothing here", path, hint)
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
    keywords: dict[str, Any] = {name: _bound(name) for name in _BOUNDS} | {"const": _const}
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


def _const(_validator: Any, wanted: Any, instance: Any, _schema: Any) -> Iterator[Any]:  # noqa: ANN401
    from jsonschema import ValidationError

    found = nodes.as_int(instance.node) if isinstance(wanted, int) and isinstance(instance, Text) else instance
    if found != wanted:
        yield ValidationError(f"expected {wanted}" + (f", not {instance}" if isinstance(instance, str) else ""))


def _tell(error: Any, root: Node, prefix: Path, findings: Findings) -> None:  # noqa: ANN401 - jsonschema's error
    """Turn one of jsonschema's errors into problems."""
    inside = tuple(error.absolute_path)
    node, path = nodes.find(root, inside), prefix + inside
    names_a_key = "propertyNames" in list(error.absolute_schema_path)[-2:-1]
    teller = _tell_name if names_a_key else _TELLERS.get(error.validator)
    if teller is not None:
        teller(error, root, node, path, prefix, findings)
        return
    value, limit = error.instance, error.validator_value
    shown = f"'{value[:60]}'" if isinstance(value, str) else nodes.kind(node)
    hint = ""
    if error.validator == "type":
        names = [limit] if isinstance(limit, str) else [name for name in limit if name == "string"] or list(limit)
        message = f"expected {_either(_WORDS.get(name, name) for name in names)}, not {nodes.kind(node)}"
        hint = _type_hint(node, names)
    elif error.validator == "enum":
        message = f"{shown} is not one of {', '.join(map(str, limit))}"
        hint = did_you_mean(str(value), map(str, limit))
    elif error.validator == "pattern":
        message = f"{shown} is not {error.schema.get('patternErrorMessage', f'of the form {limit}')}"
    elif error.validator in ("minItems", "minLength", "minProperties"):
        message = "must not be empty" if limit == 1 else f"needs at least {limit} entries"
    elif error.validator == "uniqueItems":
        message = "holds the same entry twice"
    else:
        message = error.message if len(error.message) < 200 else f"breaks the rule '{error.validator}'"
    findings.add(node, message, path, hint)


def _type_hint(node: Node, names: list[str]) -> str:
    if nodes.is_null(node):
        return 'write "" for an empty text' if "string" in names else ""
    if not isinstance(node, Scalar) or not {"integer", "number", "boolean"} & set(names):
        return ""
    bare = Scalar(node.source, node.line, node.column, node.text)
    fits = nodes.as_bool(bare) is not None if "boolean" in names else nodes.as_number(bare) is not None
    return "write it without quotes" if fits and not node.plain else ""


def _tell_unknown(error: Any, _root: Node, node: Node, path: Path, _prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    assert isinstance(node, Map)
    known = set(error.schema.get("properties", {}))
    patterns = [re.compile(pattern) for pattern in error.schema.get("patternProperties", {})]
    for key in node.entries:
        if key in known or any(pattern.search(key) for pattern in patterns):
            continue
        if error.schema.get("additionalProperties") is not False:
            continue
        hint = did_you_mean(key, known)
        if not hint and len(known) <= 12:
            hint = f"known: {', '.join(sorted(known))}"
        findings.add(nodes.key_or_value(node, key), f"unknown key '{key[:60]}'", (*path, key), hint)


def _tell_missing(error: Any, root: Node, node: Node, path: Path, prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    missing = [key for key in error.validator_value if isinstance(node, Map) and key not in node.entries]
    for key in missing:
        if _misspelt(node, [key], error.schema):
            continue
        findings.add(_owner(root, path[len(prefix) :], node), f"the key '{key}' is missing", path, "")


def _tell_name(error: Any, _root: Node, node: Node, path: Path, _prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    assert isinstance(node, Map)
    key = str(error.instance)
    says = error.schema.get("patternErrorMessage")
    message = f"'{key[:60]}' is not {says}" if says else f"unknown name '{key[:60]}'"
    findings.add(nodes.key_or_value(node, key), message, (*path, key), did_you_mean(key, error.schema.get("enum", ())))


def _tell_choice(error: Any, root: Node, node: Node, path: Path, prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    """Report `anyOf` and `oneOf` by the branch that the value's own kind picks, or as a choice of keys."""
    branches = error.validator_value
    if all(set(branch) == {"required"} for branch in branches):
        _tell_keys(error, [branch["required"][0] for branch in branches], root, node, path, prefix, findings)
        return
    by_branch: dict[int, list[Any]] = {}
    for inner in error.context:
        by_branch.setdefault(inner.relative_schema_path[0], []).append(inner)
    fitting = [found for found in by_branch.values() if not any(_at_root(inner, "type") for inner in found)]
    if len(fitting) == 1 and not any(_at_root(inner, "const") for inner in fitting[0]):
        for inner in fitting[0]:
            _tell(inner, root, prefix, findings)
        return
    findings.add(node, f"expected {_either(_options(error, branches))}, not {nodes.kind(node)}", path)


def _tell_keys(
    error: Any,  # noqa: ANN401
    keys: list[str],
    root: Node,
    node: Node,
    path: Path,
    prefix: Path,
    findings: Findings,
) -> None:
    present = [key for key in keys if isinstance(node, Map) and key in node.entries]
    if present and isinstance(node, Map):
        place = nodes.key_or_value(node, present[1])
        findings.add(place, f"'{present[0]}' and '{present[1]}' exclude each other", (*path, present[1]))
    elif isinstance(node, Map) and not _misspelt(node, keys, error.schema):
        if says := error.schema.get(f"{error.validator}ErrorMessage"):
            findings.add(_owner(root, path[len(prefix) :], node), says, path)
            return
        word = "exactly one" if error.validator == "oneOf" else "one"
        findings.add(_owner(root, path[len(prefix) :], node), f"needs {word} of {', '.join(keys)}", path)


def _misspelt(node: Node, wanted: list[str], rules: Mapping[str, Any]) -> bool:
    """Return whether an unknown key of a map was meant to be one of the wanted: one mistake is told once."""
    known = rules.get("properties", {})
    unknown = [key for key in node.entries if key not in known] if isinstance(node, Map) else []
    return any(did_you_mean(key, known) == f"did you mean '{one}'?" for key in unknown for one in wanted)


def _at_root(error: Any, keyword: str) -> bool:  # noqa: ANN401
    return error.validator == keyword and not error.relative_path


def _options(error: Any, branches: list[dict[str, Any]]) -> Iterator[str]:  # noqa: ANN401
    """Name what each branch takes."""
    for number, branch in enumerate(branches):
        reached = [inner for inner in error.context if inner.relative_schema_path[0] == number]
        full = reached[0].schema if reached and "$ref" in branch else branch
        wanted = full.get("type", full.get("const", "something else"))
        names = [wanted] if isinstance(wanted, str) else ["string"]
        yield from (_WORDS.get(name, f"'{name}'") for name in names)


def _either(words: Iterable[str]) -> str:
    unique = list(dict.fromkeys(words))
    return unique[0] if len(unique) == 1 else f"{', '.join(unique[:-1])} or {unique[-1]}"


def _owner(root: Node, inside: Path, node: Node) -> Node:
    """Return the key under which a map stands: what is missing inside it is best shown there."""
    parent = nodes.find(root, inside[:-1]) if inside else None
    return nodes.key_or_value(parent, str(inside[-1])) if isinstance(parent, Map) else node


_TELLERS: Mapping[Any, Any] = {
    "additionalProperties": _tell_unknown,
    "required": _tell_missing,
    "anyOf": _tell_choice,
    "oneOf": _tell_choice,
}
