"""What every session has in common: a shell, an engine, and which question or command goes to which of them.

Takes a running `Shell`; `ssh_session.py` and `local_session.py` add the connection and the way to the engine. Safe for
several threads: the shell does one batch at a time, the engine up to four requests, and neither waits for the other.
"""

from __future__ import annotations

import abc
import contextlib
import functools
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from srprov.errors import TransportError
from srprov.session import Measures, Progress, Pulse, Streams, Traffic, no_progress
from srprov.transport.background import background
from srprov.transport.engine import EngineAccess, preload
from srprov.transport.engine.link import EngineLink, EngineSocket
from srprov.transport.engine_streams import EngineStreams
from srprov.transport.shell.lock_channel import HeartbeatChannel
from srprov.transport.shell.shell import Shell, tell
from srprov.wire import AnyQuery, Command, Copy, EngineCall, EngineQuery, Put, Query, Reply, Run, sh

if TYPE_CHECKING:
    from srprov.definitions.model import Host
    from srprov.transport.options import ConnectOptions, Peers


class BaseSession(EngineStreams, abc.ABC):
    """A session without its connection; subclasses say how to dial the engine, whether they live, and how to end."""

    _find_connection = "line=; echo; "
    """For the shell of a lock: set `line` to the process on the robot that is this connection, and print it."""
    _proof = "local"
    """What nobody else could show: a robot's host key."""

    def __init__(self, host: Host, options: ConnectOptions, peers: Peers | None, shell: Shell, mark: str) -> None:
        """Take the robot, how to reach others, a shell that was just started, and SRPROV_SESSION of what it runs."""
        self._robot, self._host = host, host.name
        self._vault, self._options, self._peers = options.vault, options, peers
        self._shell = shell
        self._traffic = shell.traffic
        self._mark = mark
        link = functools.partial(EngineLink, host=host.name, alive=lambda: self.alive, traffic=shell.traffic)
        self.engine = EngineAccess(link(dial=self._dial_reads), link(dial=self._dial_changes))
        self._lock_channel: HeartbeatChannel | None = None
        self._prepared = False
        self._lost: TransportError | None = None

    @property
    def host(self) -> str:
        """The robot's name in the inventory."""
        return self._host

    @property
    def identity(self) -> str:
        """Its name, and what it proved to be."""
        return f"{self._host} {self._proof}"

    @property
    def traffic(self) -> Traffic:
        """What was used so far, by all threads."""
        return self._traffic

    @property
    @abc.abstractmethod
    def alive(self) -> bool:
        """Tell whether the connection still stands."""

    @abc.abstractmethod
    def _dial_reads(self, seconds: float) -> EngineSocket:
        """Open a stream to the engine that is only read from; raises EngineGone in words."""

    @abc.abstractmethod
    def _dial_changes(self, seconds: float) -> EngineSocket:
        """Open a stream to the engine that ends with the session's lock; raises EngineGone in words."""

    @abc.abstractmethod
    def _second_shell(self) -> Streams:
        """Start a second shell, without the session's mark, and return its streams when it is ready."""

    @abc.abstractmethod
    def _close_connection(self) -> None:
        """End what the session runs on."""

    def prepare(self) -> None:
        """Get ready, once and in the background, for changes: the engine's client, and the shell of a lock."""
        if not self._prepared:
            self._prepared = True
            preload()

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Ask the shell everything in one round trip, and meanwhile the engine; replies in the same order.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        # modules ask for themselves: what several want to know is asked once
        first: dict[AnyQuery, int] = {}
        same = [first.setdefault(query, at) for at, query in enumerate(queries)]
        shell = {at: query for query, at in first.items() if isinstance(query, Query)}
        engine = {at: query for query, at in first.items() if isinstance(query, EngineQuery)}
        begun = time.monotonic()
        with self._in_contact():
            if shell and engine:
                engine_replies = background(lambda: self._ask_engine(engine, alongside_shell=True))
                replies = self._ask_shell(shell) | engine_replies.result()
            else:
                replies = self._ask_engine(engine) if engine else self._ask_shell(shell)
        self._traffic.asked_s += time.monotonic() - begun
        return [replies[at] for at in same]

    def _ask_shell(self, queries: dict[int, Query]) -> dict[int, Reply]:
        """Ask the shell, by position."""
        with self._closing_on_error():
            return dict(zip(queries, self._shell.ask(list(queries.values())), strict=True))

    def _ask_engine(self, queries: dict[int, EngineQuery], *, alongside_shell: bool = False) -> dict[int, Reply]:
        """Ask the engine, by position."""
        replies = self.engine.reader.ask(list(queries.values()), alongside_shell=alongside_shell)
        return dict(zip(queries, replies, strict=True))

    def execute(self, command: Command, progress: Progress = no_progress) -> Reply:
        """Do one thing and wait for its end; a failure is a reply with `ok` false and the reason in `err`.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        with self._acting():
            if isinstance(command, EngineCall):
                return self.engine.client.call(command, progress)
            if isinstance(command, Copy):
                from srprov.transport.copies import copy

                return copy(command, self, self._peers, self._options, progress)
            with self._closing_on_error():
                return self._shell.run(command, self._script(command), progress)

    def execute_all(self, commands: Sequence[Run | Put]) -> Sequence[Reply]:
        """Do several short things in one round trip, one after the other, each whatever came of the others.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        scripts = [self._script(one) for one in commands]
        with self._acting(), self._closing_on_error():
            return self._shell.run_all(scripts, [one.timeout_s for one in commands], [one.text() for one in commands])

    def _script(self, command: Run | Put) -> str:
        """Return the script of a command: the last step, and the only one that puts a secret's value in."""
        if isinstance(command, Put) and command.secret:
            from srprov.transport.shell.secret_script import secret_script

            return secret_script(command, self._vault.content(command.secret))
        return command.script if isinstance(command, Run) else command.script()

    def open_lock_channel(self, script: str, words: Sequence[str], pulse: Pulse) -> HeartbeatChannel:
        """Run a script in a second shell and keep it alive by a heartbeat; see `session.Session`.

        Raises:
            TransportError: It cannot be started.
        """
        channel = HeartbeatChannel(self._host, self._second_shell(), self._traffic, pulse, self._contact_lost)
        start = sh("exec", "sh", "-c", script, "lock", self._mark, str(pulse.robot_s))
        channel.open(f'{self._find_connection}{start} "$line" {sh(*words)}')
        self._lock_channel = channel
        if self._prepared:
            threading.Thread(target=self.engine.warm_client, name="warm engine", daemon=True).start()
        return channel

    @property
    def holds_lock(self) -> bool:
        """Whether this session holds the robot's lock."""
        return self._lock_channel is not None and self._lock_channel.held

    def _contact_lost(self, error: TransportError) -> None:
        """Remember why, and end everything: whoever waits for an answer is woken by that."""
        self._lost = error
        self.close()

    @contextlib.contextmanager
    def _acting(self) -> Iterator[None]:
        """Count the time of a change, which is begun only in contact with the robot."""
        begun = time.monotonic()
        try:
            with self._in_contact():
                yield
        finally:
            self._traffic.acted_s += time.monotonic() - begun

    @contextlib.contextmanager
    def _closing_on_error(self) -> Iterator[None]:
        """Close everything when the shell is lost: half a session would show a robot as reachable that is not."""
        try:
            yield
        except TransportError:
            self.close()
            raise

    @contextlib.contextmanager
    def _in_contact(self) -> Iterator[None]:
        """Begin nothing without contact to the robot's end of a lock, and let all that fails without it say so."""
        if self._lock_channel is not None and self._lost is None:
            try:
                self._lock_channel.check()
            except TransportError as error:
                self._contact_lost(error)
        try:
            if self._lost is None:
                yield
        except TransportError as error:
            if self._lost is None or error.host != self._host:
                raise
        if self._lost is not None:
            raise TransportError(self._host, self._lost.message, hint=self._lost.hint, code=self._lost.code)

    def open_shell(self, script: str) -> Streams:
        """Run a script in a shell of its own; see `session.Session`.

        Raises:
            TransportError: It cannot be started.
        """
        with self._acting():
            streams = self._second_shell()
            tell(self._host, streams, f"SRPROV_SESSION={self._mark}; export SRPROV_SESSION; {script}; exit\n")
        return streams

    def measure(self) -> Measures | None:
        """Return load and memory when that needs no shell, else None."""
        return None

    def close(self) -> None:
        """End the session; safe to call twice, and from another thread to end a wait."""
        self._shell.close()
        self.engine.close()
        if self._lock_channel is not None:
            self._lock_channel.cut()
        self._close_connection()
