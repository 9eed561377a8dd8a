"""`until` and `success` of an EDF's trials -> Conditions. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from srprov.codes import Code
from srprov.definitions.trialsmodel import Condition, Conditions, TrialSettings
from srprov.definitions.values import duration, scalars, text
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_T = TypeVar("_T")


def read(node: Node | None, path: Path, findings: Findings) -> Conditions | None:
    """Return the conditions of a map with `any` or `all`; None where nothing stands."""
    if not isinstance(node, Map):
        return None
    key = "all" if "all" in node.entries else "any"
    listed = node.entries.get(key)
    items = listed.items if isinstance(listed, Seq) else ()
    found = [_condition(item, (*path, key, index), findings) for index, item in enumerate(items)]
    return Conditions(items=tuple(found), every=key == "all")


def _condition(item: Node, path: Path, findings: Findings) -> Condition:
    kind, value = next(iter(item.entries.items())) if isinstance(item, Map) else ("", item)
    get = value.entries.get if isinstance(value, Map) else dict[str, Node]().get
    if kind in ("completed", "healthy"):
        return Condition(kind=kind, services=tuple(one.text for one in scalars(value)))
    if kind == "exit":
        code = get("code")
        return Condition(kind=kind, services=(text(get("service")),), code=(nodes.as_int(code) if code else None) or 0)
    if kind == "log":
        return Condition(kind=kind, services=(text(get("service")),), pattern=text(get("matches")))
    if kind == "after":
        return Condition(kind=kind, seconds=attempt(value, path, duration, findings) or 0.0)
    name, bounds = next(iter(value.entries.items())) if isinstance(value, Map) else ("", value)
    limits = bounds.entries if isinstance(bounds, Map) else {}
    below, above, equals = (
        nodes.as_number(limits[key]) if key in limits else None for key in ("below", "above", "equals")
    )
    return Condition(kind="metric", metric=name, below=below, above=above, equals=equals)


def attempt(node: Node | None, path: Path, read_text: Callable[[str], _T], findings: Findings) -> _T | None:
    """Return what a scalar's text says; None where nothing stands, or what cannot be, which is added."""
    if not isinstance(node, Scalar):
        return None
    try:
        return read_text(node.text)
    except ValueError as error:
        findings.add(node, str(error), path, code=Code.TRIAL_JUDGING)
        return None


def services_of(key: str, conditions: Conditions, index: int) -> Path:
    """Return where a condition names its services."""
    kind = conditions.items[index].kind
    path = place_of(key, conditions, index)
    return (*path, kind) if kind in ("completed", "healthy") else (*path, kind, "service")


def all_conditions(settings: TrialSettings) -> Iterator[tuple[str, Conditions]]:
    """Return `until` and `success`, those that there are."""
    for key, conditions in (("until", settings.until), ("success", settings.success)):
        if conditions is not None:
            yield key, conditions


def place_of(key: str, conditions: Conditions, index: int) -> Path:
    """Return where a condition stands."""
    return ("trials", key, "all" if conditions.every else "any", index)
