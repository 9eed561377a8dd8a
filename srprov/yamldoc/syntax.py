"""Why a text is no YAML, in words, with the place.

Takes an error of PyYAML or libyaml; gives a `Diagnostic`. Pure.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import Diagnostic, Location
from srprov.yamldoc.nodes import Source

if TYPE_CHECKING:
    import yaml

MAX_DEPTH = 60
TOO_DEEP = f"is nested more than {MAX_DEPTH} levels deep"
LINE_END = re.compile("\r\n|[\r\n\x85\u2028\u2029]")
_PARSERS_LIMIT = "exceeded maximum nesting depth"
"""libyaml's own limit of 1000 levels (in PyYAML since 6.0.4): it reads ahead, so this may come before ours."""
_HALF_A_KEY = frozenset(("did not find expected key", "could not find expected ':'"))
"""What libyaml says of a line that comes after one that is no `key: value`."""


def explained(source: Source, text: str, error: yaml.YAMLError) -> Diagnostic:
    """Return what is wrong with `text`, of which `source` has the lines."""
    import yaml

    if isinstance(error, yaml.MarkedYAMLError):
        return _marked(source, error)
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position] if isinstance(error.position, int) else ""
        lines = LINE_END.split(before)
        return _syntax(source, Location(source.file, len(lines), len(lines[-1]) + 1), error.reason)
    return _syntax(source, Location(source.file), str(error).splitlines()[0])


def _marked(source: Source, error: yaml.MarkedYAMLError) -> Diagnostic:
    mark, began = error.problem_mark or error.context_mark, error.context_mark
    place = Location(source.file, mark.line + 1, mark.column + 1) if mark else Location(source.file)
    if error.problem == _PARSERS_LIMIT:
        return Diagnostic(place, TOO_DEEP, "", source.excerpt(place.line), code=Code.TOO_LARGE)
    words = " ".join(str(part) for part in (error.context, error.problem) if part)
    hint = f"it begins on line {began.line + 1}" if began is not None and mark and began.line < mark.line else ""
    if error.problem in _HALF_A_KEY:
        hint = f"{hint}; " * bool(hint) + "is a ':' missing above, or is a line indented otherwise?"
    if "${" in source.excerpt(place.line):
        hint = 'quote a value with a brace in it: "${…}"'
    return _syntax(source, place, words, hint)


def _syntax(source: Source, place: Location, words: str, hint: str = "") -> Diagnostic:
    excerpt = source.excerpt(place.line)
    tab = "\t" in excerpt[: max(place.column, len(excerpt) - len(excerpt.lstrip()))]
    hint = "YAML allows no tab for indentation; use spaces" if tab else hint
    return Diagnostic(place, f"is not valid YAML: {words}", "", excerpt, hint, code=Code.YAML)
