"""All robots at once: their facts, everything of ours on them, and the placement records that each holds.

Takes an inventory and a way to get a Reader per robot; gives a `Snapshot`. A robot that fails is an entry of
`unreachable`. One round trip of the shell per robot; engine queries travel beside it.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import enum
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from msgspec.structs import replace

from srprov.definitions.model import Inventory
from srprov.errors import TransportError
from srprov.facts.first_look import Answers, Readers, ask
from srprov.facts.model import HostFacts, Snapshot, TakenPort
from srprov.modules import PROBING
from srprov.modules.observe import parse_probed, probe_queries
from srprov.resource import Observed, Resource
from srprov.robot_answers import answers_of
from srprov.wire import AnyQuery, Reply

_START = (
    "start it there, or restart the robot; where what it says is too long to be read, a container's image says "
    "too much: find it there by 'docker ps -a', and remove it by 'docker rm -f NAME'"
)


class Detail(enum.Enum):
    """What is asked beyond what tells whether all is as it was; each includes the one before it."""

    BASIC = "basic"
    ENGINE = "engine"
    """What each engine says of itself, which makes it start two programs."""
    TRAFFIC = "traffic"
    """The traffic of this moment, which takes a second look, at least 0.2 s after the first."""


class Gathering:
    """Questions to all robots of an inventory, asked from the moment it is made; a context manager.

    `first` waits for the first answers, `closer` asks for more, `probe` asks about single resources that are wanted.
    """

    sees = True
    """Whether what is on the robots is known, and not only what they are like."""

    def __init__(
        self, inventory: Inventory, readers: Readers, *, engine: bool = False, ports: bool = False, forks: int = 64,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Ask every robot in threads, as soon as it is connected.

        Args:
            inventory: The robots.
            readers: Gives each one's reader.
            engine: Ask the engines of themselves at once.
            ports: Whoever looks closer wants to know who has which ports.
            forks: Robots asked at the same time.
            meanwhile: Called in a thread of its own when robots are looked at closer, which means waiting for them.
        """
        self._meanwhile = meanwhile
        self.inventory, self._readers, self._engine = inventory, readers, engine
        self._ports = ports
        self._pool = concurrent.futures.ThreadPoolExecutor(max(1, min(forks, len(inventory.hosts))))
        hosts = inventory.hosts.items()
        self._futures = {name: self._pool.submit(ask, host, readers, engine) for name, host in hosts}

    def first(self, *, keep_mute: bool = False) -> Snapshot:
        """Wait for the first answers.

        A robot whose engine does not answer although services were placed there counts as unreachable: its containers
        may well run, and what cannot be seen must not pass for gone. With `keep_mute` its facts are given all the same,
        to who decides nothing from them.
        """
        concurrent.futures.wait(self._futures.values())
        snapshot = _put_together(self._futures)
        return snapshot if keep_mute else _without_mute(snapshot)

    def closer(self, detail: Detail, *, keep_mute: bool = False) -> Snapshot:
        """Ask every robot that answered for more, and return all that is known then."""
        snapshot = self.first(keep_mute=keep_mute)
        traffic, engine = detail is Detail.TRAFFIC, detail is not Detail.BASIC and not self._engine
        ports = self._ports and detail is not Detail.BASIC
        if not (traffic or engine or ports):
            return snapshot

        def ask_again(name: str) -> tuple[HostFacts, tuple[TakenPort, ...]]:
            return self._futures[name].result().closer(self._readers, engine=engine, traffic=traffic, ports=ports)

        if self._meanwhile:
            threading.Thread(target=self._meanwhile, name="meanwhile", daemon=True).start()
        again = {name: self._pool.submit(ask_again, name) for name in snapshot.facts}
        snapshot = _with_facts(snapshot, again)
        return snapshot if keep_mute else _without_mute(snapshot)

    def probe(self, snapshot: Snapshot, wants: Iterable[Resource]) -> Snapshot:
        """Ask about wanted resources that cannot be listed, only checked one by one, such as commands.

        Return the snapshot with them; one round trip per robot.

        A robot that fails meanwhile is noted as unreachable; what it said before stays.
        """
        asked: dict[str, list[Resource]] = {}
        for want in wants:
            if want.module in PROBING and want.host in snapshot.facts:
                asked.setdefault(want.host, []).append(want)
        futures = {host: self._pool.submit(_probe, self._readers, host, mine) for host, mine in asked.items()}
        observed, unreachable = dict(snapshot.observed), dict(snapshot.unreachable)
        for host, future in sorted(futures.items()):
            try:
                observed[host] = (*observed[host], *future.result())
            except TransportError as error:
                unreachable[host] = _said(error)
        return replace(snapshot, observed=observed, unreachable=unreachable) if asked else snapshot

    def ask_each(self, questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        """Return the replies of each robot, asked in one round trip.

        One that fails meanwhile is left out: what is planned there fails there, and says why.
        """
        futures = {host: self._pool.submit(_ask, self._readers, host, mine) for host, mine in questions.items()}
        replies: dict[str, Sequence[Reply]] = {}
        for host, future in sorted(futures.items()):
            with contextlib.suppress(TransportError):
                replies[host] = future.result()
        return replies

    def identity(self, name: str) -> str:
        """Return what a robot proves to be, as `Reader.identity` says it; nothing when it cannot be talked to."""
        try:
            return self._readers(name).identity
        except TransportError:
            return ""

    def __enter__(self) -> Gathering:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Ask nobody else, and wait for nobody: Ctrl-C does not wait for the slowest robot."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def gather(
    inventory: Inventory, readers: Readers, *, detail: Detail, forks: int = 64, keep_mute: bool = False
) -> Snapshot:
    """Ask every robot of the inventory, as `Gathering` does, and return what was found."""
    with Gathering(inventory, readers, engine=detail is not Detail.BASIC, forks=forks) as look:
        return look.closer(detail, keep_mute=keep_mute)


def _put_together(futures: Mapping[str, Future[Answers]]) -> Snapshot:
    """Return what the robots said, each of which was waited for."""
    facts: dict[str, HostFacts] = {}
    observed: dict[str, tuple[Observed, ...]] = {}
    unreachable: dict[str, str] = {}
    records: dict[str, Mapping[str, Mapping[str, Any]]] = {}
    proofs: dict[str, str] = {}
    for name, future in sorted(futures.items()):
        try:
            said = future.result()
        except TransportError as error:
            unreachable[name] = _said(error)
            continue
        facts[name], observed[name], records[name] = said.facts, said.observed, said.placements
        proofs[name] = said.identity
    return Snapshot(facts=facts, observed=observed, records=records, unreachable=unreachable, proofs=proofs)


def _without_mute(snapshot: Snapshot) -> Snapshot:
    """Count robots as unreachable that hold services, and whose engine does not answer."""
    mute = {
        name
        for name, one in snapshot.facts.items()
        if one.docker is None and _holds_services(name, snapshot.records.get(name, {}))
    }
    if not mute:
        return snapshot
    why = {
        name: f"its Docker Engine does not answer: {snapshot.facts[name].docker_problem}\n  {_START}"
        for name in sorted(mute)
    }
    return replace(
        snapshot,
        facts={name: one for name, one in snapshot.facts.items() if name not in mute},
        observed={name: one for name, one in snapshot.observed.items() if name not in mute},
        unreachable={**snapshot.unreachable, **why},
    )


def _with_facts(snapshot: Snapshot, again: Mapping[str, Future[tuple[HostFacts, tuple[TakenPort, ...]]]]) -> Snapshot:
    """Return the snapshot with what the second look saw; a robot that went away meanwhile cannot be reached."""
    facts, observed, unreachable = dict(snapshot.facts), dict(snapshot.observed), dict(snapshot.unreachable)
    taken: dict[str, tuple[TakenPort, ...]] = {}
    for name, future in sorted(again.items()):
        try:
            facts[name], taken[name] = future.result()
        except TransportError as error:
            unreachable[name] = _said(error)
            del facts[name], observed[name]
    return replace(snapshot, facts=facts, observed=observed, unreachable=unreachable, taken=taken)


def _said(error: TransportError) -> str:
    return error.told + (f"\n  {error.hint}" if error.hint else "")


def _ask(readers: Readers, host: str, questions: Sequence[AnyQuery]) -> Sequence[Reply]:
    return readers(host).ask(questions)


def _probe(readers: Readers, host: str, wants: Sequence[Resource]) -> tuple[Observed, ...]:
    replies = readers(host).ask(probe_queries(wants))
    with answers_of(host):
        return parse_probed(replies, wants)


def _holds_services(robot: str, records: Mapping[str, Mapping[str, Any]]) -> bool:
    """Return whether a robot's own records say so: what others say of it would make it unreachable."""
    return any(entry["robot"] == robot for record in records.values() for entry in record.get("services", {}).values())
