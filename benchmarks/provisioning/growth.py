"""What grows with robots and services in srprov itself: CPU seconds, bytes and memory by part, without connections.

    python -m benchmarks.provisioning.growth [--robots 125,250,500,1000] [--services 1,2] [--network none,overlay]

Robots are in memory, and their own time is taken out. Services are pinned, evenly: --services of them on each robot, or
with --over a number of robots, so many as --robots says on those. An experiment is planned and applied, planned again
with nothing to do, and planned and applied with a variable of every service changed. Each size has a process of its
own, so that peaks of memory are its own. `exponent` is the slope between the last two sizes: 1 is linear.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from benchmarks.provisioning.robots import ROOT

LIMIT_S = 1800


def main() -> None:
    """Measure, or be the process that measures one size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = lambda text: [int(word) for word in text.split(",")]  # noqa: E731 - one line says it
    parser.add_argument("--robots", type=numbers, default=[125, 250, 500, 1000])
    parser.add_argument("--services", type=numbers, default=[1])
    parser.add_argument("--network", type=lambda text: text.split(","), default=["none", "overlay"])
    parser.add_argument("--over", type=int, default=0, help="always so many robots; --robots are numbers of services")
    parser.add_argument("--one", nargs=3, metavar=("ROBOTS", "SERVICES", "NETWORK"), help=argparse.SUPPRESS)
    wish = parser.parse_args()
    if wish.one:
        print(json.dumps(_Case(int(wish.one[0]), int(wish.one[1]), wish.one[2]).measured()))
        return
    for network in wish.network:
        for each in wish.services:
            sizes = [(wish.over or robots, robots if wish.over else each * robots) for robots in wish.robots]
            print(f"\nnetwork {network}\n")
            print(table([(robots, services, _apart(robots, services, network)) for robots, services in sizes]))


def _apart(robots: int, services: int, network: str) -> dict[str, float]:
    """Measure one size in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="srprov-bench-") as folder:
        argv = [sys.executable, "-m", "benchmarks.provisioning.growth", "--one", str(robots), str(services), network]
        env = {**os.environ, "XDG_STATE_HOME": folder, "XDG_CACHE_HOME": folder, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(argv, env=env, capture_output=True, text=True, timeout=LIMIT_S, cwd=ROOT, check=False)
    if done.returncode:
        sys.exit(f"{robots} robots, {services} services: {done.stderr[-2000:]}")
    found: dict[str, float] = json.loads(done.stdout)
    return found


def table(rows: Sequence[tuple[int, int, Mapping[str, float]]]) -> str:
    """Return a Markdown table: a line for each part, a column for each size, and the exponent of the last two."""
    heads = [f"{robots} robots, {services} services" for robots, services, _ in rows]
    lines = [f"| part | {' | '.join(heads)} | exponent |", "|---" * (len(rows) + 2) + "|"]
    for part in rows[-1][2]:
        values = [found.get(part, 0.0) for _, _, found in rows]
        shown = " | ".join(f"{value:.0f}" if value >= 100 else f"{value:.3g}" for value in values)
        lines.append(f"| {part} | {shown} | {_exponent(rows, values)} |")
    return "\n".join(lines)


def _exponent(rows: Sequence[tuple[int, int, Mapping[str, float]]], values: Sequence[float]) -> str:
    if len(rows) < 2 or min(values[-2:]) <= 0:
        return ""
    sizes = [robots + services for robots, services, _ in rows]
    if rows[-1][0] == rows[-2][0]:
        sizes = [services for _, services, _ in rows]
    return f"{math.log(values[-1] / values[-2]) / math.log(sizes[-1] / sizes[-2]):.1f}"


class _Robot:
    """A connection to a robot in memory; what the robot itself takes is added up, and no part of the measurement."""

    taken_s = 0.0
    _lock = threading.Lock()

    def __init__(self, robot: Any) -> None:  # noqa: ANN401 - `tests.fakes` is imported by the process that measures
        self._robot = robot

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any method
        found = getattr(self._robot, name)
        return self._timed(found) if callable(found) else found

    @staticmethod
    def _timed(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*words: Any, **named: Any) -> Any:  # noqa: ANN401 - of any method
            begun = time.thread_time()
            try:
                return method(*words, **named)
            finally:
                with _Robot._lock:
                    _Robot.taken_s += time.thread_time() - begun

        return call


class _Case:
    """One size."""

    def __init__(self, robots: int, services: int, network: str) -> None:
        from tests import worlds
        from tests.fakes import World

        class Still(World):
            """A world without a memory of what happened: that alone grows with the square."""

            def note_start(self, host: str, container: Any) -> None:  # noqa: ANN401 - as the class has it
                """Note nothing."""

        self.world, self.worlds, self.network = Still(), worlds, network
        self.world.log = _Forgetful()
        for number in range(robots):
            self.world.add(f"r{number:04}", address=f"10.{1 + number // 200}.{number % 200}.1")
            self.world.robots[f"r{number:04}"].engine.images["busybox:latest"] = {}
        self.placed = {f"a{number:04}": f"r{number % robots:04}" for number in range(services)}
        self.found: dict[str, float] = {}

    def definitions(self, rate: int) -> Any:  # noqa: ANN401 - `Definitions`
        """Return the experiment, with a variable of all services."""
        from srprov.definitions.model import Definitions, NetworkSettings

        about = {"network": self.network, "environment": {"RATE": str(rate)}}
        services = [self.worlds.service(name, robot=robot, **about) for name, robot in self.placed.items()]
        settings = NetworkSettings(subnet="10.192.0.0/16")
        return Definitions(experiment=self.worlds.experiment(*services, network=settings), containers={})

    def measured(self) -> dict[str, float]:
        """Return seconds and bytes by part."""
        self.act("new", 1)
        self.act("nothing", 1)
        self.act("changed", 2)
        self.found["peak MiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return self.found

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Measure one part."""
        gc.collect()
        begun, robots = time.process_time(), _Robot.taken_s
        yield
        self.found[f"{name}: s"] = time.process_time() - begun - (_Robot.taken_s - robots)

    def act(self, act: str, rate: int) -> None:
        """Plan, show and do one of the three."""
        from srprov.controller import plan as planning
        from srprov.controller.request import PlanRequest
        from srprov.execution import run_plan
        from srprov.facts.gather import Gathering
        from srprov.network.layout import layout
        from srprov.secret import Vault

        definitions, sessions = self.definitions(rate), {name: _Robot(one) for name, one in self.world.robots.items()}
        with Gathering(self.worlds.inventory(self.world), sessions.__getitem__) as look:
            with self.part(f"{act}, reading answers"):
                snapshot = look.first()
            with self.part(f"{act}, plan"), mock.patch.object(planning, "source_of", return_value="lab@desk:/e"):
                planned = planning.make_plan(definitions, look, PlanRequest(), Vault())
        if act == "new":
            with self.part("layout of the overlay"):
                overlay = layout(definitions.experiment, self.placed, snapshot)
            self.found["FDB entries in all"] = sum(map(len, (*overlay.fdb.values(), *overlay.flood.values())))
        self.texts(act, planned)
        with self.part(f"{act}, run"):
            result = run_plan(planned.plan, sessions, self.progress(planned.plan), self.worlds.QUICK)
        assert result.exit_code == 0, [one.message for one in result.results if one.message][:3]
        self.records(act, planned, result, sessions)

    def texts(self, act: str, planned: Any) -> None:  # noqa: ANN401 - `Planned`
        """Measure what is shown of a plan."""
        from srprov.controller.saved import plan_file
        from srprov.planning.markdown import plan_markdown
        from srprov.planning.planfile import pieces
        from srprov.planning.planhash import shown_json
        from srprov.planning.text import plan_text

        shown: dict[str, Callable[[], str]] = {
            "text": lambda: plan_text(planned.plan),
            "Markdown": lambda: plan_markdown(planned.plan),
            "JSON": lambda: json.dumps(shown_json(planned.plan)),
            "file": lambda: "".join(pieces(plan_file(planned))),
        }
        for name, make in shown.items():
            with self.part(f"{act}, plan's {name}"):
                text = make()
            self.found[f"{act}, plan's {name}: KiB"] = len(text) / 1024

    def progress(self, plan: Any) -> Callable[[Any], None]:  # noqa: ANN401 - `Plan`
        """Return what shows progress, without a terminal."""
        from srprov.cli.progress import _Shown

        hosts = [step.host for step in plan.steps]
        return _Shown(hosts, None, live=False, color=False, quiet=True).listen

    def records(self, act: str, planned: Any, result: Any, sessions: Mapping[str, Any]) -> None:  # noqa: ANN401 - values of srprov
        """Measure what a run leaves, here and on robots, and what it reports."""
        from srprov.controller import remembering
        from srprov.controller.phases import Phases
        from srprov.controller.report import failures, run_json
        from srprov.controller.run import record_inputs
        from srprov.record.folder import PlainFolder

        with tempfile.TemporaryDirectory() as folder:
            with self.part(f"{act}, record"):
                record_inputs(PlainFolder(Path(folder)), planned, self.worlds.inventory(self.world), "apply")
            sizes = [path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()]
        self.found[f"{act}, record: KiB"] = sum(sizes) / 1024
        with self.part(f"{act}, memory of who has which record"):
            remembering.begin(planned)
            remembering.end(planned, result, "apply")
        with self.part(f"{act}, report"):
            document = run_json(planned.plan, result, sessions, Phases())
            failures(result, planned.images)
        self.found[f"{act}, report: KiB"] = len(json.dumps(document)) / 1024
        robot = next(iter(self.world.robots.values()))
        kept = [content for path, content in robot.disk.files.items() if path.endswith("/placement.json")]
        self.found["placement record of one robot: KiB"] = sum(map(len, kept)) / 1024


class _Forgetful(list[Any]):
    """A list that stays empty."""

    def append(self, _value: Any, /) -> None:  # noqa: ANN401 - any
        """Keep nothing."""

    def __iadd__(self, _values: Any, /) -> _Forgetful:  # type: ignore[override,misc] # noqa: ANN401 - any
        """Keep nothing."""
        return self


if __name__ == "__main__":
    main()
