"""What is sent to robots: the program for their processor, and the shell script that runs it. Reads srprov's own files.

The program is `program/probe.c`, as `tools/build_probe.py` builds it; `program/SHA256SUMS` says which bytes that are.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from srprov.probing.model import GATEWAY, UNDERLAY, Endpoint, Request
from srprov.wire import EngineQuery, Run, printed, quote

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
_UPLOAD_S = 60.0
_MARGIN_S = 30.0
"""For a robot whose processor or link is slow."""


@cache
def _packed(program: str) -> str:
    """Return a program in base64, in lines, each with its end."""
    return base64.encodebytes(gzip.compress((PROGRAMS / f"probe-{program}").read_bytes(), mtime=0)).decode("ascii")


def upload(magic: str, arch: str) -> Run:
    """Return what brings the program to a robot's shell, which has it as file descriptor 8 from then on, and no file.

    Args:
        magic: The round's own word of eight hex digits.
        arch: Docker's name of the robot's processor.
    """
    path, program = quote(_path(magic)), _packed(ARCHITECTURES[arch])
    script = (
        f"if (umask 077; {{ [ -d {FOLDER} ] || mkdir -p {FOLDER}; }} || exit 1\n"
        f'for f in {FOLDER}/.probe.*; do [ ! -e "$f" ] || {_STALE}; break; done\n'
        f"{printed(program)} | base64 -d | gzip -dc > {path} && chmod 700 {path}\n"
        f") && command exec 8<{path}; then rm -f {path}; else rm -f {path}; false; fi"
    )
    return Run(script=script, timeout_s=_UPLOAD_S, in_place=True)


def inspect(one: Endpoint) -> EngineQuery:
    """Return what asks for the process of an endpoint's container."""
    return EngineQuery(path=f"/containers/{one.container}/json")


def run(request: Request, robot: str, magic: str, namespaces: Mapping[int, int], *, again: bool = False) -> Run:
    """Return the script that runs the program for a robot's endpoints.

    Args:
        request: Everybody who is asked; the same for all robots of a round.
        robot: Where it runs.
        magic: As for `upload`, which was before.
        namespaces: Endpoint's index -> a process in its network namespace; not in it: the robot's own.
        again: The second round.
    """
    selves = [f"{at}:/proc/{namespaces[at]}/ns/net" if at in namespaces else str(at) for at in request.of(robot)]
    numbers = [magic, str(request.mtu), str(request.underlay_mtu), str(QUIET_MS[again]), str(LIMIT_MS)]
    words = " ".join(map(quote, [*numbers, *selves, "--", *map(_word, request.endpoints)]))
    return Run(script=f"exec /proc/self/fd/8 {words}", timeout_s=LIMIT_MS / 1000 + _MARGIN_S)


def _path(magic: str) -> str:
    return f"{FOLDER}/.probe.{magic}"


def _word(one: Endpoint) -> str:
    letter = {GATEWAY: "g", UNDERLAY: "u"}.get(one.kind, "s" if one.sparse else "r")
    return letter + one.address
