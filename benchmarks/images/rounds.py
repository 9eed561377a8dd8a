"""One tool on clean robots: the cases in their order, each repeated while that is cheap, and each verified."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.images import link, table
from benchmarks.images.fleet import Fleet
from benchmarks.images.tool import Tool
from benchmarks.provisioning import measure
from benchmarks.provisioning.robots import Trouble

PATIENCE_S = 1500
ENOUGH_S = 10.0
"""A case that has taken so long in all is not repeated."""


def play(fleet: Fleet, tool: Tool, word: str, wanted: Sequence[str], repeat: int) -> Iterator[dict[str, Any]]:
    """Give a row per measurement. Where `fresh` is not wanted it is done at full speed, and not reported."""
    begun = False
    try:
        for case in table.CASES:
            if case != "fresh" and case not in wanted:
                continue
            spent = 0.0
            for number in range(repeat):
                if case == "fresh":
                    if begun:
                        tool.end()
                    fleet.clean()
                    tool.begin()
                    begun = True
                row = _measured(fleet, tool, word if case in wanted else link.FULL, case, number)
                if case in wanted:
                    tell(row)
                    yield row
                if row["problem"]:
                    print(f"  {tool.name}, {case}: {row['problem']}", file=sys.stderr)
                    return
                spent += row["seconds"]
                if spent > ENOUGH_S or case not in wanted:
                    break
    finally:
        if begun:
            tool.end()


def _measured(fleet: Fleet, tool: Tool, word: str, case: str, number: int) -> dict[str, Any]:
    image = fleet.image(case, number)
    call = tool.call(image)
    with link.shaped(fleet.lab.site.bridge, word):
        before = fleet.received()
        taken = measure.run(call.argv, cwd=tool.folder, env=call.env, stdin=call.stdin, limit_s=PATIENCE_S)
        received = [after - earlier for after, earlier in zip(fleet.received(), before, strict=True)]
    problem = taken.failure
    if not problem:
        try:
            fleet.check(image)
        except Trouble as trouble:
            problem = str(trouble)
    return {
        "robots": len(fleet.targets),
        "image_mib": fleet.image_mib,
        "link": word,
        "case": case,
        "tool": tool.name,
        "repetition": number,
        "seconds": round(taken.seconds, 3),
        "cpu": round(taken.cpu, 3),
        "rss_mib": round(taken.rss_mib, 1),
        "sent": taken.sent,
        "received": taken.received,
        "per_robot": sum(received) / len(received),
        "missing": 0 if case == "nothing" else fleet.made[image],
        "idle_before": taken.idle,
        "reported": {} if problem else tool.reported(taken.out),
        "problem": problem,
    }


def tell(row: dict[str, Any]) -> None:
    """Print one measurement."""
    print(
        f"{row['robots']:3} robots {row['image_mib']} MiB {row['link']:7} {row['case']:8} {row['tool']:30}"
        f" {row['seconds']:7.2f} s  sent {row['sent'] / 2**20:7.1f} MiB  received {row['received'] / 2**20:6.1f} MiB"
        f"  {'FAILED' if row['problem'] else ''}",
        flush=True,
    )
