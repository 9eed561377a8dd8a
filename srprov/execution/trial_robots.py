"""The containers of one trial on all their robots: made, started, looked at, stopped and removed, robots in parallel.

Takes connections and what is told to the engines; gives readings. Containers run on while a connection is lost, so it
is made anew, and what was being done is done again: all of it may be. An engine that does not answer is waited for in
the same way. A robot that stays away, an engine that refuses, or one that took containers with it, ends it with
`EquipmentFailed`: that says nothing of the experiment, and the trial may be tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import msgspec

from srprov.errors import TransportError
from srprov.execution.sending import sent
from srprov.execution.stopping import stop_all
from srprov.execution.trial_at_once import at_once
from srprov.execution.trial_clocks import samples
from srprov.execution.trial_patience import EquipmentFailed, Patience, Say, check_engine
from srprov.execution.trial_survival import Survival
from srprov.execution.trial_totals import Totals
from srprov.failure import why
from srprov.modules.container_commands import remove, start, stop
from srprov.session import Session
from srprov.trials.clock import Offset, offset
from srprov.trials.reading import Reading, read
from srprov.untrusted import is_of_one
from srprov.wire import Command, EngineCall, EngineQuery

_T = TypeVar("_T")


class TrialContainer(msgspec.Struct, frozen=True, kw_only=True):
    """One container of a trial."""

    host: str
    service: str
    name: str
    create: tuple[Command, ...]
    needs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service of the trial -> `started`, `healthy` or `completed`: before this one is started."""
    grace_s: float = 10.0


class Connections(Protocol):
    """Sessions with locked robots."""

    def get(self, host: str) -> Session:
        """Return the present session with a robot."""

    def renew(self, host: str) -> None:
        """Connect to a robot anew, and lock it.

        Raises:
            TransportError: It cannot be reached.
        """


class TrialRobots:
    """The containers of one trial."""

    def __init__(
        self, connections: Connections, containers: Collection[TrialContainer], say: Say = lambda _text: None,
        disks: Mapping[str, str] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        """Take what is to be run.

        Args:
            connections: With all robots that it is run on.
            containers: What is to be run.
            say: Told who is awaited.
            disks: Robot -> where its Docker keeps its data, as far as known.
        """
        self.by_service = {one.service: one for one in containers}
        self.patience = Patience(connections.renew, say)
        self.measured: list[Mapping[str, Offset | None]] = []
        """Robot -> its clock; for each time that all were."""
        self.totals = Totals(disks)
        self.say = say
        self._connections = connections
        self._hosts = sorted({one.host for one in containers})
        self._survival = Survival(self.patience, max((one.grace_s for one in containers), default=0.0))

    def clear(self) -> None:
        """Remove the containers of this trial, or of one before that was not cleared, with their results."""
        self._on_each(lambda one: [remove(one.name)])

    def create(self) -> None:
        """Create all containers, so that what takes long is done before the first is started.

        What has their names is removed: it is of a trial before that was not cleared.
        """
        self._on_each(lambda one: [remove(one.name), *one.create])

    def start(self, services: Collection[str]) -> None:
        """Start some of them at once."""

        def act(host: str) -> None:
            if host in self.patience.restarted:  # or what died with the engine would be started a second time
                self._inspected(host)
            for one in self._of(host):
                if one.service in services:
                    self._survival.start(one.service)
                    self._do(one, start(one.name))

        self.each(act)

    def stop(self, services: Collection[str], limit_s: float) -> None:
        """Ask some of them to end at the same time, each with its own grace but none with more than the limit."""

        def act(host: str) -> None:
            calls = [stop(one.name, one.grace_s) for one in self._of(host) if one.service in services]
            if calls and (due := self.totals.due(host, now=True)):
                self.totals.take(host, self._connections.get(host).ask(due))
            if len(calls) > 1:
                self._connections.get(host).execute(stop_all(calls, limit_s))

        self._survival.stop(services)
        self.each(act)
        self._on_each(
            lambda one: [stop(one.name, one.grace_s).stopping_within(limit_s)] if one.service in services else []
        )

    def look(self) -> dict[str, Reading]:
        """Read all of them, in one round trip each robot."""
        return {service: read(answer) for service, answer in self.inspect().items()}

    def inspect(self) -> dict[str, Any]:
        """Return what the engines say of all of them, as JSON values; None for one that is not there.

        Raises:
            EquipmentFailed: An engine was away and containers died with it, among others.
        """
        return {service: answer for found in self.each(self._inspected).values() for service, answer in found.items()}

    def _inspected(self, host: str) -> dict[str, Any]:
        some, session = self._of(host), self._connections.get(host)
        states = [EngineQuery(path=f"/containers/{one.name}/json") for one in some]
        every = session.ask([*states, *self.totals.due(host)])
        replies = every[: len(some)]
        self.totals.take(host, every[len(some) :])
        for reply in replies:
            if not reply.ok and reply.status != _NOT_FOUND:
                check_engine(reply)
                raise EquipmentFailed(f"{host}: its containers cannot be read: {why(reply)}")
            if not is_of_one(reply.out):
                raise EquipmentFailed(f"{host}: what its engine says of a container is longer than any needs")
        found = {one.service: reply.json() for one, reply in zip(some, replies, strict=True)}
        self.totals.find(host, found, session)
        self._survival.look(host, {service: read(answer) for service, answer in found.items()})
        return found

    def refuse_dead(self, services: Collection[str]) -> None:
        """Refuse what its engine found dead when it began, when its robot was out of reach: that was restarted.

        Raises:
            RobotRestarted: Some of these services died so.
        """
        for service in sorted(services):
            self._survival.refuse_cut(self.by_service[service].host, service)

    def refuse_doomed(self) -> None:
        """Refuse what failed shortly before its engine went away, when all is fetched: the engine ended it.

        Raises:
            EquipmentFailed: Some service did.
        """
        for host in self._hosts:
            self._survival.refuse_ended(host, [one.service for one in self._of(host)], failed=True)

    def clocks(self) -> dict[str, Offset | None]:
        """Measure all robots' clocks against ours, then read the robots' own counters."""

        def act(host: str) -> Offset | None:
            said, reply = samples(self._connections.get(host), self.totals.of_host(host))
            self.totals.host(host, reply)
            return offset(said)

        found = self.each(act)
        self.measured.append(found)
        return found

    def forget(self) -> None:
        """Forget what was measured, to measure it anew."""
        self.measured.clear()
        self.totals.hosts.clear()

    def log(self, service: str) -> Iterator[str]:
        """Return the lines of a service's log as they come, each with the engine's time before it, to its end."""
        one = self.by_service[service]
        return self._connections.get(one.host).container_log(one.name, tail=-1, follow=True, times=True)

    def on(self, service: str, work: Callable[[Session], _T]) -> _T:
        """Do something with the session of a service's robot, again if the connection is lost meanwhile.

        Raises:
            EquipmentFailed: The robot stays away.
        """

        def act(host: str) -> _T:
            session = self._connections.get(host)
            try:
                return work(session)
            except TransportError:
                # an engine that is away is no lost connection
                (reply,) = session.ask([EngineQuery(path="/_ping", headers=True)])
                if not reply.ok:
                    check_engine(reply)
                raise

        return self.patience.do(act, self.by_service[service].host)

    def _on_each(self, commands: Callable[[TrialContainer], list[Command]]) -> None:
        """Do it for all containers, one after the other on each robot."""

        def act(host: str) -> None:
            for one in self._of(host):
                for command in commands(one):
                    self._do(one, command)

        self.each(act)

    def _do(self, one: TrialContainer, command: Command) -> None:
        session = self._connections.get(one.host)
        reply = sent(command, session)
        if not reply.ok:
            if isinstance(command, EngineCall):
                check_engine(reply)
            raise EquipmentFailed(f"{one.service} on {one.host}: {why(reply)}")

    def each(self, work: Callable[[str], _T], *, leave: bool = False) -> dict[str, _T]:
        """Do it for all robots at once, again where one was away meanwhile, and return what each gave.

        Raises:
            EquipmentFailed: On the first robot by name that failed.
        """
        return at_once(self._hosts, partial(self.patience.do, work), self.patience.over, leave=leave)

    def _of(self, host: str) -> list[TrialContainer]:
        return [one for one in self.by_service.values() if one.host == host]


_NOT_FOUND = 404
