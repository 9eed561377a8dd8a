"""What two runs were made of: definitions, placement, robots. Takes runs; gives lines. Pure."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping
from typing import Any

from srprov.errors import DefinitionError
from srprov.evidence.compare_runs import Run
from srprov.evidence.files import NotThere, content
from srprov.evidence.grades import DIFFERENT, EQUIVALENT, IDENTICAL, UNKNOWN, Line
from srprov.untrusted import decimal, integer, mapping, mappings, string, strings
from srprov.yamldoc.loader import parse
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq, dotted, kind

_YAML = (".edf", ".cdf", ".yml", ".yaml")
_MOST_SHOWN = 5
_MOST_YAML = 1 << 20
_SAME_MEMORY = 0.05
"""Of two robots with one kind of memory; a kernel keeps a little of it, and not always the same."""
_WORDS = frozenset({"description", "authors", "license"})
"""Keys for readers."""
_Path = tuple[str | int, ...]


def definitions(a: Run, b: Run) -> Iterator[Line]:
    """Compare each file that the experiment is made of, and which variables of the controller it takes."""
    here, there = (dict(_named(one)) for one in (a, b))
    for name in sorted(here.keys() | there.keys()):
        one, other = here.get(name), there.get(name)
        if one and other and one[1] == other[1]:
            yield Line(name, IDENTICAL)
        elif not any(found[2] for found in (one, other) if found):
            yield Line(name, EQUIVALENT, "it differs, and is for readers: nothing that is run follows from it")
        elif one and other:
            yield _file(name, _text(a, one[0]), _text(b, other[0]))
        else:
            yield Line(name, DIFFERENT, f"only in {(a if one else b).name}")
    taken = [sorted(strings(one.inputs.get("variables"))) for one in (a, b)]
    if taken[0] != taken[1]:
        yield Line("variables", DIFFERENT, f"{', '.join(taken[0]) or 'none'}; {', '.join(taken[1]) or 'none'}")


def _named(run: Run) -> Iterator[tuple[str, tuple[str, str, bool]]]:
    """Return name -> (name in the run, sha256, what is run may follow from it); the EDF's name is always the same."""
    for one in mappings(run.inputs.get("files"), most=100_000):
        file = string(one.get("file"))
        name = "the EDF" if file == run.inputs.get("edf") else string(one.get("path"))
        yield name, (f"{run.story.home}/{file}", string(one.get("sha256")), one.get("for_readers") is not True)


def _text(run: Run, name: str) -> str:
    try:
        return content(run.files, name, _MOST_YAML).decode("utf-8", "surrogateescape")
    except NotThere:
        return ""


def _file(name: str, a: str, b: str) -> Line:
    """Compare two files whose bytes differ; of YAML what it says, without comments, order of keys and descriptions."""
    if name != "the EDF" and posixpath.splitext(name)[1] not in _YAML:
        return Line(name, DIFFERENT, "its content differs")
    try:
        found = list(_differences(_plain(parse(a, name)), _plain(parse(b, name)), ()))
    except DefinitionError:
        return Line(name, DIFFERENT, "its content differs, and one of them is no YAML")
    if not found:
        return Line(name, EQUIVALENT, "comments, order of keys or descriptions differ")
    more = f"; and {len(found) - _MOST_SHOWN} more" * (len(found) > _MOST_SHOWN)
    return Line(name, DIFFERENT, "; ".join(found[:_MOST_SHOWN]) + more)


def _plain(node: Node | None) -> Any:  # noqa: ANN401 - what YAML may hold
    """Return what a document says: maps, lists, and (kind, text) of each value."""
    if isinstance(node, Map):
        return {key: _plain(value) for key, value in node.entries.items() if key not in _WORDS}
    if isinstance(node, Seq):
        return [_plain(one) for one in node.items]
    return (kind(node), node.text) if isinstance(node, Scalar) else ("nothing", "")


def _differences(a: Any, b: Any, path: _Path) -> Iterator[str]:  # noqa: ANN401 - as above
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(one for one in b if one not in a)]:
            if key not in a or key not in b:
                yield f"{dotted((*path, key))} only in {'A' if key in a else 'B'}"
            else:
                yield from _differences(a[key], b[key], (*path, key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for at, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _differences(one, other, (*path, at))
    elif a != b:
        yield f"{dotted(path)}: {_shown(a)}, and {_shown(b)}"


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return repr(value[1][:60])
    return f"{len(value)} entries" if isinstance(value, list | dict) else str(value)


def robots_of(a: Run, b: Run) -> dict[str, str] | None:
    """Return robot of A -> robot of B such that each service is on the same one; None where there is no such map."""
    here, there = a.story.last.assignment, b.story.last.assignment
    if here.keys() != there.keys():
        return None
    found: dict[str, str] = {}
    for service, robot in sorted(here.items()):
        if found.setdefault(robot, there[service]) != there[service]:
            return None
    return found if len(set(found.values())) == len(found) else None


def placement(a: Run, b: Run) -> Iterator[Line]:
    """Compare which robot ran which service."""
    here, there = a.story.last.assignment, b.story.last.assignment
    if here == there:
        yield Line("services", IDENTICAL, "each on the same robot")
    elif robots := robots_of(a, b):
        told = ", ".join(f"{one} is {other}" for one, other in sorted(robots.items()) if one != other)
        yield Line("services", EQUIVALENT, f"the same services together on each robot: {told}")
    else:
        for service in sorted(here.keys() | there.keys()):
            one, other = here.get(service, "nowhere"), there.get(service, "nowhere")
            yield Line(
                service, IDENTICAL if one == other else DIFFERENT, one if one == other else f"{one}, and {other}"
            )


def robots(a: Run, b: Run) -> Iterator[Line]:
    """Compare each robot with the one that did its part."""
    for one, other in sorted((robots_of(a, b) or {}).items()):
        name = one if one == other else f"{one}, {other}"
        here, there = mapping(a.robots.get(one)), mapping(b.robots.get(other))
        if not here or not there:
            yield Line(name, UNKNOWN, "nothing is recorded of it")
            continue
        found = [f"{key}: {was or 'unknown'}, and {now or 'unknown'}" for key, was, now in facts_of(here, there)]
        if not found:
            yield Line(name, IDENTICAL, "the same kind of machine with the same system")
        else:
            grade = EQUIVALENT if _same_class(here, there) else DIFFERENT
            yield Line(name, grade, "; ".join(found))


def facts_of(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[tuple[str, object, object]]:
    """Return what is different of two robots, by their facts: its name, and both values."""
    for key in ("arch", "processor", "board", "cpus", "memory_total", "os", "kernel"):
        if a.get(key) != b.get(key):
            yield key.removesuffix("_total"), a.get(key), b.get(key)
    here, there = (mapping(one.get("docker")) for one in (a, b))
    for key in ("version", "storage_driver"):
        if here.get(key) != there.get(key):
            yield f"docker {key}", here.get(key), there.get(key)


def _same_class(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    same = all(a.get(key) == b.get(key) for key in ("arch", "processor", "cpus"))
    here, there = (integer(one.get("memory_total"), high=1 << 60) for one in (a, b))
    kernels = [string(one.get("kernel")).split(".")[:2] for one in (a, b)]
    memory = abs(here - there) <= _SAME_MEMORY * max(here, there)
    return same and memory and kernels[0] == kernels[1]


def clocks(a: Run, b: Run) -> Iterator[Line]:
    """Compare how well the robots' clocks were known."""
    worst = [
        [decimal(one.get("clock_error_ms"), low=0, high=1e12, default=-1) for one in run.counted] for run in (a, b)
    ]
    known = [max((one for one in errors if one >= 0), default=None) for errors in worst]
    steps = [sum(one.get("clock_step") is True for one in run.counted) for run in (a, b)]
    if None in known:
        yield Line("errors", UNKNOWN, "not measured on both sides")
    else:
        yield Line(
            "errors",
            IDENTICAL if known[0] == known[1] else EQUIVALENT,
            f"at most {known[0]:.1f} ms, and {known[1]:.1f} ms",
        )
    grade = DIFFERENT if any(steps) and steps[0] != steps[1] else IDENTICAL if not any(steps) else EQUIVALENT
    yield Line("steps", grade, f"trials whose clock was set: {steps[0]}, and {steps[1]}")
