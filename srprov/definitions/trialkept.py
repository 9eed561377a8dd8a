"""Services that are kept over all trials have no part in one: what an EDF wants of them there cannot be.

Takes the root of the EDF, what was read of it, and the services; adds to `Findings`. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from srprov.codes import Code
from srprov.definitions.trialconditions import all_conditions, services_of
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path


def check(root: Map, found: TrialDefinitions, services: Collection[str], findings: Findings) -> None:
    """Add what is wanted of a service that is kept, and trials for which nothing is left to run."""
    kept = set(found.settings.keep)
    for place, path, name, why in _wanted(root, found):
        if name in kept:
            findings.add(
                place,
                f"'{name}' is kept over all trials, so {why}",
                path,
                "take it out of 'keep', or out of here",
                code=Code.TRIAL_DESIGN,
            )
    if services and kept >= set(services):
        path = ("trials", "keep")
        findings.add(
            nodes.find(root, path),
            "all services are kept, so that a trial has nothing to run",
            path,
            code=Code.TRIAL_DESIGN,
        )


def _wanted(root: Map, found: TrialDefinitions) -> Iterator[tuple[Node, Path, str, str]]:
    """Return what a trial wants of services: where that stands, the service, and why it cannot be if it is kept."""
    lists: list[tuple[Path, tuple[str, ...], str]] = [
        *(
            (("parameters", one.name, "apply_to"), one.services or (), "it gets no parameter")
            for one in found.parameters
        ),
        (("trials", "stop", "first"), found.settings.stop_first, "no trial stops it"),
        *(
            (("metrics", one.name, "service"), (one.service,), "a trial has no log or file of it")
            for one in found.metrics
        ),
    ]
    for key, conditions in all_conditions(found.settings):
        for index, one in enumerate(conditions.items):
            why = "it never ends" if one.kind in ("completed", "exit") else "no condition of a trial sees it"
            lists.append((services_of(key, conditions, index), one.services, why))
    for path, names, why in lists:
        for at, name in enumerate(names):
            yield nodes.find(root, (*path, at)), path, name, why
    results = root.entries.get("results")
    for name in found.results:
        place = results.keys[name] if isinstance(results, Map) else root
        yield place, ("results", name), name, "no trial brings its results home"
