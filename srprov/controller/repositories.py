"""The code repositories of CDFs, for one plan: each name is looked up once, each commit fetched once.

Takes CDFs; gives what `images` puts into a build context. Robots have no part in it: they get files.
"""

from __future__ import annotations

import posixpath
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType

from srprov import disk
from srprov.definitions.containermodel import ContainerDefinition, Repository
from srprov.git import branches, cache
from srprov.git.program import GitError
from srprov.git.tree import TreeFile
from srprov.git_address import is_commit, parse_address
from srprov.images.plan import Checkout, ContextFile

_AT_ONCE = 8
_NONE: Mapping[tuple[str, str], str] = MappingProxyType({})


class Repositories:
    """What was looked up and fetched for one plan."""

    def __init__(self, containers: Collection[ContainerDefinition]) -> None:
        """Look up the names in all CDFs, side by side; what fails is told where it is wanted."""
        wanted = {(one.url, one.ref) for cdf in containers for one in cdf.repositories}
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            self._commits = dict(zip(wanted, pool.map(_resolved, wanted), strict=True))
        self._doubts = doubts(_named(one) for cdf in containers for one in cdf.repositories if one.locked is not None)
        self._read: dict[tuple[str, str, frozenset[str]], tuple[TreeFile, ...]] = {}

    def checkout(self, cdf: ContainerDefinition, index: int) -> Checkout:
        """Return the commit and files of a CDF's repository.

        Raises:
            ValueError: It cannot be fetched, or holds what an image cannot have.
            OSError: It cannot be kept here, or all that is shipped is too much.
        """
        one = cdf.repositories[index]
        commit = self._commits[(one.url, one.ref)]
        try:
            if isinstance(commit, GitError):
                raise commit
            below = {posixpath.relpath(other.path, one.path) for other in cdf.repositories if other is not one}
            files = self._files(one.url, commit, frozenset(below))
        except GitError as error:
            raise ValueError(f"{one.url}: {error}") from None
        disk.spend(one.url, sum(len(file.content) for file in files), len(files))
        now = f"{one.ref or 'the default branch'} of {one.url} is commit {commit[:12]} now"
        moving = "" if is_commit(one.ref) else now
        if one.locked is not None:
            moving = self._doubts[_named(one)]
        return Checkout(commit=commit, files=tuple(map(_in_context, files)), moving=moving)

    def _files(self, url: str, commit: str, elsewhere: frozenset[str]) -> tuple[TreeFile, ...]:
        """Return what a commit holds; several CDFs may have one, which is read once."""
        key = (url, commit, elsewhere)
        if key not in self._read:
            self._read[key] = cache.files(parse_address(url), commit, disk.left(), elsewhere=elsewhere)
        return self._read[key]


def _resolved(wanted: tuple[str, str]) -> str | GitError:
    url, ref = wanted
    try:
        return cache.resolve(parse_address(url), ref)
    except GitError as error:
        return error


def doubts(named: Iterable[tuple[str, str, str]]) -> dict[tuple[str, str, str], str]:
    """Return what is to be said of commits that a lock has: (address, branch or tag, commit) -> words, or nothing.

    Each is asked for once, side by side: where there is no network, that takes its time.
    """
    wanted = sorted(set(named))
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return dict(zip(wanted, pool.map(_doubt, wanted), strict=True))


def _doubt(named: tuple[str, str, str]) -> str:
    url, ref, commit = named
    return branches.doubt(parse_address(url), ref, commit)


def _named(one: Repository) -> tuple[str, str, str]:
    return one.url, one.locked or "", one.ref


def commit_of(url: str, ref: str) -> str:
    """Return the commit that a branch or tag is now.

    Raises:
        ValueError: There is none, or the repository cannot be reached.
    """
    found = _resolved((url, ref))
    if isinstance(found, GitError):
        raise ValueError(f"{url}: {found}")
    branches.note(parse_address(url), ref, found)  # what is locked here stays so when the branch is another by then
    return found


def tree(url: str, ref: str, commits: Mapping[tuple[str, str], str] = _NONE) -> str:
    """Return a folder with the files of a repository's branch, tag or commit, for the CDF in it.

    One that is among `commits` is not looked up.

    Raises:
        ValueError: It cannot be fetched or kept, or holds what cannot be taken.
    """
    address = parse_address(url)
    try:
        commit = commits.get((url, ref)) or cache.resolve(address, ref)
        return str(cache.folder(address, commit, disk.MAX_BYTES))
    except (GitError, OSError) as error:
        raise ValueError(f"{url}: {error}") from None


def _in_context(file: TreeFile) -> ContextFile:
    if file.is_link:
        return ContextFile(path=file.path, link=file.content.decode("utf-8"), mode=0o777)
    return ContextFile(path=file.path, content=file.content, mode=0o755 if file.executable else 0o644)
