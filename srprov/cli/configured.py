"""`srprov config`: every setting with its value, and where that comes from. Reads files and the environment alone."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from srprov.cli import options
from srprov.cli.config import OWN_FIRST, ConfigFile, files, places, user_folder
from srprov.cli.output import out, out_json
from srprov.cli.status import table
from srprov.cli.variables import long_name
from srprov.cli.whose_inventory import is_of, verbs_of
from srprov.codes import Code
from srprov.errors import UsageError, did_you_mean

_ENVIRONMENT = {
    "XDG_CONFIG_HOME": "Where srprov/srprov.toml, playbooks and policy.yml of the user are; else ~/.config.",
    "XDG_STATE_HOME": "Where runs, owners of volumes and what is known of instances are; else ~/.local/state.",
    "XDG_CACHE_HOME": "Where fetched repositories, layers, data sets and compiled playbooks are; else ~/.cache.",
    "SRPROV_LAB": "The embedded lab that `srprov lab` is about, as its --name.",
    "SSH_AUTH_SOCK": "The agent with SSH keys.",
    "DOCKER_HOST": "The engine of a robot that is this machine.",
    "NO_COLOR": "Any value: no colours.",
    "TERM": "dumb: no line is drawn again.",
}
_ASSIGNMENTS = ("env", "set")
"""Options whose values are NAME=VALUE, in which VALUE may be nobody else's business."""
_NO_SETTINGS = ("lab", "completion", "config")
_MANY = 4


@click.command("config")
@click.argument("verb", required=False, metavar="[VERB]")
@click.option("--changed", is_flag=True, help="Only what is not srprov's own default.")
@options.JSON
@click.pass_context
def configured(context: click.Context, verb: str | None, changed: bool, as_json: bool) -> int:
    """Show every option that can be set, or those of one VERB, with its value and where that comes from.

    From weak to strong: srprov's own default, the user's srprov.toml, the project's pyproject.toml and srprov.toml,
    the environment. An option on the command line wins over all of them. Of the inventory, the user's own file wins
    over a project's, where it has whole paths or names of robots.
    """
    root = context.find_root()
    group = root.command
    assert isinstance(group, click.Group)
    verbs = dict.fromkeys((name for name in group.list_commands(root) if name not in _NO_SETTINGS), "")
    if verb is not None and verb not in verbs:
        raise UsageError(f"no verb '{verb}' has settings", hint=did_you_mean(verb, verbs), code=Code.UNKNOWN_VERB)
    every = files(Path.cwd(), os.environ)
    lines = {file: places(verbs_of(root), file) for file in every}
    rows = [row for name in ([verb] if verb else verbs) for row in _rows(group, root, name, lines)]
    rows = [row for row in rows if not changed or row["source"] != "default"]
    own = _own_files(every)
    if as_json:
        environment = {name: os.environ.get(name) for name in _ENVIRONMENT}
        out_json({"settings": rows, "files": own, "environment": environment})
        return 0
    out("\n".join(f"{one['path']}  {'' if one['there'] else '(not there)'}".rstrip() for one in own))
    shown = [{**row, "from": _from(row), "value": _shown(row["value"])} for row in rows]
    if shown:
        out("\n" + _text(shown, rows, whole=verb is None and not changed))
    elif changed:
        out("\nnothing is set: all is srprov's own default")
    given = [{"variable": name, "value": os.environ[name], "what": _ENVIRONMENT[name]}
             for name in _ENVIRONMENT if name in os.environ]  # fmt: skip
    if given and verb is None:
        out("\n" + table(given, ("variable", "value", "what")))
    return 0


def _rows(
    group: click.Group, root: click.Context, verb: str, lines: Mapping[ConfigFile, Mapping[tuple[str, str], int]]
) -> Iterator[dict[str, Any]]:
    """Return a row for each option of a verb, as the schema has it; of a verb that stands for several, of those."""
    command = group.get_command(root, verb)
    assert command is not None
    for name, one, context in _commands(command, verb, root):
        for option in one.params:
            if isinstance(option, click.Option) and not option.hidden:
                yield {"verb": name, **_setting(option, context, verb, lines)}


def _commands(command: click.Command, verb: str, root: click.Context) -> Iterator[tuple[str, click.Command, Any]]:
    context = click.Context(command, parent=root, info_name=verb, resilient_parsing=True)
    if not isinstance(command, click.Group):
        yield verb, command, context
        return
    for name, below in command.commands.items():
        yield f"{verb} {name}", below, click.Context(below, parent=context, info_name=name, resilient_parsing=True)


def _setting(
    option: click.Option, context: click.Context, verb: str, lines: Mapping[ConfigFile, Mapping[tuple[str, str], int]]
) -> dict[str, Any]:
    """Return what an option is when the command line does not say; nothing is converted, so no file is opened."""
    value, source = option.consume_value(context, {})
    name = long_name(option)
    found: dict[str, Any] = {"setting": name, "value": _plain(name, value), "source": "default"}
    found |= {"file": None, "line": None, "variable": None}
    if source is ParameterSource.ENVIRONMENT:
        found |= {"source": "environment", "variable": _variable(option, context)}
    elif source is ParameterSource.DEFAULT_MAP:
        having = [one for one in lines if (verb, option.name) in lines[one]]
        own = option.name in OWN_FIRST and is_of(having[0], verbs_of(context), verb, value)
        file = having[0] if own else having[-1]
        place = {"file": str(file.path), "line": lines[file][verb, option.name or ""]}
        found |= {"source": "user" if file.own else "project", **place}
    return found


def _variable(option: click.Option, context: click.Context) -> str:
    """Return the name of the variable that gave an option its value; click takes the first that is not empty."""
    named = [option.envvar] if isinstance(option.envvar, str) else list(option.envvar or ())
    named.append(f"{context.auto_envvar_prefix}_{(option.name or '').upper()}")
    return next(one for one in named if os.environ.get(one))


def _plain(name: str, value: Any) -> Any:  # noqa: ANN401 - what click has for a default
    """Return a value as JSON has it, without what stands behind the sign of an assignment."""
    if isinstance(value, list | tuple):
        return [_plain(name, one) for one in value]
    if isinstance(value, str) and name in _ASSIGNMENTS and "=" in value:
        return value.partition("=")[0] + "=…"
    return value if isinstance(value, str | int | float | bool) else None


def _own_files(every: Sequence[ConfigFile]) -> list[dict[str, Any]]:
    own = user_folder(os.environ)
    found = [("options", file.path) for file in every]
    found += [("policy", folder / "policy.yml") for folder in (Path("/etc/srprov"), own)]
    found += [("playbooks", own / "playbooks")]
    return [{"what": what, "path": str(path), "there": os.path.exists(path)} for what, path in found]


def _from(row: Mapping[str, Any]) -> str:
    if row["file"]:
        return f"{row['file']}:{row['line']}"
    return str(row["variable"] or row["source"])


def _shown(value: object) -> str:
    if value is None or value == []:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _text(shown: Sequence[Mapping[str, Any]], rows: Sequence[Mapping[str, Any]], *, whole: bool) -> str:
    """Return a line for each value of a setting, with the verbs that have it."""
    having: dict[str, set[str]] = {}
    for row in rows:
        having.setdefault(row["setting"], set()).add(row["verb"])
    grouped: dict[tuple[str, str, str], list[str]] = {}
    for row in shown:
        grouped.setdefault((row["setting"], row["value"], row["from"]), []).append(row["verb"])
    lines = []
    for (setting, value, source), verbs in sorted(grouped.items()):
        all_of_them = whole and len(verbs) >= _MANY and set(verbs) == having[setting]
        words = "every verb that has it" if all_of_them else ", ".join(verbs)
        lines.append({"setting": setting, "value": value, "from": source, "verbs": words})
    return table(lines, ("setting", "value", "from", "verbs"))
