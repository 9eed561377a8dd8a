"""`srprov logs`: what services print, from all robots, in the order of time, each line with its service's name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import inputs, options
from srprov.cli.codes import UNREACHABLE
from srprov.cli.output import err, out_json_line, out_labelled, tell_unreachable, wants_color
from srprov.cli.since import since as read_since
from srprov.cli.streams import reader_left
from srprov.errors import visible

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.merged_logs import LogLine, MergedLogs, Source
    from srprov.facts.model import Snapshot

_COLORS = ("cyan", "yellow", "green", "magenta", "blue", "bright_cyan", "bright_yellow", "bright_green")
_WRONG_S = 1.0
"""How far a robot's clock must be off to be corrected: less is not known better than by a look at it."""


def _tail(_context: click.Context, _option: click.Parameter, text: str | None) -> int | None:
    """Read a number of lines, or `all` as -1."""
    if text is None or text == "all":
        return -1 if text else None
    if not text.isdecimal() or len(text) > 9:
        raise click.BadParameter(f"{text[:60]!r} is neither a number of lines nor all.")
    return int(text)


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", metavar="[SERVICE]...", nargs=-1)
@options.quietly_robots
@options.INSTANCE
@click.option("-n", "--tail", callback=_tail, default=None, metavar="LINES",
              help="Lines of each container from the end, or all (default: 100; all with --since).")  # fmt: skip
@click.option("--since", callback=read_since, default=None, metavar="TIME",
              help="Only what was printed since: 10m, 1h30m, or 2026-11-22T10:00:00Z.")  # fmt: skip
@click.option("-t", "--timestamps", is_flag=True, help="Show when each line was printed, by its robot's engine.")
@click.option("-f", "--follow", is_flag=True, help="Go on until Ctrl-C, or until all have ended.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document a line.")
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def logs(
    file: str, services: tuple[str, ...], inventories: tuple[str, ...], forks: int, timeout: float, instance: str,
    tail: int | None, since: float | None, timestamps: bool, follow: bool, as_json: bool, no_color: bool,
) -> int:  # fmt: skip
    """Show what services print (all, or those named), also those that have ended, in the order of time.

    A service is a name of the EDF, which means all its replicas; or one replica, or SERVICE@ROBOT.

    Exits with 0, also when whoever reads goes away; with 4 when a robot cannot be reached, or is lost meanwhile, while
    the others go on; with 130 after Ctrl-C.
    """
    from srprov.controller.merged_logs import MergedLogs, Wanted
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        code = tell_unreachable(snapshot.unreachable)
        inputs.tell_maker(snapshot, name, source)
        sources = _sources(file, name, services, fleet, snapshot)
        lines = tail if tail is not None else 100 if since is None else -1
        show = _json if as_json else _Text(sources, timestamps, not no_color and wants_color(sys.stdout)).show
        with MergedLogs(sources, Wanted(tail=lines, follow=follow, since=since)) as merged:
            lost = _show(merged, show)
    return UNREACHABLE if lost else code


def _sources(file: str, name: str, services: tuple[str, ...], fleet: Fleet, snapshot: Snapshot) -> list[Source]:
    """Return the containers whose logs are wanted."""
    from srprov.controller.located import containers_of, locate
    from srprov.controller.merged_logs import Source

    there = locate(snapshot, name, inputs.experiment_if_valid(file) if services else None)
    have = {one.service for one in there.services if one.found}
    wanted = [one for word in services for one in sorted(have & there.families.get(word, set())) or [word]]
    offsets = {host: facts.clock_offset_s for host, facts in snapshot.facts.items()}
    return [
        Source(
            label=label,
            service=label.partition("@")[0],
            host=host,
            container=container,
            session=fleet.sessions.get(host),
            ahead_s=offset if abs(offset := offsets.get(host, 0.0)) > _WRONG_S else 0.0,
        )
        for label, host, container in containers_of(snapshot, name, wanted)
    ]


def _show(merged: MergedLogs, show: Callable[[LogLine], None]) -> bool:
    """Print lines until all logs have ended or nobody reads any more; return whether one was lost."""
    from srprov.controller.merged_logs import LogLost

    any_lost = False
    for some in merged.all():
        for one in some:
            if isinstance(one, LogLost):
                any_lost = True
                err(f"{visible(one.source.label)}: {one.why}")
            else:
                show(one)
        if reader_left(sys.stdout):
            return False
    return any_lost


class _Text:
    """Prints lines for a person: the service's name, and the time where it is wanted."""

    def __init__(self, sources: list[Source], times: bool, color: bool) -> None:
        labels = sorted({one.label for one in sources})
        width = max((len(visible(label)) for label in labels), default=0)
        self._labels = {label: f"{visible(label):<{width}} | " for label in labels}
        self._colors = {label: _COLORS[at % len(_COLORS)] if color else None for at, label in enumerate(labels)}
        self._times = times

    def show(self, line: LogLine) -> None:
        """Print one line."""
        label, time = line.source.label, f"{line.time} " if self._times else ""
        out_labelled(self._labels[label], time + line.text, self._colors[label])


def _json(line: LogLine) -> None:
    """Print one line as `schemas/logs.schema.json` describes it."""
    source = line.source
    document: dict[str, Any] = {"service": source.service, "robot": source.host, "container": source.container}
    out_json_line({"time": line.time or None, **document, "text": line.text})
