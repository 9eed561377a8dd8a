"""What a person reads first in a bundle, README.md, and how to cite it, CITATION.cff. Pure.

Source: Citation File Format 1.2.0.
"""

from __future__ import annotations

import json
import re
from collections import Counter

from srprov.evidence.crate_base import Told, ended_utc
from srprov.evidence.files import MANIFEST, SIGNATURE
from srprov.untrusted import mapping, string

_ORCID = re.compile(r"\(?\s*(https://orcid\.org/\d{4}-\d{4}-\d{4}-\d{3}[\dX])\s*\)?", re.ASCII)


_LIMITS = """\
## What this does not show

- That the data come from these robots, and not from a careful forger. A signature says who answers for them.
- What srprov cannot record: where robots stood, light, floor, batteries, firmware of sensors, people.
- What was taken out: addresses, and names of hosts and users, are replaced by others (`bundle.json` counts them),
  except in results, which are as they came, and in the experiment's own files.
"""
_CHECK = f"""\
## Check it

    sha256sum -c {MANIFEST}
    ssh-keygen -Y verify -f SIGNERS -I WHO -n srprov-bundle -s {SIGNATURE} < {MANIFEST}   # if it is signed
    srprov verify BUNDLE.zip

The first two need no srprov. The third computes again what follows from the files: design, seeds, order, placement,
tables, metrics and verdicts. Whom a signature is to be believed of, you must know from elsewhere.
"""


def readme(told: Told) -> str:
    """Return README.md: what this is, how to check and repeat it, and what it does not show."""
    story = told.story
    experiment = story.definitions.experiment
    counts = Counter(string(row.get("status")) for row in story.rows)
    ended = ", ".join(f"{count} {status}" for status, count in sorted(counts.items())) or "none"
    version = string(told.environment.get("srprov"))
    return f"""\
# {experiment.name}: a run of trials

{experiment.description or "The experiment has no description."}

Run `{story.run}`, made by srprov {version}, ended {ended_utc(story)}. Attempts by status: {ended}.
A failed or interrupted attempt is in here like any other.

{_CHECK}
{_contents(story.home, story.edf.removeprefix(f"{story.home}/inputs/"))}
## Robots

{_robots(told)}

## Run it again

    srprov run {story.edf} -i YOUR-INVENTORY -o results

with srprov {version}. Images are not in the bundle: their names and ids are in `journal.jsonl` and
`ro-crate-metadata.json`, and they must be obtainable, or are built from the definitions.

{_LIMITS}"""


def _contents(home: str, edf: str) -> str:
    return f"""\
## What is in it

| | |
|---|---|
| `journal.jsonl` | the truth: every event, in the order in which it happened |
| `*.csv` | tables that follow from it; `csv-metadata.json` explains each column |
| `{home}/inputs/` | the experiment: `{edf}` with all that it names; `inventory.yml` says nothing of access |
| `{home}/facts.json`, `assignment.json` | the robots as they were, and who ran what |
| `{home}/plan.json`, `rendered/` | what was done before the first trial, and what should be true on each robot |
| `trials/ID/` | logs, results and what the engine said of each container, for each attempt |
| `ro-crate-metadata.json` | all of that for programs, as an RO-Crate |
"""


def _robots(told: Told) -> str:
    lines = ["| robot | processor | cores | memory | system | kernel | Docker |", "|---|---|---|---|---|---|---|"]
    for name, found in sorted(mapping(told.facts.get("robots")).items()):
        one = mapping(found)
        processor = string(one.get("processor")) or string(one.get("arch"))
        memory = f"{int(one.get('memory_total') or 0) >> 20} MiB"
        docker = string(mapping(one.get("docker")).get("version"))
        cells = (
            name,
            processor,
            str(one.get("cpus")),
            memory,
            string(one.get("os")),
            string(one.get("kernel")),
            docker,
        )
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return "\n".join(lines)


def citation(told: Told) -> str:
    """Return CITATION.cff; JSON texts are YAML."""
    experiment = told.story.definitions.experiment
    authors = [_author(one) for one in experiment.authors] or [{"name": "The authors of the experiment"}]
    lines = [
        "cff-version: 1.2.0",
        "message: If you use these data, please cite them as below.",
        f"title: {_text(f'{experiment.name}: run {told.story.run}')}",
        "type: dataset",
        f"date-released: {ended_utc(told.story)[:10]}",
        "authors:",
    ]
    for author in authors:
        first, *rest = (f"{key}: {_text(value)}" for key, value in author.items())
        lines += [f"  - {first}", *(f"    {one}" for one in rest)]
    license_, doi = (string(experiment.metadata.get(key)) for key in ("license", "doi"))
    lines += [f"license: {_text(license_)}"] if license_ else []
    lines += ["references:", "  - type: article", f"    doi: {_text(doi)}", f"    title: {_text(experiment.name)}",
              "    authors:", *(f"      - name: {_text(_name(one))}" for one in authors)] if doi else []  # fmt: skip
    return "\n".join(lines) + "\n"


def _author(word: str) -> dict[str, str]:
    orcid = _ORCID.search(word)
    name = _ORCID.sub("", word).partition("<")[0].strip() or "unnamed"
    return {"name": name, **({"orcid": orcid[1]} if orcid else {})}


def _name(author: dict[str, str]) -> str:
    return author["name"]


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
