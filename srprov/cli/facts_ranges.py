"""Stored facts against `schemas/facts.schema.json`: numbers in their ranges, texts of their form."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from srprov.codes import Code
from srprov.errors import UsageError


def check_ranges(robots: Mapping[str, Any]) -> None:
    """Compare each robot's facts with the schema; fields may be missing or new, as other versions write them.

    Raises:
        UsageError: A value is out of its range; the message names the robot and the field.
    """
    from jsonschema.exceptions import best_match

    validator = _validator()
    for name, values in sorted(robots.items()):
        error = best_match(validator.iter_errors(values))
        if error is not None:
            where = ".".join(str(part) for part in error.absolute_path)
            raise UsageError(
                f"the facts of '{name}' cannot be: '{where}': {error.message[:200]}",
                hint="give a file that `srprov facts --json` wrote",
                code=Code.FACTS_FILE,
            )


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
    return {key: _lenient(one) for key, one in schema.items() if key not in ("required", "additionalProperties")}
