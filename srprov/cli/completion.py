"""`srprov completion`: a script for the user's shell, and the answers that it asks for at each Tab.

The script calls `srprov completion SHELL -- …` with the command line so far, and gets a first line that says what to
offer (`words`, `files` or `folders`) and a line for each word. Nothing here asks a robot or runs a program.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import click

from srprov.cli.completion_line import Answer, answer
from srprov.cli.completion_scripts import SCRIPTS
from srprov.cli.config import default_map
from srprov.cli.output import out
from srprov.cli.shell_words import split, unquoted
from srprov.errors import SrprovError


@click.command(context_settings={"auto_envvar_prefix": None})
@click.argument("shell", type=click.Choice(sorted(SCRIPTS)), metavar="bash|zsh|fish")
@click.argument("words", nargs=-1, type=click.UNPROCESSED, metavar="[WORDS]...")
@click.pass_context
def completion(context: click.Context, shell: str, words: tuple[str, ...]) -> int:
    """Print a script that completes srprov's command lines in your shell.

    \b
    bash  in ~/.bashrc:                    eval "$(srprov completion bash)"
    zsh   in ~/.zshrc, after compinit:     eval "$(srprov completion zsh)"
    fish  in ~/.config/fish/config.fish:   srprov completion fish | source

    It offers verbs, options, what they take, files; services and profiles of the EDF on the command line, and robots
    and groups of the inventory there or in srprov.toml. It asks no robot and runs no inventory that is a program.
    """  # noqa: D301 - click's own mark, a backspace
    if not words:
        out(SCRIPTS[shell].rstrip())
        return 0
    group = context.find_root().command
    assert isinstance(group, click.Group)
    if shell == "bash":  # its words are cut at `=`, `:` and `@`; the line is whole
        line, cut = (*words, "")[:2]
        before, incomplete = split(line)
        inventories = _configured(group, before)
        given = answer(group, before, incomplete, inventories)
        out(_for_bash(given, incomplete, cut))
    else:
        before, incomplete = [unquoted(word) for word in words[1:-1]], unquoted(words[-1])
        given = answer(group, before, incomplete, _configured(group, before))
        out("\n".join([_head(given), *("\t".join(filter(None, pair)) for pair in given.words)]))
    return 0


def _head(given: Answer) -> str:
    return given.kind + (" nospace" if given.words and all(word[-1:] in ":@=" for word, _ in given.words) else "")


def _for_bash(given: Answer, incomplete: str, cut: str) -> str:
    """Return words as bash wants them: without the part before the one that it completes."""
    begun = len(incomplete) - len(cut) if incomplete.endswith(cut) else 0
    return "\n".join([_head(given), *(word[begun:] for word, _ in given.words)])


def _configured(group: click.Group, before: list[str]) -> list[str]:
    """Return the inventories of the environment or of configuration files, for the verb of a command line."""
    verbs = group.list_commands(click.Context(group))
    verb = next((word for word in before if word in verbs), "")
    for name in (f"SRPROV_{verb.upper()}_INVENTORY", f"SRPROV_{verb.upper()}_INVENTORIES"):
        if given := os.environ.get(name):
            return given.split()
    with contextlib.suppress(SrprovError, OSError, ValueError):
        found = default_map(dict.fromkeys(verbs, ""), Path.cwd(), os.environ).get(verb, {})
        return [str(path) for path in found.get("inventories", ())]
    return []
