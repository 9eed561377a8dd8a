"""Experiments in a folder, exported; what Compose would read of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from srprov.controller import compose
from srprov.exporting.model import Export
from srprov.exporting.report import report_json

HEAD = "edf: 1\nname: demo\n"


def experiment(folder: Path, text: str, **files: str) -> Path:
    """Write an EDF with the files beside it, `__` in names for a slash and `_dot_` for a dot; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        path = folder / name.replace("__", "/").replace("_dot_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    edf = folder / "demo.edf"
    edf.write_text(text if "edf:" in text else HEAD + text)
    return edf


def twin(edf: Path, *allowed: str, profiles: tuple[str, ...] = ()) -> Export:
    return compose.twin(compose.read(str(edf), frozenset(allowed), profiles))


def document(export: Export, robot: str = "") -> dict[str, Any]:
    """Return a machine's Compose file as YAML reads it, with `$$` as Compose has it."""
    path = f"{robot}/compose.yml" if robot else "compose.yml"
    text = next(file.content.decode() for file in export.files if file.path == path)
    found = yaml.safe_load(text)
    assert isinstance(found, dict)
    return found


def classes(export: Export) -> dict[str, str]:
    """Return field -> class, of all that the report has."""
    return {one["field"]: one["class"] for one in report_json(export)["fields"]}


def notes(export: Export) -> dict[str, str]:
    """Return field -> what is said of it."""
    return {one["field"]: one["note"] for one in report_json(export)["fields"]}


def contents(export: Export) -> dict[str, bytes]:
    return {file.path: file.content for file in export.files}
