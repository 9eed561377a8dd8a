"""Material -> one HTML page. Pure; equal material gives equal bytes."""

from __future__ import annotations

from srprov import __version__
from srprov.report.changes import changes, failures, rows_of
from srprov.report.embed import link
from srprov.report.head import head, title
from srprov.report.html import Html, document, el, join, style
from srprov.report.lanes import lanes
from srprov.report.material import Material
from srprov.report.parts import Section
from srprov.report.placement import asks, placement
from srprov.report.probe import probe
from srprov.report.rest import images, limits, origin, robots
from srprov.report.style import RULES, policy
from srprov.report.timeline import timeline
from srprov.report.trials import trials


def page(material: Material) -> str:
    """Return a page as the text of a file."""
    sections = _sections(material)
    links = [el("li", el("a", one.title, href=f"#{one.id}")) for one in sections]
    body = [
        el("header", head(material), el("nav", el("ul", links), aria_label="Sections")),
        el("main", [_section(one) for one in sections]),
        el("footer", el("p", "All that this page is about, as data: ", link(material.data_name, material.data), "."),
           el("p", f"Made by srprov {__version__}. The page loads nothing and runs nothing.")),
    ]  # fmt: skip
    return document(el("html", _head(material), el("body", body), lang="en"))


def _head(material: Material) -> Html:
    return el(
        "head",
        el("meta", charset="utf-8"),
        el("meta", http_equiv="Content-Security-Policy", content=policy()),
        el("meta", name="viewport", content="width=device-width, initial-scale=1"),
        el("meta", name="color-scheme", content="light dark"),
        el("meta", name="referrer", content="no-referrer"),
        el("meta", name="generator", content=f"srprov {__version__}"),
        el("link", rel="icon", href="data:,"),
        el("title", title(material)),
        style(RULES),
    )


def _sections(material: Material) -> list[Section]:
    rows = rows_of(material)
    time = timeline(material.events, material.plan.steps if material.plan else ()) if material.events else None
    result = material.result
    found = [
        failures(material),
        *trials(material),
        placement(material),
        asks(material),
        changes(material, time.tasks if time is not None else {}),
        lanes(
            time,
            {one.number: one for one in rows},
            result.phases if result is not None else {},
            len(result.robots) if result is not None else len(time.lanes) if time is not None else 0,
        ),
        probe(material),
        images(material, rows),
        robots(material),
        origin(material),
        limits(material),
    ]
    return [one for one in found if one is not None]


def _section(one: Section) -> Html:
    return join(
        [
            el(
                "section",
                el("h2", one.title, id=f"{one.id}-title"),
                one.body,
                id=one.id,
                aria_labelledby=f"{one.id}-title",
            )
        ]
    )
