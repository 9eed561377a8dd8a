"""Services whose images come from a bundle: which one each has on its robot, and what is not planned then. Pure.

The images lie in this machine's cache of layers. On robots they are named by their configurations' digests, so that no
name of the lab leads elsewhere afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from srprov.controller.request import BundledImage
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.model import Experiment
from srprov.facts.model import HostFacts


def chosen(
    images: Mapping[str, tuple[BundledImage, ...]], experiment: Experiment, placed: Mapping[str, str],
    facts: Mapping[str, HostFacts],
) -> tuple[dict[str, BundledImage], Experiment]:  # fmt: skip
    """Return service -> its image, where one is for its robot; and the experiment, in which no registry has those."""
    found: dict[str, BundledImage] = {}
    for service, some in images.items():
        robot = facts.get(placed.get(service, ""))
        runs = robot.runs if robot else ()
        fits = [one for one in some if not one.architecture or not runs or one.architecture in runs]
        if robot is not None and fits and service in experiment.services:
            found[service] = fits[0]
    services = {
        name: replace(one, runtime=replace(one.runtime, pull_policy="missing")) if name in found else one
        for name, one in experiment.services.items()
    }
    return found, replace(experiment, services=services) if found else experiment


def to_build(
    containers: Mapping[str, ContainerDefinition], experiment: Experiment, bundled: Mapping[str, BundledImage]
) -> Mapping[str, ContainerDefinition]:
    """Return the CDFs that a service needs whose image is not here."""
    gone = unbuilt(containers, experiment, bundled)
    return {key: one for key, one in containers.items() if key not in gone}


def unbuilt(
    containers: Mapping[str, ContainerDefinition], experiment: Experiment, bundled: Mapping[str, BundledImage]
) -> frozenset[str]:
    """Return the CDFs of which all services have a bundle's image."""
    needed = {one.cdf for name, one in experiment.services.items() if name not in bundled}
    return frozenset(containers.keys() - needed) if bundled else frozenset()
