"""Stored facts against `schemas/facts.schema.json`: numbers in their ranges, texts of their form."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from itertools import islice
from typing import Any

from srprov.codes import Code
from srprov.errors import UsageError

_MOST_ERRORS = 100
"""Of which the best is told."""
_ANY_TEXT = {"type": "string"}
_NOT_ASKED = ("required", "additionalProperties", "description", "examples")
_KINDS: Mapping[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "integer": (int,), "number": (int, float),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip
_CHECKS: Mapping[str, Callable[[Any, Any], bool]] = {
    "minimum": lambda value, least: value >= least,
    "maximum": lambda value, most: value <= most,
    "minLength": lambda value, least: len(value) >= least,
    "maxLength": lambda value, most: len(value) <= most,
    "enum": lambda value, some: value in some,
    "pattern": lambda text, form: bool(re.search(form[:-1] + r"\Z" if form.endswith("$") else form, text)),
}


def check_ranges(robots: Mapping[str, Any]) -> None:
    """Compare each robot's facts with the schema; fields may be missing or new, as other versions write them.

    Raises:
        UsageError: A value is out of its range; the message names the robot and the field.
    """
    from jsonschema.exceptions import best_match

    ranges, validator = _ranges(), _validator()
    for name, values in sorted(robots.items()):
        if _fits(values, ranges, ranges["$defs"]):
            continue  # jsonschema takes milliseconds for each robot; it is asked for its words
        error = best_match(islice(validator.iter_errors(values), _MOST_ERRORS))
        if error is not None:
            where = ".".join(str(part) for part in error.absolute_path)
            raise UsageError(
                f"the facts of '{name}' cannot be: '{where}': {error.message[:200]}",
                hint="give a file that `srprov facts --json` wrote",
                code=Code.FACTS_FILE,
            )


def _fits(value: Any, schema: Mapping[str, Any], defs: Mapping[str, Any]) -> bool:  # noqa: ANN401 - JSON is any
    """Tell whether a value is surely what a schema says; of one with a word that is not known here, it is not."""
    if "type" in schema and type(value) not in _KINDS.get(str(schema["type"]), ()):
        return False
    return all(_fits_word(value, word, said, defs) for word, said in schema.items() if word not in ("type", "$defs"))


def _fits_word(value: Any, word: str, said: Any, defs: Mapping[str, Any]) -> bool:  # noqa: ANN401 - JSON is any
    if word == "properties":
        return all(_fits(value[key], inner, defs) for key, inner in said.items() if key in value)
    if word == "items":
        if said == _ANY_TEXT:
            return all(type(one) is str for one in value)
        return all(_fits(one, said, defs) for one in value)
    if word == "anyOf":
        return any(_fits(value, one, defs) for one in said)
    if word == "$ref":
        return _fits(value, defs[said.removeprefix("#/$defs/")], defs)
    return word in _CHECKS and _CHECKS[word](value, said)


def _validator() -> Any:  # noqa: ANN401 - jsonschema does not type it
    from jsonschema import Draft202012Validator, validators

    from srprov.definitions.schema import pattern

    exact: Any = validators.extend(Draft202012Validator, validators={"pattern": pattern})  # type: ignore[no-untyped-call]  # jsonschema does not type it
    return exact(_ranges())


@cache
def _ranges() -> dict[str, Any]:
    from srprov import data

    whole = data.schema("facts")
    robot: dict[str, Any] = _lenient({**whole["$defs"]["robot"], "$defs": whole["$defs"]})
    return robot


def _lenient(schema: Any) -> Any:  # noqa: ANN401 - JSON is any
    if isinstance(schema, list):
        return [_lenient(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return {key: _lenient(one) for key, one in schema.items() if key not in _NOT_ASKED}
