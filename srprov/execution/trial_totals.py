"""What the robots and containers of one attempt of a trial used, read while that is asked for anyway.

Takes sessions and what engines say of containers; gives readings. The counters of a container vanish with its last
process, so they are read together with its state, and the last reading counts. What cannot be read is not known, and
spoils no trial.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from srprov.session import Session
from srprov.trials.cgroup import Counters, Group, Mount, Used, added, counters, group, highest, mounts
from srprov.trials.files import Files, by_file
from srprov.trials.hosts import MOUNTINFO, SCRIPT, HostReading
from srprov.trials.hosts import read as read_host
from srprov.trials.reading import read
from srprov.untrusted import integer, mapping, string
from srprov.wire import Query, Reply, sh

_DATA = "/var/lib/docker"
_LONGEST_S = 1.0
"""Between two readings of containers."""
_SHARE = 0.05
"""Of the time since its robot's first one began: so much of a container's life may go unseen at its end."""
_MOST_PIDS = 1 << 22


@dataclass(slots=True)
class _Service:
    """A service's container, and the one before it was started again."""

    group: Group
    own_network: bool
    earlier: Counters
    """Of those before it."""
    now: Counters = field(default_factory=dict)
    latest: Counters = field(default_factory=dict)
    """The last reading alone."""
    moment: float = 0.0
    """When it, or one before it, was last read."""
    finished: float = 0.0


class Totals:
    """The counters of one attempt; several threads may use it, each for another robot."""

    def __init__(self, disks: Mapping[str, str]) -> None:
        """Take where robots' Docker Engines keep their data, as far as known; know nothing else yet."""
        self._disks = disks
        self.hosts: dict[str, list[HostReading]] = {}
        """Robot -> its readings, in order: before and after, or only before."""
        self._mounts: dict[str, Mapping[str, Mount]] = {}
        self._services: dict[str, dict[str, _Service]] = {}
        """Robot -> its services."""
        self._asked: dict[str, tuple[str, ...]] = {}
        """Robot -> the services that are being asked for."""
        self._first: dict[str, float] = {}
        self._last: dict[str, float] = {}

    def of_host(self, host: str) -> Query:
        """Return what asks for a robot's own counters."""
        return Query(command=f"{sh('df', '-Pk', self._disks.get(host) or _DATA)} 2>/dev/null\n{SCRIPT}")

    def host(self, host: str, reply: Reply) -> None:
        """Take a robot's answer to `of_host`."""
        self.hosts.setdefault(host, []).append(read_host(reply.out))
        self._mounts[host] = mounts(by_file(reply.out).get(MOUNTINFO, ()))

    def due(self, host: str, *, now: bool = False) -> Sequence[Query]:
        """Return what to ask of a robot together with its containers' state; nothing where that is too soon."""
        some, moment = self._services.get(host, {}), time.monotonic()
        pause = min(_LONGEST_S, _SHARE * (moment - self._first.get(host, moment)))
        if not some or not (now or moment - self._last.get(host, 0.0) >= pause):
            return ()
        self._asked[host], self._last[host] = tuple(some), moment
        files = [path for one in some.values() for path in one.group.files]
        return (Query(command=sh("grep", "-sHa", "", *files)),)

    def take(self, host: str, replies: Sequence[Reply]) -> None:
        """Take the answer to what was due."""
        for reply in replies:
            files = by_file(reply.out)
            for service in self._asked.get(host, ()):
                one = self._services[host][service]
                if _is_there(one.group, files):
                    found = counters(one.group, files, own_network=one.own_network)
                    one.now, one.latest, one.moment = highest(one.now, found), found, time.time()

    def find(self, host: str, inspected: Mapping[str, object], session: Session) -> None:
        """Find where the counters of containers are that were started since the last time.

        Args:
            host: The robot.
            inspected: Service -> what its engine says of its container.
            session: With the robot.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        some = self._services.setdefault(host, {})
        new = {}
        for service, answer in inspected.items():
            pid = integer(mapping(mapping(answer).get("State")).get("Pid"), high=_MOST_PIDS)
            if pid and (service not in some or some[service].group.pid != pid):
                new[service] = pid
            elif service in some:
                some[service].finished = read(answer).finished
        if not new:
            return
        self._first.setdefault(host, time.monotonic())
        (reply,) = session.ask(
            [Query(command=sh("grep", "-sHa", "", *(f"/proc/{pid}/cgroup" for pid in new.values())))]
        )
        files = by_file(reply.out)
        for service, pid in new.items():
            where = group(pid, files.get(f"/proc/{pid}/cgroup", ()), self._mounts.get(host, {}))
            before = some.get(service)
            some[service] = _Service(
                group=where,
                own_network=_has_own_network(inspected[service]),
                earlier=added(before.earlier, before.now) if before else {},
                moment=before.moment if before else 0.0,
            )

    def latest(self, host: str, service: str) -> tuple[float, Counters]:
        """Return when a service's container was last read, by the controller's clock, and what it said then."""
        one = self._services.get(host, {}).get(service)
        return (one.moment, one.latest) if one else (0.0, {})

    def used(self) -> dict[str, Used]:
        """Return what each service used that was ever found running."""
        return {
            service: Used(counters=added(one.earlier, one.now), moment=one.moment, finished=one.finished)
            for some in self._services.values()
            for service, one in some.items()
        }


def _is_there(one: Group, files: Files) -> bool:
    """Return whether a container's process was there, and not another that has its number by now."""
    *counted, interfaces = one.files
    # one that has ended has no interfaces any more, and its group goes with it
    return interfaces in files and (not counted or any(path in files for path in counted))


def _has_own_network(answer: object) -> bool:
    """Return whether a container's interfaces are its own."""
    mode = string(mapping(mapping(answer).get("HostConfig")).get("NetworkMode"))
    return mode != "host" and not mode.startswith("container:")
