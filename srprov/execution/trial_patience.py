"""Waiting for robots and their Docker Engines to come back in a trial, and saying so.

Takes what is done with a robot; does it again when the robot is back.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from srprov.errors import TransportError
from srprov.failure import why
from srprov.wire import Reply

PATIENCE_S = 120.0
"""For a robot that is out of reach, or an engine that does not answer, to come back."""
_PAUSE_S = 1.0
_REMIND_S = 30.0
_AWAY = (0, 503)
_T = TypeVar("_T")

Say = Callable[[str], None]


class EquipmentFailed(Exception):
    """A robot or its engine did not do what it was asked; the text names it."""


class RobotRestarted(EquipmentFailed):
    """A robot went down and came back: its containers are dead, and what was there over all trials may be gone."""


class EngineAway(Exception):
    """A robot can be talked to, and its engine does not answer; the text says why."""


class Patience:
    """Waits for the robots of one attempt; several threads may use it, each for another robot."""

    def __init__(self, renew: Callable[[str], None], say: Say) -> None:
        """Take how a robot is connected to anew, and whom to tell who is awaited."""
        self._renew, self._say = renew, say
        self.over = threading.Event()
        """Set when nobody needs to wait any more."""
        self.gap_s = 0.0
        """How long some robot, or its engine, was out of reach, all in all."""
        self.cut: set[str] = set()
        """Robots whose connections were lost."""
        self.restarted: set[str] = set()
        """Robots whose engines were away and came back, for who looks at their containers next."""
        self.away: dict[str, float] = {}
        """Robot -> when its engine was last found to be away, by `time.monotonic`."""

    def do(self, work: Callable[[str], _T], host: str) -> _T:
        """Do something with a robot, again when it or its engine was away meanwhile.

        Raises:
            EquipmentFailed: It stays away.
        """
        try:
            return work(host)
        except (TransportError, EngineAway) as error:
            return self._again(work, host, error)

    def _again(self, work: Callable[[str], _T], host: str, why: TransportError | EngineAway) -> _T:
        begun = said = time.monotonic()
        if isinstance(why, EngineAway):
            self.away[host] = begun
        if not self.over.is_set():
            self._say(f"waiting for {host}, up to {PATIENCE_S:g} s: {_words(why)}")
        while (waited := time.monotonic() - begun) < PATIENCE_S and not self.over.is_set():
            if time.monotonic() - said >= _REMIND_S:
                said = time.monotonic()
                self._say(f"still waiting for {host}, {PATIENCE_S - waited:.0f} s more at most: {_words(why)}")
            try:
                if isinstance(why, TransportError):
                    self.cut.add(host)
                    self._renew(host)
                else:
                    self.restarted.add(host)
                done = work(host)
            except (TransportError, EngineAway) as error:
                why = error
                self.over.wait(_PAUSE_S)
            else:
                gap = time.monotonic() - begun
                self.gap_s += gap
                self._say(f"{host} is back after {gap:.0f} s")
                return done
        self.over.set()  # nor is it waited for once more to be cleared
        raise EquipmentFailed(f"{host}: {_words(why)}") from why


def _words(why: TransportError | EngineAway) -> str:
    return why.message if isinstance(why, TransportError) else str(why)


def check_engine(reply: Reply) -> None:
    """Raise EngineAway for the answer of an engine that is not there, or not yet."""
    if reply.status in _AWAY:
        raise EngineAway(why(reply))
