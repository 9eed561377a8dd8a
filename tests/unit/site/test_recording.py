"""The recording of a terminal: what was printed is what the picture shows, and it holds nothing else."""

from __future__ import annotations

import itertools
import os
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tools.recording.__main__ import commands
from tools.recording.svg import LAST_S, drawn
from tools.recording.terminal import LONGEST_S, PAUSE_S, Recording

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


def test_the_recorded_commands_are_those_of_the_demo() -> None:
    listed = commands()
    assert [line.split()[1] for line in listed] == ["apply", "status", "wait", "logs", "apply"]
    assert all("examples/chatter-ros/experiment.edf -i inventory/lab.yml" in line for line in listed)
