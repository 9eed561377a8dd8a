"""What is asked of one git repository of a robot, so that nothing of it can start a program there.

Gives shell text for a repository; `repositories.py` reads the answer. Pure.

git runs programs that a repository's own configuration and attributes name, and there will be more such keys than
anybody lists. So git is started where the kernel lets it start none: as the repository's owner with no capability, and
with a limit of no further process (RLIMIT_NPROC), which root alone is exempt from. A repository of root's is read by
`nobody`, who may read everything and nothing else (CAP_DAC_READ_SEARCH). It can write no byte either (RLIMIT_FSIZE).
The script first tries to start a process in the same way, and gives up where that succeeds. That git is told not to use
such keys as well, by its environment and `-c`, is for its answers to be right, not for safety.

Source: setrlimit(2), capabilities(7), execve(2), git-config(1), gitattributes(5).
"""

from __future__ import annotations

import msgspec

from srprov.sandbox import INSIDE, NO_SANDBOX, sandboxed
from srprov.wire import quote, sh

NOBODY = 65534
MOST_PATCH = 384 << 10
"""Bytes of a repository's patch."""
MOST_NAMES = 16 << 10
_SHORT_S, _LONG_S = 3, 10
TIMEOUT_S = 8 * _SHORT_S + 2 * _LONG_S + 10
"""Of all that is asked of one repository."""
_LINKS = "-type l -print -quit"
_OTHERS = "-xdev ! -uid 0 -printf x -quit"
_TIMED_OUT = 124
"""What `timeout` exits with then, or more, by the signal: `find` exits with less."""
LIMITS = ("--nproc=0:0", "--fsize=0:0", "--core=0:0", "--data=1073741824:1073741824", "--cpu=20:20")
_ENVIRONMENT = (
    "PATH=/usr/local/bin:/usr/bin:/bin", "LC_ALL=C", "HOME=/nonexistent", "GIT_CONFIG_NOSYSTEM=1",
    "GIT_CONFIG_SYSTEM=/dev/null", "GIT_CONFIG_GLOBAL=/dev/null", "GIT_ATTR_NOSYSTEM=1", "GIT_OPTIONAL_LOCKS=0",
    "GIT_NO_LAZY_FETCH=1", "GIT_ALLOW_PROTOCOL=none", "GIT_TERMINAL_PROMPT=0",
)  # fmt: skip
_SETTINGS = (
    "core.multiPackIndex=false", "core.commitGraph=false",
    "core.fsmonitor=false", "core.untrackedCache=false", "core.preloadIndex=false", "index.threads=1",
    "pack.threads=1", "core.hooksPath=/dev/null", "core.attributesFile=/dev/null", "core.excludesFile=/dev/null",
    "core.bigFileThreshold=4m", "core.quotePath=true", "core.sshCommand=false", "credential.helper=",
    "protocol.allow=never", "diff.ignoreSubmodules=all", "diff.renames=false", "diff.noprefix=false",
    "diff.mnemonicPrefix=false", "diff.relative=false", "diff.interHunkContext=0",
    "diff.autoRefreshIndex=false", "filter.lfs.required=false",
    "filter.lfs.clean=", "filter.lfs.process=",
)  # fmt: skip
# `diff` would write what it learned into the index; this one never does
_DIFF = (
    "diff-index", "--patch", "--no-ext-diff", "--no-textconv", "--no-color", "--no-renames", "--ignore-submodules=all",
    "--full-index", "--src-prefix=a/", "--dst-prefix=b/", "--unified=3", "HEAD", "--",
)  # fmt: skip
_HEAD = ("rev-parse", "--quiet", "--verify", "HEAD")
ASKED: tuple[tuple[str, int, int, tuple[str, ...]], ...] = (
    ("branch", 300, _SHORT_S, ("symbolic-ref", "--quiet", "--short", "HEAD")),
    ("remotes", 8 << 10, _SHORT_S, ("config", "--local", "--no-includes", "--null", "--get-regexp",
                                     "^remote[.].*[.]url")),
    ("pushed", 300, _SHORT_S, ("for-each-ref", "--count=1", "--contains", "HEAD", "--format=%(refname)",
                               "refs/remotes")),
    ("untracked", MOST_NAMES, _SHORT_S, ("ls-files", "--others", "--exclude-standard", "--directory", "-z")),
    ("flags", MOST_NAMES, _SHORT_S, ("ls-files", "-v", "-z")),
    ("patch", MOST_PATCH, _LONG_S, _DIFF),
)  # fmt: skip
"""Name of the answer -> its most bytes, the seconds that it may take, git's words."""


class Found(msgspec.Struct, frozen=True):
    """A repository as `find` told of it."""

    folder: str
    """Absolute; where its files are."""
    uid: int


def confined(found: Found, seconds: int, *, root: bool) -> tuple[str, ...]:
    """Return the words before a program that shall start no other one, write nothing and read what the owner may."""
    if not root:  # but in a user namespace, where it is called so
        who: tuple[str, ...] = ("--inh-caps=-all", "--bounding-set=-all")
    elif found.uid == 0:
        only = "-all,+dac_read_search"
        # access(2) asks without capabilities else, and git believes it
        who = (f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", "--securebits=+no_setuid_fixup",
               f"--inh-caps={only}", f"--ambient-caps={only}", f"--bounding-set={only}")  # fmt: skip
    else:
        # no group: what a group may read is not always the owner's
        who = (f"--reuid={found.uid}", f"--regid={NOBODY}", "--clear-groups", "--inh-caps=-all",
               "--bounding-set=-all")  # fmt: skip
    return ("timeout", str(seconds), "setpriv", *who, "--no-new-privs", "prlimit", *LIMITS)


def script(found: Found, *, root: bool) -> str:
    """Return what is asked of a repository; `root` says that the shell is root's.

    It sees nothing but the repository's folder: neither a link among git's files nor a name in one of them leads to
    another file of the robot's, whoever asks.

    Raises:
        ValueError: Its path holds a NUL byte.
    """
    asked = _script(Found(folder=INSIDE, uid=found.uid), root=root)
    closed = sandboxed(found.folder, asked, found.folder, user=not root)
    return f"( {closed} ); [ $? != {NO_SANDBOX} ] || echo 'odd open'"


def _script(found: Found, *, root: bool) -> str:
    folder, place = quote(found.folder), quote(f"{found.folder}/.git")
    lines = [
        f"[ -d {place} ] && [ ! -L {place} ] && [ ! -L {folder} ] || {{ echo 'odd kind'; exit 0; }}",
        # a pipe in their place would keep git waiting
        "for f in HEAD config config.worktree index; do",
        f"[ ! -e {place}/$f ] || [ -f {place}/$f ] || {{ echo 'odd pipe'; exit 0; }}",
        "done",
        # what git says with them, or that it fails, tells of whatever file they lead to
        f"! grep -qis '\\[include' {place}/config {place}/config.worktree || {{ echo 'odd include'; exit 0; }}",
        # git sets the time of a shared index whenever it reads it
        f"for f in {place}/sharedindex.*; do [ ! -e \"$f\" ] || {{ echo 'odd split'; exit 0; }}; done",
        f"[ ! -e {place}/reftable ] || {{ echo 'odd commit'; exit 0; }}",
        f"[ ! -e {place}/commondir ] || {{ echo 'odd commondir'; exit 0; }}",
        f"[ ! -s {place}/objects/info/alternates ] || {{ echo 'odd alternates'; exit 0; }}",
        f"[ ! -e {folder}/.gitmodules ] || echo 'odd submodules'",
    ]
    lines.append(f"[ -z \"$(find {place} {_LINKS} 2>&1)\" ] || {{ echo 'odd links'; exit 0; }}")
    if root and found.uid == 0:
        other = f"timeout {_LONG_S} find {folder} {_OTHERS} 2>/dev/null"
        lines.append(f"o=$({other}) || [ $? -lt {_TIMED_OUT} ] || {{ echo 'odd many'; exit 0; }}")
        lines.append("[ -z \"$o\" ] || { echo 'odd mixed'; exit 0; }")
    forks = sh(*confined(found, _SHORT_S, root=root), "sh", "-c", "(:) && echo forks")
    lines.append(f"o=$({forks} 2>/dev/null); [ -z \"$o\" ] || {{ echo 'odd forks'; exit 0; }}")
    head = sh(*confined(found, _SHORT_S, root=root), *_git(found.folder, _HEAD))
    lines.append(f"c=$({head} 2>/dev/null | head -c 80); [ -n \"$c\" ] || {{ echo 'odd commit'; exit 0; }}")
    lines.append("printf 'commit '; printf '%s\\0000' \"$c\" | base64 | tr -d '\\n'; echo")
    for name, most, seconds, words in ASKED:
        ask = sh(*confined(found, seconds, root=root), *_git(found.folder, words))
        lines.append(f"printf '{name} '")
        lines.append(f"{{ {ask} 2>/dev/null; printf '\\0%s' $?; }} | head -c {most} | base64 | tr -d '\\n'; echo")
    return "\n".join([*lines, ":"])


def _git(folder: str, words: tuple[str, ...]) -> tuple[str, ...]:
    where = (f"GIT_DIR={folder}/.git", f"GIT_WORK_TREE={folder}")
    settings = (word for setting in _SETTINGS for word in ("-c", setting))
    return ("env", "-i", *_ENVIRONMENT, *where, "git", "--no-pager", "--no-replace-objects", *settings, *words)
