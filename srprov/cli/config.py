"""Defaults from files: the user's own configuration, then the project's.

    ~/.config/srprov/srprov.toml    the user's (XDG_CONFIG_HOME is honoured)
    ~/.config/srprov/playbooks/     the user's own playbooks, see docs/playbooks.md
    ./srprov.toml                   the project's
    ./pyproject.toml                the project's, in its table [tool.srprov]

A key is an option's long name; a table named like a verb holds for that verb alone. A flag on the command line wins,
then `SRPROV_<VERB>_<OPTION>` in the environment, then the project, then the user; of an inventory first the user.

A project's file may come from a stranger: it may set PROJECT_KEYS and nothing else. None of them runs or writes
anything, gives permission, or names an instance. The inventory that it names lies in its folder and runs nothing, see
`inputs.load_inventory`.
"""

from __future__ import annotations

import importlib
import itertools
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from srprov import regular_file
from srprov.cli.standing import stand
from srprov.cli.toml_text import check_parts, line
from srprov.cli.whose_settings import check_owner
from srprov.codes import Code
from srprov.errors import UsageError, did_you_mean

PROJECT_KEYS = frozenset(
    ("inventory", "forks", "timeout", "wait-timeout", "settle", "lock-wait", "time-limit", "max-fail", "format",
     "verbose", "explain", "timings", "no-color", "tail", "locked", "workers")
)  # fmt: skip
OWN_KEYS = PROJECT_KEYS | {
    *("allow", "yes", "adopt", "data", "volumes", "unreachable", "reassign", "ask-become-pass", "limit", "exclude"),
    *("copy", "instance", "runs", "events", "out", "sign", "signers", "svg", "png", "history", "facts", "update"),
    *("quiet", "json", "detailed-exitcode", "exit-code", "pareto", "follow", "stop-timeout", "resume", "only", "show"),
    *("older-than", "cache", "since", "timestamps", "until", "env", "user", "workdir", "tty", "metric", "over"),
    *("discard", "rerun", "reason", "accept-changes", "rotate-keys", "no-probe", "network", "profile"),
    *("margin", "strict", "with", "map", "twin", "set", "name", "env-file", "robot-map", "root", "home", "lab"),
    *("preserve", "check", "diff", "example", "owner"),
    *("with-images", "no-bundled-images", "editor", "changed", "target", "expect", "extract", "wide", "all-instances"),
    *("lossy", "connect-rate", "engine", "site", "host", "port", "no-secret", "watch"),
}
PARAMETERS = {"inventory": "inventories", "json": "as_json", "format": "form", "out": "target", "facts": "stored",
              "profile": "profiles", "margin": "margins", "with": "others", "map": "pairs",
              "set": "settings", "env-file": "env_files", "with-images": "way",
              "target": "targets", "all-instances": "every"}  # fmt: skip
"""Options that have another name in the code."""
_LISTS = ("inventory", "allow", "until", "env", "profile", "margin", "with", "map", "set", "env-file", "target")
_GROUPS = {"export": ("compose", "kubernetes", "swarm"), "import": ("compose", "swarmrob")}
"""Verbs that stand for several: what is set for one holds for those."""
_MOST = {"workers": os.cpu_count() or 1, "forks": 512}  # of a project's file: processes and threads of this machine
OWN_FIRST = ("inventories",)  # here the user's own file is stronger where what it has stands: robots get his secrets
_SWITCHES = ("locked",)  # a project's file may ask for it, and not do without what the user's own asks for
_MOST_BYTES, _MOST_FAULTS, _BEYOND = 1 << 20, 20, 1e15
_MOST_ENTRIES, _LONGEST = 64, 4096  # of a list, and characters of a text


class ConfigFile(msgspec.Struct, frozen=True, kw_only=True):
    """One configuration file, and which of its keys count."""

    path: Path
    table: str = ""
    """The table of a shared file that is ours; empty: all of it."""
    own: bool = False
    """The user's, not a project's."""


def default_map(verbs: Mapping[str, Any], folder: Path, environ: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return click's default map: verb -> option -> value.

    Raises:
        UsageError: A file that is no TOML, that somebody else could have written, or that sets what it may not.
    """
    defaults, mine = ({verb: dict[str, Any]() for verb in verbs} for _ in range(2))
    for file in files(folder, environ):
        table, _ = read_table(file, verbs)
        for verb, chosen in defaults.items():
            chosen.update(set_for(verb, table, file))
            chosen.update(mine[verb])
            mine[verb] |= {key: chosen[key] for key in OWN_FIRST if file.own and stand(chosen.get(key, ()))}
    return {**defaults, **{group: dict.fromkeys(verbs_below, defaults[group]) for group, verbs_below in _GROUPS.items()
                           if group in defaults}}  # fmt: skip


def files(folder: Path, environ: Mapping[str, str]) -> tuple[ConfigFile, ...]:
    """Return the files that configure srprov in a folder, from weak to strong; none of them need be there."""
    return (
        ConfigFile(path=user_folder(environ) / "srprov.toml", own=True),
        ConfigFile(path=folder / "pyproject.toml", table="tool.srprov"),
        ConfigFile(path=folder / "srprov.toml"),
    )


def places(verbs: Mapping[str, Any], file: ConfigFile) -> dict[tuple[str, str], int]:
    """Return verb and parameter -> the line of a file that sets it, where the file does.

    Raises:
        UsageError: As `default_map`.
    """
    table, text = read_table(file, verbs)
    lines: dict[tuple[str, str], int] = {}
    everywhere = {key: value for key, value in table.items() if not isinstance(value, dict)}
    for verb in verbs:
        for name, some in (("", everywhere), (verb, _of_verb(table, verb))):
            at = f"{file.table}.{name}".strip(".")
            lines |= {(verb, _parameter(key)): line(text, at, key) for key in some}
    return lines


def set_for(verb: str, table: Mapping[str, Any], file: ConfigFile) -> dict[str, Any]:
    """Return parameter -> what the table of a file, as `read_table` gives it, sets for a verb."""
    here = {**{key: one for key, one in table.items() if not isinstance(one, dict)}, **_of_verb(table, verb)}
    return {_parameter(key): _value(key, value, file) for key, value in here.items()}


def _of_verb(table: Mapping[str, Any], verb: str) -> Mapping[str, Any]:
    """Return a verb's own table; options such as `explain` and `runs` have the name of a verb, and are none."""
    own = table.get(verb)
    return own if isinstance(own, dict) else {}


def user_folder(environ: Mapping[str, str]) -> Path:
    """Return the user's own folder for srprov: `~/.config/srprov`, or below XDG_CONFIG_HOME."""
    given = environ.get("XDG_CONFIG_HOME", "")
    # the specification ignores a relative path; it would lie in the folder of a project
    return (Path(given) if os.path.isabs(given) else Path(environ.get("HOME", "/")) / ".config") / "srprov"


def _parameter(key: str) -> str:
    """Return click's parameter of an option's name."""
    return PARAMETERS.get(key, key.replace("-", "_"))


def _value(key: str, value: Any, file: ConfigFile) -> object:  # noqa: ANN401 - what TOML has
    """Return a value as click takes it; the inventory that a project names must lie with the project."""
    if key not in _LISTS:
        return value
    words = value if isinstance(value, list) else [value]
    if key != "inventory":
        return words
    paths = [os.path.expanduser(word) if file.own else word for word in words]
    root = os.path.realpath(file.path.parent)
    for path in () if file.own else paths:
        if os.path.isabs(path) or os.path.commonpath((root, os.path.realpath(file.path.parent / path))) != root:
            what = f"{file.path}: the inventory '{path}' is not in the project's folder"
            raise UsageError(what, hint="name it on the command line: -i FILE", code=Code.CONFIGURATION)
    return paths


def read_table(file: ConfigFile, verbs: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return what a file sets, and its text; an empty table where there is none."""
    if not file.path.is_file():
        return {}, ""
    if not file.own and os.path.realpath(file.path) != os.path.join(os.path.realpath(file.path.parent), file.path.name):
        if file.table:
            return {}, ""  # of other tools; what it holds would be told by errors
        raise UsageError(
            f"{file.path} is a link to another file", hint="put a file of its own in its place", code=Code.STRANGE_FILE
        )
    try:
        content, about = regular_file.read_with_status(file.path, _MOST_BYTES)
        text = content.decode("utf-8")
        if file.table and file.table.rpartition(".")[2] not in text:
            return {}, ""  # of other tools
        check_parts(text)
        # tomllib came with Python 3.11; tomli is the same library for 3.10
        table: Any = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli").loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            f"cannot read {file.path}: {error}", hint="fix it, or move it away", code=Code.CONFIGURATION
        ) from error
    for name in filter(None, file.table.split(".")):
        table = table.get(name, {}) if isinstance(table, dict) else {}
    if not isinstance(table, dict) or not table:
        return {}, ""
    check_owner(file.path, about, own=file.own)
    if faults := list(itertools.islice(_faults(file, table, verbs, text), _MOST_FAULTS)):
        hint = "say it on the command line" + ("" if file.own else ", or in your own ~/.config/srprov/srprov.toml")
        raise UsageError("\n".join(faults), hint=hint, code=Code.CONFIGURATION)
    return table, text


def _faults(file: ConfigFile, table: Mapping[str, Any], verbs: Mapping[str, Any], text: str) -> Iterator[str]:
    """Name each key that the file cannot set, with its line."""
    for key, value in table.items():
        if isinstance(value, dict):
            if file.own and key == "lab":
                continue  # it has verbs of its own
            for inner in value if key in verbs and key != "lab" else ():
                yield from _fault(file, f"{file.table}.{key}".lstrip("."), inner, value[inner], text)
            if key not in verbs or key == "lab":
                why = "a project's file cannot set anything of" if key == "lab" else "there is no verb"
                yield f"{file.path}:{line(text, f'{file.table}.{key}'.lstrip('.'), '')}: {why} '{key[:60]}'"
        else:
            yield from _fault(file, file.table, key, value, text)


def _fault(file: ConfigFile, table: str, key: str, value: object, text: str) -> Iterator[str]:
    words = value if key in _LISTS and isinstance(value, list) else [value]
    known, few = key in (OWN_KEYS if file.own else PROJECT_KEYS), len(words) <= _MOST_ENTRIES
    fair = file.own or not (_is_more(value, _MOST.get(key)) or (key in _SWITCHES and value is not True))
    if known and few and fair and all(_plain(word, text_only=key in _LISTS) for word in words):
        return
    place = f"{file.path}:{line(text, table, key)}"
    if known:
        yield f"{place}: '{key}' cannot have this value"
    elif key in OWN_KEYS:
        yield f"{place}: a project's file cannot set '{key}': it may come from a stranger"
    else:
        yield f"{place}: there is no option '{key[:60]}' to set; {did_you_mean(key, OWN_KEYS)}".removesuffix("; ")


def _is_more(value: object, most: int | None) -> bool:
    try:
        return most is not None and int(str(value).partition(".")[0]) > most
    except ValueError:
        return False  # no number: the option says so, or takes it


def _plain(value: object, *, text_only: bool) -> bool:
    """Return whether a value is one that an option takes: a text, a finite number, a boolean."""
    if isinstance(value, str):
        return "\0" not in value and len(value) <= _LONGEST
    return not text_only and isinstance(value, int | float) and abs(value) < _BEYOND  # not infinite, NaN or no float
