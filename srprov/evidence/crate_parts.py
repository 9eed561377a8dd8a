"""The parts of a crate that trials refer to: parameters, results, metrics, robots, people, srprov. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from srprov.evidence.crate_base import Entity, Told, author_ids, output_id, refs, robot_id
from srprov.evidence.crate_runs import software
from srprov.evidence.deposits import instruments
from srprov.evidence.story import Story
from srprov.untrusted import mapping, string


def parameters(story: Story) -> Iterator[Entity]:
    """Return what the experiment takes and gives."""
    for one in story.given.parameters:
        numbers = all(_is_number(value) for value in one.values)
        yield {
            "@id": f"#param-{one.name}", "@type": "FormalParameter", "name": one.name, "unitText": one.unit,
            "additionalType": "Number" if numbers else "Text", "description": one.description, "valueRequired": "true",
        }  # fmt: skip
    yield {
        "@id": "#param-seed", "@type": "FormalParameter", "name": "seed", "additionalType": "Integer",
        "description": "What SRPROV_SEED is in a trial's containers.", "valueRequired": "true",
    }  # fmt: skip
    for service, some in sorted(story.given.results.items()):
        for result in some:
            yield {
                "@id": output_id(service, result.path), "@type": "FormalParameter", "additionalType": "Dataset",
                "name": f"{result.path} of {service}",
            }  # fmt: skip
    for metric in story.given.metrics:
        yield {
            "@id": f"#metric-{metric.name}", "@type": "FormalParameter", "additionalType": "Number",
            "name": metric.name, "unitText": metric.unit, "description": metric.description,
        }  # fmt: skip


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def robots(told: Told) -> Iterator[Entity]:
    """Return the robots, with what reproduces a result or explains it."""
    pids = dict(instruments(told))
    for name, one in sorted(mapping(told.facts.get("robots")).items()):
        about = mapping(one)
        docker = mapping(about.get("docker"))
        shown = {
            "architecture": about.get("arch"), "processors": about.get("cpus"), "processor": about.get("processor"),
            "memory in bytes": about.get("memory_total"), "kernel": about.get("kernel"),
            "operating system": about.get("os"), "Docker Engine": docker.get("version"),
        }  # fmt: skip
        values = {key: str(value) for key, value in shown.items() if value}
        yield {
            "@id": robot_id(name), "@type": "IndividualProduct", "name": name, "model": string(about.get("board")),
            "serialNumber": string(about.get("machine_id")), "identifier": pids.get(name, ""),
            "additionalProperty": refs(_property_id(name, key) for key in values),
        }  # fmt: skip
        for key, value in values.items():
            yield {"@id": _property_id(name, key), "@type": "PropertyValue", "name": key, "value": value}


def _property_id(robot: str, key: str) -> str:
    return f"{robot_id(robot)}-{key.replace(' ', '-')}"


def agents(told: Told) -> Iterator[Entity]:
    """Return who ran it, and with which software."""
    names = told.story.definitions.experiment.authors
    for name, word in zip(author_ids(told.story), names or ("The user who ran srprov",), strict=True):
        yield {"@id": name, "@type": "Person", "name": word}
    yield from software(told)
