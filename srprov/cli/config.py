"""Defaults from files: the user's own configuration, then the project's.

    ~/.config/srprov/srprov.toml    the user's (XDG_CONFIG_HOME is honoured)
    ~/.config/srprov/playbooks/     the user's own playbooks, see docs/playbooks.md
    ./srprov.toml                   the project's
    ./pyproject.toml                the project's, in its table [tool.srprov]

A key is an option's long name with `_` for `-`; a table named like a verb holds for that verb alone. A flag on the
command line wins, then `SRPROV_<VERB>_<OPTION>` in the environment, then the project, then the user.

A project's file may come from a stranger: what gives permission (`allow`, `yes`, `adopt`, `volumes`) counts only in
the user's own.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from srprov.errors import UsageError

PERMISSIONS = ("allow", "yes", "adopt", "volumes")


def default_map(verbs: Mapping[str, Any], folder: Path, environ: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return click's default map: verb -> option -> value.

    Raises:
        UsageError: A file that cannot be read as TOML, or a project's file that gives permission.
    """
    own = user_folder(environ) / "srprov.toml"
    defaults: dict[str, dict[str, Any]] = {verb: {} for verb in verbs}
    for path, table, trusted in (
        (own, _read(own), True),
        (folder / "pyproject.toml", _tool(_read(folder / "pyproject.toml")), False),
        (folder / "srprov.toml", _read(folder / "srprov.toml"), False),
    ):
        if not trusted:
            _check_project(path, table, verbs)
        everywhere = {key: value for key, value in table.items() if not isinstance(value, dict)}
        for verb, chosen in defaults.items():
            section = table.get(verb)
            here = {**everywhere, **(section if isinstance(section, dict) else {})}
            chosen.update({_parameter(key): value for key, value in here.items()})
    return defaults


def user_folder(environ: Mapping[str, str]) -> Path:
    """Return the user's own folder for srprov: `~/.config/srprov`, or below XDG_CONFIG_HOME."""
    return Path(environ.get("XDG_CONFIG_HOME") or Path(environ.get("HOME", "/")) / ".config") / "srprov"


def _parameter(key: str) -> str:
    """Return click's parameter of an option's name; three options have another name in the code."""
    return {"inventory": "inventories", "json": "as_json", "format": "form"}.get(key, key.replace("-", "_"))


def _tool(document: Mapping[str, Any]) -> dict[str, Any]:
    tool = document.get("tool")
    ours = tool.get("srprov") if isinstance(tool, dict) else None
    return ours if isinstance(ours, dict) else {}


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    # tomllib came with Python 3.11; tomli is the same library for 3.10
    toml = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    try:
        document = toml.loads(path.read_text(encoding="utf-8"))
        return document if isinstance(document, dict) else {}
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {path}: {error}", hint="fix it, or move it away") from error


def _check_project(path: Path, table: Mapping[str, Any], verbs: Mapping[str, Any]) -> None:
    sections = [table, *(table[verb] for verb in verbs if isinstance(table.get(verb), dict))]
    given = sorted({key for section in sections for key in section if key in PERMISSIONS})
    if given:
        raise UsageError(
            f"{path} gives permission ({', '.join(given)}), and a project's file may come from a stranger",
            hint="say it on the command line, or in your own ~/.config/srprov/srprov.toml",
        )
