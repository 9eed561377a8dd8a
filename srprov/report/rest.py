"""Robots, images, files and versions, and what a page could not show. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from srprov.report.changes import Row
from srprov.report.html import NOTHING, Child, Html, el, join, lines
from srprov.report.material import EnvironmentView, Material, RobotFacts
from srprov.report.parts import Section, facts, listed, outcome, table
from srprov.report.words import counted, natural, number, ranges, size

_MOST = 400
_LISTED = 300


def robots(material: Material) -> Section | None:
    """Return the robots as they were; None where that was not recorded."""
    found = material.facts.robots if material.facts is not None else {}
    if not found:
        return None
    head = ["robot", "system", "kernel", "arch", "CPUs", "load", "memory", "free", "Docker", "clock"]
    named = sorted(found, key=natural)
    body = [[robot, *_facts(found[robot])] for robot in named[:_MOST]]
    shown = table("As they were before the run", head, body, numbers=(4, 5, 6, 7, 9))
    more = el("p", f"and {len(named) - _MOST} more, in facts.json") if len(named) > _MOST else NOTHING
    return Section(id="robots", title="Robots", body=join([shown, more]))


def _facts(one: RobotFacts) -> list[Child]:
    clock: Child = (
        "" if one.clock_offset_s is None else number(one.clock_offset_s, f"{one.clock_offset_s * 1000:+.0f} ms")
    )
    return [
        one.os, one.kernel, one.arch, number(one.cpus), number(one.load1), size(one.memory_total),
        size(one.memory_available), one.docker.version if one.docker is not None else "none", clock,
    ]  # fmt: skip


def images(material: Material, rows: Sequence[Row]) -> Section | None:
    """Return the images of the run: what was brought to which robot and how, and what was there."""
    groups: dict[tuple[str, str, str, str], list[str]] = {}
    for one in rows:
        if one.what.startswith("image:"):
            said = "" if one.bad else one.message
            groups.setdefault((one.what.removeprefix("image:"), one.cause, one.outcome, said), []).append(one.robot)
    there: dict[str, list[str]] = {}
    for also in material.plan.also_wanted if material.plan is not None else ():
        if also.module == "image":
            there.setdefault(also.name, []).append(also.robot)
    parts: list[Html] = []
    if groups:
        head = ["image", "robots", "how", "outcome", "what was sent"]
        body: list[list[Child]] = [
            [el("code", name), ranges(names), how, outcome(word) if word else "", said]
            for (name, how, word, said), names in list(groups.items())[:_MOST]
        ]
        parts.append(table("Brought to robots", head, body, kind="long"))
        if len(groups) > _MOST:
            parts.append(el("p", f"and {len(groups) - _MOST} more"))
    if there:
        body = [[el("code", name), ranges(there[name], 50)] for name in sorted(there)[:_MOST]]
        parts.append(table("There already", ["image", "robots"], body, kind="long"))
        if len(there) > _MOST:
            parts.append(el("p", f"and {len(there) - _MOST} more"))
    if material.trials is not None and material.trials.images:
        named = sorted(material.trials.images.items())[:_MOST]
        body = [[service, el("code", name), el("code", about)] for service, (name, about) in named]
        parts.append(table("Of the trials' containers", ["service", "image", "id"], body, kind="long"))
    return Section(id="images", title="Images", body=join(parts)) if parts else None


def origin(material: Material) -> Section | None:
    """Return what the run was made of, and with which versions."""
    parts: list[Html] = []
    if material.environment is not None:
        parts.append(facts(_environment(material.environment)))
    if material.inputs:
        body = [[el("code", one.name), size(one.size), el("code", one.sha256)] for one in material.inputs]
        parts.append(table("Files that it was made of", ["file", "size", "sha256"], body, numbers=(1,), kind="long"))
    return Section(id="origin", title="Files and versions", body=join(parts)) if parts else None


def _environment(about: EnvironmentView) -> Iterator[tuple[str, Child]]:
    yield "srprov", about.srprov
    yield "Python", f"{about.python} on {about.platform}"
    yield "libraries", ", ".join(f"{name} {version}" for name, version in sorted(about.libraries.items()))
    if (source := about.source) is not None:
        dirty = ", with changes that are in no commit" if source.dirty else ""
        yield "experiment", [el("code", source.file), f" at commit {source.commit}{dirty}" if source.commit else ""]
        if source.problem:
            yield "commit", source.problem


def limits(material: Material) -> Section:
    """Return what could not be seen or read, and what a page never says."""
    away: dict[str, str] = {}
    if material.facts is not None:
        away |= material.facts.unreachable
    if material.plan is not None:
        away |= material.plan.unreachable
    for robot in material.result.unreachable if material.result is not None else ():
        away.setdefault(robot, "the steps that were to be done there say why")
    named = sorted(away.items(), key=lambda one: natural(one[0]))
    items: list[Child] = [
        [el("b", el("bdi", robot)), " could not be reached: ", lines(why)] for robot, why in named[:_LISTED]
    ]
    if len(named) > _LISTED:
        items.append(f"{counted(len(named) - _LISTED, 'more robot')} could not be reached")
    items += material.missing
    items += _always(material)
    return Section(id="limits", title="What could not be seen", body=listed(items))


def _always(material: Material) -> Iterator[str]:
    """Return what no page of this kind shows."""
    if material.kind == "plan":
        yield "A plan is what was so when it was made; `apply` looks again, and refuses what has moved since."
        yield "Commands are in the plan: `srprov plan -v` shows them."
    elif material.trials is None:
        yield "What containers did after the run had ended is not in its record."
        yield "The exact commands of each step are in plan.txt."
        if material.probe is None:
            yield "The overlay was not tried in this run, or the record has no probe.json."
    if material.kind == "bundle":
        yield "Hashes and signature of the bundle were not looked at: `srprov verify` does that."
    if material.trials is not None:
        yield "Logs, results and measurements of each robot are in the folder of each attempt, and not in this page."
