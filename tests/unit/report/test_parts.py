"""The parts of a page: markup that data cannot make, stretches of time, names, and the critical path."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from srprov.report import html
from srprov.report.html import Html, cut, document, el, join, lines, style, text
from srprov.report.model import EventView, Need, PlannedStep
from srprov.report.spans import total, united, without
from srprov.report.style import RULES
from srprov.report.timeline import Timeline, timeline
from srprov.report.words import exactly, moment, number, ranges, seconds, size

ROOM = Path(html.__file__).parent


def test_markup_is_made_in_one_file_only() -> None:
    """Nothing else makes an Html of a text, so nothing else can forget to escape one."""
    made = [
        path.name
        for path in sorted(ROOM.glob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Html"
    ]
    assert set(made) == {"html.py"}
    assert not [path.name for path in ROOM.glob("*.py") if path.name != "html.py" and ".markup" in path.read_text()]


def test_names_of_elements_and_attributes_are_the_programs_own() -> None:
    """Those of the source alone: each is a literal, or a name of the file that makes it."""
    for path in sorted(ROOM.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "el":
                assert isinstance(node.args[0], ast.Constant), f"{path.name}:{node.lineno}"
                assert all(one.arg for one in node.keywords), f"{path.name}:{node.lineno}: **attributes"
    for tag in ("script", "img", "iframe", "p onclick=x", "a><b", ""):
        with pytest.raises(ValueError, match="no element"):
            el(tag)
    for name in ("onclick", "src", "style", "x y", "hre f"):
        with pytest.raises(ValueError, match="no attribute"):
            el("p", **{name: "1"})


@pytest.mark.parametrize(
    "address", ["https://a.b", "//a.b", "javascript:alert(1)", "data:text/html,<b>", " #a", "/etc/passwd", "DATA:,"]
)
def test_no_address_leads_out_of_a_page(address: str) -> None:
    with pytest.raises(ValueError, match="leads out"):
        el("a", "x", href=address)


def test_text_is_escaped_wherever_it_stands() -> None:
    made = el("td", "<b>&'\"\x1b\u202e", ["a<", None, 3, el("b", ">")], title='"><script>', class_=None, open=False)
    assert made.markup == (
        '<td title="&quot;&gt;&lt;script&gt;">&lt;b&gt;&amp;&#x27;&quot;\\x1b\\u202ea&lt;3<b>&gt;</b></td>'
    )
    assert el("details", open=True, data_of="/a").markup == '<details open data-of="/a"></details>'
    assert el("br").markup == "<br>" and el("path", d="M0 0").markup == '<path d="M0 0"/>'
    assert text("a\nb").markup == "a\\nb" and lines("a<\nb\r").markup == "a&lt;\nb\\r"
    assert join(["<", Html("<i>"), [1, "&"]]).markup == "&lt;<i>1&amp;"
    assert cut("x" * 500, 3) == "xxx… (497 more characters)"
    with pytest.raises(ValueError, match="no <"):
        style("p{}</style>")
    assert document(el("html")) == "<!doctype html>\n<html></html>\n"


def test_stretches_of_time_are_united_and_taken_from_each_other() -> None:
    assert united([(3, 4), (0, 1), (1, 2), (5, 5), (3.5, 6), (9, 8)]) == [(0, 2), (3, 6)]
    assert without([(0, 10)], [(1, 2), (4, 6), (9, 12)]) == [(0, 1), (2, 4), (6, 9)]
    assert without([(0, 2), (3, 5)], [(1, 4)]) == [(0, 1), (4, 5)]
    assert without([(0, 2), (3, 5)], []) == [(0, 2), (3, 5)] and without([], [(0, 1)]) == []
    assert total([(0, 1.5), (2, 3)]) == 2.5


def test_names_are_folded_and_numbers_keep_their_value() -> None:
    assert ranges(["robot10", "robot2", "robot1", "robot3", "base", "robot9"]) == "base, robot[1-3], robot9, robot10"
    assert ranges([f"a{at}x" for at in range(20)]).endswith(" and 8 more")
    assert ranges([]) == "" and ranges(["\u0663", "7"]) == "7, \u0663"
    assert (
        size(1536).markup == '<data value="1536">1.5 KiB</data>' and size(7).markup == '<data value="7">7 bytes</data>'
    )
    assert seconds(1.5, of="/a/b").markup == '<data value="1.5" data-of="/a/b">1.500 s</data>'
    assert number(float("nan")).markup == '<data value="no number">no number</data>' and exactly(1e17) == "1e+17"
    assert moment("2026-11-23T18:50:56+01:00").markup == (
        '<time datetime="2026-11-23T17:50:56Z">2026-11-23 17:50:56 UTC</time>'
    )
    assert moment("<b>").markup == "<span>&lt;b&gt;</span>"


def events(*done: tuple[int, str, float, float, float]) -> list[EventView]:
    """Return events of steps: number, robot, begun, acted, ended."""
    found = []
    for number_, robot, begun, acted, end in done:
        found.append(EventView(time=1000 + begun, event="start", robot=robot, step=number_))
        found.append(EventView(time=1000 + end, event="end", robot=robot, step=number_, duration_s=acted))
    return sorted(found, key=lambda one: one.time)


def step(number_: int, robot: str, needs: tuple[int, ...] = (), waits: tuple[Need, ...] = ()) -> PlannedStep:
    return PlannedStep(
        number=number_, robot=robot, module="file", name=f"f{number_}", action="create", needs=needs, waits=waits
    )


def found(*args: object) -> Timeline:
    made = timeline(*args)  # type: ignore[arg-type]  # a helper of tests
    assert made is not None
    return made


def test_a_robots_time_is_acting_checking_and_waiting() -> None:
    done = events((1, "a", 0.0, 1.0, 1.5), (2, "b", 0.0, 2.0, 2.25), (3, "a", 3.0, 0.5, 4.0))
    steps = [step(1, "a"), step(2, "b"), step(3, "a", (2,))]
    made = found(done, steps)
    (a, b) = made.lanes
    assert (a.robot, a.acting, a.checking, a.awaiting) == (
        "a", [(0, 1), (3, 3.5)], [(1, 1.5), (3.5, 4)], [(1.5, 3)]
    )  # fmt: skip
    assert (a.end, a.waiting_s, b.waiting_s, made.seconds) == (4.0, 1.5, 0.0, 4.0)
    assert found(done).lanes[0].awaiting == [], "without a plan nobody knows what it waited for"
    told = [*done, EventView(time=1002, event="waiting", robot="a", step=3)]
    assert found(sorted(told, key=lambda one: one.time)).lanes[0].awaiting == [(2, 3)]


def test_the_critical_path_goes_over_robots_where_a_step_needs_another() -> None:
    done = events(
        (1, "a", 0.0, 1.0, 1.1), (2, "b", 0.0, 3.0, 3.1), (3, "a", 3.2, 1.0, 4.3), (4, "c", 0.0, 2.0, 2.1),
        (5, "c", 4.4, 0.5, 5.0),
    )  # fmt: skip
    steps = [
        step(1, "a"),
        step(2, "b"),
        step(3, "a", (1, 2)),
        step(4, "c"),
        step(5, "c", (4,), (Need("a/file:f3", "started"),)),
    ]
    chain = found(done, steps).chain
    assert [link.task.number for link in chain] == [2, 3, 5]
    assert [round(link.gap, 3) for link in chain] == [0.0, 0.2, 0.2]
    assert [link.task.number for link in found(done).chain] == [4, 5], "without a plan, the robot's own steps"


def test_events_that_make_no_sense_make_no_time_line() -> None:
    assert timeline([]) is None
    assert timeline([EventView(time=float(2**80), event="start", robot="a", step=1)]) is None
    assert timeline([EventView(time=1.0, event="end", robot="a", step=1)]) is None
    backwards = [
        EventView(time=9.0, event="start", robot="a", step=1),
        EventView(time=5.0, event="end", robot="a", step=1),
    ]
    (lane,) = found(backwards).lanes
    assert lane.acting == [] and lane.end == 4.0
    same = events(*((at, "a", 0.0, 0.0, 0.0) for at in range(1, 2001)))
    assert len(found(same).chain) == 1, "steps that were begun in one moment are not before each other"


def test_the_sheet_loads_nothing() -> None:
    assert "url(" not in RULES and "@import" not in RULES and "expression" not in RULES


def test_a_file_of_a_picture_is_xml() -> None:
    root = ET.fromstring(html.picture(el("svg", el("text", "<&\x00"), xmlns="http://www.w3.org/2000/svg")))
    assert "".join(root.itertext()) == "<&\\x00"
