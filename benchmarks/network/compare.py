"""Side by side between two robots of the lab: what each way costs, over a link like the paper's and over a fast one.

    python -m benchmarks.network.compare
    python -m benchmarks.network.compare --links limited --ways native,overlay --repeat 3 --scratch

Needs root, for the lab. All ways are up at once. A repetition is a block: each measure of each way once, in an order
that a seed shuffles anew for each block.
"""

from __future__ import annotations

import argparse
import datetime as dt
import itertools
import json
import os
import platform
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from benchmarks.network import link as links
from benchmarks.network import measures, table
from benchmarks.network.plots import draw
from benchmarks.network.ways import MAKERS, PROGRAMS, Ends, Site, bring_up
from benchmarks.provisioning import measure, robots
from benchmarks.provisioning.compare import among
from benchmarks.provisioning.robots import Trouble

RESULTS = Path(__file__).parent / "results"
_PATIENCE_S = 3600
_CALM_S = 60


def main() -> None:
    """Measure what is asked for, print tables, and write JSON, tables and plots."""
    wish = _arguments()
    install(PROGRAMS)
    file = RESULTS / "network.json"
    before = json.loads(file.read_text(encoding="utf-8")) if wish.more and file.exists() else {}
    found: dict[str, dict[str, Any]] = {}
    for name, one in measured(wish):
        kept = before.get(name, {}).get("values", {}) if len(wish.measures) < len(measures.MEASURES) else {}
        found[name] = {**one, "values": {**kept, **one["values"]}}
        print(f"\n{name}: {links.LINKS[name].words}\n\n{text(name, found[name])}", flush=True)
        if not wish.scratch:
            write(RESULTS, {**before, **found})
    lists = [values for one in found.values() for ways in one["values"].values() for values in ways.values()]
    sys.exit(1 if any(values.count(None) > len(values) / 10 for values in lists) else 0)


def install(programs: Sequence[str]) -> None:
    """Install Debian packages of these names where the programs are missing; robots of the lab see this machine's."""
    missing = [name for name in programs if shutil.which(name) is None]
    if missing:
        print(f"installing Debian packages: {' '.join(missing)}", file=sys.stderr)
        for words in (["update"], ["install", "-y", "--no-install-recommends", *missing]):
            env = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
            subprocess.run(["apt-get", "-qq", *words], check=True, timeout=600, env=env, stdout=sys.stderr)


def measured(wish: argparse.Namespace) -> Iterator[tuple[str, dict[str, Any]]]:
    """Measure all that is wanted on one lab; give each link with what was found as soon as it is done."""
    with (
        robots.lab(2, 0, _PATIENCE_S) as lab,
        tempfile.TemporaryDirectory(prefix="srprov-bench-network-") as folder,
        ExitStack() as shells,
    ):
        site = Site(lab, Path(folder), shells)
        ways, missing = everything(site, wish.ways)
        about = {"missing": missing, "mtus": {way: ends.target.mtu for way, ends in ways.items()}, **_about(site)}
        if "wireguard" in ways:
            by = site.ask(0, "pgrep -x wireguard-go >/dev/null && echo wireguard-go || echo 'the kernel'")
            about["programs"] = [*about["programs"], f"WireGuard by {by}"]
        for name in wish.links:
            first, second = (robot for robot, _ in lab.robots)
            with links.shaped(lab.site, first, second, links.LINKS[name]):
                one = {**about, **blocks(ways, links.LINKS[name], wish.repeat, wish.seed, wish.measures)}
            yield name, one
            if one["repeat"] < wish.repeat:
                return


def everything(site: Site, wanted: Sequence[str]) -> tuple[dict[str, Ends], dict[str, str]]:
    """Bring all ways up; give those that are, and way -> why not of those that cannot be had."""
    ways, missing = {}, {}
    for name in (name for name in MAKERS if name in wanted):
        try:
            ways[name] = bring_up(site, name)
        except Trouble as trouble:
            if name in ("native", "overlay"):
                raise  # nothing is to be compared without them
            missing[name] = str(trouble)
            print(f"{name} is not measured: {trouble}", file=sys.stderr)
    return ways, missing


def blocks(
    ways: Mapping[str, Ends], link: links.Link, repeat: int, seed: int, chosen: Sequence[str] = measures.MEASURES
) -> dict[str, Any]:
    """Measure over a link: so many blocks, each in an order of its own. Ctrl-C gives what whole blocks have shown."""
    source, begun = random.Random(seed), time.monotonic()
    idle = measure.calm(_CALM_S)
    values: dict[str, dict[str, list[float | None]]] = {name: {way: [] for way in ways} for name in chosen}
    problems: list[str] = []
    done = 0
    try:
        while done < repeat:
            order = list(itertools.product(chosen, ways))
            source.shuffle(order)
            block = {(name, way): _one(ways[way], name, link, problems) for name, way in order}
            for (name, way), value in block.items():
                values[name][way].append(value)
            done += 1
            print(f"block {done} of {repeat}, {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("interrupted; writing what there is", file=sys.stderr)
    return {
        "repeat": done,
        "seed": seed,
        "idle": round(idle, 3),
        "seconds": round(time.monotonic() - begun),
        "problems": problems,
        "values": values,
    }


def _one(ends: Ends, name: str, link: links.Link, problems: list[str]) -> float | None:
    try:
        code, said = ends.client.run(measures.command(name, ends.target, link), measures.LONGEST_S + 5)
        return round(measures.value(name, code, said), 4)
    except Trouble as trouble:
        problems.append(str(trouble))
        print(f"  {trouble}", file=sys.stderr, flush=True)
        return None


def _about(site: Site) -> dict[str, Any]:
    """Return what a reader wants to know of the machine; programs natively and in the image must be the same."""
    ask = "dpkg-query -W -f '${Package} ${Version}\\n' " + " ".join(PROGRAMS)
    versions = [site.ask(0, ask), site.ask(0, f"docker exec srprov.bench-plain.end0 {ask}")]
    if versions[0] != versions[1]:
        raise Trouble(f"the robot's own programs and those in the container differ: {versions}")
    return {
        "date": dt.datetime.now(dt.timezone.utc).date().isoformat(),
        "cpus": os.cpu_count(),
        "kernel": platform.release(),
        "docker": site.ask(0, "docker version -f '{{.Server.Version}}'"),
        "programs": versions[0].splitlines(),
    }


def text(name: str, one: Mapping[str, Any]) -> str:
    """Return the table of a link."""
    link = links.LINKS[name]
    return table.table(table.rows(one["values"], one["mtus"], link), beside=bool(link.rate_mbit))


def write(folder: Path, found: Mapping[str, Mapping[str, Any]]) -> None:
    """Write network.json, and a plot for each link."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "network.json").write_text(json.dumps(found) + "\n", encoding="utf-8")
    for name, one in found.items():
        draw(one["values"], folder / f"network-{name}.svg")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=among(links.LINKS), default=list(links.LINKS), help=",".join(links.LINKS))
    parser.add_argument("--ways", type=among(MAKERS), default=list(MAKERS), help=",".join(MAKERS))
    parser.add_argument("--measures", type=among(measures.MEASURES), default=list(measures.MEASURES),
                        help="with --more, earlier results of the others are kept")  # fmt: skip
    parser.add_argument("--repeat", type=int, default=table.PAPER_RUNS, help="blocks")
    parser.add_argument("--seed", type=int, default=1, help="of the orders")
    parser.add_argument("--more", action="store_true", help="keep the results of links that are not measured now")
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    wish.ways = list(dict.fromkeys(["overlay", "native", *wish.ways]))
    return wish


if __name__ == "__main__":
    main()
