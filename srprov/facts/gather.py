"""All robots at once: their facts, everything of ours on them, and the newest placement record of each instance.

Takes an inventory and a way to get a Reader per robot; gives `Snapshot`. A robot that fails is an entry of
`unreachable`. One round trip of the shell per robot; engine queries travel beside it.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import enum
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from srprov.definitions.model import Experiment, Host, Inventory
from srprov.errors import TransportError
from srprov.facts.host import host_queries, later_query, parse_host
from srprov.facts.model import HostFacts, Snapshot
from srprov.facts.observe import observe_queries, parse_observed, parse_probed, probe_queries
from srprov.facts.probes import INFO
from srprov.facts.untrusted import text
from srprov.modules import PROBING
from srprov.modules.module import STATE_ROOT
from srprov.resource import Observed, Resource
from srprov.wire import EngineQuery, Measures, Query, Reader, Reply

_PLACEMENTS = Query(command=f'for f in {STATE_ROOT}/*/placement.json; do test -f "$f" && cat "$f" && echo; done; :')
_SIZE_LIMIT = 1_000_000

Readers = Callable[[str], Reader]
"""Robot's name -> reader; raises TransportError when it cannot be reached."""


class Detail(enum.Enum):
    """What is asked beyond what tells whether all is as it was; each includes the one before it."""

    NO = "no"
    ENGINE = "engine"
    """What each engine says of itself, which makes it start two programs."""
    TRAFFIC = "traffic"
    """The traffic of this moment, which takes a second look, at least 0.2 s after the first."""


class Gathering:
    """A look at all robots that has begun; made by `begin`."""

    def __init__(self, inventory: Inventory, readers: Readers, *, info: bool, forks: int) -> None:
        """Ask every robot, in threads."""
        self._readers, self._info = readers, info
        self._pool = concurrent.futures.ThreadPoolExecutor(max(1, min(forks, len(inventory.hosts))))
        self._futures = {name: self._pool.submit(_one, host, readers, info) for name, host in inventory.hosts.items()}

    def end(self, closer: Detail | Callable[[Snapshot], Detail], *, only_look: bool = False) -> Snapshot:
        """Wait for the answers, and look closer where that is wanted; a function decides that after the first look.

        With `only_look`, as of `gather`, nothing will be decided from it.
        """
        try:
            found, looks = _found(self._futures, only_look)
            wanted = closer if isinstance(closer, Detail) else closer(found)
            traffic, engine = wanted is Detail.TRAFFIC, wanted is not Detail.NO and not self._info
            if traffic or engine:
                again = {
                    name: self._pool.submit(look.closer, self._readers, engine, traffic) for name, look in looks.items()
                }
                found = _closer(found, again, only_look)
            return found
        finally:
            self.close()

    def close(self) -> None:
        """Ask nobody else, and wait for nobody: Ctrl-C does not wait for the slowest robot. Safe to call twice."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def begin(
    inventory: Inventory, readers: Readers, experiment: Experiment, *, exact: bool = False, forks: int = 64
) -> Gathering:
    """Begin to ask every robot of the inventory, as soon as it is connected; for an experiment that may run there.

    The engines are asked of themselves at once with `exact`, and when a service requires a disk of some size: which one
    is Docker's, only the engine knows for sure.
    """
    info = exact or any(service.requires.disk for service in experiment.services.values())
    return Gathering(inventory, readers, info=info, forks=forks)


def gather(
    inventory: Inventory,
    readers: Readers,
    *,
    closer: Detail,
    forks: int = 64,
    only_look: bool = False,
) -> Snapshot:
    """Ask every robot of the inventory.

    A robot whose engine does not answer although services were placed there counts as unreachable: its containers may
    well run, and what cannot be seen must not pass for gone.

    Args:
        inventory: the robots.
        readers: gives each one's reader.
        closer: how closely to look.
        forks: robots asked at the same time.
        only_look: nothing will be decided from it, so give the facts of such a robot all the same.
    """
    return Gathering(inventory, readers, info=closer is not Detail.NO, forks=forks).end(closer, only_look=only_look)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Look:
    """What one robot said."""

    host: Host
    replies: Sequence[Reply]
    measures: Measures | None
    asked_at: float
    """Seconds since the epoch."""
    facts: HostFacts
    observed: tuple[Observed, ...]
    placements: list[Mapping[str, Any]]

    def closer(self, readers: Readers, engine: bool, traffic: bool) -> HostFacts:
        """Ask the engine of itself; read the counters again, some time after the first reading: both at once."""
        queries = [INFO] * engine + [later_query(self.replies)] * traffic
        answers = list(readers(self.host.name).ask(queries))
        later = answers.pop() if traffic else None
        replies = [*self.replies, *answers]
        seen = parse_host(self.host, replies, measures=self.measures, now=self.asked_at, later=later)
        if self.facts.docker is None:
            seen = dataclasses.replace(seen, docker=None, docker_problem=self.facts.docker_problem)
        return seen


def _found(futures: Mapping[str, Future[_Look]], only_look: bool) -> tuple[Snapshot, dict[str, _Look]]:
    """Wait for all, and put together what they said."""
    facts: dict[str, HostFacts] = {}
    observed: dict[str, tuple[Observed, ...]] = {}
    unreachable: dict[str, str] = {}
    records: dict[str, Mapping[str, Any]] = {}
    looks: dict[str, _Look] = {}
    concurrent.futures.wait(futures.values())
    for name, future in sorted(futures.items()):
        try:
            look = looks[name] = future.result()
        except TransportError as error:
            unreachable[name] = _said(error)
            continue
        facts[name], observed[name] = look.facts, look.observed
        for record in look.placements:
            best = records.get(record["instance"])
            if best is None or record["serial"] > best["serial"]:
                records[record["instance"]] = record
    found = Snapshot(facts=facts, observed=observed, placements=records, unreachable=unreachable)
    if not only_look:
        found = _without_mute(found)
    return found, {name: look for name, look in looks.items() if name in found.facts}


def _without_mute(snapshot: Snapshot) -> Snapshot:
    """Count robots as unreachable that hold services, and whose engine does not answer."""
    mute = {
        name
        for name, one in snapshot.facts.items()
        if one.docker is None and _holds_services(name, snapshot.placements)
    }
    if not mute:
        return snapshot
    start = "start it there, or restart the robot"
    why = {
        name: f"its Docker Engine does not answer: {snapshot.facts[name].docker_problem}\n  {start}"
        for name in sorted(mute)
    }
    return dataclasses.replace(
        snapshot,
        facts={name: one for name, one in snapshot.facts.items() if name not in mute},
        observed={name: one for name, one in snapshot.observed.items() if name not in mute},
        unreachable={**snapshot.unreachable, **why},
    )


def _closer(snapshot: Snapshot, again: Mapping[str, Future[HostFacts]], only_look: bool) -> Snapshot:
    """Put in what the second look saw; a robot that went away meanwhile cannot be reached."""
    facts, observed, unreachable = dict(snapshot.facts), dict(snapshot.observed), dict(snapshot.unreachable)
    for name, future in sorted(again.items()):
        try:
            facts[name] = future.result()
        except TransportError as error:
            unreachable[name] = _said(error)
            del facts[name], observed[name]
    snapshot = dataclasses.replace(snapshot, facts=facts, observed=observed, unreachable=unreachable)
    return snapshot if only_look else _without_mute(snapshot)


def _said(error: TransportError) -> str:
    return error.message + (f"\n  {error.hint}" if error.hint else "")


def probe(snapshot: Snapshot, wants: Iterable[Resource], readers: Readers, *, forks: int = 64) -> Snapshot:
    """Return the snapshot with what only shows when a wanted resource is asked for; one round trip per robot.

    A robot that fails meanwhile is noted as unreachable; what it said before stays.
    """
    asked: dict[str, list[Resource]] = {}
    for want in wants:
        if want.module in PROBING and want.host in snapshot.facts:
            asked.setdefault(want.host, []).append(want)
    if not asked:
        return snapshot
    observed, unreachable = dict(snapshot.observed), dict(snapshot.unreachable)
    with concurrent.futures.ThreadPoolExecutor(max(1, min(forks, len(asked)))) as pool:
        futures = {
            host: pool.submit(lambda host=host, mine=mine: readers(host).ask(probe_queries(mine)))  # type: ignore[misc]
            for host, mine in asked.items()
        }
    for host, future in sorted(futures.items()):
        try:
            observed[host] = (*observed[host], *parse_probed(future.result(), asked[host]))
        except TransportError as error:
            unreachable[host] = _said(error)
    return dataclasses.replace(snapshot, observed=observed, unreachable=unreachable)


def _holds_services(robot: str, records: Mapping[str, Mapping[str, Any]]) -> bool:
    placed = (record.get("services") for record in records.values())
    entries = [entry for services in placed if isinstance(services, Mapping) for entry in services.values()]
    return any(isinstance(entry, Mapping) and entry.get("robot") == robot for entry in entries)


def _one(host: Host, readers: Readers, info: bool) -> _Look:
    reader = readers(host.name)
    mine = host_queries(info=info)
    ours = observe_queries()
    asked_at = time.time()  # the robot's clock is read first of all
    replies = reader.ask([*mine, *ours, _PLACEMENTS])
    measures, asked = reader.measure(), replies[: len(mine)]
    facts = parse_host(host, asked, measures=measures, now=asked_at)
    seen = replies[len(mine) : -1]
    mute = [reply for query, reply in zip(ours, seen, strict=True) if isinstance(query, EngineQuery) and not reply.ok]
    if mute and facts.docker is not None:
        # an engine that says its version but not what it runs is as good as none
        facts = dataclasses.replace(facts, docker=None, docker_problem=text(mute[0].err) or f"status {mute[0].status}")
    return _Look(
        host=host,
        replies=asked,
        measures=measures,
        asked_at=asked_at,
        facts=facts,
        observed=parse_observed(seen),
        placements=_placements(replies[-1]),
    )


def _placements(reply: Reply) -> list[Mapping[str, Any]]:
    """Read one JSON document per line; a record that is not of the right shape is as good as none."""
    found: list[Mapping[str, Any]] = []
    for line in reply.out[:_SIZE_LIMIT].splitlines():
        try:
            record = json.loads(line)
        except ValueError:
            continue
        if (
            isinstance(record, dict)
            and isinstance(record.get("instance"), str)
            and isinstance(record.get("serial"), int)
        ):
            found.append(record)
    return found
