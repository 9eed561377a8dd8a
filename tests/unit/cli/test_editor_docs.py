"""The settings in docs/editors.md are those that srprov prints, and its task reads what `validate` says."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.editor_settings import editor_settings
from srprov.cli.main import run

MANUAL = (Path(__file__).parents[3] / "docs/editors.md").read_text(encoding="utf-8")


def blocks() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the manual's settings.json and tasks.json."""
    settings, tasks = (json.loads(block.split("```")[0]) for block in MANUAL.split("```json\n")[1:])
    return settings, tasks


def test_the_manuals_settings_are_the_printed_ones() -> None:
    settings, _ = blocks()
    addresses = {kind: f".vscode/{kind}.schema.json" for kind in ("edf", "cdf")}
    assert settings == json.loads(editor_settings("vscode", addresses))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("edf: 1\nname: a\nservices: {a: {image: x, cots: 3}}\n", ("3", "26", "error", "unknown key 'cots'")),
        ("edf: 1\nname: a\nservices: {a: {image: x, environment: {A: '${B}'}}}\n", ("3", "43", "warning", "")),
    ],
)
def test_the_manuals_task_reads_what_validate_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, found: tuple[str, ...]
) -> None:
    _, tasks = blocks()
    (task,) = tasks["tasks"]
    pattern = task["problemMatcher"]["pattern"]
    file = tmp_path / "an experiment.edf"
    file.write_text(text)
    run([word.replace("${file}", str(file)) for word in task["args"]])
    matches = [match for line in capsys.readouterr().out.splitlines() if (match := re.match(pattern["regexp"], line))]
    (match,) = matches
    told = {name: match[group] for name, group in pattern.items() if name != "regexp"}
    assert (told["line"], told["column"], told["severity"]) == found[:3] and found[3] in told["message"]
    assert Path(told["file"]) == file
