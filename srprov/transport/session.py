"""What every session has in common: a shell, an engine, and which question or command goes to which of them.

Takes a running `Shell` and a way to dial the engine; `ssh.py` and `local.py` add the connection. Safe for several
threads: the shell does one batch at a time, the engine up to four requests, and neither waits for the other.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from srprov.errors import TransportError
from srprov.secret import Secret, Vault
from srprov.transport import prefetch
from srprov.transport.background import Background
from srprov.transport.copying import counted
from srprov.transport.hold import Heartbeat
from srprov.transport.secretfile import secret_script
from srprov.transport.shell import Shell, Streams
from srprov.wire import (
    AnyQuery,
    Command,
    CopyImage,
    EngineCall,
    EngineQuery,
    Measures,
    Progress,
    Pulse,
    Put,
    Query,
    Reply,
    Run,
    Traffic,
    no_progress,
    sh,
)  # fmt: skip

if TYPE_CHECKING:
    from srprov.transport import Peers
    from srprov.transport.engine import Engine
    from srprov.transport.engine_reads import EngineReader
    from srprov.transport.engine_stream import EngineSocket


class BaseSession:
    """A session without its connection; subclasses say how to dial the engine, whether they live, and how to end."""

    _find_line = "line=; echo; "
    """For the shell of a hold: set and print the process that the connection is on the robot, to be ended with it."""

    def __init__(self, host: str, shell: Shell, traffic: Traffic, peers: Peers | None, mark: str) -> None:
        """Take the robot's name, its shell, where to count, how to reach other robots, and the shell's mark."""
        self._host = host
        self._mark = mark
        self._shell = shell
        self._traffic = traffic
        self._peers = peers
        self.vault = Vault()
        """Values for the placeholders of secrets."""
        self._become: Secret | None = None
        self._engine_lock = threading.Lock()
        self._engine: Engine | None = None
        self._engine_reader: EngineReader | None = None
        self._hold: Heartbeat | None = None
        self._prepared = False
        self._lost: TransportError | None = None

    @property
    def host(self) -> str:
        """The robot's name in the inventory."""
        return self._host

    @property
    def traffic(self) -> Traffic:
        """What was used so far, by all threads."""
        return self._traffic

    @property
    def alive(self) -> bool:
        """Tell whether the connection still stands."""
        raise NotImplementedError

    @property
    def reader(self) -> EngineReader:
        """What asks the robot's Docker Engine, whether that is there or not."""
        with self._engine_lock:
            if self._engine_reader is None:
                from srprov.transport.engine_reads import EngineReader

                self._engine_reader = EngineReader(self._host, self._dial_reads, self._traffic, lambda: self.alive)
            return self._engine_reader

    @property
    def engine(self) -> Engine:
        """What changes the robot's Docker Engine, whether that is there or not."""
        with self._engine_lock:
            if self._engine is None:
                from srprov.transport.engine import Engine

                self._engine = Engine(self._host, self._dial_engine, self._traffic, lambda: self.alive)
            return self._engine

    def prepare(self) -> None:
        """Get ready, once and in the background, for changes: the engine's client, and the hold's shell."""
        if not self._prepared:
            self._prepared = True
            prefetch()

    def _warm_engine(self) -> None:
        """Import what the engine's client needs, and connect."""
        self.engine.warm(self.reader.api_version)

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
            if not shell or not engine:
                replies = self._ask_engine(engine) or self._ask_shell(shell)
            else:
                background = Background(lambda: self._ask_engine(engine, beside=True))
                replies = self._ask_shell(shell) | background.result()
        self._traffic.asked_s += time.monotonic() - begun
        return [replies[at] for at in same]

    def _ask_shell(self, queries: dict[int, Query]) -> dict[int, Reply]:
        """Ask the shell, by position."""
        with self._ending_on_error():
            return dict(zip(queries, self._shell.ask(list(queries.values())), strict=True))

    @contextlib.contextmanager
    def _ending_on_error(self) -> Iterator[None]:
        """Close everything when the shell is lost: half a session would show a robot as reachable that is not."""
        try:
            yield
        except TransportError:
            self.close()
            raise

    def _ask_engine(self, queries: dict[int, EngineQuery], *, beside: bool = False) -> dict[int, Reply]:
        """Ask the engine, by position."""
        return dict(zip(queries, self.reader.ask(list(queries.values()), beside=beside), strict=True))

    def execute(self, command: Command, progress: Progress = no_progress) -> Reply:
        """Do one thing and wait for its end; a failure is a reply with `ok` false and the reason in `err`.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        begun = time.monotonic()
        try:
            return self._execute(command, progress)
        finally:
            self._traffic.acted_s += time.monotonic() - begun

    def _execute(self, command: Command, progress: Progress) -> Reply:
        with self._in_contact():
            if isinstance(command, Run | Put):
                run = (
                    command
                    if isinstance(command, Run)
                    else Run(script=self._written(command), timeout_s=command.timeout_s)
                )
                with self._ending_on_error():
                    return self._shell.run(run, progress, shown=command.text())
            if isinstance(command, EngineCall):
                return self.engine.call(command, progress)
            return self._copy(command, progress)

    def execute_all(self, commands: Sequence[Run | Put]) -> Sequence[Reply]:
        """Do several short things in one round trip, one after the other, each whatever came of the others.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        begun = time.monotonic()
        scripts = [one.script if isinstance(one, Run) else self._written(one) for one in commands]
        try:
            with self._in_contact(), self._ending_on_error():
                limits = [one.timeout_s for one in commands]
                return self._shell.run_all(scripts, limits, [one.text() for one in commands])
        finally:
            self._traffic.acted_s += time.monotonic() - begun

    def hold(self, script: str, words: Sequence[str], pulse: Pulse) -> Heartbeat:
        """Run a script beside the session's own shell and keep it alive by a heartbeat; see `wire.Session`.

        Raises:
            TransportError: It cannot be started.
        """
        hold = Heartbeat(self._host, self._beside(), self._traffic, pulse, self._contact_lost)
        hold.begin(self._find_line + sh("exec", "sh", "-c", script, "hold", self._mark, str(pulse.robot_s))
                   + f' "$line" {sh(*words)}')  # fmt: skip
        self._hold = hold
        if self._prepared:
            threading.Thread(target=self._warm_engine, name="warm engine", daemon=True).start()
        return hold

    def _contact_lost(self, error: TransportError) -> None:
        """Remember why, and end everything: whoever waits for an answer is woken by that."""
        self._lost = error
        self.close()

    @contextlib.contextmanager
    def _in_contact(self) -> Iterator[None]:
        """Begin nothing without contact to the other end of a hold, and let all that fails without it say so."""
        if self._hold is not None and self._lost is None:
            try:
                self._hold.check()
            except TransportError as error:
                self._contact_lost(error)
        try:
            if self._lost is None:
                yield
        except TransportError as error:
            if self._lost is None or error.host != self._host:
                raise
        if self._lost is not None:
            raise TransportError(self._host, self._lost.message, hint=self._lost.hint)

    def _written(self, put: Put) -> str:
        """Give the script that writes a file: the last step, and the only one that puts a secret's value in."""
        return secret_script(put, self.vault.content(put.secret)) if put.secret else put.script()

    def _copy(self, copy: CopyImage, progress: Progress) -> Reply:
        """Load an image here while another robot saves it; never more of it in memory than one piece."""
        if self._peers is None:
            return Reply(status=0, ok=False, err=f"no way to {copy.source_host} from here")
        try:
            chunks = self._peers(copy.source_host).save_image(copy.image, copy.timeout_s)
            return self.engine.load(counted(chunks, copy.image, progress), copy.timeout_s, progress)
        except TransportError as error:
            if error.host == self._host:
                raise
            return Reply(status=0, ok=False, err=f"{error.host}: {error.message}")

    def save_image(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream the image as `docker save` writes it.

        Raises:
            TransportError: The engine does not have it, or went away.
        """
        return self.engine.save(image, timeout_s)

    def container_log(self, container: str, *, tail: int, follow: bool) -> Iterator[str]:
        """Give a container's log line by line, standard output and error together; with `follow` until it ends.

        Raises:
            TransportError: The engine or the robot cannot be talked to any more.
        """
        return self.engine.log(container, tail=tail, follow=follow)

    def measure(self) -> Measures | None:
        """Give load and memory when that needs no shell, else None."""
        return None

    def close(self) -> None:
        """End the session; safe to call twice, and from another thread to end a wait."""
        self._shell.close()
        if self._engine_reader is not None:
            self._engine_reader.close()
        if self._engine is not None:
            self._engine.close()
        if self._hold is not None:
            self._hold.cut()
        self._close_connection()

    def _dial_engine(self, seconds: float) -> EngineSocket:
        """Open a stream to the engine; raises EngineGone in words."""
        raise NotImplementedError

    def _dial_reads(self, seconds: float) -> EngineSocket:
        """Open a stream to the engine that is only read from; raises EngineGone in words."""
        return self._dial_engine(seconds)

    def _beside(self) -> Streams:
        """Start a second shell, without the session's mark, and give its streams when it is ready."""
        raise NotImplementedError

    def _close_connection(self) -> None:
        """End what the session runs on."""
        raise NotImplementedError
