"""An EDF -> the name of its instance, and nothing else.

`destroy`, `status` and `logs` must work when the EDF was edited in between, even when it is no longer valid: all
they need of it is the name. Reads the file.
"""

from __future__ import annotations

import re

from srprov import names, regular_file
from srprov.codes import Code
from srprov.errors import DefinitionError, UsageError
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Map, Scalar

_LINE = re.compile(r"""^name\s*:\s*(["']?)([a-z0-9][a-z0-9-]{0,31})\1\s*(?:#.*)?$""", re.MULTILINE)
"""What is looked for in a file that is no YAML any more."""


def experiment_name(path: str) -> str:
    """Return the `name` at the top level of an EDF.

    Raises:
        UsageError: The file cannot be read, or holds no valid name, neither as YAML nor in a line `name: …`.
    """
    try:
        text = regular_file.read_text(path, loader.MAX_BYTES, "replace")
    except OSError as error:
        raise UsageError(
            f"cannot read {path}: {error.strerror}", hint="name an EDF, or --instance ID", code=Code.NO_FILE
        ) from error
    name = _as_yaml(text, path)
    if names.valid("instance", name):
        return name
    found = _LINE.search(text)
    if found is None:
        raise UsageError(
            f"{path} has no line `name: …` with a valid name",
            hint="name the instance with --instance ID",
            code=Code.WHICH,
        )
    return found[2]


def _as_yaml(text: str, path: str) -> str:
    try:
        root = loader.parse(text, path)
    except DefinitionError:
        return ""
    name = root.entries.get("name") if isinstance(root, Map) else None
    return name.text if isinstance(name, Scalar) else ""
