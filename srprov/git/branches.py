"""Whether a branch or tag leads to a commit: a lock has one for each, and may come from a stranger.

Takes an address, a name and a commit; says when that is elsewhere. Who serves a repository gives any commit that
is there by its id, also those of forks and pull requests, which anybody may have put there. What was found out is kept
beside the repositories, so that the network is asked once. Of the history no files are fetched, where a server can do
without.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from srprov import believed
from srprov.git.cache import ALL, locked, make, place_of, resolve
from srprov.git.program import FETCH_S, LOOK_S, GitError, run
from srprov.git_address import Address

_MOST_SAID = 1 << 20


def doubt(address: Address, ref: str, commit: str, *, folder: Path | None = None) -> str:
    """Return in words why a branch or tag may never have been a commit, or nothing.

    What this machine knows already, as it looked the name up itself or asked before, it knows without the network.

    Args:
        address: The repository.
        ref: The branch or tag; empty: the default branch.
        commit: In full.
        folder: Where repositories are kept; None: the user's own.
    """
    mark, name = _mark(address, ref, commit, folder), ref or "the default branch"
    told = f"the lock has commit {commit[:12]} for {name} of {address.url}"
    try:
        if os.path.lexists(mark) and believed.is_safe_folder(mark.parent):
            return ""
        tip = resolve(address, ref)
        if tip != commit and not _leads_to(address, tip, commit, folder):
            why = "the name was moved or rewritten since, or somebody else put that commit there, as by a pull request"
            return f"{told}, which does not lead there: {why}"
    except (GitError, OSError) as error:
        return f"{told}, and whether that leads there cannot be found out: {error}"
    note(address, ref, commit, folder=folder)
    return ""


def note(address: Address, ref: str, commit: str, *, folder: Path | None = None) -> None:
    """Keep that a branch or tag was this commit; where that cannot be kept, it is found out again."""
    with contextlib.suppress(OSError):
        _keep(_mark(address, ref, commit, folder))


def _mark(address: Address, ref: str, commit: str, folder: Path | None) -> Path:
    name = hashlib.sha256(f"{ref} {commit}".encode()).hexdigest()[:32]
    return place_of(address, folder).with_suffix(".led") / name


def _keep(mark: Path) -> None:
    believed.make_folder(mark.parent)
    believed.write(mark, "", 0)


def _leads_to(address: Address, tip: str, commit: str, folder: Path | None) -> bool:
    place = place_of(address, folder).with_suffix(".history")
    with locked(place):
        make(place, tip)
        _fetch(place, address, tip)
        try:
            leads = ["merge-base", "--is-ancestor", commit, tip]
            run(leads, repository=place, most=_MOST_SAID, seconds=LOOK_S)
        except GitError:  # it is none, or is not there at all
            return False
        return True


def _fetch(place: Path, address: Address, tip: str) -> None:
    """Fetch the commits that a branch leads to, without what they hold where the server can leave that out."""
    fetch = ["fetch", "--quiet", "--no-tags", "--no-write-fetch-head", "--filter=tree:0"]
    for wanted in ([f"+{tip}:refs/srprov/tip"], ALL):  # not every server gives a commit by its id
        try:
            words = [*fetch, "--", address.url, *wanted]
            run(words, repository=place, transport=address.scheme, most=_MOST_SAID, seconds=FETCH_S)
        except GitError as error:
            why = error
        else:
            return
    raise why
