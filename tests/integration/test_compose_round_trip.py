"""An experiment, exported to Compose and imported again, is the same experiment, but for what is listed here.

Services are compared by what is wanted of their containers, images by the folders that they are built from.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from srprov.controller import compose
from srprov.conversion import compose as importing
from srprov.conversion import folder
from srprov.definitions import load_experiment
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.expand import expand
from srprov.definitions.model import Definitions, Experiment
from srprov.exporting.folder import write as put
from srprov.exporting.model import Export
from srprov.images.tag import tailored
from tests.compose_values import content, of_service
from tests.property.edfs import experiments, write

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(str(one.relative_to(ROOT)) for one in (ROOT / "examples").glob("*/*.edf"))

LISTED: Mapping[str, str] = {
    "services: cost, requires, robot, job; relations, pools, weights, placement": "not in the Compose file; the import"
    " gives one robot as many slots as there are services",
    "services: replicas": "each is a service; the name for all of them is an alias, and in `extra_hosts` of services of"
    " the machine's own network",
    "services: per_robot": "one service",
    "services: network: both": "`network: host`",
    "services: cdf": "a CDF with the Dockerfile that was built; what it said of containers stands at the service",
    "services: env_file, data": "variables stand in `environment`; a file of a data set is shipped as a folder is",
    "services: environment without a value": "left out unless `--set` gives one",
    "services: volumes: create_host_path": "of a path of the system, such as below /dev, it is not made",
    "volumes: user": "whoever copies the folder owns it",
    "secrets: file, command": "a file in `secrets/`, beside the Compose file",
    "network, but for discovery": "the overlay's own",
    "parameters": "the first value of each, in `environment`",
    "description, authors, license, doi, notes, trials, results, metrics, playbooks": "not in the Compose file",
}
"""Field of an EDF -> what it is after the way there and back. Everything else is the same."""


def test_the_page_has_what_is_listed() -> None:
    page = (ROOT / "docs" / "from-compose.md").read_text()
    _, _, section = page.partition("### There and back")
    rows = [line for line in section.partition("\n### ")[0].splitlines() if line.startswith("| ")][1:]
    assert rows == [f"| {field} | {words} |" for field, words in LISTED.items()]


def there_and_back(edf: Path, place: Path) -> tuple[Export, Definitions]:
    """Export an experiment as a twin, give what it needs, and import that."""
    made = compose.twin(compose.read(str(edf), frozenset({"host-path"})))
    out, back = place / "out", place / "back"
    put(str(out), made.files)
    for need in made.needs:
        if need.kind == "file" and not (out / need.name).exists():
            (out / need.name).write_text("given")
    file = str(out / "compose.yml")
    draft = importing.draft(importing.Wanted(files=(file,), folder=str(back)))
    assert draft.refused == ()
    folder.write(draft, str(back), (file,))
    return made, load_experiment(back / folder.EDF)


def compared(before: Experiment, after: Experiment) -> dict[str, Any]:
    """Return `service.field` -> what was and what is, of all that is not listed."""
    assert before.name == after.name
    assert set(before.services) == set(after.services)
    several = {one.instance_of for one in before.services.values()}
    wrong = {}
    for name, service in before.services.items():
        was, now = of_service(service), of_service(after.services[name])
        now["extra_hosts"] = {host for host in now["extra_hosts"] or () if host[0] not in several} or None
        wrong |= {f"{name}.{key}": (was[key], now[key]) for key in was if was[key] != now[key]}
    for name, secret in after.secrets.items():
        wrong |= {f"secrets.{name}": secret.env} if secret.env != before.secrets[name].env else {}
    return wrong


def same_images(made: Export, before: Definitions, after: Definitions, out: Path) -> None:
    """Compare what images are built from: the same folder, whose Dockerfile is that of the CDF."""
    for name, service in expand(before.experiment, {}).services.items():
        one = before.containers.get(service.cdf)
        if one is None or one.image:
            continue
        again = after.containers[after.experiment.services[name].cdf]
        folders = [out / "build" / path.parts[1] for path in map(Path, (f.path for f in made.files))
                   if path.parts[0] == "build"]  # fmt: skip
        assert content(_context(again)) in {content(str(folder)) for folder in folders}
        if one.dockerfile:
            assert again.dockerfile_text == tailored(one)
            assert (dict(again.build_args), again.target) == ({}, "")
        else:
            assert all(package in again.dockerfile_text for package in (*one.apt, *one.pip, *one.npm))


def _context(one: ContainerDefinition) -> str:
    return one.context or str(Path(one.dockerfile).parent)


def both_ways(edf: Path, place: Path) -> None:
    """Go there and back, and compare."""
    before = load_experiment(edf)
    made, after = there_and_back(edf, place)
    assert compared(expand(before.experiment, {}), after.experiment) == {}
    same_images(made, before, after, place / "out")


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_comes_back(tmp_path: Path, example: str) -> None:
    before = compose.read(str(ROOT / example), frozenset()).definitions  # with the first value of each parameter
    made, after = there_and_back(ROOT / example, tmp_path)
    wrong = compared(expand(before.experiment, {}), after.experiment)
    assert after.experiment.network.discovery == before.experiment.network.discovery
    assert after.experiment.network.discovery_servers == before.experiment.network.discovery_servers
    assert wrong == {}
    same_images(made, before, after, tmp_path / "out")


def test_the_files_of_several_robots_come_back_as_one_experiment_with_pins(tmp_path: Path) -> None:
    """Names that hosts files had are the overlay's again; services keep their robot's own network."""
    source = compose.read(str(ROOT / "examples" / "hello" / "experiment.edf"), frozenset(), placed=True)
    before = source.definitions.experiment
    placed = {"web": "r1", "greeter": "r2", "once": "r3"}
    put(
        str(tmp_path / "out"),
        compose.on_robots(source, before, placed, {f"r{n}": f"192.0.2.{n}" for n in (1, 2, 3)}).files,
    )
    files = tuple(str(tmp_path / "out" / robot / "compose.yml") for robot in sorted(placed.values()))
    robots = tmp_path / "robots.yml"
    robots.write_text("".join(f"{file}: {Path(file).parent.name}\n" for file in files))
    back = str(tmp_path / "back")
    wanted = importing.Wanted(files=files, folder=back, robot_map=str(robots), name="hello", root=str(tmp_path / "out"))
    draft = importing.draft(wanted)
    folder.write(draft, back, files)
    after = load_experiment(Path(back) / folder.EDF).experiment
    assert {name: one.robot for name, one in after.services.items()} == placed
    fields = {field.partition(".")[2] for field in compared(before, after)}
    assert fields == {"network_mode", "hostname", "depends_on"}


@settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=experiments())
def test_any_experiment_comes_back(tmp_path_factory: pytest.TempPathFactory, document: dict[str, Any]) -> None:
    place = tmp_path_factory.mktemp("both-ways")
    both_ways(write(place / "in", document), place)


@pytest.mark.soak
@settings(max_examples=500, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=experiments())
def test_many_experiments_come_back(tmp_path_factory: pytest.TempPathFactory, document: dict[str, Any]) -> None:
    place = tmp_path_factory.mktemp("both-ways")
    both_ways(write(place / "in", document), place)
