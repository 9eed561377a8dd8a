"""Probe an overlay: a program of ours on every robot at once, and a closer look at them when something fails.

Takes what to ask and sessions; gives rounds and looks. On a robot it writes one file, which is gone as soon as its
shell has opened it, and changes nothing else. A robot that fails is a value.
"""

from __future__ import annotations

import concurrent.futures
import secrets
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeVar

import msgspec

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.facts.host import docker_arch
from srprov.probing.answers import parse_said
from srprov.probing.look import Look, parse_look, queries
from srprov.probing.model import Request, Round, Said
from srprov.probing.request import among
from srprov.probing.script import ARCHITECTURES, inspect, run, upload
from srprov.probing.verdict import Probed, fails
from srprov.robot_answers import answers_of
from srprov.session import Session
from srprov.untrusted import integer, mapping, text
from srprov.wire import Query, Reply

_T = TypeVar("_T")
_NOT_RUNNING = {"created": "its container was never started", "exited": "its container has ended"}
"""Docker's word for a state -> what is said of it."""


class OverlayProbe(msgspec.Struct, frozen=True, kw_only=True):
    """What to probe."""

    request: Request
    architectures: Mapping[str, str]
    """Robot -> Docker's name of its processor; robots that are not in it are asked."""


class Brought(msgspec.Struct, frozen=True, kw_only=True):
    """Robots that have the program already, for the first round."""

    magic: str = ""
    robots: frozenset[str] = frozenset()


class _Ready(msgspec.Struct, frozen=True, kw_only=True):
    """A robot that has the program."""

    namespaces: Mapping[int, int] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Endpoint's index -> process."""
    absent: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service whose container does not run -> its state."""


def bring(probing: OverlayProbe, sessions: Mapping[str, Session]) -> Brought:
    """Bring the program to robots before it is wanted; one that does not take it is asked again by `probe`."""
    magic = secrets.token_hex(4)
    there = {robot: sessions[robot] for robot in probing.request.robots if robot in sessions}
    done, _ = _everywhere(there, lambda robot: _upload(probing, robot, magic, there[robot]))
    return Brought(magic=magic, robots=frozenset(done))


def probe(
    probing: OverlayProbe, sessions: Mapping[str, Session], brought: Brought | None = None, *, closer: bool = False
) -> Probed:
    """Ask everybody, and say what came of it; with `closer`, look at robots also when everything works.

    When something fails, robots are looked at, all are asked again, and looked at again: what fails twice counts, and a
    rule whose counter rose in between dropped it.
    """
    begun = time.monotonic()
    found = probe_once(probing, sessions, brought)
    before: dict[str, Look] = {}
    if fails(found):
        before = look_at(found, sessions)
        found = probe_once(probing, sessions, again=True)
    after = look_at(found, sessions) if closer or before else {}
    return Probed(found=found, before=before, after=after, seconds=time.monotonic() - begun)


def probe_once(
    probing: OverlayProbe, sessions: Mapping[str, Session], brought: Brought | None = None, *, again: bool = False
) -> Round:
    """Ask everybody once, all at the same time: two round trips of the shell and one of the engine on each robot.

    Where the program was brought before, one of the shell is enough. The second time they wait longer for each other.
    """
    request = probing.request
    here = brought or Brought(magic=secrets.token_hex(4))
    magic = here.magic
    lost = {robot: "it cannot be reached" for robot in request.robots if robot not in sessions}
    there = {robot: sessions[robot] for robot in request.robots if robot in sessions}
    ready, failed = _everywhere(there, lambda robot: _prepare(probing, robot, here, there[robot]))
    lost |= failed
    left_out = {name: why for one in ready.values() for name, why in one.absent.items()}
    services = {one.service for one in request.endpoints} - left_out.keys()
    asked = among(request, ready.keys(), services)
    processes = _renumbered(request, asked, ready)
    replies, failed = _everywhere(
        {robot: there[robot] for robot in ready},
        lambda robot: there[robot].execute(run(asked, robot, magic, _of(processes, asked, robot), again=again)),
    )
    lost |= failed
    said: dict[int, Said] = {}
    for robot, reply in replies.items():
        mine = parse_said(reply.out, asked, robot)
        said |= mine
        silent = [one.name for at, one in asked.of(robot).items() if at not in mine]
        if not mine:
            lost[robot] = f"the probe does not run there: {text(reply.err) or f'it ended with {reply.status}'}"
        elif silent:  # what nobody says anything of does not count as tried
            lost[robot] = f"its probe says nothing of {', '.join(silent[:8])}"
    return Round(request=asked, said=said, left_out=left_out, lost=lost, namespaces=processes)


def _architecture(probing: OverlayProbe, robot: str, session: Session) -> str:
    arch = probing.architectures.get(robot) or docker_arch(session.ask([Query(command="uname -m")])[0].out.strip())
    if arch not in ARCHITECTURES:
        why = f"there is no probe for its processor ({text(arch) or 'unknown'}), only for {', '.join(ARCHITECTURES)}"
        raise TransportError(robot, why, hint="--no-probe", code=Code.PROBE)
    return arch


def _upload(probing: OverlayProbe, robot: str, magic: str, session: Session) -> None:
    """Bring the program.

    Raises:
        TransportError: The robot cannot be talked to, or does not take it.
    """
    put = session.execute(upload(magic, _architecture(probing, robot, session)))
    if not put.ok:
        raise TransportError(
            robot, f"the probe cannot be written there: {text(put.err)}", hint="is its disk full?", code=Code.PROBE
        )


def _prepare(probing: OverlayProbe, robot: str, here: Brought, session: Session) -> _Ready:
    """Bring the program where it is not, and ask which processes its containers are.

    Raises:
        TransportError: The robot cannot be talked to, or does not take it.
    """
    if robot not in here.robots:
        _upload(probing, robot, here.magic, session)
    inside = {at: one for at, one in probing.request.of(robot).items() if one.container}
    replies = session.ask([inspect(one) for one in inside.values()])
    states = {at: _process(reply) for at, reply in zip(inside, replies, strict=True)}
    return _Ready(
        namespaces={at: pid for at, (pid, _) in states.items() if pid},
        absent={inside[at].service: why for at, (pid, why) in states.items() if not pid},
    )


def _process(reply: Reply) -> tuple[int, str]:
    """Return a container's process, or 0 and what it is instead of running."""
    if not reply.ok:
        return 0, "its container is not there"
    state = mapping(mapping(reply.json()).get("State"))
    pid = integer(state.get("Pid"), high=2**31)
    status = text(state.get("Status"), length=20)
    return pid, "" if pid else _NOT_RUNNING.get(status, f"its container is {status or 'not running'}")


def _renumbered(whole: Request, asked: Request, ready: Mapping[str, _Ready]) -> dict[int, int]:
    """Return the index among those who are asked -> process."""
    processes = {whole.endpoints[at]: pid for one in ready.values() for at, pid in one.namespaces.items()}
    return {at: processes[one] for at, one in enumerate(asked.endpoints) if one in processes}


def _of(processes: Mapping[int, int], asked: Request, robot: str) -> dict[int, int]:
    return {at: processes[at] for at in asked.of(robot) if at in processes}


def look_at(found: Round, sessions: Mapping[str, Session]) -> dict[str, Look]:
    """Look at every robot that was asked, in one round trip; one that fails meanwhile is left out."""

    def work(robot: str) -> Look:
        asked = queries(found.request, robot, found.namespaces)
        return parse_look(sessions[robot].ask(asked), found.request, robot, found.namespaces)

    return _everywhere({robot: sessions[robot] for robot in found.request.robots}, work)[0]


def _everywhere(sessions: Mapping[str, Session], work: Callable[[str], _T]) -> tuple[dict[str, _T], dict[str, str]]:
    """Do something on all robots at once; return what came of it, and robot -> why it failed."""
    done: dict[str, _T] = {}
    failed: dict[str, str] = {}

    def one(robot: str) -> _T:
        with answers_of(robot):
            return work(robot)

    with concurrent.futures.ThreadPoolExecutor(max(1, len(sessions))) as pool:
        futures = {robot: pool.submit(one, robot) for robot in sorted(sessions)}
        for robot, future in futures.items():
            try:
                done[robot] = future.result()
            except TransportError as error:
                failed[robot] = error.message
    return done, failed
