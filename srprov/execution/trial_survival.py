"""Whether a trial's containers lived through the restart of their Docker Engine, or of their robot.

Takes what is started, stopped and read; raises `EquipmentFailed` where something died with its engine. An engine that
is asked to end stops its containers first, with their own signals, and still answers meanwhile: so what ended shortly
before it went away is not believed to have ended by itself, whatever its exit code.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping

from srprov.execution.trial_patience import EquipmentFailed, Patience, RobotRestarted
from srprov.trials.reading import Reading

_SHUTDOWN_S = 20.0
"""An engine gives its containers 15 s to end, or their own grace."""


class Survival:
    """The containers of one attempt."""

    def __init__(self, patience: Patience, longest_grace_s: float) -> None:
        """Take who knows which engines were away."""
        self._patience = patience
        self._window_s = max(_SHUTDOWN_S, longest_grace_s)
        self._started: set[str] = set()
        self._going: dict[str, float] = {}
        """Services that were started and had not ended when last looked at -> when they were, 0 where not known."""
        self._ended: dict[str, tuple[float, int]] = {}
        """Services that ended without being asked to -> when that was seen, by `time.monotonic`, and the exit code."""

    def start(self, service: str) -> None:
        """Note that a service is about to be started."""
        self._started.add(service)
        self._going[service] = 0.0

    def stop(self, services: Collection[str]) -> None:
        """Note that services are about to be stopped: how they end is no matter any more."""
        for service in services:
            self._going.pop(service, None)

    def look(self, host: str, readings: Mapping[str, Reading]) -> None:
        """Take a look at all services of a robot.

        Raises:
            EquipmentFailed: The engine was away since the last look, and one of them died with it; or it knows nothing
                of one any more, whose log and exit code are lost with it.
        """
        returned = host in self._patience.restarted
        for service, reading in readings.items():
            since = self._going.get(service)
            lost = reading.ended or not reading.state
            if returned and since is not None and (lost or (since and reading.started != since)):
                self._fail(host, service)
            if service in self._started and not reading.state:
                raise EquipmentFailed(f"{host}: the container of {service} is gone; somebody removed it")
            if since is None:
                continue
            if reading.ended:
                self._ended[service] = (time.monotonic(), reading.exit_code)
                del self._going[service]
            else:
                self._going[service] = reading.started
        if returned:
            self.refuse_ended(host, readings)
        self._patience.restarted.discard(host)

    def refuse_ended(self, host: str, services: Collection[str], *, failed: bool = False) -> None:
        """Refuse what ended shortly before the robot's engine went away; only what has a failure's exit code, or all.

        Raises:
            EquipmentFailed: Something did.
        """
        away = self._patience.away.get(host)
        if away is None:
            return
        for service in sorted(self._ended.keys() & set(services)):
            seen, code = self._ended[service]
            if 0 <= away - seen <= self._window_s and (code or not failed):
                self._fail(host, service)

    def refuse_cut(self, host: str, service: str) -> None:
        """Refuse a service that its engine found dead, if its robot was out of reach: that was restarted.

        Raises:
            RobotRestarted: It was.
        """
        if host in self._patience.cut:
            self._fail(host, service)

    def _fail(self, host: str, service: str) -> None:
        if host in self._patience.cut:
            raise RobotRestarted(f"{host} was out of reach and {service} did not survive it: it was restarted")
        raise EquipmentFailed(f"the Docker Engine of {host} was away and {service} did not survive it")
