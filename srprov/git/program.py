"""Git as a child process: none of the user's settings, no prompts, no hooks, one transport, and limits.

Takes arguments; gives what it printed, or raises GitError. Whoever serves a repository is a stranger, so the kernel
holds git to sizes and times, and nothing that it fetched is ever checked out.
"""

from __future__ import annotations

import os
import secrets
import subprocess
import time
from collections.abc import Mapping, Sequence
from typing import BinaryIO

from srprov.definitions.program import read_both, stop

LOOK_S = 60.0
"""To ask for the names of a repository, and to read what was fetched."""
FETCH_S = 600.0
MOST_FETCHED = 512 * 1024 * 1024
"""Bytes of what is fetched at once, packed."""
_MOST_MEMORY = 2 << 30
OF_A_LOOK = 256 << 20
"""Bytes of memory to look at a repository that is here: git holds a tree as a whole, whatever size it says it has. The
list of objects of a pack counts, too: seven million of them are too many."""
_MOST_PROCESSOR_S = 300
_MOST_SAID = 300
"""Characters of git's own words that an error repeats."""
_SETTINGS = (
    "safe.bareRepository=explicit",
    *("core.multiPackIndex=false", "core.commitGraph=false"),  # they name other files
    *("protocol.version=2", "core.hooksPath=/dev/null", "core.fsmonitor=false", "credential.helper="),
    *("http.followRedirects=false", "http.lowSpeedLimit=1000", "http.lowSpeedTime=30"),
    *("submodule.recurse=false", "fetch.recurseSubmodules=false", "gc.auto=0", "maintenance.auto=false"),
    # one pack per fetch, so that its size is that of one file; large blobs are not held in memory
    *("fetch.unpackLimit=1", "core.bigFileThreshold=1m", "core.packedGitWindowSize=32m", "pack.threads=1"),
)
_KEPT = (
    *("PATH", "SSH_AUTH_SOCK", "SSL_CERT_FILE", "SSL_CERT_DIR", "GIT_SSL_CAINFO"),
    *("https_proxy", "HTTPS_PROXY", "no_proxy", "NO_PROXY", "all_proxy", "ALL_PROXY"),
)
"""What of the user's environment git needs to reach hosts at all."""
_SSH = (
    "ssh -o BatchMode=yes -o StrictHostKeyChecking=yes -o ConnectTimeout=15 -o ClearAllForwardings=yes"
    " -o ForwardAgent=no -o ForwardX11=no -o PermitLocalCommand=no"
)
_NOWHERE = "/dev/null/none"
"""A repository that is none. Git that is told of one looks for none by rules of its own, in the folders around."""
_LIMITED = 'ulimit -c 0 && ulimit -f "$1" && ulimit -v "$2" && ulimit -t "$3" && shift 3 && exec git "$@"'


class GitError(ValueError):
    """Git cannot do what was asked; the message is for the user."""


def run(
    arguments: Sequence[str],
    *,
    repository: str | os.PathLike[str] = _NOWHERE,
    transport: str = "",
    most: int,
    seconds: float,
    memory: int = _MOST_MEMORY,
    given: BinaryIO | None = None,
) -> bytes:
    """Run git and return what it printed.

    Args:
        arguments: Its command and what belongs to it.
        repository: The folder that it works in; without it, in none. It never looks for one.
        transport: The one way by which it may reach a repository: `https`, `ssh` or `file`; empty: none.
        most: Bytes that it may print.
        seconds: After which it is ended.
        memory: Bytes of address space that it may have.
        given: What it reads.

    Raises:
        GitError: It failed, printed more, took longer, or is not installed.
    """
    process = subprocess.Popen(
        [*_limited(memory), *arguments],
        stdin=given or subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd="/",
        env={**_environment(os.environ, transport), "GIT_DIR": os.fspath(repository)},
        start_new_session=True,
    )
    code, printed, said = _ended(process, most, seconds)
    if code:
        raise GitError(_why(code, said.decode("utf-8", "replace")))
    return printed


def _ended(process: subprocess.Popen[bytes], most: int, seconds: float) -> tuple[int, bytes, bytes]:
    try:
        printed, said = read_both(process, time.monotonic() + seconds, most + 1)
        if len(printed) > most:
            raise GitError(f"git prints more than {most >> 10} KiB")
        return process.wait(timeout=seconds), printed, said
    except (TimeoutError, subprocess.TimeoutExpired):
        raise GitError(f"git was not done after {seconds:g} s") from None
    finally:
        stop(process)


def _limited(memory: int) -> list[str]:
    held = (f"core.packedGitLimit={memory >> 2}", f"core.deltaBaseCacheLimit={memory >> 3}")
    limits = [str(MOST_FETCHED // 512), str(memory >> 10), str(_MOST_PROCESSOR_S)]
    settings = (word for one in (*_SETTINGS, *held) for word in ("-c", one))
    return ["/bin/sh", "-c", _LIMITED, "sh", *limits, *settings]


def _environment(own: Mapping[str, str], transport: str) -> dict[str, str]:
    return {
        **{name: own[name] for name in _KEPT if name in own},
        # no .gitconfig and no .netrc; ssh finds the user's own folder without it
        "HOME": "/nonexistent",
        "LC_ALL": "C",
        "GIT_CONFIG_NOSYSTEM": "1",
        "GIT_CONFIG_SYSTEM": "/dev/null",
        "GIT_CONFIG_GLOBAL": "/dev/null",
        "GIT_ATTR_NOSYSTEM": "1",
        "GIT_NO_REPLACE_OBJECTS": "1",
        "GIT_NO_LAZY_FETCH": "1",
        # a repository's settings may call any word a protocol, and name a program for it: here, one that nobody knows
        "GIT_ALLOW_PROTOCOL": transport or secrets.token_hex(16),
        "GIT_TERMINAL_PROMPT": "0",
        "GIT_ASKPASS": "/bin/false",
        "SSH_ASKPASS": "/bin/false",
        "SSH_ASKPASS_REQUIRE": "never",
        "GIT_SSH_COMMAND": _SSH,
        "GIT_SSH_VARIANT": "ssh",
    }


def _why(code: int, said: str) -> str:
    """Return in words why git failed: its last lines, but for hints."""
    if code == 127:
        return "git is not installed here"
    if "index-pack" in said:  # killed by a limit, or by what it read
        return f"what it sends is broken, or larger than {MOST_FETCHED >> 20} MiB"
    lines = [line.strip() for line in said.splitlines() if line.strip() and not line.startswith("hint:")]
    told = "; ".join(line.removeprefix("fatal: ").removeprefix("error: ") for line in lines[:3])
    return (told or f"git ended with {code}")[:_MOST_SAID]
