"""Where the files that ship with srprov lie: schemas, playbooks and examples.

Takes a kind's name; gives its content or folder. Touches srprov's own files, for reading. An installed wheel carries
them in `srprov/_data/`; a checkout has them at its top level.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from srprov.codes import Code
from srprov.errors import UsageError, did_you_mean

_HERE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    installed = _HERE / "_data" / name
    return installed if installed.is_dir() else _HERE.parent / name


def playbooks_folder() -> Path:
    """Return the folder of the playbooks that ship with srprov."""
    return _folder("playbooks")


def example_names() -> tuple[str, ...]:
    """Name every example that there is, in name order."""
    return tuple(sorted(path.parent.name for path in _folder("examples").glob("*/experiment.edf")))


def example_files(name: str) -> dict[str, bytes]:
    """Return the files of an example, the experiment first, by their path in its folder.

    Raises:
        UsageError: There is no such example; the hint names those that exist.
    """
    if name not in example_names():
        raise UsageError(
            f"there is no example named '{name[:60]}'",
            hint=f"there are: {', '.join(example_names())}",
            code=Code.OPTION_VALUE,
        )
    folder = _folder("examples") / name
    paths = sorted((one for one in folder.rglob("*") if one.is_file() and "__pycache__" not in one.parts),
                   key=lambda one: (one.name != "experiment.edf", one))  # fmt: skip
    return {str(one.relative_to(folder)): one.read_bytes() for one in paths}


def schema_kinds() -> tuple[str, ...]:
    """Name every schema that there is, in name order: `cdf`, `edf`, `inventory-vars` and so on."""
    return tuple(sorted(path.name.removesuffix(".schema.json") for path in _folder("schemas").glob("*.schema.json")))


@cache
def schema(kind: str) -> dict[str, Any]:
    """Return one JSON Schema by its kind; callers share the object and must not change it.

    Raises:
        UsageError: There is no such kind; the hint names those that exist.
    """
    content = json.loads(schema_text(kind))
    assert isinstance(content, dict)
    return content


@cache
def schema_text(kind: str) -> str:
    """Return one JSON Schema as it is written.

    Raises:
        UsageError: There is no such kind; the hint names those that exist.
    """
    return schema_path(kind).read_text(encoding="utf-8")


def schema_path(kind: str) -> Path:
    """Return the file of one JSON Schema.

    Raises:
        UsageError: There is no such kind; the hint names those that exist.
    """
    if kind not in schema_kinds():
        hint = did_you_mean(kind, schema_kinds()) or f"known: {', '.join(schema_kinds())}"
        raise UsageError(f"there is no schema named '{kind}'", hint=hint, code=Code.OPTION_VALUE)
    return _folder("schemas") / f"{kind}.schema.json"
