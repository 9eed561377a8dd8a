"""What a person reads first in a bundle: README.md. Pure."""

from __future__ import annotations

from collections import Counter
from shlex import quote

from srprov.evidence.crate_base import Told, ended_utc, of_robot
from srprov.evidence.crate_images import in_words
from srprov.evidence.files import MANIFEST, SIGNATURE
from srprov.evidence.images import has_images
from srprov.evidence.story import Story
from srprov.planning.markdown import escaped
from srprov.untrusted import mapping, string

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

{escaped(experiment.description) or "The experiment has no description."}

Run `{story.run}`, made by srprov {version}, ended {ended_utc(story)}. Attempts by status: {ended}.
A failed or interrupted attempt is in here like any other.

{_CHECK}
{_contents(story.home, story.edf.removeprefix(f"{story.home}/inputs/"))}
## Robots

{_robots(told)}

## Run it again

    srprov replay BUNDLE.zip -i YOUR-INVENTORY -o again{_maps(story)}

with srprov {version}: it verifies the bundle, runs the same trials with the same seeds in the same order, on robots of
yours that do the parts of these, and compares what comes of it. The experiment alone, wherever its services fit:

    srprov run {quote(story.edf)}

{_had(told)}

{_LIMITS}"""


def _maps(story: Story) -> str:
    return "".join(f" --map {robot}=YOURS" for robot in sorted(set(story.last.assignment.values())))


def _had(told: Told) -> str:
    """Return what of the experiment must be had from elsewhere."""
    images = (
        in_words(told)
        if has_images(told.files)
        else """\
Images are not in the bundle: their names
and ids are in `journal.jsonl` and `ro-crate-metadata.json`, and they must be obtainable, or are built from the
definitions."""
    )
    count = len(told.data_sets)
    sets = f" {count} data set{'s' * (count > 1)} must be had too: `{told.story.home}/inputs.json` has the sha256."
    return (images + sets * bool(count)).strip()


def _contents(home: str, edf: str) -> str:
    edf = edf.replace("`", "'").replace("|", "/")
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
| `LICENSE`, `CITATION.cff` | what may be done with it, and how to cite it |
| `CHECKLIST.md` | what reviewers of artifacts ask, and what of that is here |
| `.zenodo.json`, `datacite.json` | for a deposit in an archive |
"""


def _robots(told: Told) -> str:
    lines = ["| robot | processor | cores | memory | system | kernel | Docker |", "|---|---|---|---|---|---|---|"]
    for name, found in sorted(mapping(told.facts.get("robots")).items()):
        one = mapping(found)
        processor = of_robot(one.get("processor")) or of_robot(one.get("arch"))
        memory = f"{int(one.get('memory_total') or 0) >> 20} MiB"
        docker = of_robot(mapping(one.get("docker")).get("version"))
        cells = (
            of_robot(name),
            processor,
            str(one.get("cpus")),
            memory,
            of_robot(one.get("os")),
            of_robot(one.get("kernel")),
            docker,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
