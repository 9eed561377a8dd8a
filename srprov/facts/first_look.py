"""One robot's first answers: facts, everything of ours on it, and the placement records that it holds.

Takes a Host and its Reader; gives `Answers`, which know how to ask closer. What a robot says is untrusted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.definitions.model import Host
from srprov.facts.host import host_queries, later_query, parse_host, with_closer
from srprov.facts.model import HostFacts, TakenPort
from srprov.facts.placements import parse_placements, without_records
from srprov.facts.probes import FILES, INFO
from srprov.facts.taken import QUERIES, taken_ports
from srprov.modules.observe import observe_queries, parse_observed
from srprov.resource import Observed
from srprov.robot_answers import answers_of
from srprov.session import Reader
from srprov.untrusted import text
from srprov.wire import AnyQuery, EngineQuery, Reply

Readers = Callable[[str], Reader]
"""Robot's name -> reader; raises TransportError when it cannot be reached."""


class Answers(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot said."""

    host: Host
    replies: Sequence[Reply]
    facts: HostFacts
    observed: tuple[Observed, ...]
    placements: Mapping[str, Mapping[str, Any]]
    """Instance -> the record that it holds."""
    identity: str
    """What it proved to be."""

    def closer(
        self, readers: Readers, *, engine: bool, traffic: bool, ports: bool
    ) -> tuple[HostFacts, tuple[TakenPort, ...]]:
        """Ask for more, all at once: the engine of itself, a second reading of the counters, who has which ports."""
        queries = [INFO] * engine + [later_query(self.replies)] * traffic
        asked = [*(QUERIES if ports else ()), *queries]
        answers = list(readers(self.host.name).ask(asked))
        of_ports = [answers.pop(0) for _ in QUERIES] if ports else []
        later = answers.pop() if traffic else None
        replies = [*self.replies, *answers]
        with answers_of(self.host.name):
            taken = taken_ports(of_ports) if ports else ()
            seen = with_closer(self.facts, replies, later)
        if self.facts.docker is None:
            seen = replace(seen, docker=None, docker_problem=self.facts.docker_problem)
        return seen, taken


def ask(host: Host, readers: Readers, engine: bool) -> Answers:
    """Ask one robot everything at once; with `engine`, its engine of itself too.

    Raises:
        TransportError: It cannot be reached or talked to.
    """
    reader = readers(host.name)
    mine = host_queries(info=engine)
    asked_at = time.time()  # the robot's clock is read first of all
    replies = reader.ask([*mine, *observe_queries(), FILES])
    with answers_of(host.name):
        return _read(host, reader, replies, mine, asked_at)


def _read(host: Host, reader: Reader, replies: Sequence[Reply], mine: Sequence[AnyQuery], asked_at: float) -> Answers:
    """Read the replies; the first of them, those to `mine`, are about the robot itself."""
    asked, ours = replies[: len(mine)], observe_queries()
    facts = parse_host(host, asked, measures=reader.measure(), now=asked_at)
    seen = replies[len(mine) : -1]
    mute = [reply for query, reply in zip(ours, seen, strict=True) if isinstance(query, EngineQuery) and not reply.ok]
    if mute and facts.docker is not None:
        # an engine that says its version but not what it runs is as good as none
        facts = replace(facts, docker=None, docker_problem=text(mute[0].err) or f"status {mute[0].status}")
    return Answers(
        host=host,
        replies=[without_records(one) if query == FILES else one for query, one in zip(mine, asked, strict=True)],
        facts=facts,
        observed=parse_observed(seen),
        placements=parse_placements(replies[-1]),
        identity=reader.identity,
    )
