"""`parameters`, `trials`, `results` and `metrics` of an EDF: reading them, and what about them cannot be.

Takes the root of an EDF that passed the schema, and the services; gives TrialDefinitions, or adds to `Findings`. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction
from types import MappingProxyType
from typing import TypeVar

from srprov.codes import Code
from srprov.definitions import trialchecks, trialconditions
from srprov.definitions.model import Service, repository_in
from srprov.definitions.trialsmodel import Limits, Margin, Metric, Parameter, Result, TrialDefinitions, TrialSettings
from srprov.definitions.values import duration, scalars, text, texts
from srprov.yamldoc import nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

KEYS = ("parameters", "trials", "results", "metrics")
_LEADING_ZERO = re.compile("[-+]?0[0-9]")
_MOST_DIGITS = 30
_T = TypeVar("_T")


def read(root: Map, services: Mapping[str, Service], findings: Findings) -> TrialDefinitions | None:
    """Return what the EDF says of trials; None when it says nothing, or its schema is broken there."""
    if not any(key in root.entries for key in KEYS) or any(findings.broken((key,)) for key in KEYS):
        return None
    settings = _settings(root, findings)
    found = TrialDefinitions(
        parameters=_parameters(root, findings),
        settings=settings,
        results=MappingProxyType(_results(root, findings)),
        metrics=_metrics(root),
    )
    trialchecks.check(root, found, services, findings)
    return found


def value_text(node: Scalar) -> str:
    """Return what a container sees of a value: numbers in one form, so that 0.50 and 0.5 are one value."""
    whole, number = nodes.as_int(node), nodes.as_number(node)
    if whole is not None:
        return str(whole)
    # a leading zero is a number to some versions of YAML only
    return node.text if number is None or _LEADING_ZERO.match(node.text) else repr(number)


def _parameters(root: Map, findings: Findings) -> tuple[Parameter, ...]:
    given = root.entries.get("parameters")
    return tuple(
        _parameter(name, node, findings) for name, node in (given.entries.items() if isinstance(given, Map) else ())
    )


def _parameter(name: str, node: Node, findings: Findings) -> Parameter:
    get = node.entries.get if isinstance(node, Map) else dict[str, Node]().get
    listed = node if isinstance(node, Seq) else get("values")
    spaced = get("range")
    values = tuple(value_text(one) for one in scalars(listed))
    if isinstance(spaced, Map):
        odd = [key for key in ("from", "to") if abs(Decimal(_decimal(spaced.entries[key])).adjusted()) > _MOST_DIGITS]
        values = () if odd else _range(spaced)
        for key in odd:
            findings.add(
                spaced.entries[key],
                f"it has more than {_MOST_DIGITS} digits",
                ("parameters", name, "range"),
                code=Code.TRIAL_DESIGN,
            )
    for index, value in enumerate(values):
        if value in values[:index]:
            place = scalars(listed)[index] if listed is not None else node
            findings.add(
                place, f"{name} has the value '{value[:60]}' twice", ("parameters", name), code=Code.TRIAL_DESIGN
            )
    services = get("apply_to")
    return Parameter(
        name=name,
        values=values,
        services=None if services is None else texts(services),
        unit=text(get("unit")),
        description=text(get("description")),
    )


def _decimal(node: Node) -> str:
    """Return a number's digits; whole ones may be written in other bases."""
    whole = nodes.as_int(node)
    return text(node) if whole is None else str(whole)


def _range(node: Map) -> tuple[str, ...]:
    """Return evenly spaced values, without the errors of binary fractions; whole numbers where all of them are."""
    words = [_decimal(node.entries[key]) for key in ("from", "to", "steps")]
    first, last, steps = (Fraction(word) for word in words)
    values = [first + (last - first) * index / (steps - 1) for index in range(int(steps))]
    if all(value.denominator == 1 for value in values) and "." not in words[0] + words[1]:
        return tuple(str(int(value)) for value in values)
    return tuple(repr(float(value)) for value in values)


def _settings(root: Map, findings: Findings) -> TrialSettings:
    node = root.entries.get("trials")
    if isinstance(node, Scalar):
        return TrialSettings(repetitions=nodes.as_int(node) or 1)
    if not isinstance(node, Map):
        return TrialSettings()
    get = node.entries.get
    stop, between = _map(get("stop")), _map(get("between"))
    seed = _whole(get("seed"))
    order = text(get("order"), "listed" if seed is None and "parameters" not in root.entries else "random")
    if order == "random" and seed is None and "parameters" in root.entries:
        hint = "any whole number, for example 'seed: 1'; or 'order: listed'"
        findings.add(root.keys["trials"], "a random order needs a 'seed'", ("trials",), hint, code=Code.TRIAL_DESIGN)
    grace = stop.get("grace")
    return TrialSettings(
        repetitions=_whole(get("repetitions")) or 1,
        design=text(get("design"), "product"),
        exclude=_points(get("exclude")),
        include=_points(get("include")),
        order=order,
        seed=seed or 0,
        paired_seeds=text(get("seeds")) == "per-repetition",
        ready_s=_or(_seconds(get("ready"), "ready", findings), 60.0),
        settle_s=_or(_seconds(get("settle"), "settle", findings), 0.0),
        until=trialconditions.read(get("until"), ("trials", "until"), findings),
        timeout_s=_or(_seconds(get("timeout"), "timeout", findings), 600.0),
        stop_signal=text(stop.get("signal")),
        stop_grace_s=None if grace is None else _seconds(grace, "stop", findings),
        stop_first=texts(stop.get("first")),
        success=trialconditions.read(get("success"), ("trials", "success"), findings),
        retries=_or(_whole(get("retries")), 1),
        stop_on_failure=text(get("on_failure")) == "stop",
        max_failures=_or(_whole(get("max_failures")), 3),
        pause_s=_or(_seconds(between.get("sleep"), "between", findings), 0.0),
        prompt=text(between.get("prompt")),
        keep=texts(get("keep")),
        limits=_limits(_map(get("limits")), findings),
    )


def _limits(given: Mapping[str, Node], findings: Findings) -> Limits:
    get, path = given.get, ("trials", "limits")
    offset = trialconditions.attempt(get("clock_offset"), (*path, "clock_offset"), duration, findings)
    warmest = get("temperature")
    return Limits(
        clock_offset_s=offset,
        disk_free_bytes=trialconditions.attempt(get("disk_free"), (*path, "disk_free"), size_in_bytes, findings),
        battery_percent=_whole(get("battery")),
        temperature_c=None if warmest is None else nodes.as_number(warmest),
        wait_s=_or(trialconditions.attempt(get("wait"), (*path, "wait"), duration, findings), 120.0),
    )


def _or(value: _T | None, default: _T) -> _T:
    return default if value is None else value


def _map(node: Node | None) -> Mapping[str, Node]:
    return node.entries if isinstance(node, Map) else {}


def _whole(node: Node | None) -> int | None:
    return nodes.as_int(node) if node is not None else None


def _seconds(node: Node | None, key: str, findings: Findings) -> float | None:
    return trialconditions.attempt(node, ("trials", key), duration, findings)


def _points(node: Node | None) -> tuple[Mapping[str, str], ...]:
    items = node.items if isinstance(node, Seq) else ()
    maps = [item.entries for item in items if isinstance(item, Map)]
    return tuple({key: value_text(one) for key, one in some.items() if isinstance(one, Scalar)} for some in maps)


def _results(root: Map, findings: Findings) -> dict[str, tuple[Result, ...]]:
    found = {}
    for service, node in sorted(_map(root.entries.get("results")).items()):
        items = node.items if isinstance(node, Seq) else ()
        found[service] = tuple(_result(item, ("results", service), findings) for item in items)
    return found


def _result(node: Node, path: Path, findings: Findings) -> Result:
    get = _map(node).get
    most, required = get("max"), get("required")
    place = node if isinstance(node, Scalar) else get("path")
    if place is not None and repository_in(text(place).split("/"), folder=True) is not None:
        told = f"'{text(place)[:80]}' would make a repository here, whose settings may name programs"
        findings.add(place, told, path, "have the service pack it into a file", code=Code.WRONG_VALUE)
    if isinstance(node, Scalar):
        return Result(path=node.text)
    return Result(
        path=text(get("path")),
        required=bool(required is not None and nodes.as_bool(required)),
        most_bytes=trialconditions.attempt(most, path, size_in_bytes, findings) or 0,
    )


def _margin(node: Node | None) -> Margin | None:
    """Return a margin, whose form the schema has checked: a number, or a percentage."""
    if node is None:
        return None
    given = text(node)
    return Margin(float(given[:-1]) / 100, relative=True) if given.endswith("%") else Margin(float(given))


def _metrics(root: Map) -> tuple[Metric, ...]:
    found = []
    for name, node in sorted(_map(root.entries.get("metrics")).items()):
        get = _map(node).get
        file, _, pointer = text(get("json")).partition("#")
        found.append(
            Metric(
                name=name,
                service=text(get("service")),
                file=file,
                pointer=pointer,
                pattern=text(get("log")),
                reduce=text(get("reduce"), "last"),
                unit=text(get("unit")),
                better=text(get("better")),
                margin=_margin(get("margin")),
                description=text(get("description")),
            )
        )
    return tuple(found)
