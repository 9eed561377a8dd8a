"""The time line: a lane for each robot with when it acted, was checked and waited; the critical path. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from srprov.report.changes import Row
from srprov.report.html import NOTHING, Child, Html, el, join
from srprov.report.parts import Section, fold, table
from srprov.report.spans import Spans, total
from srprov.report.timeline import Lane, Link, Timeline
from srprov.report.words import counted, pointer, seconds

_WIDTH = 1000
"""Units of a lane, whatever the page's width."""
_LEAST = 2.0
"""Units of the shortest stretch, so that it can be seen."""
_MOST_LANES = 60
_MOST_LINKS = 60
_MOST_PHASES = 20
_MOST_IN_TABLE = 400
_KEYS = (
    ("act", "acting"),
    ("check", "being checked"),
    ("await", "waiting for what a step needs"),
    ("rest", "waiting for its turn"),
    ("path", "critical path"),
)


def lanes(
    time: Timeline | None, rows: Mapping[int, Row], phases: Mapping[str, float], robots: int
) -> Section | None:  # fmt: skip
    """Return the section, or None where nothing is known of times.

    Args:
        time: Of the run's steps.
        rows: Number -> step.
        phases: Of the run, in seconds.
        robots: That took part in it.
    """
    parts = [_phases(phases)] if phases else []
    if time is not None:
        parts += [_key(), *_lanes(time), _sums(time.lanes), _chain(time, rows)]
        if idle := robots - len(time.lanes):
            parts.append(el("p", f"On {counted(idle, 'more robot')} no step was begun.", class_="soft"))
    return Section(id="time", title="Time line", body=join(parts)) if parts else None


def _phases(phases: Mapping[str, float]) -> Html:
    some: list[Child] = []
    for name, took in list(phases.items())[:_MOST_PHASES]:
        some += [f"{' · ' if some else 'The run: '}{name} ", seconds(took, of=pointer("phases", name))]
    return el("p", some, class_="soft")


def _key() -> Html:
    def sample(kind: str) -> Html:
        line = el("path", d="M0 7h100", class_=kind)
        return el("svg", line, viewBox="0 0 100 14", preserveAspectRatio="none", aria_hidden="true")

    return el("p", [el("span", sample(kind), words, class_="key") for kind, words in _KEYS])


def _lanes(time: Timeline) -> Iterator[Html]:
    critical: dict[str, list[tuple[float, float]]] = {}
    for link in time.chain:
        critical.setdefault(link.task.robot, []).append((link.task.begun, link.task.acted))
    first = sorted(time.lanes, key=lambda one: (one.robot not in critical, -one.end, one.robot))
    shown = [_lane(one, critical.get(one.robot, []), time.seconds) for one in first[:_MOST_LANES]]
    yield el("ul", [el("li", one) for one in shown], class_="lanes")
    marks = [el("span", f"{time.seconds * share / 4:.2f} s") for share in range(5)]
    yield el("div", marks, class_="axis", aria_hidden="true")
    if len(first) > _MOST_LANES:
        text = f"{len(first) - _MOST_LANES} robots that ended earlier have no lane here; the table has their sums."
        yield el("p", text, class_="soft")


def _lane(one: Lane, critical: Spans, whole: float) -> list[Child]:
    layers: list[tuple[str, Spans, int]] = [
        ("rest", [(0.0, one.end)], 10),
        ("check", one.checking, 10),
        ("await", one.awaiting, 10),
        ("act", one.acting, 10),
        ("path", critical, 18),
    ]
    paths = [el("path", d=_path(spans, whole, y), class_=kind) for kind, spans, y in layers if spans]
    words = f"{one.robot}: acting {total(one.acting):.3f} s, waiting {one.waiting_s:.3f} s, ended at {one.end:.3f} s"
    picture = el("svg", paths, viewBox=f"0 0 {_WIDTH} 20", preserveAspectRatio="none", role="img", aria_label=words)
    return [
        el("bdi", one.robot, class_="who", title=one.robot),
        picture,
        el("span", f"{one.end:.2f} s", class_="num soft"),
    ]


def _path(spans: Sequence[tuple[float, float]], whole: float, y: int) -> str:
    """Return strokes of an SVG path; what lies closer together than can be seen is one."""
    scale = _WIDTH / whole if whole > 0 else 0.0
    drawn: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        left = min(begin * scale, _WIDTH - _LEAST)
        right = max(end * scale, left + _LEAST)
        if drawn and left - drawn[-1][1] < 1:
            drawn[-1] = (drawn[-1][0], max(drawn[-1][1], right))
        else:
            drawn.append((left, right))
    return "".join(f"M{left:.1f} {y}H{right:.1f}" for left, right in drawn)


def _sums(found: Sequence[Lane]) -> Html:
    rows: list[list[Child]] = [
        [
            one.robot,
            seconds(round(total(one.acting), 3)),
            seconds(round(total(one.checking), 3)),
            seconds(round(one.waiting_s, 3)),
            seconds(round(total(one.awaiting), 3)),
            seconds(round(one.end, 3)),
        ]
        for one in found[:_MOST_IN_TABLE]
    ]
    head = ["robot", "acting", "being checked", "waiting", "of that for a need", "ended at"]
    caption = "Seconds since the first step was begun; acting, being checked and waiting are the time to its end"
    rest = NOTHING
    if len(found) > _MOST_IN_TABLE:
        rest = el("p", f"and {len(found) - _MOST_IN_TABLE} robots that ended earlier", class_="soft")
    return fold(
        f"The same as a table: {counted(len(found), 'robot')}", table(caption, head, rows, numbers=range(1, 6)), rest
    )


def _chain(time: Timeline, rows: Mapping[int, Row]) -> Html:
    """Return the critical path as a table."""
    acting = sum(link.task.acted - link.task.begun for link in time.chain)
    links = time.chain[-_MOST_LINKS:]
    text = (
        f"Critical path: {counted(len(time.chain), 'step')} one after the other, {acting:.3f} s of acting in "
        f"{time.seconds:.3f} s. What makes one of them shorter makes the run shorter, until another path is longer."
    )
    caption = "Each began when the one before it had ended, or when what lay between was over"
    head = ["robot", "#", "step", "waited before", "acted", "ended at"]
    shown = table(caption, head, [_link(one, rows) for one in links], numbers=(3, 4, 5), kind="long")
    more = len(time.chain) - len(links)
    return join(
        [
            el("p", text),
            fold("The critical path, step by step", f"{more} steps before these" if more else NOTHING, shown),
        ]
    )


def _link(link: Link, rows: Mapping[int, Row]) -> list[Child]:
    task, row = link.task, rows.get(link.task.number)
    what = el("code", row.what) if row is not None else NOTHING
    times = (link.gap, task.acted - task.begun, task.acted)
    return [task.robot, task.number, what, *(seconds(round(one, 3)) for one in times)]
