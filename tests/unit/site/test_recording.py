"""The recording of a terminal: what was printed is what the picture shows, and it holds nothing else."""

from __future__ import annotations

import itertools
import os
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tools.recording.__main__ import HOST, PLACE, ROOT, USER, commands
from tools.recording.svg import LAST_S, drawn
from tools.recording.terminal import LONGEST_S, PAUSE_S, PROGRESS_S, SHORTEST_S, Recording, Span

SVG = "{http://www.w3.org/2000/svg}"


def shown(picture: str) -> list[str]:
    """Return the texts of a picture's rows."""
    root = ElementTree.fromstring(picture)
    return ["".join(span.text or "" for span in text) for text in root.iter(f"{SVG}text")]


def hostile(recording: Recording, folder: Path) -> int:
    script = r"printf '\033[31mred\033[0m <script>alert(1)</script> & \302\233x\n'; sleep 1.8; echo late; exit 3"
    return recording.run(script, folder, dict(os.environ))


def test_what_is_printed_is_shown_and_is_text_only(tmp_path: Path) -> None:
    recording = Recording(80, 5)
    assert hostile(recording, tmp_path) == 3
    picture = drawn(recording.frames, 80, "a <title>", "& more")
    rows = shown(picture)
    assert any("red<script>alert(1)</script>" in row.replace(" ", "") for row in rows) and "late" in rows
    elements = {element.tag.removeprefix(SVG) for element in ElementTree.fromstring(picture).iter()}
    assert elements <= {"svg", "title", "desc", "style", "defs", "text", "tspan", "clipPath", "rect", "g", "use"}
    assert 'fill="#ff7b72"' in picture and "<title" in picture and "a &lt;title&gt;" in picture


def test_waiting_is_shortened_and_the_last_screen_stands(tmp_path: Path) -> None:
    recording = Recording(80, 5)
    hostile(recording, tmp_path)
    times = [at for at, _ in recording.frames]
    assert times == sorted(times) and max(b - a for a, b in itertools.pairwise(times)) <= LONGEST_S + PAUSE_S
    picture = drawn(recording.frames, 80, "t", "d")
    whole = re.search(r"animation:s ([0-9.]+)s", picture)
    assert whole and float(whole[1]) == pytest.approx(times[-1] - times[0] + LAST_S, abs=0.01)
    assert picture.count("%{transform") == len(times) + 1 and "prefers-reduced-motion" in picture


def test_a_line_that_tells_progress_is_run_through(tmp_path: Path) -> None:
    """What else takes its time keeps it, and so does what comes after."""
    recording = Recording(80, 5)
    screens = [(0.0, "$ build"), *((1.0 + at / 10, f"$ build\n{at} of 400") for at in range(401)), (42.0, "$ end\nof")]
    recording.frames = [(at, (*((Span(row, "default", False),) for row in f"{text}\n".split("\n")[:2]),))
                        for at, text in screens]  # fmt: skip
    shown = recording.shown()
    assert shown[-1][0] == pytest.approx(PROGRESS_S + 1.0) and shown[-1][1] == recording.frames[-1][1]
    assert (shown[0], shown[-2][1]) == (recording.frames[0], recording.frames[-2][1])
    assert all(later - at >= SHORTEST_S for (at, _), (later, _) in itertools.pairwise(shown[:-2]))
    assert recording.frames[-1][0] == 42.0, "the recording is as it was"


def test_the_picture_of_the_readme_names_no_machine() -> None:
    picture = (ROOT / "docs/media/demo.svg").read_text(encoding="utf-8")
    rows = shown(picture)
    assert {row for row in rows if "@" in row} == {
        row for row in rows if f"(from {USER}@{HOST}:{PLACE}/examples/" in row
    }
    assert not re.search(r"/(tmp|home|root|work|var/folders)/", "\n".join(rows))
    assert any("hello from talker" in row for row in rows) and any("0 changed, 21 unchanged" in row for row in rows)
    assert "](docs/media/demo.svg)" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_recorded_commands_are_those_of_the_demo() -> None:
    listed = commands()
    assert [line.split()[1] for line in listed] == ["apply", "status", "wait", "logs", "apply"]
    assert all("examples/chatter-ros/experiment.edf -i inventory/lab.yml" in line for line in listed)
