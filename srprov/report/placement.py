"""Who runs what, what it would cost elsewhere, and why not there; and what a plan asks for. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sized

from srprov.report.html import NOTHING, Child, Html, el, join, whole
from srprov.report.material import Material
from srprov.report.model import DecisionView, PlanView, Terms
from srprov.report.parts import Section, captioned, fold, listed, scrolled, table
from srprov.report.words import counted, natural, number, ranges

_MOST_CELLS = 1000
_MOST_COLUMNS = 24
"""Robots side by side; with more, services are listed without a matrix."""
_MOST_ROWS = 2000


def placement(material: Material) -> Section | None:
    """Return who runs what, as a matrix where it is small; None where nothing was placed."""
    placed, costs = _placed(material)
    if not placed:
        return None
    made = material.assignment.decision if material.assignment is not None else None
    parts = [_sentence(made, material), _matrix(placed, made), _list(placed, costs, made), _reasons(made)]
    return Section(id="placement", title="Placement", body=join(parts))


def _placed(material: Material) -> tuple[Mapping[str, str], Mapping[str, float]]:
    """Return service -> robot, and service -> cost."""
    if material.assignment is not None and material.assignment.assignment:
        return material.assignment.assignment, material.assignment.costs
    if material.plan is not None:
        return material.plan.assignment, material.plan.costs
    return (material.result.assignment, {}) if material.result is not None else ({}, {})


def _sentence(made: DecisionView | None, material: Material) -> Html:
    if made is None:
        decided = material.assignment is not None
        return el("p", "This run took the placement as it was." if decided else NOTHING, class_="soft")
    words = [
        "No placement costs less."
        if made.optimal
        else f"The search was stopped: {made.gap:.3f} less may be possible."
        if made.gap
        else f"Services stay where they run: moving them (--reassign) would cost {made.least:.3f} in all."
    ]
    if made.frozen:
        words.append(f"{ranges(made.frozen)} stay on robots that cannot be reached.")
    notes = listed(map(whole, made.notes[:_MOST_ROWS])) if made.notes else NOTHING
    return join([el("p", " ".join(words)), notes, _more(made.notes)])


def _more(rows: Sized) -> Html:
    """Return how many rows a page leaves out, if any: who reviews a plan by it must know that there are some."""
    more = len(rows) - _MOST_ROWS
    return el("p", f"and {more} more, in the data of this page") if more > 0 else NOTHING


def _matrix(placed: Mapping[str, str], made: DecisionView | None) -> Html:
    if made is None or not made.matrix:
        return NOTHING
    robots = sorted({robot for row in made.matrix.values() for robot in row}, key=natural)
    services = sorted(made.matrix, key=natural)
    if len(robots) > _MOST_COLUMNS or len(robots) * len(services) > _MOST_CELLS:
        text = f"{len(services)} services on {len(robots)} robots are too many for a matrix; they are listed below."
        return el("p", text, class_="soft")
    head = el("tr", el("th", "service", scope="col"), [el("th", robot, scope="col") for robot in robots])
    rows = []
    for service in services:
        row, why = made.matrix[service], made.why_not.get(service, {})
        cells = [_cell(row.get(robot), placed.get(service) == robot, why.get(robot, "")) for robot in robots]
        rows.append(el("tr", el("th", service, scope="row"), cells))
    caption = "Cost of each service on each robot, alone; ● is where it runs"
    grid = el("table", captioned(caption), el("thead", head), el("tbody", rows), class_="grid")
    return scrolled("Cost of each service on each robot", grid)


def _cell(cost: float | None, here: bool, why: str) -> Html:
    shown: Child = "cannot" if cost is None else number(cost, f"{cost:.3f}")
    if here:
        return el("td", "● ", shown, class_="here")
    return el("td", shown, class_="no" if cost is None else None, title=why or None)


def _list(placed: Mapping[str, str], costs: Mapping[str, float], made: DecisionView | None) -> Html:
    """Return a row for each service: its robot, its cost, what that is made of."""
    terms = made.terms if made is not None else {}
    named = sorted(placed, key=natural)
    rows: list[list[Child]] = [
        [
            service,
            placed[service],
            number(costs[service], f"{costs[service]:.4f}") if service in costs else "",
            *_terms(terms.get(service)),
        ]
        for service in named[:_MOST_ROWS]
    ]
    head = ["service", "robot", "cost", *(("cpu", "memory", "swap", "bandwidth") if terms else ())]
    shown = table("Where each service runs", head, [row[: len(head)] for row in rows], numbers=range(2, len(head)))
    rest = _more(named)
    small = made is None or not made.matrix
    return (
        join([shown, rest]) if small else fold(f"What the costs of {counted(len(named), 'service')} are made of", shown)
    )


def _terms(one: Terms | None) -> list[Child]:
    if one is None:
        return ["", "", "", ""]
    return [number(value, f"{value:.4f}") for value in (one.cpu, one.memory, one.swap, one.bandwidth)]


def _reasons(made: DecisionView | None) -> Html:
    """Return why services cannot run elsewhere; robots with one reason are together."""
    if made is None:
        return NOTHING
    rows: list[list[Child]] = []
    for service in sorted(made.why_not, key=natural):
        of: dict[str, list[str]] = {}
        for robot, why in made.why_not[service].items():
            of.setdefault(why, []).append(robot)
        rows += [[service, ranges(robots), why] for why, robots in sorted(of.items())]
    if not rows:
        if made.matrix:
            return el("p", "Every robot that was reached could run every service.", class_="soft")
        return el("p", "This record does not say what other robots would have cost.", class_="soft")
    shown = table("Why not there", ["service", "not on", "because"], rows[:_MOST_ROWS], kind="long")
    return fold(f"Why not elsewhere: {counted(len(rows), 'reason')}", shown, _more(rows))


def asks(material: Material) -> Section | None:
    """Return what a plan asks for beyond its own containers, and what else a reviewer should know."""
    plan = material.plan
    if plan is None:
        return None
    parts = list(_asks(plan))
    return Section(id="asks", title="Permissions and notes", body=join(parts)) if parts else None


def _asks(plan: PlanView) -> Iterator[Html]:
    if plan.permissions:
        rows: list[list[Child]] = [[one.kind, one.service, whole(one.what)] for one in plan.permissions]
        yield table("Asked for beyond its own containers", ["kind", "service", "what"], rows[:_MOST_ROWS], kind="long")
        yield _more(rows)
    if plan.playbooks:
        rows = [[one.name, one.place, one.file] for one in plan.playbooks]
        yield table("Playbooks beside srprov's own", ["playbook", "place", "file"], rows[:_MOST_ROWS], kind="long")
        yield _more(rows)
    if plan.secrets:
        yield el("p", f"Secrets, whose values are nowhere in here: {ranges(plan.secrets, 50)}.")
    if plan.limit:
        yield el("p", f"Steps of other robots than {ranges(plan.limit, 50)} were left out (--limit).")
    if plan.notes:
        yield el("h3", "Notes")
        yield listed(map(whole, plan.notes[:_MOST_ROWS]))
        yield _more(plan.notes)
