"""The overlay as it was tried: who reached whom, and how fast, as a heat map. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

from srprov.report.html import NOTHING, Child, Html, el, join
from srprov.report.material import Material
from srprov.report.model import PairView, ProbeView
from srprov.report.parts import Section, captioned, facts, listed, scrolled, table
from srprov.report.words import counted, natural, number, pointer, seconds

_MOST_ENDS = 40
"""Rows and columns of the heat map; with more of them, robots stand for their services, and then only failures show."""
_SHADES = 5
_MOST_FAILED = 500
_UNDERLAY = "underlay"


class _Cell:
    """What is known of all pairs between two places."""

    __slots__ = ("failed", "longest")

    def __init__(self) -> None:
        self.failed: list[str] = []
        self.longest: float | None = None

    def add(self, pair: PairView) -> None:
        """Add a pair."""
        self.failed += pair.failed
        if pair.rtt_ms is not None:
            self.longest = max(self.longest or 0.0, pair.rtt_ms[1])


def probe(material: Material) -> Section | None:
    """Return what came of trying the overlay; None where it was not tried."""
    said = material.probe
    if said is None:
        return None
    parts = [_sums(said, material), _map(said), _failed(said.pairs)]
    if said.causes:
        parts.append(
            listed(
                [[cause.text, el("br"), el("span", cause.hint, class_="soft")] for cause in said.causes[:_MOST_FAILED]]
            )
        )
    away = {**said.left_out, **said.unreachable}
    if away:
        parts += [el("h3", "Not tried"), listed(f"{name}: {why}" for name, why in sorted(away.items())[:_MOST_FAILED])]
    return Section(id="network", title="Network", body=join(parts))


def _sums(said: ProbeView, material: Material) -> Html:
    ended = material.result.probe if material.result is not None else None
    works = [one.rtt_ms for one in said.pairs if one.rtt_ms is not None]
    failed = sum(bool(one.failed) for one in said.pairs)
    of = pointer("probe", "pairs") if ended is not None and ended.pairs == len(said.pairs) else None
    of_failed = pointer("probe", "failed") if ended is not None and ended.failed == failed else None
    pairs: Child = [number(failed, of=of_failed), " of ", number(len(said.pairs), of=of), " do not work"]
    sent, received = sum(one.sent for one in said.pairs), sum(one.received for one in said.pairs)
    shown: list[tuple[str, Child]] = [
        ("pairs", pairs),
        ("packets lost", [number(sent - received), " of ", number(sent)]),
        ("largest packet", [number(said.mtu), " bytes"]),
        ("took", seconds(said.duration_s, of=pointer("probe", "duration_s") if ended is not None else None)),
    ]
    if works:
        middle, most = median(one[1] for one in works), max(one[2] for one in works)
        trips: Child = [
            number(middle, f"{middle:.3f} ms"),
            " in the middle, ",
            number(most, f"{most:.3f} ms"),
            " at most",
        ]
        shown.insert(1, ("round trips", trips))
    return facts(shown)


def _map(said: ProbeView) -> Html:
    """Return the heat map: between all that took part, else between robots, else none."""
    home = {one.name: one.robot for one in said.endpoints if one.kind != _UNDERLAY}
    names = sorted(home, key=natural)
    if len(names) > _MOST_ENDS:
        names = sorted(set(home.values()), key=natural)
        of = home
    else:
        of = {name: name for name in home}
    if len(names) > _MOST_ENDS:
        text = f"{len(names)} robots are too many for a map; what does not work is listed."
        return el("p", text, class_="soft")
    cells: dict[tuple[str, str], _Cell] = {}
    for pair in said.pairs:
        where = (of.get(pair.source, pair.source), of.get(pair.target, pair.target))
        cells.setdefault(where, _Cell()).add(pair)
    return _table(names, cells)


def _table(names: Sequence[str], cells: Mapping[tuple[str, str], _Cell]) -> Html:
    times = sorted(one.longest for one in cells.values() if one.longest is not None)
    head = el("tr", el("th", "from \\ to", scope="col"), [el("th", name, scope="col") for name in names])
    rows = [
        el("tr", el("th", source, scope="row"), [_cell(cells.get((source, target)), times) for target in names])
        for source in names
    ]
    caption = "Mean round trip in ms; ✕ is what does not work"
    grid = el("table", captioned(caption), el("thead", head), el("tbody", rows), class_="grid heat")
    return join([_key(times), scrolled("Round trips between all places", grid)])


def _cell(one: _Cell | None, times: Sequence[float]) -> Html:
    if one is None:
        return el("td", "·", class_="none")
    if one.failed:
        return el("td", f"✕ {one.failed[0]}", class_="x")
    if one.longest is None:
        return el("td", "?", class_="none")
    return el("td", number(one.longest, f"{one.longest:.2f}"), class_=f"h{_shade(one.longest, times)}")


def _bounds(times: Sequence[float]) -> list[float]:
    """Return the times at which shades change: a fifth of all cells each, as a few slow ones would hide the rest."""
    return [times[min(len(times) - 1, len(times) * share // _SHADES)] for share in range(1, _SHADES)]


def _shade(value: float, times: Sequence[float]) -> int:
    return 1 + sum(value >= bound for bound in _bounds(times)) if len(set(times)) > 1 else 1


def _key(times: Sequence[float]) -> Html:
    if len(set(times)) < _SHADES:
        return NOTHING
    bounds = _bounds(times)
    words = [f"below {bounds[0]:.2f}", *(f"from {bound:.2f}" for bound in bounds)]
    return el("p", [el("span", el("span", word, class_=f"h{at}"), class_="key") for at, word in enumerate(words, 1)])


def _failed(pairs: Sequence[PairView]) -> Html:
    bad = [one for one in pairs if one.failed]
    if not bad:
        return NOTHING
    rows = [[one.source, one.target, ", ".join(one.failed)] for one in bad[:_MOST_FAILED]]
    more = len(bad) - _MOST_FAILED
    shown = table(f"{counted(len(bad), 'pair')} that do not work", ["from", "to", "what fails"], rows)
    return join([shown, el("p", f"and {more} more, in probe.json") if more > 0 else NOTHING])
