"""What is sent to robots: the program for their processor, and the shell script that runs it. Reads srprov's own files.

The program is `program/probe.c`, as `tools/build_probe.py` builds it; `program/SHA256SUMS` says which bytes that are.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from srprov.probing.model import GATEWAY, UNDERLAY, Endpoint, Request
from srprov.wire import EngineQuery, Put, Run, quote

FOLDER = "/var/lib/srprov"
"""Where only root may enter, and programs may be run from; /run and /tmp are often mounted without that."""
PROGRAMS = Path(__file__).with_name("program")
ARCHITECTURES = {"amd64": "x86_64", "arm64": "aarch64", "arm": "arm", "riscv64": "riscv64"}
"""Docker's name of a processor -> that of its program."""
QUIET_MS = (1200, 4000)
"""Without news for so long it ends: in the first round, where TCP sends a lost first packet again after a second; and
in the second, which decides: a robot whose processors are busy may begin seconds after the others."""
LIMIT_MS = 10_000
_STALE = f"find {FOLDER} -maxdepth 1 -name '.probe.*' -mmin +2 -delete 2>/dev/null"
_MARGIN_S = 30.0
"""For a robot whose processor or link is slow."""


@cache
def _packed(program: str) -> bytes:
    return gzip.compress((PROGRAMS / f"probe-{program}").read_bytes(), mtime=0)


def upload(magic: str, arch: str) -> Put:
    """Return what brings the program to a robot; `magic` is the round's own word of eight hex digits."""
    return Put(path=f"{_path(magic)}.gz", content=_packed(ARCHITECTURES[arch]), mode=0o600)


def inspect(one: Endpoint) -> EngineQuery:
    """Return what asks for the process of an endpoint's container."""
    return EngineQuery(path=f"/containers/{one.container}/json")


def run(request: Request, robot: str, magic: str, namespaces: Mapping[int, int], *, again: bool = False) -> Run:
    """Return the script that runs the program for a robot's endpoints; its file is gone as soon as it runs.

    Args:
        request: Everybody who is asked; the same for all robots of a round.
        robot: Where it runs.
        magic: As for `upload`.
        namespaces: Endpoint's index -> a process in its network namespace; not in it: the robot's own.
        again: The second round.
    """
    selves = [f"{at}:/proc/{namespaces[at]}/ns/net" if at in namespaces else str(at) for at in request.of(robot)]
    numbers = [magic, str(request.mtu), str(request.underlay_mtu), str(QUIET_MS[again]), str(LIMIT_MS)]
    words = " ".join(map(quote, [*numbers, *selves, "--", *map(_word, request.endpoints)]))
    path = quote(_path(magic))
    script = (
        f"umask 077; gzip -dc {path}.gz >{path} && chmod 700 {path} && exec 9<{path} || exit 1\n"
        f'rm -f {path} {path}.gz; for f in {FOLDER}/.probe.*; do [ ! -e "$f" ] || {_STALE}; break; done\n'
        f"exec /proc/self/fd/9 {words}\n"
    )
    return Run(script=script, timeout_s=LIMIT_MS / 1000 + _MARGIN_S)


def _path(magic: str) -> str:
    return f"{FOLDER}/.probe.{magic}"


def _word(one: Endpoint) -> str:
    letter = {GATEWAY: "g", UNDERLAY: "u"}.get(one.kind, "s" if one.sparse else "r")
    return letter + one.address
