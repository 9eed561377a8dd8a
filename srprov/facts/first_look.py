"""One robot's first answers: facts, everything of ours on it, and the placement records that it holds.

Takes a Host and its Reader; gives `Answers`, which know how to ask closer. What a robot says is untrusted.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from srprov import names
from srprov.definitions.model import Host
from srprov.facts.host import host_queries, later_query, parse_host
from srprov.facts.model import HostFacts, TakenPort
from srprov.facts.observe import observe_queries, parse_observed
from srprov.facts.probes import INFO
from srprov.facts.taken import QUERIES, taken_ports
from srprov.modules.module import STATE_ROOT
from srprov.resource import Observed
from srprov.session import Measures, Reader
from srprov.untrusted import json_or_none, mapping, text
from srprov.wire import EngineQuery, Query, Reply

_PLACEMENTS = Query(command=f'for f in {STATE_ROOT}/*/placement.json; do test -f "$f" && cat "$f" && echo; done; :')
_SIZE_LIMIT = 1_000_000
Readers = Callable[[str], Reader]
"""Robot's name -> reader; raises TransportError when it cannot be reached."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Answers:
    """What one robot said."""

    host: Host
    replies: Sequence[Reply]
    measures: Measures | None
    asked_at: float
    """Seconds since the epoch."""
    facts: HostFacts
    observed: tuple[Observed, ...]
    placements: list[Mapping[str, Any]]

    def closer(
        self, readers: Readers, *, engine: bool, traffic: bool, ports: bool
    ) -> tuple[HostFacts, tuple[TakenPort, ...]]:
        """Ask for more, all at once: the engine of itself, a second reading of the counters, who has which ports."""
        queries = [INFO] * engine + [later_query(self.replies)] * traffic
        asked = [*(QUERIES if ports else ()), *queries]
        answers = list(readers(self.host.name).ask(asked))
        taken = taken_ports([answers.pop(0) for _ in QUERIES]) if ports else ()
        later = answers.pop() if traffic else None
        replies = [*self.replies, *answers]
        seen = parse_host(self.host, replies, measures=self.measures, now=self.asked_at, later=later)
        if self.facts.docker is None:
            seen = dataclasses.replace(seen, docker=None, docker_problem=self.facts.docker_problem)
        return seen, taken


def ask(host: Host, readers: Readers, engine: bool) -> Answers:
    """Ask one robot everything at once; with `engine`, its engine of itself too.

    Raises:
        TransportError: It cannot be reached or talked to.
    """
    reader = readers(host.name)
    mine = host_queries(info=engine)
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
    return Answers(
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
        record = mapping(json_or_none(line))
        if names.valid("instance", record.get("instance")) and isinstance(record.get("serial"), int):
            found.append(record)
    return found
