"""All verbs as values, from click: what a manual says of each.

Takes the group of verbs, gives a `Verb` for each command that can be called. Reads no file and asks nobody.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator

import click
import msgspec


class Paragraph(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a help text."""

    text: str
    as_is: bool
    """Its lines are columns, and must stay as they are."""


class Option(msgspec.Struct, frozen=True, kw_only=True):
    """One option."""

    names: tuple[str, ...]
    """As they are typed, the short one first."""
    value: str
    """What stands after the name; empty for a flag."""
    help: str
    """What it does, with its default and range."""
    variable: str
    """The variable of the environment that sets it; of several the one that other verbs have too."""


class Verb(msgspec.Struct, frozen=True, kw_only=True):
    """One command."""

    name: str
    """All its words after `srprov`, such as `lab up`."""
    usage: str
    """Its command line, with options as one word."""
    paragraphs: tuple[Paragraph, ...]
    options: tuple[Option, ...]


def verbs(group: click.Group) -> Iterator[Verb]:
    """Yield all commands below `srprov`, in its order; a group among them is followed by its own."""
    # click keeps the names of its help by whoever asks first
    context = click.Context(group, info_name="srprov", help_option_names=["-h", "--help"])
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        yield from _below(context, command, name)


def _below(parent: click.Context, command: click.Command, name: str) -> Iterator[Verb]:
    context = click.Context(command, info_name=name, parent=parent)
    yield Verb(
        name=context.command_path.partition(" ")[2],
        usage=" ".join(filter(None, (context.command_path, *command.collect_usage_pieces(context)))),
        paragraphs=tuple(_paragraphs(command.help or "")),
        options=tuple(_options(context, command)),
    )
    if isinstance(command, click.Group):
        for word in command.list_commands(context):
            inner = command.get_command(context, word)
            assert inner is not None
            yield from _below(context, inner, word)


def _paragraphs(text: str) -> Iterator[Paragraph]:
    """Yield the parts of a help text; click marks those that it must not wrap with a line that has only a backspace."""
    for part in inspect.cleandoc(text.partition("\f")[0]).split("\n\n"):
        as_is = part.lstrip("\n").startswith("\b")
        lines = part.replace("\b\n", "").strip("\n")
        if lines:
            yield Paragraph(text=lines if as_is else " ".join(lines.split()), as_is=as_is)


def _options(context: click.Context, command: click.Command) -> Iterator[Option]:
    for one in command.get_params(context):
        shown = one.get_help_record(context) if isinstance(one, click.Option) else None
        if shown is None or not isinstance(one, click.Option):
            continue
        yield Option(
            names=(*one.opts, *one.secondary_opts),
            value="" if one.is_flag else shown[0].rpartition(one.opts[-1])[2].strip(),
            help=shown[1],
            variable=_variable(one),
        )


def _variable(option: click.Option) -> str:
    named = [option.envvar] if isinstance(option.envvar, str) else list(option.envvar or ())
    return "" if "--help" in option.opts else next(reversed(named), "")
