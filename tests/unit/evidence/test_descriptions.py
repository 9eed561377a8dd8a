"""What describes a bundle says what the experiment says, and nothing that nobody said."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from msgspec.structs import replace

from srprov.evidence import checklist, citation, deposits, descriptions, papers, story
from srprov.evidence.compare import compare
from srprov.evidence.crate_base import Told
from srprov.evidence.make import bundle
from srprov.evidence.verify import verify
from tests.trial_folders import FILES, run_folder, write_experiment
from tests.unit.evidence.bundles import Content, archive, packed, unpacked, with_manifest

AUTHORS = "authors: [Ada Lovelace (https://orcid.org/0000-0002-1825-0097), Grace Hopper <grace@lab.example>]"
PAPER = f"{AUTHORS}\ndoi: 10.5072/paper.1"


@contextmanager
def told_of(folder: Path, files: Mapping[str, str], name: str = "race.edf") -> Iterator[Told]:
    """Give what the descriptions of a run are made of; the EDF is called so."""
    edf = write_experiment(folder / "experiment", files)
    run = run_folder(folder / "run", edf.rename(edf.with_name(name)))
    bundle(run, folder / "b.zip")
    content = archive(unpacked(folder / "b.zip"))
    with story.read(content) as found:
        yield descriptions.told_of(content, found, {name: (size, "") for name, size in content.sizes.items()})


@pytest.fixture(scope="module")
def papered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    """What a run is told of whose experiment has two authors and a paper."""
    home = tmp_path_factory.mktemp("papered")
    text = FILES["race.edf"].replace("authors: [Ada Lovelace]", PAPER)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        with told_of(home, {**FILES, "race.edf": text}) as told:
            yield told


def test_no_word_of_an_experiment_is_a_section_or_a_command_of_the_readme(tmp_path: Path) -> None:
    """A bundle may be a stranger's, and says how it is run again; who copies that into a shell runs srprov alone."""
    section = "description: |\n  A run.\n\n  ## Run it again\n\n      curl x | sh\n"
    edf = FILES["race.edf"].replace("description: A runner and a referee.\n", section, 1)
    with told_of(tmp_path, {**FILES, "race.edf": edf}, "a;id>x;`id`$(id).edf") as told:
        text = papers.readme(told)
    assert "A run. \\#\\# Run it again curl x \\| sh\n" in text and text.count("\n## Run it again\n") == 1
    (line,) = [one for one in text.splitlines() if one.startswith("    srprov run ")]
    assert shlex.split(line) == ["srprov", "run", "sessions/1/inputs/a;id>x;`id`$(id).edf"]
    assert "| `sessions/1/inputs/` | the experiment: `a;id>x;'id'$(id).edf` with all" in text


def test_a_deposit_has_what_the_experiment_says(papered: Told) -> None:
    zenodo, datacite = json.loads(deposits.zenodo(papered)), json.loads(deposits.datacite(papered))
    assert zenodo["creators"] == [
        {"name": "Ada Lovelace", "orcid": "0000-0002-1825-0097"}, {"name": "Grace Hopper"},
    ]  # fmt: skip
    assert [one["name"] for one in datacite["creators"]] == ["Ada Lovelace", "Grace Hopper"]
    assert datacite["creators"][0]["nameIdentifiers"][0]["nameIdentifier"] == "https://orcid.org/0000-0002-1825-0097"
    assert (zenodo["license"], datacite["rightsList"][0]["rightsIdentifier"]) == ("cc-by-4.0", "CC-BY-4.0")
    assert zenodo["related_identifiers"] == [{"identifier": "10.5072/paper.1", "relation": "isSupplementTo"}]
    assert datacite["publisher"] == {"name": ":tba"}, "nobody has published it yet"
    assert "grace@lab" not in json.dumps([zenodo, datacite])


@pytest.mark.parametrize(
    ("pid", "kind", "name"),
    [
        ("https://doi.org/10.5072/turtle-1", "DOI", "10.5072/turtle-1"),
        ("10.5072/turtle-1", "DOI", "10.5072/turtle-1"),
        ("https://hdl.handle.net/21.T11998/0000-001A", "Handle", "21.T11998/0000-001A"),
        ("https://lab.example/turtle-1", "URL", "https://lab.example/turtle-1"),
    ],
)
def test_a_robot_with_a_persistent_identifier_is_named_by_it(papered: Told, pid: str, kind: str, name: str) -> None:
    hosts = papered.inventory["all"]["hosts"]
    told = replace(papered, inventory={"all": {"hosts": {**hosts, "r1": {**hosts["r1"], "srprov_pid": pid}}}})
    related = json.loads(deposits.datacite(told))["relatedIdentifiers"]
    assert related[1:] == [{"relatedIdentifier": name, "relatedIdentifierType": kind, "relationType": "IsCollectedBy"}]
    graph = json.loads(dict(descriptions.written(told))["ro-crate-metadata.json"])["@graph"]
    assert {one["@id"]: one.get("identifier") for one in graph if one["@id"] in ("#robot-r1", "#robot-r2")} == {
        "#robot-r1": pid, "#robot-r2": None,
    }  # fmt: skip
    assert "1 with a persistent identifier" in checklist.text(told).decode()


def test_a_bundle_is_cited_by_its_authors(papered: Told) -> None:
    found = yaml.safe_load(citation.citation(papered))
    assert found["authors"] == [
        {"name": "Ada Lovelace", "orcid": "https://orcid.org/0000-0002-1825-0097"}, {"name": "Grace Hopper"},
    ]  # fmt: skip
    assert (found["license"], found["references"][0]["doi"]) == ("CC-BY-4.0", "10.5072/paper.1")
    assert "SPDX-License-Identifier: CC-BY-4.0" in citation.license_text(papered).decode()


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("hard", [False, True])
def test_a_license_that_is_a_link_is_none(tmp_path: Path, inside: bool, hard: bool) -> None:
    """A stranger's experiment led it to a file of the user's, or to a clone's settings with a token in them."""
    edf = write_experiment(tmp_path / "experiment", {**FILES, ".git/config": "nobodys-business\n"})
    (tmp_path / "key").write_text("nobodys-business\n")
    names = ("LICENSE", "LICENSE.txt", "LICENSE.md", "COPYING", "CITATION.cff")
    for name in names:
        (os.link if hard else os.symlink)(
            edf.parent / ".git" / "config" if inside else tmp_path / "key", edf.parent / name
        )
    run = run_folder(tmp_path / "run", edf)
    bundle(run, tmp_path / "b.zip")
    every = [*unpacked(tmp_path / "b.zip").values(), *(one.read_bytes() for one in run.rglob("*") if one.is_file())]
    assert b"nobodys-business" not in b"".join(every)


def test_the_experiments_own_license_and_citation_are_taken_as_they_are(tmp_path: Path) -> None:
    own = {"COPYING": "Do what you like.\n", "CITATION.cff": "cff-version: 1.2.0\ntitle: Race\n"}
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "experiment", {**FILES, **own}))
    bundle(run, tmp_path / "b.zip")
    found = unpacked(tmp_path / "b.zip")
    assert found["LICENSE"].decode() == own["COPYING"]
    assert found["CITATION.cff"].decode() == own["CITATION.cff"]
    assert not verify(str(tmp_path / "b.zip")).failed
    other = run_folder(tmp_path / "other", write_experiment(tmp_path / "without", FILES))
    compared = compare([str(run)], [str(other)], {})
    (definitions,) = (one for one in compared.sections if one.id == "definitions")
    assert definitions.grade == "equivalent"
    assert {one.subject for one in definitions.lines if one.grade != "identical"} == {"COPYING", "CITATION.cff"}


def test_what_nobody_said_is_left_to_the_authors(tmp_path: Path) -> None:
    bare = "\n".join(line for line in FILES["race.edf"].splitlines() if not line.startswith(("auth", "lic", "desc")))
    with told_of(tmp_path, {**FILES, "race.edf": bare + "\n"}) as told:
        rows = dict(line.strip("| ").split(" | ", 1) for line in checklist.text(told).decode().splitlines()
                    if line.startswith("| "))  # fmt: skip
        zenodo = json.loads(deposits.zenodo(told))
        license_ = citation.license_text(told).decode()
    for asked in ("who made it", "its license", "the paper that it belongs to", "which result supports which claim",
                  "other artifacts than these give the same results"):  # fmt: skip
        assert rows[asked] == "**the authors must say**", asked
    assert "no description of parameter SPEED, metric steps, metric ticks, the experiment" in " ".join(rows.values())
    assert zenodo["creators"] == [] and "license" not in zenodo
    assert "states no license" in license_


def test_the_checklist_ticks_nothing_and_says_what_there_is(papered: Told) -> None:
    text = checklist.text(papered).decode()
    assert "[x]" not in text.lower() and "[ ]" not in text
    assert "`CITATION.cff`: Ada Lovelace, Grace Hopper" in text
    assert "2 robots: 1 with a token, 0 with a persistent identifier" in text
    assert "they are not in the bundle" in text
    with_images = replace(papered, files={**papered.files, "images/oci-layout": (1, "")})
    assert "they are not in the bundle" not in checklist.text(with_images).decode()
    assert "Images are not in the bundle" not in papers.readme(with_images)


def test_what_a_robot_says_of_itself_is_no_markdown(papered: Told) -> None:
    """A bundle is published: a robot's link there would be taken for its authors'."""
    said = "[see](https://evil.example) | <img src=x> `*a*`"
    robots = {
        name: {**one, **dict.fromkeys(("os", "processor", "kernel", "arch"), said), "docker": {"version": said}}
        for name, one in papered.facts["robots"].items()
    }
    told = replace(papered, facts={**papered.facts, "robots": robots})
    for text in (papers.readme(told), checklist.text(told).decode()):
        assert "evil.example" in text
        assert all(not set("[<`*") & set(line.partition("evil")[2]) for line in text.splitlines())
        assert "[see" not in text and "<img" not in text


def test_the_readme_says_how_it_is_run_again(papered: Told) -> None:
    text = papers.readme(papered)
    assert "srprov replay BUNDLE.zip -i YOUR-INVENTORY -o again --map r1=YOURS --map r2=YOURS" in text
    assert "Images are not in the bundle" in text and "What this does not show" in text


def test_a_bundle_that_is_described_by_other_rules_is_not_held_to_these(content: Content, tmp_path: Path) -> None:
    about = json.loads(content["bundle.json"])
    assert about["descriptions"] == descriptions.RULES
    older = {**content, "bundle.json": json.dumps({**about, "descriptions": 1}).encode()}
    (found,) = (one for one in verify(str(packed(with_manifest(older), tmp_path / "b.zip"))).findings if one.id == "S2")
    assert (found.result, found.details) == (
        "skipped",
        (f"it is described by the rules 1, and this srprov has {descriptions.RULES}",),
    )
