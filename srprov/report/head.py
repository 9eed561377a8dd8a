"""The head of a page: what came of it, how much, and whether data is lost. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import msgspec

from srprov.report.html import NOTHING, Child, Html, el, join
from srprov.report.material import Material
from srprov.report.model import Moved, PlannedStep, PlanView, ResultView
from srprov.report.parts import listed
from srprov.report.words import counted, moment, number, pointer, seconds
from srprov.trials.judge import COUNTED

_MOST_LOST = 500
_KINDS = {"plan": "Plan", "run": "Run", "trials": "Trials", "bundle": "Trials of a bundle"}
_ACTIONS = {"create": "to add", "update": "to change", "replace": "to replace", "delete": "to remove", "run": "to run"}


class Verdict(msgspec.Struct, frozen=True):
    """What came of it."""

    kind: str
    """`ok`, `warn` or `bad`."""
    word: str
    sentence: str


_MARKS = {"ok": "✓", "warn": "!", "bad": "✕"}


def title(material: Material) -> str:
    """Return the page's title."""
    return f"{_KINDS[material.kind]}: {material.instance}"


def head(material: Material) -> Html:
    """Return title, verdict, counts, and what becomes of data."""
    said = verdict(material)
    return join(
        [
            el("h1", title(material)),
            el("p", _about(material), class_="about"),
            el("div", el("b", f"{_MARKS[said.kind]} {said.word}"), said.sentence, class_=f"verdict {said.kind}"),
            _tiles(material),
            _data(material.plan, material.result),
        ]
    )


def _about(material: Material) -> list[Child]:
    about = material.environment
    parts: list[Child] = []
    if about is not None:
        parts = [about.verb and [el("code", f"srprov {about.verb}")], moment(about.begun), f"by {about.owner}"]
    if material.plan is not None and material.plan.source:
        parts.append(["from ", el("code", material.plan.source)])
    parts.append(["record ", el("code", material.name)] if material.kind == "run" else el("code", material.name))
    if material.plan is not None and material.plan.hash:
        parts.append(["hash ", el("code", material.plan.hash)])
    shown: list[Child] = []
    for one in parts:
        if one:
            shown += [" · ", one] if shown else [one]
    return shown


def verdict(material: Material) -> Verdict:
    """Return what came of a run, what a plan would do, or how many trials count."""
    if material.trials is not None:
        return _of_trials(material)
    if material.result is not None:
        return _of_run(material.result)
    if material.kind == "plan" and material.plan is not None:
        return _of_plan(material.plan)
    return Verdict("warn", "Not ended", "The run was killed, or is under way: it has no result.")


def _of_run(result: ResultView) -> Verdict:
    done = f"{counted(result.changed, 'step')} changed, {result.unchanged} unchanged"
    bad = list(_went_wrong(result))
    if result.failed or (result.probe is not None and not result.probe.ok):
        return Verdict("bad", "Failed", f"{', '.join(bad)}; {done}.")
    if bad:
        return Verdict("warn", "Not complete", f"{', '.join(bad)}; {done}.")
    works = f" The overlay works between all {result.probe.pairs} pairs." if result.probe is not None else ""
    return Verdict("ok", "Done", f"{done}.{works}" if result.changed else f"Nothing had to change; {done}.{works}")


def _went_wrong(result: ResultView) -> Iterator[str]:
    for count, word in ((result.failed, "failed"), (result.skipped, "skipped"), (result.not_reached, "not done")):
        if count:
            yield f"{count} {word}"
    if result.unreachable:
        yield f"{counted(len(result.unreachable), 'robot')} unreachable"
    if result.probe is not None and not result.probe.ok:
        yield f"{result.probe.failed} of {result.probe.pairs} pairs of the overlay do not work"


def _of_plan(plan: PlanView) -> Verdict:
    if not plan.steps:
        return Verdict("ok", "Nothing to do", f"{counted(plan.unchanged, 'resource')} are right already.")
    parts = [f"{plan.counts[name]} {word}" for name, word in _ACTIONS.items() if plan.counts.get(name)]
    sentence = f"{', '.join(parts)}; {plan.unchanged} unchanged."
    if plan.unreachable:
        sentence += f" {counted(len(plan.unreachable), 'robot')} could not be reached."
    lost = any(one.destructive for one in plan.steps)
    word = "Plan that destroys data" if lost else "Plan"
    return Verdict("warn" if lost or plan.unreachable else "ok", word, sentence)


def _of_trials(material: Material) -> Verdict:
    assert material.trials is not None
    about = material.trials.document
    done, asked, early = about["done"], about["trials"], about["ended_early"]
    sentence = f"{done} of {counted(asked, 'trial')} count."
    if early:
        return Verdict("warn", "Not complete", f"{sentence[:-1]}: {early}.")
    return Verdict("ok", "Done", sentence) if done == asked else Verdict("warn", "Not complete", sentence)


def _tiles(material: Material) -> Html:
    return el("dl", [el("div", el("dt", name), el("dd", one)) for name, one in _figures(material)], class_="tiles")


def _figures(material: Material) -> Iterator[tuple[str, Html]]:
    if (result := material.result) is not None:
        yield from (
            (word, number(getattr(result, key), of=pointer(key)))
            for key, word in (
                ("changed", "changed"), ("unchanged", "unchanged"), ("failed", "failed"), ("skipped", "skipped"),
                ("not_reached", "not done"),
            )
        )  # fmt: skip
        yield "unreachable", number(len(result.unreachable))
        yield "took", seconds(result.duration_s, of="/duration_s")
        if result.assignment:
            yield "cost", number(result.cost, f"{result.cost:.3f}", of="/cost")
    elif (trials := material.trials) is not None:
        document = trials.document
        yield "trials", number(document["trials"], of="/trials")
        yield "count", number(document["done"], of="/done")
        yield "attempts", number(len(document["rows"]))
        yield "did not count", number(sum(row["status"] not in COUNTED for row in document["rows"]))
    elif material.kind == "plan" and (plan := material.plan) is not None:
        some = [(word, key) for key, word in _ACTIONS.items() if key in plan.counts]
        yield from ((word, number(plan.counts[key], of=pointer("counts", key))) for word, key in some)
        yield "unchanged", number(plan.unchanged, of="/unchanged")
        if plan.assignment:
            yield "cost", number(plan.cost, f"{plan.cost:.3f}", of="/cost")


def _data(plan: PlanView | None, result: ResultView | None) -> Html:
    """Return what becomes of data: the steps that destroy some, and services that go where theirs is not."""
    if plan is None:
        return NOTHING
    ends = {one.number: one.outcome for one in result.steps} if result is not None else {}
    lost = [one for one in plan.steps if one.destructive]
    moved = [one for one in plan.data if one.how != "move"]
    if not lost and not plan.data:
        return el("p", "No step destroys data.", class_="soft") if plan.steps else NOTHING
    verb = "destroys" if len(lost) == 1 else "destroy"
    head_line = f"{counted(len(lost), 'step')} {verb} data" if lost else "Data of services that move"
    kind = "bad" if lost else "warn" if moved else "ok"
    items = [*_lost(lost, ends), *(el("span", _move(one)) for one in plan.data[:_MOST_LOST])]
    if len(plan.data) > _MOST_LOST:
        items.append(f"data of {len(plan.data) - _MOST_LOST} more, in the data of this page")
    return el("div", el("b", head_line), listed(items), class_=f"box {kind}")


def _lost(steps: Sequence[PlannedStep], ends: Mapping[int, str]) -> Iterator[Child]:
    for one in steps[:_MOST_LOST]:
        ended = f" ({ends[one.number]})" if one.number in ends else ""
        yield [f"#{one.number} ", el("code", one.id), f": {one.cause}{ended}"]
    if len(steps) > _MOST_LOST:
        yield f"and {len(steps) - _MOST_LOST} more, in plan.txt"


def _move(one: Moved) -> str:
    if one.how == "move":
        return f"data of {one.service} ({one.volume}) is copied from {one.source} to {one.target}"
    return f"data of {one.service} stays on {one.source} ({one.volume}); it starts without it on {one.target}"
