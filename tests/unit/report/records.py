"""Records of runs as `apply` leaves them, of any size and with any names, for tests of pages."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

KINDS = (
    ("network", "srprov.demo"),
    ("vxlan_filter", "srpv1"),
    ("vxlan", "srpv1"),
    ("file", "/var/lib/srprov/demo/hosts"),
    ("file", "/var/lib/srprov/demo/placement.json"),
    ("image", "busybox:1.36"),
)
BEGAN = 1_795_459_856.0


def write(folder: Path, files: Mapping[str, Any]) -> Path:
    """Write files of a record; texts as they are, all else as JSON."""
    for name, content in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(content if isinstance(content, str) else json.dumps(content))
    return folder


def run(robots: int, per_robot: int = 8, *, word: str = "", failed: bool = False, probed: int = 12) -> dict[str, Any]:
    """Return the files of a run that put a service on each robot.

    Args:
        robots: How many.
        per_robot: Steps on each; the last one is the service's container, which waits for that of the robot before it.
        word: Added to every name, cause and message: what a hostile robot might say.
        failed: The container of the last robot does not start.
        probed: At most so many robots tried the overlay.
    """
    names = [f"robot{at}{word}" for at in range(1, robots + 1)]
    placed = {f"node-{at}{word}": name for at, name in enumerate(names, 1)}
    steps = [one for at in range(robots) for one in _steps(at, names, per_robot, word)]
    events, ends = _done(steps, failed, word)
    bad = [one for one in ends if one["outcome"] != "changed"]
    result = {
        "instance": f"demo{word}", "changed": len(ends) - len(bad), "unchanged": 4,
        "failed": sum(one["outcome"] == "failed" for one in ends), "skipped": 0, "not_reached": 0, "unreachable": [],
        "assignment": placed, "cost": round(0.731 * robots, 6),
        "robots": {name: _effort(at, name, ends) for at, name in enumerate(names, 1)},
        "phases": {"definitions": 0.111, "facts": 0.446, "plan": 0.07, "apply": 3.705}, "duration_s": 4.333,
        "probe": _probed(min(robots, probed)), "run": f"/somewhere/demo{word}", "steps": ends,
    }  # fmt: skip
    plan = {
        "plan": 1, "instance": f"demo{word}", "source": f"ada@desk:/race/demo.edf{word}", "assignment": placed,
        "cost": result["cost"],
        "permissions": [{"kind": "privileged", "service": f"node-1{word}", "what": f"all{word}"}],
        "secrets": {f"TOKEN{word}": {"env": "TOKEN"}}, "playbooks": [], "notes": [f"busybox is not pinned{word}"],
        "data": [{"service": f"node-1{word}", "volume": "bags", "source": names[0], "target": names[-1], "how": ""}],
        "unreachable": {}, "unchanged": 4, "counts": {"create": len(steps), "delete": 0}, "steps": steps, "format": 2,
        "costs": dict.fromkeys(placed, 0.731), "also_wanted": [], "limit": [], "inputs": {}, "proof": "",
        "blobs": {},
    }  # fmt: skip
    return {
        "result.json": result,
        "plan.json": plan,
        "events.jsonl": "".join(json.dumps(one) + "\n" for one in events),
        "assignment.json": _decided(placed, names, word) if robots <= 50 else {"assignment": placed, "cost": 1.0},
        "facts.json": {"robots": {name: _facts(at, word) for at, name in enumerate(names)}, "unreachable": {}},
        "probe.json": _probe(names[:probed], word),
        "environment.json": {
            "verb": "apply", "instance": f"demo{word}", "begun": "2026-11-23T18:50:56+00:00",
            "owner": f"ada@desk{word}", "srprov": "0.1.0",
            "python": "3.11.7", "platform": f"Linux-6.1{word}", "libraries": {"click": "8.5.1"},
            "source": {"file": "/race/demo.edf", "commit": "e6ab35967a8f", "dirty": True, "changed": [], "added": []},
        },
        "inputs/demo.edf": f"edf: 1\nname: demo {word!a}\n",
    }  # fmt: skip


def _steps(at: int, names: list[str], per_robot: int, word: str) -> list[dict[str, Any]]:
    first, robot = at * per_robot + 1, names[at]
    found = []
    for more in range(per_robot):
        last = more == per_robot - 1
        module, name = ("container", f"srprov.demo.node-{at + 1}{word}") if last else KINDS[more % len(KINDS)]
        before = [{"id": f"{names[at - 1]}/container:srprov.demo.node-{at}{word}", "condition": "started"}]
        found.append({
            "number": first + more, "robot": robot, "module": module, "name": name, "action": "create",
            "cause": f"not there{word}", "destructive": last and at == 0, "needs": [first + more - 1] if more else [],
            "waits": before if last and at % 4 else [],
            "commands": [{"run": f"true {word}"}], "want": {"params": {"service": f"node-{at + 1}"}, "needs": []},
        })  # fmt: skip
    return found


def _done(steps: list[dict[str, Any]], failed: bool, word: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return events and ends: every step takes 0.1 s, and each robot begins 0.01 s after the one before it."""
    free: dict[str, float] = {}
    over: dict[str, float] = {}
    events, ends = [], []
    for one in steps:
        address = f"{one['robot']}/{one['module']}:{one['name']}"
        ready = max([over.get(need["id"], 0.0) for need in one["waits"]], default=0.0)
        begun = max(free.get(one["robot"], 0.01 * len(free)), ready)
        free[one["robot"]] = over[address] = begun + 0.12
        bad = failed and one is steps[-1]
        about = {"robot": one["robot"], "step": one["number"], "id": address}
        outcome, text = ("failed", f"it said{word}:\nno such device{word}\n") if bad else ("changed", "")
        events.append(
            {"time": BEGAN + begun, "event": "start", **about, "outcome": None, "text": "", "duration_s": 0.0}
        )
        events.append({"time": BEGAN + begun + 0.05, "event": "progress", **about, "outcome": None, "text": f"…{word}"})
        events.append({"time": BEGAN + begun + 0.12, "event": "end", **about, "outcome": outcome, "text": text,
                       "duration_s": 0.1})  # fmt: skip
        ends.append({"number": one["number"], "id": address, "outcome": outcome, "message": text})
    return sorted(events, key=lambda one: one["time"]), ends


def _effort(at: int, name: str, ends: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "changed": 8, "failed": 0, "connections": 1, "round_trips": 16 + at, "bytes_sent": 66_732 + at,
        "bytes_received": 58_201 * at, "connect_s": 0.155, "asked_s": 0.381, "acted_s": 1.264, "duration_s": 0.8,
    }  # fmt: skip


def _decided(placed: Mapping[str, str], names: list[str], word: str) -> dict[str, Any]:
    matrix: dict[str, dict[str, float | None]] = {}
    why: dict[str, dict[str, str]] = {}
    for at, service in enumerate(placed):
        matrix[service] = {
            name: None if (at + there) % 5 == 4 and name != placed[service] else 0.7 + there / 100
            for there, name in enumerate(names)
        }
        why[service] = {
            name: f"it lacks the tag 'lidar'{word}" for name, cost in matrix[service].items() if cost is None
        }
    terms = {service: {"cpu": 0.7, "memory": 0.03, "swap": 0.0, "bandwidth": 0.001} for service in placed}
    made = {"placed": placed, "terms": terms, "optimal": True, "least": 0.73, "gap": 0.0, "moves": [], "frozen": [],
            "pools": {}, "jain": 1.0, "notes": [f"speed is not known{word}"], "matrix": matrix,
            "why_not": why}  # fmt: skip
    return {"assignment": placed, "costs": dict.fromkeys(placed, 0.731), "cost": 0.731 * len(placed), "decision": made}


def _facts(at: int, word: str) -> dict[str, Any]:
    return {
        "name": f"robot{at}", "arch": "arm64", "cpus": 4, "memory_total": 8 << 30, "memory_available": 5 << 30,
        "os": f"Debian GNU/Linux 12{word}", "kernel": "6.1.0", "load1": 0.25, "docker": {"version": "20.10.24"},
        "clock_offset_s": 0.004, "tags": ["arm64"],
    }  # fmt: skip


def _probed(robots: int) -> dict[str, Any]:
    pairs = robots * (robots - 1)
    return {
        "pairs": pairs,
        "failed": 0,
        "ok": True,
        "duration_s": 0.147,
        "causes": [],
        "left_out": {},
        "unreachable": {},
    }


def _probe(names: list[str], word: str) -> dict[str, Any]:
    ends = [{"name": name, "kind": "gateway", "robot": name, "service": "", "address": "10.0.0.1"} for name in names]
    pairs = [
        {"from": one, "to": other, "failed": [], "sent": 5, "received": 5, "mtu": 1450, "tcp": None, "multicast": None,
         "rtt_ms": [0.04, 0.1 + ((at * 7 + there * 3) % 23) / 20, 3.0]}
        for at, one in enumerate(names) for there, other in enumerate(names) if one != other
    ]  # fmt: skip
    return {"instance": "demo", "ok": True, "mtu": 1450, "duration_s": 0.147, "endpoints": ends, "pairs": pairs,
            "underlay": [], "causes": [], "left_out": {f"job{word}": f"its container is exited{word}"},
            "unreachable": {}}  # fmt: skip
