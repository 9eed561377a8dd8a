"""Files of a Compose project -> trees, and what may be read at all.

Takes paths; gives trees, or `Refused`. Reads files: those that the user named, and others only in their folders.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection
from dataclasses import dataclass, field

from srprov.codes import Code
from srprov.definitions.own_lines import is_users_own
from srprov.definitions.paths import belongs
from srprov.errors import DefinitionError, Diagnostic
from srprov.importing.compose.folders import apart, led_away
from srprov.importing.compose.scalars import Date, meaning
from srprov.importing.compose.scalars import shown as as_printed
from srprov.importing.compose.values import Value, dotted
from srprov.importing.normal import Named, Refused
from srprov.importing.position import Path, Position
from srprov.yamldoc import loader, nodes

MOST_FILES = 200
MOST_OF_VARIABLES = 100_000
"""Of files of variables that files name, each as often as it is named: a line is one, and so are twenty characters."""
HINT = "copy it there; or, where the whole project is your own, say which folder that is: --root DIR"
"""Of what lies outside of the folder of the file that says so."""
_KINDS = {bool: "a boolean", int: "a number", float: "a number", type(None): "nothing", Date: "a date"}


@dataclass
class Reading:
    """What may be read, and what was."""

    home: str
    """Real path of the folder in which all Compose files lie, and of which each may name files."""
    whole: bool = False
    """They may lie anywhere below it: it is the folder of a whole project, as the user says."""
    own: frozenset[str] = frozenset()
    """Real paths of files that secrets were read from on this machine: their values are put into nothing else."""
    judged: dict[str, bool] = field(default_factory=dict)
    """Whether what a file names is the user's own, by its real path."""
    count: int = 0
    of_variables: int = 0
    texts: dict[str, str] = field(default_factory=dict)
    """What was read, by its real path."""
    trees: dict[tuple[str, str], Value] = field(default_factory=dict)
    secrets: set[str] = field(default_factory=set)
    """Real paths of what any of the files calls a secret's file, whether a service that is wanted has it or not."""
    named: list[Named] = field(default_factory=list)
    """What was read because a file names it."""
    written: dict[Position, str] = field(default_factory=dict)
    """Numbers that Compose prints in another way than they are written, by their place."""

    def inside(self, path: str, named: Value) -> str:
        """Return the real path of a file that a file names; it must lie in the folder of which that one may name files.

        It must not be what version control keeps there, such as a token.

        Raises:
            Refused: It does not.
        """
        real = os.path.realpath(path)
        if not belongs(real, self.home) or led_away(path, (self.home,)):
            where = "outside of the folder of the file that says so, in .git or the like"
            message = f"'{named.data}' lies {where}, or elsewhere by another name (a hard link), and is not read"
            raise Refused([Diagnostic(named.at, message, hint=HINT, code=Code.OUTSIDE)])
        return real

    def beside(self, shown: str, path: str, named: Value, *, folder: bool = False) -> None:
        """Check that a Compose file that one names, or the folder of a project, is no other project's.

        Raises:
            Refused: It lies apart, or may not be named at all.
        """
        real = self.inside(path, named)
        place = real if folder else os.path.dirname(real)
        if not self.whole and place != self.home:
            raise apart(shown, named.at.file, (place, self.home), named.at)

    def note_secrets(self, tree: Value, folders: Collection[str]) -> None:
        """Note what a file calls secrets' files, wherever its relative paths may begin."""
        given = tree.get("secrets")
        for entry in given.data.values() if given is not None and isinstance(given.data, dict) else ():
            file = entry.get("file")
            if file is not None and isinstance(file.data, str) and "\0" not in file.data:
                named = os.path.expanduser(file.data)
                self.secrets |= {os.path.realpath(os.path.join(folder, named)) for folder in folders}

    def text(self, path: str, shown: str, named: Value | None) -> str:
        """Return a file's text; `named` is where a file names it, None for one that the user named.

        A file names none that is the user's own: nobody knows again what of it is in an experiment, or is quoted.

        Raises:
            Refused: It cannot be read, or must not be.
        """
        try:
            real = os.path.realpath(path) if named is None else self.inside(path, named)
            if named is not None:
                self._refuse_own(real, shown, named)
                self.named.append(Named(real, str(named.data), named.at))
            if real not in self.texts:
                self.one_more(named.at if named else Position(shown))
                self.texts[real] = loader.read_text(real, shown, real=True)
            return self.texts[real]
        except ValueError:
            raise Refused([Diagnostic(Position(shown), "no file can have such a name", code=Code.UNREADABLE)]) from None
        except Refused:
            raise
        except DefinitionError as error:
            raise _at(error, named) from None

    def variables(self, path: str, shown: str, named: Value | None) -> str:
        """Return the text of a file of variables, as `text` does.

        Raises:
            Refused: It cannot be read, or must not be.
        """
        text = self.text(path, shown, named)
        if named is not None:
            before = self.of_variables  # of a single file it is told which limit it breaks
            self.of_variables += 10 + text.count("\n") + len(text) // 20
            if before and self.of_variables > MOST_OF_VARIABLES:
                message = "what files of variables say, as often as services name them, is more than a project has"
                raise Refused([Diagnostic(named.at, message, code=Code.TOO_LARGE)])
        return text

    def _refuse_own(self, real: str, shown: str, named: Value) -> None:
        if real not in self.judged:
            self.judged[real] = is_users_own(real, self.home, self.own)
        if self.judged[real]:
            what = "holds a password of robots, a key or a secret, or lies in a record of srprov's own"
            hint = f"if you mean its variables, name it yourself: --env-file {shlex.quote(shown)}"
            message = f"'{named.data}' {what}, and no file may have it read"
            raise Refused([Diagnostic(named.at, message, hint=hint, code=Code.OUTSIDE)])

    def one_more(self, at: Position) -> None:
        """Count a file, or a project that is included.

        Raises:
            Refused: There are too many.
        """
        self.count += 1
        if self.count > MOST_FILES:
            raise Refused([Diagnostic(at, f"the project has more than {MOST_FILES} files", code=Code.TOO_LARGE)])

    def tree(self, path: str, shown: str, named: Value | None) -> Value:
        """Return a Compose file's tree.

        Raises:
            Refused: It cannot be read, is no YAML, too large, empty, no map, or has keys that are no text.
        """
        if (path, shown) not in self.trees:
            self.trees[path, shown] = _tree(self.text(path, shown, named), shown, self.written)
        return self.trees[path, shown]


def _at(error: DefinitionError, named: Value | None) -> Refused:
    """Return the refusal of a file that cannot be read, at the place where it is named."""
    if named is None:
        return Refused(error.problems)
    return Refused(
        [
            Diagnostic(named.at, f"'{named.data}' {one.message}", "", "", one.hint, code=Code.COMPOSE)
            for one in error.problems
        ]
    )


def _tree(text: str, shown: str, written: dict[Position, str]) -> Value:
    try:
        root = loader.parse(text, shown)
    except DefinitionError as error:
        raise Refused(error.problems) from None
    if root is None:
        raise Refused([Diagnostic(Position(shown), "the file is empty", code=Code.COMPOSE)])
    problems: list[Diagnostic] = []
    value = _Reader(problems, written).value(root, None, ())
    if not problems and not isinstance(value.data, dict):
        problems.append(Diagnostic(value.at, "a Compose file is a map with services", code=Code.COMPOSE))
    if problems:
        raise Refused(problems)
    return value


class _Reader:
    """Makes a tree of nodes; gathers what is wrong with them, and numbers that are printed otherwise."""

    def __init__(self, problems: list[Diagnostic], written: dict[Position, str]) -> None:
        self.problems = problems
        self.written = written

    def value(self, node: nodes.Node, key: Position | None, path: Path) -> Value:
        at = nodes.location(node)
        tag = node.tag if node.tag in ("!reset", "!override") else ""
        if isinstance(node, nodes.Map):
            for name, written in node.keys.items():
                self._key(name, written, path)
            keys = {name: nodes.location(node.keys[name]) for name in node.entries}
            entries = {name: self.value(item, keys[name], (*path, name)) for name, item in node.entries.items()}
            return Value(entries, at, key, tag)
        if isinstance(node, nodes.Seq):
            items = [self.value(item, None, (*path, number)) for number, item in enumerate(node.items)]
            return Value(items, at, key, tag)
        data = meaning(node.text) if node.plain and not node.tag else node.text
        if isinstance(data, Date):
            message = "this is a date to YAML, which Compose takes nowhere"
            self.problems.append(nodes.problem(node, message, dotted(path), "quote it", code=Code.COMPOSE))
        if isinstance(data, int | float) and as_printed(data) != node.text.lower():
            self.written[at] = node.text
        return Value(data, at, key, tag)

    def _key(self, name: str, key: nodes.Scalar, path: Path) -> None:
        means = meaning(name) if key.plain else name
        if not isinstance(means, str) or isinstance(means, Date):
            message = f"the key '{name}' is {_KINDS.get(type(means), 'no text')}; a key must be text"
            self.problems.append(nodes.problem(key, message, path, "quote it", code=Code.COMPOSE))
