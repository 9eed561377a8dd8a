"""A run as an RO-Crate: JSON-LD that says what there is, who made it with what, and how it hangs together.

Takes a Story, facts, and the sizes and hashes of the bundle's files; gives the document. Pure; equal runs give equal
documents. Profiles: RO-Crate 1.1, Process Run Crate 0.5, Workflow Run Crate 0.5, Workflow RO-Crate 1.0.

A trial is an action whose instrument is the EDF; robots are used by it (`prov:used`), since a profile's instrument is
software. Above `MOST_LISTED` files those of trials are not listed: the manifest names every file.

Source: https://w3id.org/ro/crate/1.1, https://w3id.org/ro/wfrun/workflow/0.5.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.evidence import crate_runs
from srprov.evidence.crate_base import (
    Entity,
    Told,
    author_ids,
    ended_utc,
    file_id,
    listed_files,
    output_id,
    ref,
    refs,
)  # fmt: skip
from srprov.evidence.crate_images import images
from srprov.evidence.crate_parts import agents, parameters, robots
from srprov.evidence.crate_trials import Action, trials
from srprov.evidence.story import attempt_folder
from srprov.untrusted import string

_WFRUN = "https://w3id.org/ro/terms/workflow-run#"
_OWN_TERMS = ("sha256", "ContainerImage", "DockerImage", "containerImage", "registry", "tag", "environment",
              "resourceUsage")  # fmt: skip
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {name: f"{_WFRUN}{name}" for name in _OWN_TERMS}]
_PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": ("Process Run Crate", "0.5"),
    "https://w3id.org/ro/wfrun/workflow/0.5": ("Workflow Run Crate", "0.5"),
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": ("Workflow RO-Crate", "1.0"),
}
_FORMATS = {
    ".json": "application/json", ".jsonl": "application/x-ndjson", ".csv": "text/csv", ".md": "text/markdown",
    ".log": "text/plain", ".txt": "text/plain", ".yml": "application/yaml", ".yaml": "application/yaml",
    ".edf": "application/yaml", ".cdf": "application/yaml", ".cff": "application/yaml", ".lock": "application/yaml",
}  # fmt: skip
_LANGUAGE = "#edf"


def document(told: Told) -> dict[str, Any]:
    """Return the crate."""
    entities = {one["@id"]: one for one in _entities(told)}
    return {"@context": CONTEXT, "@graph": [_tidy(entities[name]) for name in sorted(entities)]}


def text(told: Told) -> str:
    """Return it as it is written."""
    return json.dumps(document(told), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _tidy(one: Entity) -> Entity:
    """Return an entity without what is empty; a list of one is that one."""
    found = {}
    for key, value in one.items():
        some = value[0] if isinstance(value, list) and len(value) == 1 and key != "@graph" else value
        if some not in (None, "", []):
            found[key] = some
    return found


def _entities(told: Told) -> Iterator[Entity]:
    story = told.story
    actions = [*trials(told)]
    yield {
        "@id": "ro-crate-metadata.json", "@type": "CreativeWork", "about": ref("./"),
        "conformsTo": refs(["https://w3id.org/ro/crate/1.1", "https://w3id.org/workflowhub/workflow-ro-crate/1.0"]),
    }  # fmt: skip
    yield from _root(told, actions)
    yield from _profiles()
    yield from _definitions(told)
    yield from _files(told)
    yield from parameters(story)
    yield from robots(told)
    yield from images(told)
    yield from agents(told)
    yield from crate_runs.sessions(told)
    yield from crate_runs.environment(told)
    yield from (one for action in actions for one in action.entities)


def _root(told: Told, actions: Sequence[Action]) -> Iterator[Entity]:
    story = told.story
    experiment = story.definitions.experiment
    listed = [file_id(name) for name in listed_files(told.files)]
    folders = sorted(
        {f"{attempt_folder(row)}/" for row in story.rows if f"{attempt_folder(row)}/trial.json" in told.files}
    )
    yield {
        "@id": "./", "@type": "Dataset", "name": f"Run {story.run} of {experiment.name}",
        "description": experiment.description or f"Trials of the experiment {experiment.name}, run by srprov.",
        "datePublished": ended_utc(story)[:10],
        "license": ref("#license"), "author": refs(author_ids(story)), "conformsTo": refs(sorted(_PROFILES)),
        "mainEntity": ref(file_id(story.edf)), "hasPart": refs([*listed, *folders]),
        "mentions": refs(sorted([*crate_runs.session_names(told), *(action.name for action in actions)])),
    }  # fmt: skip
    license_ = string(experiment.metadata.get("license"))
    yield {
        "@id": "#license", "@type": "CreativeWork", "name": license_ or "No licence was given",
        "description": "" if license_ else "The experiment states no licence: ask its authors before you use it.",
        "identifier": license_,
    }  # fmt: skip
    inside: dict[str, list[str]] = {}
    for name in listed_files(told.files):
        inside.setdefault("/".join(name.split("/")[:2]) + "/", []).append(file_id(name))
    for folder in folders:
        parts = refs(inside.get(folder, ()))
        yield {"@id": folder, "@type": "Dataset", "name": f"Attempt {folder[7:-1]}", "hasPart": parts}


def _profiles() -> Iterator[Entity]:
    for name, (text, version) in _PROFILES.items():
        yield {"@id": name, "@type": "CreativeWork", "name": text, "version": version}


def _definitions(told: Told) -> Iterator[Entity]:
    story, files = told.story, told.files
    experiment, home = story.definitions.experiment, f"{story.home}/inputs/"
    parts = [name for name in files if name.startswith(home) and name.endswith(".cdf")]
    outputs = [output_id(service, one.path) for service, some in sorted(story.given.results.items()) for one in some]
    outputs += [f"#metric-{one.name}" for one in story.given.metrics]
    yield {
        **_file(story.edf, files),
        "@type": ["File", "SoftwareSourceCode", "ComputationalWorkflow", "HowTo"], "name": experiment.name,
        "description": experiment.description, "version": files[story.edf][1][:16],
        "conformsTo": ref("https://bioschemas.org/profiles/ComputationalWorkflow/1.0-RELEASE"),
        "programmingLanguage": ref(_LANGUAGE), "hasPart": refs(map(file_id, parts)),
        "input": refs([*(f"#param-{one.name}" for one in story.given.parameters), "#param-seed"]),
        "output": refs(outputs),
    }  # fmt: skip
    for name in parts:
        yield {**_file(name, files), "@type": ["File", "SoftwareSourceCode"], "version": files[name][1][:16]}
    yield _language()


def _language() -> Entity:
    home = ref("https://pypi.org/project/srprov/")
    return {
        "@id": _LANGUAGE, "@type": "ComputerLanguage", "name": "srprov experiment definition", "alternateName": "EDF",
        "identifier": home, "url": home, "version": "1",
    }  # fmt: skip


def _files(told: Told) -> Iterator[Entity]:
    parts = {one["@id"] for one in _definitions(told)}
    for name in listed_files(told.files):
        if file_id(name) not in parts:
            yield {**_file(name, told.files), **({"about": ref("./")} if name == "README.md" else {})}


def _file(name: str, files: Mapping[str, tuple[int, str]]) -> Entity:
    size, sha256 = files[name]
    _, dot, end = name.rpartition("/")[2].rpartition(".")
    form = _FORMATS.get(dot + end, "application/octet-stream") if dot else "text/plain"
    return {
        "@id": file_id(name), "@type": "File", "name": name.rpartition("/")[2], "contentSize": str(size),
        "sha256": sha256, "encodingFormat": form,
    }  # fmt: skip
