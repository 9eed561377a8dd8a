"""What may come next on a command line: verbs, options, choices, files, and names from the user's own files.

Takes click's commands and the words so far; gives an `Answer`. The words are read as click reads them, but nothing is
converted and no callback is called: those open files to write. Reads the EDF and the inventories that the line names.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence

import click
import msgspec

from srprov.cli.completion_words import codes, permissions, schemas

Word = tuple[str, str]
"""A word, and what it means in one line, or nothing."""


class Answer(msgspec.Struct, frozen=True):
    """What to offer."""

    kind: str = "words"
    """`words`; `files` and `folders` are the shell's to list."""
    words: tuple[Word, ...] = ()


class _Line:
    """A command line that has been read up to the word that is being typed."""

    def __init__(self, group: click.Group) -> None:
        self.root = group
        self.enter(group)

    def enter(self, command: click.Command) -> None:
        """Begin to read the words of a command."""
        self.command = command
        self.context = click.Context(command, resilient_parsing=True, help_option_names=["-h", "--help"])
        params = command.get_params(self.context)
        self.options = {flag: one for one in params if isinstance(one, click.Option) for flag in _flags(one)}
        self.arguments = [one for one in params if isinstance(one, click.Argument)]
        self.given: dict[str, list[str]] = {}
        self.positionals: list[str] = []
        self.open: click.Option | None = None
        """The option whose value is the next word."""
        self.only_words = False
        """No word is an option any more."""

    def read(self, word: str) -> None:
        """Read the next word."""
        if self.open is not None:
            self._take(self.open, word)
            self.open = None
        elif not self.only_words and word == "--":
            self.only_words = True
        elif not self.only_words and word.startswith("--"):
            name, sign, value = word.partition("=")
            self._option(self.options.get(name), value, given=bool(sign))
        elif not self.only_words and word.startswith("-") and len(word) > 1:
            self._short(word[1:])
        elif isinstance(self.command, click.Group):
            if (command := self.command.get_command(self.context, word)) is not None:
                self.enter(command)
        else:
            self.positionals.append(word)
            self.only_words = self.only_words or not self.context.allow_interspersed_args

    def _short(self, letters: str) -> None:
        for at, letter in enumerate(letters, 1):
            option = self.options.get(f"-{letter}")
            if option is not None and _takes_value(option):
                self._option(option, letters[at:], given=bool(letters[at:]))
                return

    def _option(self, option: click.Option | None, value: str, *, given: bool) -> None:
        if option is None or not _takes_value(option):
            return
        if given:
            self._take(option, value)
        else:
            self.open = option

    def _take(self, option: click.Option, value: str) -> None:
        self.given.setdefault(option.name or "", []).append(value)

    def argument(self, index: int) -> click.Argument | None:
        """Return the argument that takes the word with this index among those that are no options."""
        if not self.arguments:
            return None
        last = self.arguments[-1]
        return self.arguments[index] if index < len(self.arguments) else (last if last.nargs < 0 else None)

    def files(self) -> list[str]:
        """Return the words that a parameter `file` took."""
        some = ((self.argument(at), word) for at, word in enumerate(self.positionals))
        return [os.path.expanduser(word) for argument, word in some if argument and argument.name == "file"]


def _flags(option: click.Option) -> Sequence[str]:
    return (*option.opts, *option.secondary_opts)


def _takes_value(option: click.Option) -> bool:
    return not option.is_flag and not option.count


def answer(group: click.Group, before: Sequence[str], incomplete: str, inventories: Sequence[str] = ()) -> Answer:
    """Return what may stand in the place of the last, incomplete word.

    Args:
        group: All verbs.
        before: The words between the program and that one.
        incomplete: What there is of it.
        inventories: Those of configuration files, used where the line names none.
    """
    line = _Line(group)
    for word in before:
        line.read(word)
    names = _Names(line, [os.path.expanduser(one) for one in line.given.get("inventories", inventories)])
    if line.open is not None:
        return _matching(names.of(line.open, incomplete), incomplete)
    if not line.only_words and incomplete.startswith("--") and "=" in incomplete:
        name, _, value = incomplete.partition("=")
        option = line.options.get(name)
        if option is None or not _takes_value(option):
            return Answer()
        found = _matching(names.of(option, value), value)
        return Answer(found.kind, tuple((f"{name}={word}", text) for word, text in found.words))
    if not line.only_words and incomplete.startswith("-"):
        return _matching(Answer("words", tuple(_options(line))), incomplete)
    if isinstance(line.command, click.Group):
        return _matching(Answer("words", tuple(_verbs(line.command, line.context))), incomplete)
    argument = line.argument(len(line.positionals))
    return _matching(names.of(argument, incomplete), incomplete) if argument else Answer()


def _matching(found: Answer, incomplete: str) -> Answer:
    return Answer(found.kind, tuple(one for one in found.words if one[0].startswith(incomplete)))


def _verbs(group: click.Group, context: click.Context) -> Iterator[Word]:
    lines: Mapping[str, str] = getattr(group, "lines", {})
    for name in group.list_commands(context):
        # the verbs' own files are not read for their help: all of them would be
        command = None if name in lines else group.get_command(context, name)
        yield name, lines.get(name, "") if command is None else command.get_short_help_str(200)


def _options(line: _Line) -> Iterator[Word]:
    for flag, option in line.options.items():
        once = option.name in line.given and not option.multiple
        if flag.startswith("--") and not option.hidden and not once:
            yield flag, " ".join((option.help or "").split())


_FILES = ("EDF|PLAN", "RUN", "RUN|PLAN|BUNDLE", "OLD", "NEW", "-- COMMAND...")
"""What arguments that take files are called, besides FILE."""


class _Names:
    """What a parameter may be given, from click's types and from the files that the command line names."""

    def __init__(self, line: _Line, inventories: Sequence[str]) -> None:
        self._line, self._inventories = line, inventories
        self._by_name: Mapping[str, Callable[[str], Iterator[str]]] = {
            "service": self._services,
            "services": self._services,
            "targets": self._services,
            "limit": self._robots_and_groups,
            "exclude": self._robots_and_groups,
            "robots": self._robots,
            "robot": self._robots,
            "code": codes,
            "profiles": self._profiles,
            "until": self._conditions,
            "allow": permissions,
            "kind": schemas,
            "verb": self._verbs,
        }

    def of(self, param: click.Parameter, incomplete: str) -> Answer:
        """Return what a parameter may be given; of files, that it is files."""
        names = self._by_name.get(param.name or "")
        if names is not None:
            return Answer("words", tuple((name, "") for name in dict.fromkeys(names(incomplete))))
        if isinstance(param.type, click.Choice):
            return Answer("words", tuple((str(choice), "") for choice in param.type.choices))
        shown = param.metavar or ""
        if isinstance(param.type, click.Path | click.File):
            folder = isinstance(param.type, click.Path) and not param.type.file_okay
            return Answer("folders" if folder else "files")
        if "FILE" in shown or shown.strip("[]") in _FILES:
            return Answer("files")
        if shown == "DIR":
            return Answer("folders")
        words = [(word, "") for word in re.findall(r"[a-z]+", shown)] if param.name == "words" else []
        return Answer(words=tuple(words))

    def _services(self, incomplete: str) -> Iterator[str]:
        from srprov.definitions import offered

        service, at, _ = incomplete.partition("@")
        if at:
            yield from (f"{service}@{robot}" for robot in self._robots(""))
            return
        for file in self._line.files():
            yield from offered(file, "services")

    def _profiles(self, _incomplete: str) -> Iterator[str]:
        from srprov.definitions import offered

        for file in [*self._line.files(), *self._line.positionals[:1]][:1]:
            yield from offered(file, "profiles")

    def _robots(self, _incomplete: str) -> Iterator[str]:
        from srprov.definitions import offered

        for file in self._inventories:
            yield from offered(file, "robots")

    def _robots_and_groups(self, incomplete: str) -> Iterator[str]:
        from srprov.definitions import offered

        begun = re.match(r"(.*[,:&!])?", incomplete)
        yield from (f"{begun[0] if begun else ''}{robot}" for robot in self._robots(""))
        for file in self._inventories:
            yield from (f"{begun[0] if begun else ''}{group}" for group in offered(file, "groups"))
        yield "@failed"

    def _conditions(self, _incomplete: str) -> Iterator[str]:
        yield "healthy"
        for service in self._services(""):
            yield from (f"completed:{service}", f"healthy:{service}", f"log:{service}=")

    def _verbs(self, _incomplete: str) -> Iterator[str]:
        yield from self._line.root.list_commands(self._line.context)
