"""Which other containers of a robot have a folder of a new one: who writes there may say what the other one runs.

A plan says of places of data only that they may be grave, and what lies there is often what another container starts,
with its own rights and secrets. The robot's engine knows who mounts what. Pure, but for the question.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Mapping

from srprov.led import led_of
from srprov.modules.container_names import instance_of
from srprov.untrusted import absolute, mapping, mappings, string, string_map, text
from srprov.wire import EngineQuery, Reply

CONTAINERS = EngineQuery(path="/containers/json", params=(("all", "true"),))
_MOST_MOUNTS = 1000
"""Of a container that are paths of the robot; it may have any number of volumes beside them."""
_MOST_CONTAINERS = 10_000


def shared(paths: Iterable[tuple[str, bool, Collection[str]]], reply: Reply, instance: str) -> Iterator[str]:
    """Yield a sentence for each path that containers of others have, or what holds it, or lies in it.

    Two that only read do not matter to each other.

    Args:
        paths: What is said of each, whether a new container may write to it, and its names on the robot.
        reply: What the engine says to `CONTAINERS`.
        instance: Whose new containers these are: they may run what their own experiment writes.
    """
    wanted = list(paths)
    if wanted and not (reply.ok and isinstance(reply.json(), list)):
        yield "which other containers have the folders of new ones cannot be told"
        return
    items = mappings(reply.json(), most=_MOST_CONTAINERS + 1) if wanted else []
    users, is_whole = _users(items[:_MOST_CONTAINERS], instance)
    if not is_whole or len(items) > _MOST_CONTAINERS:
        yield "which other containers have the folders of new ones cannot all be told: more is there than is looked at"
    known = sorted(users)
    for said, written, names in wanted:
        found = dict[str, bool]()
        for path in sorted({f"{one.rstrip('/')}/" for one in names}):
            above = (path[: slash.end()] for slash in re.finditer("/", path))
            below = known[bisect_left(known, path) : bisect_left(known, f"{path[:-1]}0")]  # "0" follows "/"
            for one in (*(path for path in above if path in users), *below):
                _add(found, users[one])
        if some := sorted(name for name, writes in found.items() if written or writes):
            others = f"{'containers' if len(some) > 1 else 'container'} {', '.join(some)} of others"
            yield f"{said} {'is had by' if written else 'may be written to by'} the {others}: {_WHY[written]}"


_WHY = {True: "they may run or believe what is written there", False: "what lies there may be theirs"}


def _users(items: Iterable[object], instance: str) -> tuple[dict[str, dict[str, bool]], bool]:
    """Return path of the robot, with a slash at its end -> containers of others that mount it, and who writes.

    And whether that is all.
    """
    users: dict[str, dict[str, bool]] = {}
    is_whole = True
    for item in map(mapping, items):
        labels = string_map(item.get("Labels"))
        if instance_of(item) == instance:
            continue
        names = item.get("Names")
        name = string(names[0]).removeprefix("/") if isinstance(names, list) and names else string(item.get("Id"))[:12]
        mounts = [one for one in mappings(item.get("Mounts")) if one.get("Type") == "bind"]
        is_whole, mounts = is_whole and len(mounts) <= _MOST_MOUNTS, mounts[:_MOST_MOUNTS]
        led = led_of({"Mounts": mounts, "Config": {"Labels": labels}})
        for one in mounts:
            source = absolute(one.get("Source"))
            who = {text(name) or "without a name": one.get("RW") is not False}
            for path in {source, led.get(source, "")} - {""}:
                _add(users.setdefault(f"{path.rstrip('/')}/", {}), who)
    return users, is_whole


def _add(found: dict[str, bool], more: Mapping[str, bool]) -> None:
    for name, writes in more.items():
        found[name] = found.get(name, False) or writes
