"""What a schema cannot say of an EDF's trials: names that must exist, and combinations that make no sense.

Takes the root of the EDF, what was read of it, and the services; adds to `Findings`. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from srprov.codes import Code
from srprov.definitions import trialkept
from srprov.definitions.model import Service
from srprov.definitions.trialconditions import all_conditions, place_of, services_of
from srprov.definitions.trialpoints import MOST_TRIALS, combinations, most_points
from srprov.definitions.trialsmodel import TrialDefinitions, TrialSettings, folder_of
from srprov.definitions.values import scalars
from srprov.errors import did_you_mean
from srprov.linear_regex import Patterns
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Seq

OWN = "SRPROV_"
"""What srprov's own variables begin with."""


def check(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add everything that is wrong beyond the schema."""
    _parameters(root, found, services, findings)
    _points(root, found, findings)
    _names(root, found, services, findings)
    _results(root, found, findings)
    patterns = Patterns()
    _metrics(root, found, findings, patterns)
    _conditions(root, found, services, findings, patterns)
    _settings(root, found, findings)
    trialkept.check(root, found, services, findings)


def _parameters(root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings) -> None:
    """Add names that are srprov's own, and those that a service sets itself: one of the two would be lost."""
    node = root.entries.get("parameters")
    for one in found.parameters:
        assert isinstance(node, Map)
        place, path = node.keys[one.name], ("parameters", one.name)
        if one.name.startswith(OWN):
            findings.add(
                place,
                f"'{one.name}' is one of srprov's own variables",
                path,
                "choose another name",
                code=Code.TRIAL_DESIGN,
            )
        if one.name == "PATH":
            findings.add(
                place,
                "'PATH' says where programs are found: no service would start",
                path,
                "choose another name",
                code=Code.TRIAL_DESIGN,
            )
        for name in sorted(services) if one.services is None else one.services:
            if name in services and name not in found.settings.keep and one.name in services[name].runtime.environment:
                message = f"'{name}' sets {one.name} itself"
                findings.add(
                    place,
                    message,
                    path,
                    "take it out of the service, or name others in 'apply_to'",
                    code=Code.TRIAL_DESIGN,
                )
    for name in sorted(services.keys() - set(found.settings.keep)):
        for variable in sorted(services[name].runtime.environment):
            if variable.startswith(OWN):
                where: Path = ("services", name, "environment", variable)
                message = f"'{name}' sets {variable[:60]}, which is one of srprov's own variables in a trial"
                findings.add(_variable(root, where), message, where, "choose another name", code=Code.TRIAL_DESIGN)


def _variable(root: Map, path: Path) -> Node:
    """Return where a service's variable stands: in a map, in a list, or at the service that gets it from elsewhere."""
    there = nodes.find(root, path[:-1])
    lines = [one for one in scalars(there) if one.text.partition("=")[0] == path[-1]] if isinstance(there, Seq) else []
    return lines[0] if lines else nodes.find(root, path)


def _named_points(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    known = {one.name: one for one in found.parameters}
    for key, points in (("exclude", found.settings.exclude), ("include", found.settings.include)):
        for index, point in enumerate(points):
            place, path = nodes.find(root, ("trials", key, index)), ("trials", key, index)
            for name in (name for name in point if name not in known):
                wrong = f"there is no parameter '{name[:60]}'"
                findings.add(place, wrong, path, did_you_mean(name, known), code=Code.NO_SUCH_NAME)
            if key == "include" and (missing := sorted(known.keys() - point.keys())):
                wrong = f"it gives no {', '.join(missing)}; a point of 'include' gives all"
                findings.add(place, wrong, path, code=Code.TRIAL_DESIGN)
            strange = sorted(name for name, value in point.items() if name in known and value not in known[name].values)
            if key == "exclude" and strange:
                findings.add(place, f"{strange[0]} never is '{point[strange[0]][:60]}'", path, code=Code.TRIAL_DESIGN)


def _points(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add points that name no parameter, or not all of them; and lists of unequal length that should be zipped."""
    _named_points(root, found, findings)
    node = root.entries.get("trials")
    lengths = {len(one.values) for one in found.parameters}
    if found.settings.design == "zip" and len(lengths) > 1:
        findings.add(
            node or root,
            f"'zip' wants parameters of one length, not {sorted(lengths)}",
            ("trials",),
            code=Code.TRIAL_DESIGN,
        )
    if found.settings.design == "list" and not found.settings.include:
        findings.add(
            node or root, "'list' runs the points of 'include', and there are none", ("trials",), code=Code.TRIAL_DESIGN
        )
    if findings.broken(("trials",)) or findings.broken(("parameters",)):
        return
    count = most_points(found) * found.settings.repetitions
    if count > MOST_TRIALS:
        place = root.keys["parameters" if found.parameters else "trials"]
        findings.add(
            place,
            f"{count} trials are more than {MOST_TRIALS}",
            ("trials",),
            "give fewer values or repetitions",
            code=Code.TRIAL_DESIGN,
        )
    elif found.settings.exclude and not found.settings.include and not combinations(found):
        where: Path = ("trials", "exclude")
        findings.add(
            nodes.find(root, where), "no trial is left: 'exclude' takes all points away", where, code=Code.TRIAL_DESIGN
        )


def _settings(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add a time in which nothing can happen."""
    path: Path = ("trials", "timeout")
    if found.settings.timeout_s == 0 and not findings.broken(path):
        findings.add(
            nodes.find(root, path), "a trial of no time is over before it begins", path, code=Code.TRIAL_JUDGING
        )


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
    places = [(nodes.find(root, (*path, at)), path, name) for path, some in named for at, name in enumerate(some)]
    results = root.entries.get("results")
    if isinstance(results, Map):
        places += [(results.keys[name], ("results",), name) for name in found.results]
    for place, path, name in places:
        if name not in services and not findings.broken(("services", name)):
            hint = did_you_mean(name, services) or f"known: {', '.join(sorted(services)[:12])}"
            findings.add(place, f"there is no service '{name[:60]}'", path, hint, code=Code.NO_SUCH_NAME)


def _in_conditions(settings: TrialSettings) -> Iterator[tuple[Path, tuple[str, ...]]]:
    for key, conditions in all_conditions(settings):
        for index, one in enumerate(conditions.items):
            yield services_of(key, conditions, index), one.services


def _results(root: Map, found: TrialDefinitions, findings: Findings) -> None:
    """Add paths whose folder cannot become a volume of its own."""
    for service, some in found.results.items():
        for index, one in enumerate(some):
            path: Path = ("results", service, index)
            if folder_of(one.path) == "/" or ".." in one.path.split("/"):
                message = f"'{one.path[:60]}' is in no folder that can be brought home"
                findings.add(nodes.find(root, path), message, path, code=Code.TRIAL_JUDGING)
            elif any(sign in one.path for sign in "*?["):
                message, hint = f"'{one.path[:60]}' is a pattern, and results are files or folders", "name their folder"
                findings.add(nodes.find(root, (*path, "path")), message, path, hint, code=Code.TRIAL_JUDGING)


def _metrics(root: Map, found: TrialDefinitions, findings: Findings, patterns: Patterns) -> None:
    """Add patterns that are none, and files that nobody brings home."""
    for one in found.metrics:
        path: Path = ("metrics", one.name)
        if one.pattern:
            _pattern(root, (*path, "log"), one.pattern, 0 if one.reduce == "count" else 1, findings, patterns)
        elif one.reduce != "last":
            findings.add(
                nodes.find(root, (*path, "reduce")), "'reduce' is for numbers of a log", path, code=Code.TRIAL_JUDGING
            )
        brought = [result.path for result in found.results.get(one.service, ())]
        if one.file and not any(one.file == home or one.file.startswith(home.rstrip("/") + "/") for home in brought):
            message = f"{one.file} is not among the results of '{one.service}'"
            findings.add(
                nodes.find(root, (*path, "json")),
                message,
                path,
                "add it, or its folder, to 'results'",
                code=Code.TRIAL_JUDGING,
            )


def _conditions(
    root: Map, found: TrialDefinitions, services: Mapping[str, Service], findings: Findings, patterns: Patterns
) -> None:
    """Add conditions that cannot be: of metrics that nobody extracts, and of services that never end."""
    metrics = {one.name for one in found.metrics}
    for key, conditions in all_conditions(found.settings):
        for index, one in enumerate(conditions.items):
            path = place_of(key, conditions, index)
            if one.pattern:
                _pattern(root, (*path, "log", "matches"), one.pattern, 0, findings, patterns)
            if one.metric and one.metric not in metrics:
                _no_metric(root, path, one.metric, metrics, findings)
            for at, name in enumerate(one.services if one.kind in ("completed", "exit") else ()):
                restart = services[name].runtime.restart if name in services else ""
                if restart not in ("", "no") and name not in found.settings.keep:
                    place = nodes.find(root, (*services_of(key, conditions, index), at))
                    findings.add(
                        place,
                        f"'{name}' never ends for good, with its 'restart: {restart}'",
                        path,
                        code=Code.TRIAL_JUDGING,
                    )


def _no_metric(root: Map, path: Path, metric: str, known: Collection[str], findings: Findings) -> None:
    named = nodes.find(root, (*path, "metric"))
    place = named.keys.get(metric, named) if isinstance(named, Map) else named
    hint = did_you_mean(metric, known)
    findings.add(place, f"there is no metric '{metric[:60]}'", path, hint, code=Code.NO_SUCH_NAME)


def _pattern(root: Map, path: Path, pattern: str, groups: int, findings: Findings, patterns: Patterns) -> None:
    try:
        patterns.check(pattern, groups)
    except ValueError as error:
        findings.add(nodes.find(root, path), str(error), path, code=Code.TRIAL_JUDGING)
