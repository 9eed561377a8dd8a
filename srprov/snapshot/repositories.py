"""Git repositories of a robot: the commit, the remote that has it, and what was changed since.

Takes the answers of `gitscript`; gives repositories. Pure. A patch is taken apart into its files: one that looks as if
it held a secret, or is no text, is left out and noted, and the rest is kept.

Source: git-diff(1), "Generating patch text with -p".
"""

from __future__ import annotations

import base64
import binascii
import itertools
import posixpath
import re
import shlex
from collections.abc import Iterator, Mapping

import msgspec

from srprov.git_address import is_commit, parse_address
from srprov.names import few
from srprov.snapshot.gitscript import ASKED, MOST_PATCH, Found
from srprov.snapshot.notes import Notes
from srprov.snapshot.questions import END
from srprov.snapshot.suspicion import masked
from srprov.untrusted import lines_of, text

MOST = 100
"""Repositories of a robot."""
MOST_PATCHES = 4 << 20
"""Bytes of all patches of a robot."""
CLONES = "/srv/clones"
"""Where somebody puts clones of what a robot has by itself, on the machine that runs srprov."""
_LONGEST_PATH = 400
_FOUND = re.compile(r"([0-9]{1,10}) ([a-z]) (/.*)", re.DOTALL)
_ODD = {
    "kind": "is a link, or its .git is no folder (a worktree or submodule of another one): it is not read",
    "commondir": "shares its objects with another one: it is not read",
    "alternates": "borrows objects from another folder: it is not read",
    "links": "has links among git's files: it is not read",
    "mixed": "belongs to root and has files of other users, for whom root would read: it is not read",
    "open": "cannot be closed off from the robot's other files: it is not read. Root can do that, and others where "
    "unshare may make user namespaces, unless something else is mounted in it",
    "include": "has settings that include other files: it is not read",
    "many": "belongs to root and has too many files to know whether others have some of them: it is not read",
    "pipe": "has no files where git has them: it is not read",
    "split": "has a split index, which git writes to when it reads it: it is not read",
    "commit": "has no commit, or cannot be read by its owner with plain git",
    "forks": "could start programs when it is read, since this kernel does not forbid them: it is not read",
    "submodules": "has submodules: they are repositories of their own, and not part of this one's files",
}


class Repository(msgspec.Struct, frozen=True, kw_only=True):
    """One repository that an image can have."""

    folder: str
    """Absolute, on the robot and in the image."""
    url: str
    commit: str
    branch: str = ""
    patch: bytes = b""
    """What was changed in tracked files since the commit."""


def parse_found(out: str, notes: Notes) -> tuple[Found, ...]:
    """Read the paths of all `.git` that were found."""
    paths, whole = parts_of(out)
    if not whole:
        notes.lost("repositories", "looking for them took too long, or there are too many: more may be there")
    found = []
    for one in paths:
        match = _FOUND.fullmatch(one)
        if match is None:
            continue
        folder = posixpath.dirname(match[3])
        subject = f"repository {folder!r}" if not folder.isprintable() else f"repository {folder}"
        if match[2] != "d":
            notes.lost(subject, _ODD["kind"])
        elif not folder.isprintable() or "\ufffd" in folder or len(folder) > _LONGEST_PATH or folder == "/":
            notes.lost(subject, "has a path that no definition can name")
        else:
            found.append(Found(folder=folder, uid=int(match[1])))
    if len(found) > MOST:
        notes.lost("repositories", f"only {MOST} of {len(found)} are read")
    return tuple(sorted(found, key=lambda one: one.folder)[:MOST])


def parts_of(out: str) -> tuple[list[str], bool]:
    """Return the texts of an answer of base64 between its NULs, and whether it is whole."""
    whole = decoded(out).decode("utf-8", "replace")
    ended = whole.endswith(END)
    # without its end, the last one may be cut
    parts = whole.removesuffix(END).split("\0")
    return [one for one in (parts if ended else parts[:-1]) if one], ended


def decoded(out: str) -> bytes:
    """Return what an answer of base64 says; nothing where it is none."""
    try:
        return base64.b64decode("".join(out.split()), validate=True)
    except (binascii.Error, ValueError):
        return b""


def parse_repository(found: Found, out: str, notes: Notes) -> Repository | None:
    """Read what one repository said."""
    subject = f"repository {found.folder}"
    said, odd = _answers(out)
    for one in odd:
        notes.lost(subject, _ODD.get(one, "is odd"))
    if set(odd) - {"submodules"}:
        return None
    commit = said["commit"].strip()
    if not is_commit(commit):
        notes.lost(subject, _ODD["commit"])
        return None
    url = _remote(said["remotes"], subject, notes)
    if not url:
        return None
    if not said["pushed"].startswith("refs/remotes/"):
        notes.lost(subject, f"its commit {commit[:12]} is on no remote that it knows of: push it and look again")
        return None
    _names(said, subject, notes)
    branch = text(said["branch"].strip(), length=200)
    patch = _patch(said["patch"], subject, notes)
    return Repository(folder=found.folder, url=url, commit=commit, branch=branch, patch=patch)


def _answers(out: str) -> tuple[dict[str, str], list[str]]:
    """Return name -> what git said, which is empty where git failed or the answer was cut; and what is odd.

    Bytes that are no UTF-8 are kept as surrogates.
    """
    said = {"commit": "", **{name: "" for name, *_ in ASKED}}
    odd = []
    for line in lines_of(out, 64):
        name, _, coded = line.partition(" ")
        if name == "odd":
            odd.append(coded)
        elif name in said and not said[name]:
            whole = decoded(coded).decode("utf-8", "surrogateescape")
            body, nul, status = whole.rpartition("\0")
            said[name] = body if nul and status == "0" else _FAILED if name == "patch" else ""
    return said, odd


_FAILED = "\0"


def _remote(listed: str, subject: str, notes: Notes) -> str:
    """Return the address of `origin`, or of the first remote, in a form that srprov fetches from."""
    remotes: dict[str, str] = {}
    for one in listed.split("\0"):
        key, _, url = one.partition("\n")
        remotes.setdefault(key.removeprefix("remote.").removesuffix(".url"), url)
    remotes.pop("", None)
    if not remotes:
        notes.lost(subject, "has no remote that it could be fetched from")
        return ""
    return fetchable(remotes.get("origin") or next(iter(remotes.values())), subject, notes)


def fetchable(url: str, subject: str, notes: Notes) -> str:
    """Return an address that srprov fetches from, without user and password; empty and noted where there is none."""
    plain = re.sub(r"\A(https://)[^/@]*@", r"\1", url)
    plain = re.sub(r"\A(ssh://[^/:@]*):[^/@]*@", r"\1@", plain)
    if plain != url:
        notes.secret(subject, "its remote's address holds a user or password: it is left out")
    if plain.startswith("/"):
        plain = f"file://{plain}"
    if masked(plain) != plain:
        notes.secret(subject, "its remote's address looks as if it held a secret")
        return ""
    try:
        address = parse_address(plain)
    except ValueError:
        scheme = re.match(r"[A-Za-z][A-Za-z0-9+.-]{0,20}::?", plain)
        notes.lost(subject, f"its remote is of a kind that is not fetched from ({scheme[0] if scheme else 'a path'})")
        return ""
    if address.scheme == "file":
        # not at the same path: a robot may name any, also of a repository that is the user's own here, or another one's
        here = posixpath.join(CLONES, notes.robot, address.path.lstrip("/"))
        if shlex.quote(here) != here:
            # a value that the robot calls a secret would be taken out of the command, and quotes with it
            notes.lost(subject, "its remote is a folder of the robot whose name needs quotes: it is not fetched from")
            return ""
        clone = f"git clone --bare ssh://ROBOT{address.path} {here}"
        notes.adapted(subject, f"its remote {address.path} is a folder of the robot: {clone}, which the CDF names")
        return f"file://{here}"
    return address.url


def _names(said: Mapping[str, str], subject: str, notes: Notes) -> None:
    untracked = [text(one, length=80) for one in said["untracked"].split("\0") if one]
    if untracked:
        notes.lost(subject, f"files that are not tracked: {few(untracked, 8)}")
    hidden = [one[2:] for one in said["flags"].split("\0") if one[:1].islower() or one.startswith("S ")]
    if hidden:
        notes.lost(
            subject, f"{len(hidden)} files whose changes git is told not to see, such as {text(hidden[0], length=80)}"
        )


def _patch(diff: str, subject: str, notes: Notes) -> bytes:
    """Return a patch without the files that cannot be shown."""
    if diff == _FAILED:
        notes.lost(subject, f"git could not say what was changed, or it is more than {MOST_PATCH >> 10} KiB")
        return b""
    kept = []
    for section in _sections(diff):
        if len(section.splitlines()) == 1:
            continue  # its time was changed, and nothing else
        name = _name_of(section)
        if re.search(r"^Binary files ", section, re.MULTILINE):
            notes.lost(subject, f"{name} was changed and is no text")
        elif "\nGIT binary patch" in section or re.search(
            r"^(?:new |old )?(?:file )?mode (?:120000|160000)", section, re.M
        ):
            notes.lost(subject, f"{name} is a link or no plain file, and was changed")
        elif masked(changed := _content(section)) != changed:
            notes.secret(subject, f"the changes of {name} look as if they held a secret: they are not in the patch")
        else:
            kept.append(section)
    return "".join(kept).encode("utf-8", "surrogateescape")


def _sections(diff: str) -> Iterator[str]:
    """Return the part of each file."""
    starts = [match.start() for match in re.finditer(r"^diff --git ", diff, re.MULTILINE)]
    for start, end in itertools.pairwise([*starts, len(diff)]):
        yield diff[start:end]


def _name_of(section: str) -> str:
    return text(section.partition("\n")[0].removeprefix("diff --git "), length=160)


def _content(section: str) -> str:
    """Return a file's changes with their context, without what git says of it, which has hashes."""
    body = section.partition("\n@@ ")[2]
    return "\n".join(line[1:] for line in body.split("\n") if not line.startswith("@@ "))
