"""What services use at the moment: CPU and memory, from two readings of their containers' counters.

Takes sessions and rows of `status`; gives the rows with figures. Only reads robots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from srprov.errors import TransportError
from srprov.execution.trial_totals import Totals
from srprov.robot_answers import answers_of
from srprov.session import Session
from srprov.wire import EngineQuery

Key = tuple[str, str]
"""Robot and container."""


class Live:
    """Readings of robots' containers, each with the one before it."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._totals: dict[str, Totals] = {}
        self._before: dict[Key, tuple[float, float]] = {}
        """When it was read, and its CPU seconds."""

    def rows(self, rows: Sequence[Mapping[str, Any]], sessions: Mapping[str, Session]) -> list[dict[str, Any]]:
        """Return rows of `status` with `cpu_percent`, of one processor, and `memory_bytes`, without cached files.

        Both are None where they are not known: the former also when a container is seen for the first time.
        """
        containers: dict[str, list[str]] = {}
        for row in rows:
            if row["container"] and row["robot"] in sessions:
                containers.setdefault(row["robot"], []).append(row["container"])
        with ThreadPoolExecutor(max(1, len(containers))) as pool:
            every = pool.map(lambda robot: self._read(robot, containers[robot], sessions[robot]), containers)
            found = {key: value for some in every for key, value in some.items()}
        nothing = {"cpu_percent": None, "memory_bytes": None}
        return [{**row, **found.get((row["robot"], row["container"]), nothing)} for row in rows]

    def _read(self, robot: str, containers: Sequence[str], session: Session) -> dict[Key, dict[str, float | None]]:
        totals = self._totals.setdefault(robot, Totals({}))
        try:
            with answers_of(robot):
                if robot not in totals.hosts:
                    totals.host(robot, session.ask([totals.of_host(robot)])[0])
                states = session.ask([EngineQuery(path=f"/containers/{one}/json") for one in containers])
                totals.find(robot, {one: state.json() for one, state in zip(containers, states, strict=True)}, session)
                totals.take(robot, session.ask(totals.due(robot, now=True)))
        except TransportError:  # who asks for the state says so
            return {}
        return {(robot, one): self._used(totals, (robot, one)) for one in containers}

    def _used(self, totals: Totals, key: Key) -> dict[str, float | None]:
        moment, counters = totals.latest(*key)
        cpu_s, before = counters.get("cpu_s"), self._before.get(key)
        percent = None
        if cpu_s is not None:
            if before and moment > before[0] and cpu_s >= before[1]:
                percent = 100 * (cpu_s - before[1]) / (moment - before[0])
            self._before[key] = (moment, cpu_s)
        return {"cpu_percent": percent, "memory_bytes": counters.get("memory_anon_bytes")}
