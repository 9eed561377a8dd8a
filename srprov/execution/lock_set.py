"""Acquire the locks of all robots of a run, or of none.

A `LockSet` takes names, sessions and a claim. Of several controllers that want overlapping robots one goes on
and no two wait for each other for ever: whoever waits for a robot holds only robots that come before it by name. So the
first is locked by itself, which settles nearly every race; the rest at once; and where one of them is missing, those
behind it are released before it is waited for.
"""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections.abc import Callable, Collection, Mapping
from types import TracebackType

import msgspec

from srprov.errors import LockHeld, TransportError, one_line
from srprov.execution.locks import SCRIPT, Claim, Holder, parse_holder
from srprov.execution.options import MOST_AT_ONCE, RunOptions
from srprov.execution.outcome import Event, Listener
from srprov.planning.plan import Plan
from srprov.session import LockChannel, Pulse, Session
from srprov.spool import tidy_script
from srprov.wire import CopyImage, quote

_GRACE_S = 1.0
"""For a lock that is only being tested, or released by a controller that lost a race."""
_FIRST_PAUSE_S = 0.05
_LONGEST_PAUSE_S = 0.5
_LOOK_S = 0.1


class LockOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How long to wait for a lock, and by what signs of life it is held."""

    wait_s: float = 0.0
    pulse: Pulse = msgspec.field(default_factory=Pulse)
    forks: int = 64
    copied_to: frozenset[str] = frozenset()
    """Robots that may go on with what has arrived of an image: that is not removed."""


def lock_options(plan: Plan, options: RunOptions) -> LockOptions:
    """Return how the robots of a plan are locked."""
    copied_to = frozenset(
        step.host
        for step in plan.steps
        for one in step.commands
        if isinstance(one, CopyImage) and one.way in ("", "thin")
    )
    return LockOptions(wait_s=options.lock_wait_s, pulse=options.pulse, forks=options.forks, copied_to=copied_to)


class LockSet:
    """The locks of one run; a context manager that releases them."""

    def __init__(
        self,
        robots: Collection[str],
        sessions: Mapping[str, Session],
        claim: Claim,
        options: LockOptions,
        stop: threading.Event,
        listener: Listener,
    ) -> None:
        """Take the robots, how to reach them, and whom to tell who is waited for; nothing is locked yet."""
        self._names = sorted(robots)
        self._sessions, self._claim, self._options = sessions, claim, options
        self._stop, self._listener = stop, listener
        self._pool = concurrent.futures.ThreadPoolExecutor(max(1, min(options.forks, len(self._names))))
        self._begun = time.monotonic()
        self._guard = threading.Lock()
        self._over = False
        self._channels: dict[str, LockChannel] = {}
        self._holders: dict[str, Holder] = {}
        self.held: set[str] = set()
        self.lost: dict[str, str] = {}
        """Robot -> why it cannot be locked: it cannot be talked to, or lacks a tool."""

    def __enter__(self) -> LockSet:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Release all locks. After an error, steps may still be running: the robots end them before a lock is free.

        After a second interrupt nobody waits for the robots: they do the same when the connections end.
        """
        if kind is None:
            self.release()
        elif issubclass(kind, Exception):
            self._finish(lambda name: self._sessions[name].close())
        self._pool.shutdown(wait=False, cancel_futures=True)

    def acquire(self) -> LockSet:
        """Lock all robots, or none; none too when `stop` is set meanwhile.

        Raises:
            LockHeld: Somebody else has one of them for longer than we wait.
        """
        try:
            self._acquire()
        except BaseException as error:
            if isinstance(error, Exception):
                self.release()
            self._pool.shutdown(wait=False, cancel_futures=True)
            raise
        if self._stop.is_set():
            self.release()
        return self

    def _acquire(self) -> None:
        while (missing := self._missing()) and not self._stop.is_set():
            if not self._wait_for(missing[0]):
                continue
            self._each(self._try, missing[1:])
            if still := self._missing():
                self._each(self._unlock, [name for name in self._names if name > still[0] and name in self.held])

    def release(self) -> None:
        """Close every channel, each in its time; those still being made are closed as soon as they are there."""
        self._finish(lambda name: self._channels[name].close())

    def _finish(self, end: Callable[[str], None]) -> None:
        """End every channel that is there, all at once."""
        with self._guard:
            self._over = True
            names = list(self._channels)
        if names:
            # not in our own pool, where a robot that is slow to answer may keep a thread
            with concurrent.futures.ThreadPoolExecutor(min(len(names), MOST_AT_ONCE)) as pool:
                list(pool.map(end, names))
        self.held.clear()

    def _missing(self) -> list[str]:
        return [name for name in self._names if name not in self.held and name not in self.lost]

    def _wait_for(self, name: str) -> bool:
        """Try one robot until it is ours; False when it is not, as it cannot be talked to or we are interrupted."""
        begun, pause = time.monotonic(), _FIRST_PAUSE_S
        until = max(self._begun + self._options.wait_s, begun + _GRACE_S)
        said = 0
        while not self._stop.is_set():
            self._each(self._try, [name])
            if name in self.held or name in self.lost or self._stop.is_set():
                return name in self.held
            now = time.monotonic()
            if now >= until:
                raise self._refusal(name)
            if self._options.wait_s > 0 and int(now - begun) >= said:
                said = int(now - begun) + 1
                left = f"waiting up to {until - now:.0f} s for it"
                self._listener(Event(kind="waiting", host=name, text=f"held by {self._holders[name]}; {left}"))
            self._stop.wait(pause)
            pause = min(pause * 1.5, _LONGEST_PAUSE_S)
        return False

    def _refusal(self, name: str) -> LockHeld:
        waited = f", and was not free within {self._options.wait_s:g} s" if self._options.wait_s else ""
        return LockHeld(
            f"{name} is held by {self._holders[name]}{waited}; nothing was changed",
            hint="wait for it with --lock-wait SECONDS, or see who holds what with `srprov locks`",
        )

    def _each(self, work: Callable[[str], None], names: Collection[str]) -> None:
        """Do it for all names at once; an interrupt does not wait for a robot that is slow to answer."""
        running = {self._pool.submit(work, name) for name in names}
        while running and not self._stop.is_set():
            ended, running = concurrent.futures.wait(running, timeout=_LOOK_S)
            for one in ended:
                one.result()

    def _try(self, name: str) -> None:
        """Try to lock one robot, and note what comes of it."""
        try:
            channel = self._channels.get(name)
            if channel is None:
                tidy = tidy_script(arriving=name not in self._options.copied_to)
                script = f"tidy={quote(tidy)}\n{SCRIPT}"
                channel = self._sessions[name].open_lock_channel(script, self._claim.words(), self._options.pulse)
                answer = channel.first_answer
            else:
                answer = channel.send("t")
            self._keep(name, channel)
        except TransportError as error:
            self.lost[name] = error.told
            return
        word, _, rest = answer.partition(" ")
        if word == "locked":
            self.held.add(name)
        elif word == "busy":
            self._holders[name] = parse_holder(rest)
        else:
            self.lost[name] = f"it cannot be locked: {one_line(rest or answer)}"

    def _keep(self, name: str, channel: LockChannel) -> None:
        """Remember a channel, unless all is over by the time it is made."""
        with self._guard:
            self._channels[name] = channel
            late = self._over
        if late:
            channel.close()

    def _unlock(self, name: str) -> None:
        """Release one robot, ready to lock it again."""
        self.held.discard(name)
        try:
            self._channels[name].send("f")
        except TransportError as error:
            self.lost[name] = error.told
