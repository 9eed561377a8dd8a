"""Whether there is an image for the architecture of a robot, as far as that is known before it is pulled. Pure.

It is known of images that a lock names, which decide where a service may run, and of those whose tags are looked up for
each plan.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.render_inputs import RenderInputs
from srprov.definitions.model import Definitions, Experiment, Service
from srprov.errors import UsageError

_SHOWN = 8


def with_platforms(experiment: Experiment, definitions: Definitions) -> Experiment:
    """Return the experiment with what is known of its images' platforms."""
    known = definitions.platforms
    if not known:
        return experiment
    services = {
        name: replace(one, platforms={image: known[image] for image in _images(one, definitions) if image in known})
        for name, one in experiment.services.items()
    }
    return replace(experiment, services=services)


def _images(service: Service, definitions: Definitions) -> Sequence[str]:
    return (service.image,) if service.image else definitions.containers[service.cdf].images


def check_platforms(inputs: RenderInputs, definitions: Definitions) -> None:
    """Refuse a plan in which a robot needs an image that is for other architectures alone.

    Raises:
        UsageError: Names each.
    """
    wrong = []
    for name, robot in sorted(inputs.placed.items() if definitions.platforms else ()):
        service, facts = inputs.experiment.services[name], inputs.snapshot.facts.get(robot)
        runs = facts.runs if facts else ()
        for image in _images(service, definitions):
            there = definitions.platforms.get(image, ())
            if runs and there and not any(one.split("/")[1] in runs for one in there):
                wrong.append(f"{name}: {image} is for {', '.join(there[:_SHOWN])}; {robot} is {runs[0]}")
    if wrong:
        raise UsageError(
            f"there is no such image for a robot's architecture: {'; '.join(wrong)}",
            hint="name another image, or say `requires: {arch: …}` so that the service goes where there is one",
            code=Code.PLATFORM,
        )
