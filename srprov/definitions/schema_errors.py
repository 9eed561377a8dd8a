"""What jsonschema found -> problems in the user's words, at the key or value that is meant. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from srprov.codes import Code
from srprov.definitions import foreign_keys, unresolved
from srprov.errors import did_you_mean
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar

_WORDS = {"object": "a map", "array": "a list", "string": "text", "integer": "a whole number", "number": "a number"}
_WORDS |= {"boolean": "true or false"}
_GLUED = re.compile(r"([A-Za-z_][\w.-]{0,60}):(?![/\s])")
"""The beginning of `KEY:value`, and of no address."""
_ONE_LINE = re.compile(r'[^"\\\x00-\x1f]{1,60}')
"""A short text that double quotes keep as it is."""


def add_problem(error: Any, root: Node, prefix: Path, findings: Findings) -> None:  # noqa: ANN401 - jsonschema's error
    """Turn one of jsonschema's errors into problems."""
    inside = tuple(error.absolute_path)
    node, path = nodes.find(root, inside), prefix + inside
    names_a_key = "propertyNames" in list(error.absolute_schema_path)[-2:-1]
    handler = _wrong_key_name if names_a_key else _HANDLERS.get(error.validator)
    if handler is not None:
        handler(error, root, node, path, prefix, findings)
        return
    value, limit = error.instance, error.validator_value
    shown = f"'{value[:60]}'" if isinstance(value, str) else nodes.kind(node)
    hint, code = "", Code.WRONG_VALUE
    if error.validator == "type":
        names = [limit] if isinstance(limit, str) else [name for name in limit if name == "string"] or list(limit)
        message = f"expected {_either(_WORDS.get(name, name) for name in names)}, not {nodes.kind(node)}"
        hint, code = _type_hint(node, names, path), Code.WRONG_TYPE
    elif error.validator == "enum":
        message = f"{shown} is not one of {', '.join(map(str, limit))}"
        hint = did_you_mean(str(value), map(str, limit))
    elif error.validator == "pattern":
        message = f"{shown} is not {error.schema.get('patternErrorMessage', f'of the form {limit}')}"
        hint, code = (unresolved.HINT, Code.UNRESOLVED) if "${" in str(value) else ("", Code.WRONG_VALUE)
    elif error.validator in ("minItems", "minLength", "minProperties"):
        message = "must not be empty" if limit == 1 else f"needs at least {limit} entries"
    elif error.validator == "uniqueItems":
        message, code = "holds the same entry twice", Code.TWICE
    else:
        message = error.message if len(error.message) < 200 else f"breaks the rule '{error.validator}'"
    findings.add(node, message, path, hint, code=code)


def _type_hint(node: Node, names: list[str], path: Path) -> str:
    if nodes.is_null(node):
        if path[:1] == ("volumes",) and len(path) == 2:
            return "leave it out: only a volume that begins with a folder of the experiment stands here (`seed`)"
        return 'write "" for an empty text' if "string" in names else ""
    if "object" in names:
        return _colon_hint(node)
    if isinstance(node, Map) and path[-2:-1] == ("environment",):
        return "a list has `NAME=value`; `NAME: value` stands without a dash"
    if names == ["array"] and isinstance(node, Scalar) and _ONE_LINE.fullmatch(node.text):
        return f'write a list: ["{node.text}"]'
    if not isinstance(node, Scalar) or not {"integer", "number", "boolean"} & set(names):
        return ""
    bare = Scalar(node.source, node.line, node.column, node.text)
    fits = nodes.as_bool(bare) is not None if "boolean" in names else nodes.as_number(bare) is not None
    return "write it without quotes" if fits and not node.plain else ""


def _colon_hint(node: Node) -> str:
    """Return what to do about `KEY:value`, which YAML takes for a text; nothing for any other node."""
    glued = _GLUED.match(node.text) if isinstance(node, Scalar) and node.plain else None
    return f"YAML wants a space behind the colon: `{glued[1]}: …`" if glued else ""


def _unknown_key(error: Any, _root: Node, node: Node, path: Path, _prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    assert isinstance(node, Map)
    known = set(error.schema.get("properties", {}))
    patterns = [re.compile(pattern) for pattern in error.schema.get("patternProperties", {})]
    for key in node.entries:
        if key in known or any(pattern.search(key) for pattern in patterns):
            continue
        if error.schema.get("additionalProperties") is not False:
            continue
        hint = foreign_keys.hint(key, known) or did_you_mean(key, known)
        if not hint and len(known) <= 12:
            hint = f"known: {', '.join(sorted(known))}"
        findings.add(
            nodes.key_or_value(node, key), f"unknown key '{key[:60]}'", (*path, key), hint, code=Code.UNKNOWN_KEY
        )


def _missing_key(error: Any, root: Node, node: Node, path: Path, prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    missing = [key for key in error.validator_value if isinstance(node, Map) and key not in node.entries]
    for key in missing:
        if _misspelt(node, [key], error.schema):
            continue
        findings.add(
            _owner(root, path[len(prefix) :], node), f"the key '{key}' is missing", path,
            _example(key, error.schema), code=Code.MISSING_KEY,
        )  # fmt: skip


def _example(key: str, schema: Any) -> str:  # noqa: ANN401 - JSON is any
    """Return what to write for a key, where the schema knows one plain value of it."""
    about = schema.get("properties", {}).get(key, {})
    value = about.get("const", next(iter(about.get("examples", ())), None))
    return f"for example `{key}: {value}`" if isinstance(value, int | str) and value != "" else ""


def _wrong_key_name(error: Any, _root: Node, node: Node, path: Path, _prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    assert isinstance(node, Map)
    key = str(error.instance)
    says = error.schema.get("patternErrorMessage")
    message = f"'{key[:60]}' is not {says}" if says else f"unknown name '{key[:60]}'"
    findings.add(
        nodes.key_or_value(node, key),
        message,
        (*path, key),
        did_you_mean(key, error.schema.get("enum", ())),
        code=Code.NAME,
    )


def _wrong_choice(error: Any, root: Node, node: Node, path: Path, prefix: Path, findings: Findings) -> None:  # noqa: ANN401
    """Report `anyOf` and `oneOf` by the branch that the value's own kind picks, or as a choice of keys."""
    branches = error.validator_value
    if all(set(branch) == {"required"} for branch in branches):
        _wrong_choice_of_keys(error, [branch["required"][0] for branch in branches], root, node, path, prefix, findings)
        return
    by_branch: dict[int, list[Any]] = {}
    for inner in error.context:
        by_branch.setdefault(inner.relative_schema_path[0], []).append(inner)
    fitting = [found for found in by_branch.values() if not any(_at_root(inner, "type") for inner in found)]
    if len(fitting) == 1 and not any(_at_root(inner, "const") for inner in fitting[0]):
        for inner in fitting[0]:
            add_problem(inner, root, prefix, findings)
        return
    wanted = list(_options(error, branches))
    hint = _colon_hint(node) if _WORDS["object"] in wanted else ""
    findings.add(node, f"expected {_either(wanted)}, not {nodes.kind(node)}", path, hint, code=Code.WRONG_TYPE)


def _wrong_choice_of_keys(
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
        findings.add(
            place, f"'{present[0]}' and '{present[1]}' exclude each other", (*path, present[1]), code=Code.EXCLUSIVE
        )
    elif isinstance(node, Map) and not _misspelt(node, keys, error.schema):
        word = "exactly one" if error.validator == "oneOf" else "one"
        says = error.schema.get(f"{error.validator}ErrorMessage") or f"needs {word} of {', '.join(keys)}"
        findings.add(_owner(root, path[len(prefix) :], node), says, path, code=Code.MISSING_KEY)


def _misspelt(node: Node, wanted: list[str], rules: Mapping[str, Any]) -> bool:
    """Return whether an unknown key of a map was meant to be one of the wanted: one mistake is told once."""
    known = rules.get("properties", {})
    unknown = [key for key in node.entries if key not in known] if isinstance(node, Map) else []
    if any(foreign_keys.meant(key) in wanted for key in unknown):
        return True
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


_HANDLERS: Mapping[Any, Any] = {
    "additionalProperties": _unknown_key,
    "required": _missing_key,
    "anyOf": _wrong_choice,
    "oneOf": _wrong_choice,
}
