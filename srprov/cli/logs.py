"""`srprov logs`: what services print, from all robots, each line with its service's name."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Sequence

import click

from srprov.cli import inputs, options
from srprov.cli.codes import UNREACHABLE
from srprov.cli.output import err, out, tell_unreachable
from srprov.cli.streams import lost
from srprov.errors import TransportError, visible
from srprov.secret import redact_lines
from srprov.session import Session


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", nargs=-1)
@options.quietly_robots
@options.INSTANCE
@click.option("-n", "--tail", type=click.IntRange(min=0), default=100, show_default=True, help="Lines from the end.")
@click.option("-f", "--follow", is_flag=True, help="Go on until Ctrl-C, or until all have ended.")
def logs(
    file: str, services: tuple[str, ...], inventories: tuple[str, ...], forks: int, timeout: float, instance: str,
    tail: int, follow: bool,
) -> int:  # fmt: skip
    """Show what services print (all, or those named)."""
    from srprov.controller.status import containers_of
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name = inputs.named_instance(file, instance)[0]
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        code = tell_unreachable(snapshot.unreachable)
        chosen = containers_of(snapshot, name, services)
        show = _Lines(max((len(visible(service)) for service, _, _ in chosen), default=0))
        show.all([(fleet.sessions.get(host), service, container) for service, host, container in chosen], tail, follow)
    return UNREACHABLE if show.lost else code


class _Lines:
    """Prints whole lines of several streams, one at a time."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.lock = threading.Lock()
        self.lost: list[str] = []
        self.ended: queue.SimpleQueue[str] = queue.SimpleQueue()

    def all(self, logs: Sequence[tuple[Session, str, str]], tail: int, follow: bool) -> None:
        """Print logs, each a session, a service and its container, until all have ended or nobody reads any more."""
        for log in logs:
            threading.Thread(target=self.stream, args=(*log, tail, follow), daemon=True).start()
        for _ in logs:
            self.ended.get()
            if lost(sys.stdout):
                return

    def stream(self, session: Session, service: str, container: str, tail: int, follow: bool) -> None:
        """Print one container's log."""
        try:
            for line in redact_lines(session.container_log(container, tail=tail, follow=follow)):
                with self.lock:
                    out(f"{visible(service):<{self.width}} | {line}")
                if lost(sys.stdout):
                    break
        except TransportError as error:
            if not lost(sys.stdout):  # or it was closed because nobody reads
                self.lost.append(service)
                err(f"{visible(service)}: {error.message}")
        finally:
            self.ended.put(service)
