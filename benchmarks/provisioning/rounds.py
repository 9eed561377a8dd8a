"""One repetition of one tool: clean robots, then the scenarios in their order, each verified by independent means."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from benchmarks.provisioning import measure
from benchmarks.provisioning.job import Job
from benchmarks.provisioning.robots import Lab, Trouble
from benchmarks.provisioning.tool import Tool

PATIENCE_S = 600
Seen = dict[str, dict[str, Any]]


def play(lab: Lab, tool: Tool, job: Job, wanted: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row per wanted scenario. What the others need is done, and not reported."""
    rows: list[dict[str, Any]] = []
    lab.reset()
    tool.begin()
    try:
        before: Seen = {}
        for scenario, todo in (("fresh", job), ("nothing", job), ("changed", job.changed)):
            if scenario != "fresh" and not set(wanted) & ({scenario} if scenario == "changed" else {"nothing"}):
                continue
            call = tool.call(todo, "second" if scenario == "changed" else "first")
            taken = measure.run(call.argv, cwd=tool.folder, env=call.env, stdin=call.stdin, limit_s=PATIENCE_S)
            after = lab.look()
            problem = taken.failure or verify(lab, tool, todo, scenario, before, after)
            before = after
            if scenario in wanted:
                rows.append(_row(lab, tool, scenario, taken, problem))
                tell(rows[-1])
            if problem:
                print(f"  {tool.name}, {scenario}: {problem}", file=sys.stderr)
                break
    finally:
        tool.end()
    return rows


def _row(lab: Lab, tool: Tool, scenario: str, taken: measure.Taken, problem: str) -> dict[str, Any]:
    return {
        "robots": len(lab.robots),
        "latency_ms": lab.latency_ms,
        "tool": tool.name,
        "scenario": scenario,
        "seconds": round(taken.seconds, 4),
        "cpu": round(taken.cpu, 4),
        "rss_mib": round(taken.rss_mib, 1),
        "sent": taken.sent,
        "received": taken.received,
        "idle_before": taken.idle,
        "reported": {} if problem else tool.reported(taken.out),
        "problem": problem,
    }


def tell(row: dict[str, Any]) -> None:
    """Print one measurement."""
    print(
        f"{row['robots']:4} robots {row['latency_ms']:3} ms  {row['scenario']:8} {row['tool']:20}"
        f" {row['seconds']:7.2f} s  cpu {row['cpu']:6.2f} s"
        f"  sent {row['sent'] / 1024:7.0f} KiB  {'FAILED' if row['problem'] else ''}",
        flush=True,
    )


def verify(lab: Lab, tool: Tool, job: Job, scenario: str, before: Seen, after: Seen) -> str:
    """Say what is wrong with the robots after a scenario, or nothing."""
    try:
        _all_running(job, after)
        if tool.vxlan:
            _all_linked(lab, after)
        if scenario != "fresh":
            _replaced(before, after, 0 if scenario == "nothing" else 1)
        _reaches(lab, after)
    except Trouble as trouble:
        return str(trouble)
    return ""


def _all_running(job: Job, seen: Seen) -> None:
    values = []
    for robot, found in seen.items():
        if len(found["containers"]) != 1:
            raise Trouble(f"{robot} runs {len(found['containers'])} containers, not 1")
        values += [word for word in found["containers"][0]["env"] if word.startswith("VALUE=")]
    wanted = sorted(f"VALUE={member.value}" for member in job.members)
    if sorted(values) != wanted:
        raise Trouble(f"containers have {sorted(set(values))}, not {sorted(set(wanted))}")


def _all_linked(lab: Lab, seen: Seen) -> None:
    for robot, address in lab.robots:
        peers = sorted(other for _, other in lab.robots if other != address)
        if len(seen[robot]["links"]) != 1 or seen[robot]["vteps"] != peers:
            raise Trouble(
                f"{robot}: VXLAN links {seen[robot]['links']} to {len(seen[robot]['vteps'])} of {len(peers)} peers"
            )


def _replaced(before: Seen, after: Seen, wanted: int) -> None:
    other = [robot for robot in after if after[robot]["containers"][0]["id"] != before[robot]["containers"][0]["id"]]
    if len(other) != wanted:
        raise Trouble(f"{len(other)} containers were replaced, not {wanted}")


def _reaches(lab: Lab, seen: Seen) -> None:
    """Let the first robot's container ping those of the second and the last robot."""
    first, others = lab.robots[0][0], {lab.robots[len(lab.robots) > 1][0], lab.robots[-1][0]}
    source = seen[first]["containers"][0]
    for robot in sorted(others):
        target = seen[robot]["containers"][0]
        shared = sorted(set(source["addresses"]) & set(target["addresses"]) - {"ingress"})
        if not shared:
            raise Trouble(f"{first} and {robot} share no network")
        words = f"nsenter -t {source['pid']} -n ping -c1 -w8 {target['addresses'][shared[0]]} >/dev/null"
        try:
            lab.enter(first, words, limit_s=20)
        except (Trouble, subprocess.TimeoutExpired):
            raise Trouble(f"no ping from {first} to {robot} in the overlay") from None
