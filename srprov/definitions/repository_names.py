"""Which of the files that a stranger names would make a repository here, told before any of them is written. Pure.

git runs what the settings of a repository name as soon as it is asked for its status, as many prompts of shells do. A
`.git` is not needed for that: git takes any folder for one that holds what its own folder would.

Here all names are known at once. Where they come one by one, `model.makes_repository` tells it, which takes any file
`HEAD` for a part of one.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence

from srprov.definitions.model import VERSION_CONTROL, VERSION_CONTROL_IN_ANY_CASE

_HEAD, _COMMON, _PARTS = "head", "commondir", ("objects", "refs")
"""What git looks for in a folder; with `commondir`, it looks for the rest elsewhere. Source: git's setup.c."""
WHY = "a repository here could name programs"


def is_kept_name(path: str) -> bool:
    """Return whether a path is, or lies in, what version control calls its own.

    A disk may take names in any case; but a folder `cvs` of somebody's is none.
    """
    return any(
        part in VERSION_CONTROL or (part.startswith(".") and part.casefold() in VERSION_CONTROL_IN_ANY_CASE)
        for part in path.split("/")
    )


def repository_among(paths: Iterable[str]) -> str:
    """Return a path, relative as all of them are, by which a folder would be a repository, or nothing.

    A file `HEAD` alone makes none.
    """
    return next(repositories_among(paths), "")


def repositories_among(paths: Iterable[str]) -> Iterator[str]:
    """Yield all paths, relative as all of them are, without which no folder would be a repository."""
    some = list(paths)
    yield from filter(is_kept_name, some)
    heads = [one for one in some if one.casefold().rpartition("/")[2] == _HEAD]
    # NUL sorts before all that a name may hold, so a folder's files come right behind where its own name would be
    known = sorted(one.casefold().replace("/", "\0") for one in some) if heads else []
    yield from (one for one in heads if not is_kept_name(one) and _is_repository(one, known))


def _is_repository(head: str, known: Sequence[str]) -> bool:
    above = head.casefold().replace("/", "\0")[: -len(_HEAD)]
    return _is_there(above + _COMMON, known) or all(_is_there(above + name, known) for name in _PARTS)


def _is_there(name: str, known: Sequence[str]) -> bool:
    """Return whether one of the files has a name, or lies in a folder of that name."""
    at = bisect_left(known, name)
    return at < len(known) and (known[at] == name or known[at].startswith(f"{name}\0"))
