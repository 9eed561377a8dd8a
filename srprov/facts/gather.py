"""All robots at once: their facts, everything of ours on them, and the newest placement record of each instance.

Takes an inventory and a way to get a Reader per robot; gives `Found`. A robot that fails is an entry of
`unreachable`. One round trip of the shell per robot; engine queries travel beside it.
"""

from __future__ import annotations

import concurrent.futures
import json
import time
from collections.abc import Callable, Mapping
from typing import Any

from srprov.definitions.model import Host, Inventory
from srprov.errors import TransportError
from srprov.facts.host import host_queries, parse_host
from srprov.facts.model import Existing, Found, HostFacts
from srprov.facts.observe import observe_queries, parse_observed
from srprov.modules.module import STATE_ROOT
from srprov.wire import Query, Reader, Reply

_PLACEMENTS = Query(command=f'for f in {STATE_ROOT}/*/placement.json; do test -f "$f" && cat "$f" && echo; done; :')
_SIZE_LIMIT = 1_000_000

Readers = Callable[[str], Reader]
"""Robot's name -> reader; raises TransportError when it cannot be reached."""


def gather(lab: Inventory, readers: Readers, *, sample: bool, forks: int = 64) -> Found:
    """Ask every robot of the inventory.

    Args:
        lab: the robots.
        readers: gives each one's reader.
        sample: also measure traffic, which takes 0.3 s.
        forks: robots asked at the same time.
    """
    facts: dict[str, HostFacts] = {}
    existing: dict[str, tuple[Existing, ...]] = {}
    unreachable: dict[str, str] = {}
    records: dict[str, Mapping[str, Any]] = {}
    pool = concurrent.futures.ThreadPoolExecutor(max(1, min(forks, len(lab.hosts))))
    futures = {name: pool.submit(_one, host, readers, sample) for name, host in lab.hosts.items()}
    try:
        concurrent.futures.wait(futures.values())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # Ctrl-C does not wait for the slowest robot
    for name, future in sorted(futures.items()):
        try:
            facts[name], existing[name], placements = future.result()
        except TransportError as error:
            unreachable[name] = error.message + (f"\n  {error.hint}" if error.hint else "")
            continue
        for record in placements:
            best = records.get(record["instance"])
            if best is None or record["serial"] > best["serial"]:
                records[record["instance"]] = record
    return Found(facts=facts, existing=existing, placements=records, unreachable=unreachable)


def _one(host: Host, readers: Readers, sample: bool) -> tuple[HostFacts, tuple[Existing, ...], list[Mapping[str, Any]]]:
    reader = readers(host.name)
    mine = host_queries(sample=sample)
    ours = observe_queries()
    asked_at = time.time()  # the robot's clock is read first of all
    replies = reader.ask([*mine, *ours, _PLACEMENTS])
    facts = parse_host(host, replies[: len(mine)], measures=reader.measure(), now=asked_at)
    return facts, parse_observed(replies[len(mine) : -1]), _placements(replies[-1])


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
