"""Facts as JSON -> HostFacts: the other way round of `document`, for decisions without a robot.

Takes the JSON that `srprov facts --json` printed; gives values. Pure. The command line compares them with
`schemas/facts.schema.json`, which has the ranges of numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address
from typing import Any

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.facts.links import is_a_hosts
from srprov.facts.model import Docker, HostFacts, Link, Snapshot
from srprov.untrusted import LIST_LENGTH

_HINT = "give a file that `srprov facts --json` wrote"
_WITHIN = (("memory_available", "memory_total"), ("swap_free", "swap_total"), ("disk_free", "disk_total"))
_MOST_ROBOTS = 10_000
"""As inventories have hosts."""
_MOST_LINKS = 100_000
"""Of all robots; a file has no room for as many that are written out."""
_MOST_ENTRIES = 8 * LIST_LENGTH
"""Of one list. What robots are asked for is less, also with what an inventory adds."""


def read_document(document: Any) -> Snapshot:  # noqa: ANN401 - JSON is any
    """Return the robots of a document; resources and placements of instances are not in it.

    Raises:
        UsageError: It is not of that shape.
    """
    if not isinstance(document, Mapping) or not isinstance(document.get("robots"), Mapping):
        raise UsageError("no 'robots' in the facts", hint=_HINT, code=Code.FACTS_FILE)
    robots = document["robots"]
    links = sum(len(one["links"]) for one in robots.values() if isinstance(one, dict) and _is_list(one.get("links")))
    for count, most, what in ((len(robots), _MOST_ROBOTS, "robots"), (links, _MOST_LINKS, "links of robots")):
        if count > most:
            raise UsageError(
                f"there are facts of {count} {what}; {most} are the most", hint=_HINT, code=Code.FACTS_FILE
            )
    facts = {str(name): read_facts(str(name), values) for name, values in sorted(robots.items())}
    away = document.get("unreachable", {})
    unreachable = {str(name): str(why) for name, why in away.items()} if isinstance(away, Mapping) else {}
    return Snapshot(facts=facts, observed={name: () for name in facts}, unreachable=unreachable)


def read_facts(name: str, values: Any) -> HostFacts:  # noqa: ANN401 - JSON is any
    """Return one robot's facts; fields that are not known are left out, those not given have their default.

    Raises:
        UsageError: A value is of another kind than the field, or free is more than total.
    """
    if not isinstance(values, Mapping):
        raise UsageError(f"the facts of '{name}' are not a map", hint=_HINT, code=Code.FACTS_FILE)
    try:
        _check_lengths(values)
        given = _fields(HostFacts, values)
        given["links"] = tuple(_link(one) for one in values.get("links", ()))
        docker = values.get("docker")
        given["docker"] = Docker(**_fields(Docker, docker)) if docker is not None else None
        facts = HostFacts(**{**given, "name": name})
        for part, whole in _WITHIN:
            if getattr(facts, part) > getattr(facts, whole):
                raise TypeError(f"'{part}' is more than '{whole}'")
        if facts.underlay_address and not _is_address(facts.underlay_address):  # hosts files and exports have it
            raise TypeError("'underlay_address' is no address")
        return facts
    except (TypeError, AttributeError, OverflowError) as error:
        raise UsageError(f"the facts of '{name}' cannot be read: {error}", hint=_HINT, code=Code.FACTS_FILE) from error


def _link(values: Mapping[str, Any]) -> Link:
    _check_lengths(values)
    return Link(**_fields(Link, values))


def _is_list(value: object) -> bool:
    return isinstance(value, list)


def _check_lengths(values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if _is_list(value) and len(value) > _MOST_ENTRIES:
            raise TypeError(f"'{name[:60]}' has {len(value)} entries; {_MOST_ENTRIES} are the most")


def _fields(kind: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a class has, each checked against the kind of its default or annotation."""
    found: dict[str, Any] = {}
    for name, annotation in kind.__annotations__.items():
        if name not in values or name in ("links", "docker"):
            continue
        value, wanted = values[name], str(annotation)
        if wanted.startswith("tuple"):
            if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
                raise TypeError(f"'{name}' is not a list of texts")
            value = tuple(value)
        elif not _is_a(value, wanted):
            raise TypeError(f"'{name}' is not {wanted}")
        found[name] = float(value) if wanted == "float" else value
    return found


def _is_a(value: Any, wanted: str) -> bool:  # noqa: ANN401 - JSON is any
    if wanted == "bool":
        return isinstance(value, bool)
    if wanted in ("int", "float"):
        return isinstance(value, int if wanted == "int" else (int, float)) and not isinstance(value, bool)
    return isinstance(value, str)


def _is_address(text: str) -> bool:
    """Return whether a text is an address, and a plain one: in an IPv6 scope Python takes anything."""
    try:
        return "%" not in text and is_a_hosts(ip_address(text))
    except ValueError:
        return False
