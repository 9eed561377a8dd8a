"""`srprov doctor`: what is missing on each robot for srprov to work, each with its remedy."""

from __future__ import annotations

import concurrent.futures
import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import inputs, options
from srprov.cli.codes import FAILED
from srprov.cli.output import out, out_json, tell_unreachable
from srprov.errors import TransportError, visible
from srprov.names import few

if TYPE_CHECKING:
    from srprov.facts.preconditions import Check

_MOST_NAMED = 10


@click.command()
@options.robots
@options.chosen
def doctor(inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str, exclude: str) -> int:
    """Check what every robot must have, and say how to get what is missing.

    Exits with 3 when something that is needed is missing, with 4 when a robot cannot be reached; warnings alone are 0.
    """
    from srprov.controller.clocks import measure_clock
    from srprov.controller.kept import line, remedy, volume_rows, with_sizes
    from srprov.facts.gather import Detail
    from srprov.facts.preconditions import Verdict, judge, precondition_queries
    from srprov.robot_answers import answers_of

    inventory = inputs.load_chosen(inventories, limit, exclude)
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.ENGINE, keep_mute=True)
        unreachable = dict(snapshot.unreachable)

        def one(name: str) -> tuple[Check, ...]:
            session = fleet.sessions.get(name)
            with answers_of(name):
                return judge(snapshot.facts[name], session.ask(precondition_queries()), measure_clock(session))

        checks: dict[str, tuple[Check, ...]] = {}
        with concurrent.futures.ThreadPoolExecutor(max(1, len(snapshot.facts))) as pool:
            for name, future in {name: pool.submit(one, name) for name in snapshot.facts}.items():
                try:
                    checks[name] = future.result()
                except TransportError as error:
                    unreachable[name] = error.told
        kept = with_sizes(volume_rows(snapshot, "", kept=True), fleet, snapshot)
    if as_json:
        out_json(doctor_json(checks, unreachable, kept))
    else:
        out(doctor_text(checks))
        now = dt.datetime.now(dt.timezone.utc)
        for row in kept:
            out(visible(f"data is kept: {line(row, now)}; {remedy(row)} removes it"))
    code = tell_unreachable(unreachable)
    if any(check.verdict is Verdict.FAILED for robot in checks.values() for check in robot):
        return FAILED
    return code


def doctor_text(checks: Mapping[str, Sequence[Check]]) -> str:
    """Return a line per robot that is well, for the others what is not, and once what is so on most robots."""
    lines = []
    for name, robot in sorted(checks.items()):
        bad = [check for check in robot if check.remedy and not check.is_common]
        lines.append(f"{name}: {'all is well' if not bad else f'{len(bad)} of {len(robot)} checks'}")
        for check in bad:
            lines += [f"  {check.verdict.value}: {check.name}: {check.found}", f"    {check.remedy}"]
    return "\n".join([*lines, *_common(checks)])


def _common(checks: Mapping[str, Sequence[Check]]) -> Iterator[str]:
    """Yield what is so on most robots: what was found, and on which of them."""
    told: dict[tuple[str, str], dict[str, list[str]]] = {}
    for name, robot in sorted(checks.items()):
        for check in robot:
            if check.remedy and check.is_common:
                where = told.setdefault((f"{check.verdict.value}: {check.name}", check.remedy), {})
                where.setdefault(check.found, []).append(name)
    for (head, remedy), where in told.items():
        each = [f"{found} ({few(names, _MOST_NAMED)})" for found, names in where.items()]
        yield from (f"{head}: {few(each, _MOST_NAMED)}", f"  {remedy}")


def doctor_json(
    checks: dict[str, tuple[Check, ...]], unreachable: dict[str, str], kept: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any]:
    """Return every check of every robot, and the data that is kept."""
    robots = {
        name: [{"check": c.name, "verdict": c.verdict.value, "found": c.found, "remedy": c.remedy} for c in robot]
        for name, robot in sorted(checks.items())
    }
    return {"robots": robots, "volumes": list(kept), "unreachable": dict(sorted(unreachable.items()))}
