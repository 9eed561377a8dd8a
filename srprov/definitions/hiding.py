"""Problems of definitions -> the same, without what they tell of files that are not the experiment's own.

Takes problems; looks at where the files lie that they are about.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shlex
from collections.abc import Callable, Collection, Iterable

from srprov.codes import Code
from srprov.definitions.paths import inside, lies_open, link_out, shown_folder
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc.nodes import Findings


def hide_outside(problems: Collection[Diagnostic], *folders: str) -> list[Diagnostic]:
    """Return problems without what a file outside of some folders holds: a stranger's EDF may name any file as its CDF.

    Of such a file one problem is left, which says nothing but that there is one.
    """
    is_open = functools.cache(lambda file: any(lies_open(file, folder) for folder in folders))
    shown = []
    for one in problems:
        file = os.path.abspath(one.location.file)
        if not one.location.file or is_open(file):
            shown.append(one)
        else:
            where = f"outside of {shown_folder(folders[0])}"
            own = "that version control keeps, or that has another name elsewhere (a hard link)"
            where = own if any(inside(file, one) for one in folders) else where
            message = f"is not valid; what is wrong is not shown of a file {where}"
            hint = f"see `srprov validate {shlex.quote(os.path.realpath(file))}`, or copy it into the folder"
            shown.append(Diagnostic(Location(one.location.file), message, hint=hint, code=Code.OUTSIDE))
    return list(dict.fromkeys(shown))


def is_elsewhere(path: str) -> bool:
    """Return whether a file that is to be checked is one elsewhere: by a link out, or a second name."""
    return bool(link_out(path)) or not lies_open(path, os.path.dirname(os.path.abspath(path)))


def note_on(path: str) -> Diagnostic:
    """Return a note on such a file, of which nothing is looked at."""
    message = "is a link out of its folder, or has another name elsewhere (a hard link)"
    return Diagnostic(Location(path), f"{message}: it is not looked at without `--allow outside`", code=Code.OUTSIDE)


def without_words(notes: Iterable[Diagnostic], folder: str) -> tuple[Diagnostic, ...]:
    """Return notes on what was not looked at, without the words of files that do not lie open in a folder."""
    message = "names a file that is not the experiment's own: it is not looked at without `--allow outside`"
    shown = (
        one
        if lies_open(os.path.abspath(one.location.file), folder)
        else Diagnostic(Location(one.location.file), message, code=one.code)
        for one in notes
    )
    return tuple(dict.fromkeys(shown))


def hide_merged(
    problems: Collection[Diagnostic],
    alone: Callable[[Findings], object],
    file: str,
    folder: str,
    known: Findings | None = None,
) -> list[Diagnostic]:
    """Return what is shown of the problems of `file`, merged with one that does not lie open in `folder`.

    What was known before, and what `alone` adds to it, looking at the files in the folder alone, is shown. All else is
    one problem that has no line: one at each of many guesses would tell which of them that file has. So what is wrong
    alone is shown also where that file would mend it.
    """
    findings = Findings() if known is None else known
    with contextlib.suppress(DefinitionError):  # too many; they are in the findings nevertheless
        alone(findings)
    shown = findings.problems
    if set(shown) == set(problems):
        return [*shown]
    message = (
        f"does not fit a file outside of {shown_folder(folder)}, in .git or the like, or with another name elsewhere"
    )
    message += " (a hard link), of which nothing is shown"
    hint = "copy that file into the folder to see what is wrong; what else is said here is said without it"
    return [*shown, Diagnostic(Location(file), message, hint=hint, code=Code.OUTSIDE)]
