"""What the Workflow Run RO-Crate profile wants a crate to answer is answered by SPARQL, without srprov.

Source: the competency questions of https://www.researchobject.org/workflow-run-crate/requirements. Two of the eleven
are not asked: which configuration file each step had, and how parameters reach the tools of a workflow, are questions
to crates whose workflow is made of steps; containers of a trial run side by side.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import rdflib

from srprov.evidence.make import bundle
from tests.trial_folders import FILES, run_folder, write_experiment
from tests.unit.evidence.bundles import unpacked

pytestmark = pytest.mark.filterwarnings("ignore:ConjunctiveGraph")  # rdflib's own reader of JSON-LD
CONTEXT = Path(__file__).with_name("ro-crate-1.1-context.json")
"""The terms of RO-Crate 1.1's context that a bundle's crate has: nobody is asked for the whole one."""
BY_REFERENCE = "https://w3id.org/ro/crate/1.1/context"
PREFIXES = """
PREFIX s: <http://schema.org/>
PREFIX bio: <https://bioschemas.org/>
PREFIX run: <https://w3id.org/ro/terms/workflow-run#>
"""
USED = {"service": "runner", "cpu_s": 0.25, "memory_peak_bytes": 4096}


def graph_of(content: bytes) -> rdflib.Graph:
    """Return a crate as triples, with its context from a file."""
    crate: dict[str, Any] = json.loads(content)
    assert crate["@context"][0] == BY_REFERENCE
    crate["@context"][0] = json.loads(CONTEXT.read_text())["@context"]
    return rdflib.Graph().parse(data=json.dumps(crate), format="json-ld", publicID="file:///crate/")


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> rdflib.Graph:
    """The crate of a run whose robots said what containers used, and which images they have."""
    home = tmp_path_factory.mktemp("questions")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        run = run_folder(home / "run", write_experiment(home / "experiment", FILES))
        events = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
        for one in events:
            if one["event"] == "end" and one["row"]["status"] == "ok":
                one["row"]["containers"] = [USED, {**USED, "service": "referee"}]
        events[0]["same"] |= {"runner: image": "runner:1", "runner: image id": f"sha256:{'0' * 64}"}
        (run / "journal.jsonl").write_text("".join(json.dumps(one) + "\n" for one in events))
        bundle(run, home / "b.zip")
    return graph_of(unpacked(home / "b.zip")["ro-crate-metadata.json"])


def asked(graph: rdflib.Graph, query: str) -> set[tuple[str, ...]]:
    """Return the rows of an answer as texts, without where the crate lies."""
    rows = graph.query(PREFIXES + query)
    return {tuple(str(cell).removeprefix("file:///crate/") for cell in row) for row in rows}  # type: ignore[union-attr]  # of a SELECT they are rows


OF_TRIAL = "?run a s:CreateAction ; s:instrument ?workflow . ?workflow a bio:ComputationalWorkflow ."
OF_TOOL = "?run a s:CreateAction ; s:instrument ?tool . ?tool a s:SoftwareApplication ."
TIMES = "?run s:startTime ?start ; s:endTime ?end ."
QUESTIONS = {
    "which container images were used": f"""SELECT DISTINCT ?name ?id {{ {OF_TRIAL} ?run run:containerImage ?image .
        ?image a run:ContainerImage ; s:name ?name . OPTIONAL {{ ?image s:identifier ?id }} }}""",
    "how much was used": f"""SELECT ?run ?what ?unit ?value {{ {OF_TRIAL} ?run run:resourceUsage ?used .
        ?used a s:PropertyValue ; s:propertyID ?what ; s:unitCode ?unit ; s:value ?value }}""",
    "in which environment": f"""SELECT DISTINCT ?name ?value {{ {OF_TRIAL} ?run run:environment ?set .
        ?set a s:PropertyValue ; s:name ?name ; s:value ?value }}""",
    "how long a tool took": f"SELECT ?start ?end {{ {OF_TOOL} {TIMES} }}",
    "how long a trial took": f"SELECT ?run ?start ?end {{ {OF_TRIAL} {TIMES} }}",
    "whether it succeeded": f"""SELECT ?run ?status ?error {{ {OF_TRIAL} ?run s:actionStatus ?status .
        OPTIONAL {{ ?run s:error ?error }} }}""",
    "what went in": f"SELECT DISTINCT ?name {{ {OF_TRIAL} ?run s:object ?one . ?one s:name ?name }}",
    "what came out": f"SELECT DISTINCT ?name {{ {OF_TRIAL} ?run s:result ?one . ?one s:name ?name }}",
    "which version of what": "SELECT ?name ?v { ?tool a s:SoftwareApplication ; s:name ?name ; s:version ?v }",
    "what a tool is made of": f"""SELECT DISTINCT ?main ?other {{ {OF_TOOL}
        ?tool s:mainEntity ?solver ; s:softwareRequirements ?library .
        ?solver s:name ?main . ?library s:name ?other ; s:version ?version }}""",
}
"""Nine questions; the one about what goes in and out is two queries."""


def test_which_container_images_were_used(graph: rdflib.Graph) -> None:
    assert ("runner:1", f"sha256:{'0' * 64}") in asked(graph, QUESTIONS["which container images were used"])


def test_how_much_was_used(graph: rdflib.Graph) -> None:
    found = asked(graph, QUESTIONS["how much was used"])
    assert len(found) == 8, "two of each of four trials"
    assert {row[1:] for row in found} == {
        ("cpu_s", "https://qudt.org/vocab/unit/SEC", "0.5"),
        ("memory_peak_bytes", "https://qudt.org/vocab/unit/BYTE", "8192"),
    }


def test_in_which_environment(graph: rdflib.Graph) -> None:
    found = asked(graph, QUESTIONS["in which environment"])
    assert {("FAVOURS", "nobody"), ("SPEED", "0.5"), ("SPEED", "1")} <= found
    assert len([value for name, value in found if name == "seed"]) == 4


def test_how_long_srprov_took_and_how_long_trials(graph: rdflib.Graph) -> None:
    ((begun, ended),) = asked(graph, QUESTIONS["how long a tool took"])
    trials = asked(graph, QUESTIONS["how long a trial took"])
    assert begun < ended and len(trials) == 4 and all(start < end for _, start, end in trials)


def test_whether_it_succeeded(graph: rdflib.Graph) -> None:
    found = asked(graph, QUESTIONS["whether it succeeded"])
    words = sorted((status.rpartition("/")[2], error) for _, status, error in found)
    assert words == [("CompletedActionStatus", "None")] * 4 + [("FailedActionStatus", "infrastructure: r2: away")]


def test_what_went_in_and_what_came_out(graph: rdflib.Graph) -> None:
    given = asked(graph, QUESTIONS["what came out"])
    assert asked(graph, QUESTIONS["what went in"]) == {("SPEED",), ("seed",)}
    assert {("steps",), ("ticks",), ("verdict",)} <= given and len(given) == 8, "and a folder of each attempt"


def test_which_version_of_what(graph: rdflib.Graph) -> None:
    found = dict(asked(graph, QUESTIONS["which version of what"]))
    assert found["srprov"] and {"docker", "ortools", "paramiko"} <= found.keys()


def test_what_a_tool_is_made_of(graph: rdflib.Graph) -> None:
    assert {("ortools", "docker"), ("ortools", "paramiko")} <= asked(graph, QUESTIONS["what a tool is made of"])
