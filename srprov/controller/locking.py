"""Make the lock of an experiment: look up what is not in it yet, or shall be looked up again.

Takes an EDF, its lock and a way to ask registries; gives the new lock. Fetches CDFs from git repositories when the user
allowed it; writes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import msgspec

from srprov import __version__
from srprov.codes import Code
from srprov.controller.digests import Found
from srprov.controller.own_files import asked_for
from srprov.controller.permissions import permit_planning
from srprov.controller.pins import Names, branch_text, file_hashes, names_of, short
from srprov.controller.repositories import commit_of, tree
from srprov.controller.source import fetched
from srprov.definitions import refuse_link_out
from srprov.definitions.lockfile import Lock
from srprov.definitions.model import Definitions, Inventory
from srprov.errors import UsageError, did_you_mean, visible
from srprov.git_address import is_commit
from srprov.planning.policy import permissions

ALL = "all"


class Draft(msgspec.Struct, frozen=True):
    """A lock that lacks the digests of images."""

    definitions: Definitions
    names: Names
    kept: Lock
    """What stays of the lock that there was."""
    commits: Mapping[tuple[str, str], str]
    files: Mapping[str, str]


def draft(file: str, old: Lock, update: Collection[str], allowed: Collection[str], inventory: Inventory) -> Draft:
    """Return what is known without asking registries for images; git repositories are asked.

    A lock is handed on, and has a hash of each file: with it a password, or a short token, can be guessed. So what is
    the user's own is asked for as where it is shipped.

    Args:
        file: The EDF.
        old: Its lock; empty if there is none.
        update: Names that are looked up again: an image, an address, or `all`.
        allowed: Kinds of permission that the user gave.
        inventory: The robots, of which it has passwords and keys.

    Raises:
        DefinitionError, RefusedError: As `read_definitions` says.
        UsageError: A name to look up again is none, a repository cannot be reached, or a file cannot be read.
    """
    refuse_link_out(file)
    kept = _without(old, update)
    commits = dict(kept.commits)

    def fetch(url: str, ref: str) -> str:
        if not is_commit(ref) and (url, ref) not in commits:
            commits[(url, ref)] = commit_of(url, ref)
        return tree(url, ref, commits)

    found = asked_for(fetched(file, allowed, fetch), inventory)
    permit_planning(permissions(found.experiment, found.containers), allowed)
    names = names_of(found)
    _check_update(update, old, names)
    try:
        for url, ref in sorted(names.repositories - commits.keys()):
            commits[(url, ref)] = commit_of(url, ref)
        files = file_hashes(found.experiment, found.containers.values())
    except OSError as error:
        raise UsageError(f"{error.filename or file} cannot be read: {error.strerror}", code=Code.NO_FILE) from None
    except ValueError as error:  # of git
        raise UsageError(str(error), code=Code.REPOSITORY) from None
    return Draft(found, names, kept, {one: commits[one] for one in names.repositories}, files)


def finished(made: Draft, look_up: Callable[[Collection[str]], Mapping[str, Found]]) -> Lock:
    """Return the lock, with the digests of images that were not known yet."""
    kept = {name: digest for name, digest in made.kept.digests.items() if name in made.names.images}
    found = look_up(made.names.images - kept.keys())
    platforms = {name: made.kept.platforms.get(name, ()) for name in kept}
    return Lock(
        commits=made.commits,
        digests={**kept, **{name: digest for name, (digest, _) in found.items()}},
        platforms={**platforms, **{name: found_on for name, (_, found_on) in found.items()}},
        files=made.files,
        version=__version__,
    )


def changes(old: Lock, new: Lock) -> list[str]:
    """Return in words, a line each, what differs in two locks, but for files."""
    before = {short(name): digest for name, digest in old.digests.items()}
    before |= {branch_text(one): commit for one, commit in old.commits.items()}
    after = {short(name): digest for name, digest in new.digests.items()}
    after |= {branch_text(one): commit for one, commit in new.commits.items()}
    told = []
    for name in sorted(before.keys() | after.keys()):
        was, now = before.get(name), after.get(name)
        if was != now:
            told.append(f"+ {name}: {now}" if not was else f"- {name}" if not now else f"~ {name}: {was} is {now} now")
    return [visible(one) for one in told]


def _matches(word: str, name: str) -> bool:
    """Return whether a user means a name: all of it, an image without its tag, or an address's last part."""
    last = name.rpartition(" of ")[2].rstrip("/").rpartition("/")[2].removesuffix(".git")
    return word in (ALL, name, name.rpartition(":")[0], name.rpartition(" of ")[2], last)


def _without(old: Lock, update: Collection[str]) -> Lock:
    def stays(name: str) -> bool:
        return not any(_matches(word, name) for word in update)

    return Lock(
        commits={one: commit for one, commit in old.commits.items() if stays(branch_text(one))},
        digests={name: digest for name, digest in old.digests.items() if stays(short(name))},
        platforms=old.platforms,
        packages=tuple(one for one in old.packages if stays(one.image)),
    )


def _check_update(update: Collection[str], old: Lock, names: Names) -> None:
    known = {short(name) for name in {*names.images, *old.digests}}
    known |= {branch_text(one) for one in {*names.repositories, *old.commits}}
    known |= {one.image for one in old.packages}
    for word in update:
        if word != ALL and not any(_matches(word, name) for name in known):
            hint = did_you_mean(word, known) or f"known: {', '.join(sorted(known)) or 'nothing'}"
            raise UsageError(f"--update: nothing is called '{word}'", hint=hint, code=Code.OPTION_VALUE)
