"""What a schema cannot say of an EDF's trials: names that must exist, and combinations that make no sense.

Takes the root of the EDF, what was read of it, and the services; adds to `Findings`. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from srprov.definitions.model import Service
from srprov.definitions.trialsmodel import Conditions, TrialDefinitions, TrialSettings, folder_of
from srprov.errors import did_you_mean
from srprov.linear_regex import check_pattern
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Path

OWN = "SRPROV_"
"""What srprov's own variables begin with."""


def check(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add everything that is wrong beyond the schema."""
    _parameters(root, found, services, findings)
    _points(root, found, findings)
    _names(root, found, services, findings)
    _results(root, found, findings)
    _metrics(root, found, findings)
    _conditions(root, found, services, findings)


def _parameters(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add parameters that are srprov's own, and those that a service sets itself: one of the two would be lost."""
    node = root.entries.get("parameters")
    for one in found.parameters:
        assert isinstance(node, Map)
        place, path = node.keys[one.name], ("parameters", one.name)
        if one.name.startswith(OWN):
            findings.add(place, f"'{one.name}' is one of srprov's own variables", path, "choose another name")
        for name in sorted(services) if one.services is None else one.services:
            if name in services and name not in found.settings.keep and one.name in services[name].runtime.environment:
                message = f"'{name}' sets {one.name} itself"
                findings.add(place, message, path, "take it out of the service, or name others in 'apply_to'")


def _points(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add points that name no parameter, or not all of them; and lists of unequal length that should be zipped."""
    known = {one.name: one for one in found.parameters}
    node = root.entries.get("trials")
    for key, points in (("exclude", found.settings.exclude), ("include", found.settings.include)):
        for index, point in enumerate(points):
            place, path = nodes.find(root, ("trials", key, index)), ("trials", key, index)
            for name in point:
                if name not in known:
                    findings.add(place, f"there is no parameter '{name[:60]}'", path, did_you_mean(name, known))
            if key == "include" and (missing := sorted(known.keys() - point.keys())):
                findings.add(place, f"it gives no {', '.join(missing)}; a point of 'include' gives all", path)
            strange = sorted(name for name, value in point.items() if name in known and value not in known[name].values)
            if key == "exclude" and strange:
                findings.add(place, f"{strange[0]} never is '{point[strange[0]][:60]}'", path)
    lengths = {len(one.values) for one in found.parameters}
    if found.settings.design == "zip" and len(lengths) > 1:
        findings.add(node or root, f"'zip' wants parameters of one length, not {sorted(lengths)}", ("trials",))
    if found.settings.design == "list" and not found.settings.include:
        findings.add(node or root, "'list' runs the points of 'include', and there are none", ("trials",))


def _names(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add names of services that do not exist."""
    settings = found.settings
    named: list[tuple[Path, tuple[str, ...]]] = [
        *((("parameters", one.name, "apply_to"), one.services or ()) for one in found.parameters),
        (("trials", "keep"), settings.keep),
        (("trials", "stop", "first"), settings.stop_first),
        *((("metrics", one.name, "service"), (one.service,)) for one in found.metrics),
        *_in_conditions(settings),
    ]
    places = [(nodes.find(root, path), path, name) for path, some in named for name in some]
    results = root.entries.get("results")
    if isinstance(results, Map):
        places += [(results.keys[name], ("results",), name) for name in found.results]
    for place, path, name in places:
        if name not in services and not findings.broken(("services", name)):
            hint = did_you_mean(name, services) or f"known: {', '.join(sorted(services)[:12])}"
            findings.add(place, f"there is no service '{name[:60]}'", path, hint)


def _in_conditions(settings: TrialSettings) -> Iterator[tuple[Path, tuple[str, ...]]]:
    for key, conditions in _all_conditions(settings):
        for index, one in enumerate(conditions.items):
            yield _place(key, conditions, index), one.services


def _all_conditions(settings: TrialSettings) -> Iterator[tuple[str, Conditions]]:
    for key, conditions in (("until", settings.until), ("success", settings.success)):
        if conditions is not None:
            yield key, conditions


def _place(key: str, conditions: Conditions, index: int) -> Path:
    return ("trials", key, "all" if conditions.every else "any", index)


def _results(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add paths whose folder cannot become a volume of its own."""
    for service, some in found.results.items():
        for index, one in enumerate(some):
            if folder_of(one.path) == "/" or ".." in one.path.split("/"):
                path: Path = ("results", service, index)
                findings.add(
                    nodes.find(root, path), f"'{one.path[:60]}' is in no folder that can be brought home", path
                )


def _metrics(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add patterns that are none, and files that nobody brings home."""
    for one in found.metrics:
        path: Path = ("metrics", one.name)
        if one.pattern:
            _pattern(root, (*path, "log"), one.pattern, 0 if one.reduce == "count" else 1, findings)
        elif one.reduce != "last":
            findings.add(nodes.find(root, (*path, "reduce")), "'reduce' is for numbers of a log", path)
        brought = [result.path for result in found.results.get(one.service, ())]
        if one.file and not any(one.file == home or one.file.startswith(home.rstrip("/") + "/") for home in brought):
            message = f"{one.file} is not among the results of '{one.service}'"
            findings.add(nodes.find(root, (*path, "json")), message, path, "add it, or its folder, to 'results'")


def _conditions(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add conditions that cannot be: of metrics that nobody extracts, and of services that never end."""
    metrics = {one.name for one in found.metrics}
    for key, conditions in _all_conditions(found.settings):
        for index, one in enumerate(conditions.items):
            path = _place(key, conditions, index)
            place = nodes.find(root, path)
            if one.pattern:
                _pattern(root, (*path, "log", "matches"), one.pattern, 0, findings)
            if one.metric and one.metric not in metrics:
                hint = did_you_mean(one.metric, metrics)
                findings.add(place, f"there is no metric '{one.metric[:60]}'", path, hint)
            for name in one.services if one.kind in ("completed", "exit") else ():
                if name in found.settings.keep:
                    findings.add(place, f"'{name}' is kept over all trials, so it never ends", path)
                elif name in services and services[name].runtime.restart not in ("", "no"):
                    restart = services[name].runtime.restart
                    findings.add(place, f"'{name}' never ends for good, with its 'restart: {restart}'", path)


def _pattern(root: Map, path: Path, pattern: str, groups: int, findings: Findings) -> None:
    try:
        check_pattern(pattern, groups)
    except ValueError as error:
        findings.add(nodes.find(root, path), str(error), path)
