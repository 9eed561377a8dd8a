"""Results come home: `srprov collect` beside SFTP, scp, rsync and `docker cp`, and over a link that is cut.

    python -m benchmarks.transfer.compare                      # five ways, 100 MiB and 5000 small files, two links
    python -m benchmarks.transfer.compare --cut --mib 1024     # srprov alone: five cuts, and a kill of the controller

Needs root, for the lab, which has one robot. rsync is left out where it is not installed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"
NAME = os.environ.get("SRPROV_LAB", "transfer")
os.environ["SRPROV_LAB"] = NAME
SLOW = {"rate_mbit": 50, "ssh_latency_ms": 40, "loss_percent": 1}
LINKS = {"full": {}, "slow": SLOW}
CUTS = 5
SRPROV = (sys.executable, "-m", "srprov")
WRITE = """
mkdir /bags/small
v=$(head -c 1400 /dev/urandom | base64)
for n in $(seq {files}); do echo "$n $v" >/bags/small/$n; done
head -c {size} /dev/urandom >/bags/large
touch /bags/.done
sleep 86400
"""


def main() -> None:
    """Measure, print a table, and write it."""
    wish = _arguments()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="srprov-bench-transfer-") as name:
        for link in ["slow"] if wish.cut else wish.links:
            with robot(Path(name) / link, link, wish.mib, 0 if wish.cut else wish.files) as one:
                ways = {"srprov, cut": cut} if wish.cut else {key: WAYS[key] for key in wish.ways}
                for way, fetch in ways.items():
                    for case in ["large"] if wish.cut else wish.cases:
                        rows.append({"link": link, "way": way, "case": case, **measured(one, fetch, case)})
                        print(json.dumps(rows[-1]), flush=True)
    if wish.out:
        RESULTS.mkdir(exist_ok=True)
        file = RESULTS / ("cut.json" if wish.cut else "transfer.json")
        file.write_text(json.dumps({"mib": wish.mib, "files": wish.files, "slow": SLOW, "runs": rows}, indent=1) + "\n")


class Robot:
    """A robot with a container that has results."""

    def __init__(self, folder: Path, mib: int, files: int) -> None:
        """Bring the container up, and wait until it has written."""
        self.folder, self.inventory = folder, folder / "inventory" / f"lab-{NAME}.yml"
        script = WRITE.format(size=mib << 20, files=files)
        service = {"image": "busybox", "command": ["sh", "-c", script], "stop_signal": "SIGKILL"}
        for case in ("", "/large", "/small"):
            edf = {
                "edf": 1,
                "name": "transfer",
                "services": {"writer": service},
                "results": {"writer": [f"/bags{case}"]},
            }
            (folder / f"{case[1:] or 'all'}.edf").write_text(json.dumps(edf))
        self.srprov("apply", "all.edf", "-i", str(self.inventory), "--yes")
        found = json.loads(self.shell("docker inspect srprov.transfer.writer"))[0]["Mounts"]
        self.source = next(one["Source"] for one in found if one["Destination"] == "/bags")
        until = time.monotonic() + 300
        while "done" not in self.shell(f"ls -a {self.source}"):
            assert time.monotonic() < until, "the container does not write"
            time.sleep(0.5)
        inventory = self.inventory.read_text()
        self.key = next(line.split(":", 1)[1].strip() for line in inventory.splitlines() if "private_key" in line)
        self.address = next(line.split(":", 1)[1].strip() for line in inventory.splitlines() if "ansible_host" in line)
        state = Path(f"/run/srprov-labs/{NAME}/known_hosts")
        self.ssh = ["-i", self.key, "-o", f"UserKnownHostsFile={state}", "-o", "BatchMode=yes"]

    def shell(self, script: str) -> str:
        """Run something on the robot, past its network."""
        return self.srprov("lab", "shell", "robot1", "sh", "-c", script)

    def srprov(self, *words: str) -> str:
        """Run srprov; return what it prints."""
        argv = [*SRPROV, *words]
        done = subprocess.run(argv, cwd=self.folder, capture_output=True, text=True, env=environment(), check=False)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout

    def hashes(self, case: str) -> set[str]:
        """Return the sha256 of the files of a case."""
        lines = self.shell(f"cd {self.source}; find {case} -type f | xargs sha256sum").splitlines()
        return {line.split()[0] for line in lines}

    def sent(self) -> int:
        """Return the bytes that left the robot by its cable so far, with all headers."""
        link = next(Path("/sys/class/net").glob(f"{_bridge()}-r1"))
        return int((link / "statistics" / "rx_bytes").read_text())


def _bridge() -> str:
    listed = json.loads(subprocess.check_output([*SRPROV, "lab", "list", "--json"], env=environment()))
    labs = listed if isinstance(listed, list) else listed["labs"]
    subnet = next(one["subnet"] for one in labs if one["name"] == NAME)
    return f"srlab{subnet.split('.')[2]}"


def environment() -> dict[str, str]:
    """Return this environment with the lab's name."""
    return {**os.environ, "SRPROV_LAB": NAME, "PYTHONPATH": str(Path(__file__).parents[2])}


@contextmanager
def robot(folder: Path, link: str, mib: int, files: int) -> Iterator[Robot]:
    """Bring a lab of one robot up, and take it down."""
    folder.mkdir()
    (folder / "spec.yml").write_text(json.dumps({"count": 1, "robots": {"robot1": LINKS[link]}}))
    subprocess.run([*SRPROV, "lab", "up", "--spec", "spec.yml"], cwd=folder, check=True, env=environment())
    try:
        yield Robot(folder, mib, files)
    finally:
        subprocess.run([*SRPROV, "lab", "down"], cwd=folder, check=False, env=environment())


def measured(one: Robot, fetch: Callable[[Robot, str, Path], dict[str, Any]], case: str) -> dict[str, Any]:
    """Fetch a case into a new folder, and look at what came."""
    home = Path(tempfile.mkdtemp(dir=one.folder))
    before, begun = one.sent(), time.monotonic()
    more = fetch(one, case, home)
    seconds, sent = time.monotonic() - begun, one.sent() - before
    files = [path for path in home.rglob("*") if path.is_file()]
    came = {_hash(path): path.stat().st_size for path in files}
    wanted = one.hashes(case)
    size = sum(came.get(digest, 0) for digest in wanted)
    shutil.rmtree(home)
    whole = wanted <= came.keys()
    return {"seconds": round(seconds, 1), "wire": round(sent / max(1, size), 4), "bytes": size, "whole": whole, **more}


def _hash(path: Path) -> str:
    with path.open("rb") as stream:
        digest = hashlib.sha256()
        while piece := stream.read(1 << 20):  # all at once it would count as memory of the next program
            digest.update(piece)
    return digest.hexdigest()


def run(*words: str) -> dict[str, Any]:
    """Run something; return the memory of its largest process."""
    process = subprocess.Popen(words, env=environment(), stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return {"code": process.returncode, "peak_mib": usage.ru_maxrss >> 10}


def srprov(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """Let srprov do it, with facts and logs."""
    return run(*_collect(one, case, home))


def _collect(one: Robot, case: str, home: Path) -> Sequence[str]:
    return (*SRPROV, "collect", str(one.folder / f"{case}.edf"), "-i", str(one.inventory), "-o", str(home / "kept"))


def cut(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """Let srprov do it; its connections are ended five times, and then the controller is killed once."""
    size = int(one.shell(f"stat -c %s {one.source}/{case}"))
    ends = [size * number // (CUTS + 2) for number in range(1, CUTS + 2)]
    process = subprocess.Popen(_collect(one, case, home), env=environment())
    for number, at in enumerate(ends):
        until = time.monotonic() + 3600
        while (
            here := sum(path.stat().st_size for path in (home / "kept" / ".parts").rglob("*") if path.is_file())
        ) < at:
            assert process.poll() is None and time.monotonic() < until, f"it ended at {here}"
            time.sleep(0.2)
        if number < CUTS:
            one.shell("pkill -KILL -f '[s]shd: root' || ps ax | grep sshd >&2; true")
        else:
            os.kill(process.pid, signal.SIGKILL)
    first = os.wait4(process.pid, 0)[2].ru_maxrss >> 10
    second = run(*_collect(one, case, home))
    idle = run(*_collect(one, case, home))
    peaks = {"peak_mib": max(first, second["peak_mib"]), "idle_peak_mib": idle["peak_mib"]}
    return {"code": second["code"], **peaks, "cuts": CUTS, "kills": 1}


def scp(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """`scp -r`."""
    return run("scp", "-q", "-r", *one.ssh, f"root@{one.address}:{one.source}/{case}", str(home))


def rsync(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """`rsync -a`."""
    return run("rsync", "-a", "-e", f"ssh {' '.join(one.ssh)}", f"root@{one.address}:{one.source}/{case}", str(home))


def docker_cp(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """`ssh robot docker cp … - | tar x`, as how-tos have it."""
    script = (
        f"ssh {' '.join(one.ssh)} root@{one.address} docker cp srprov.transfer.writer:/bags/{case} - | tar x -C {home}"
    )
    return run("sh", "-c", script)


def sftp(one: Robot, case: str, home: Path) -> dict[str, Any]:
    """paramiko's SFTPClient.get for each file."""
    script = Path(__file__).with_name("sftp.py")
    return run(sys.executable, str(script), one.key, one.address, f"{one.source}/{case}", str(home))


WAYS: dict[str, Callable[[Robot, str, Path], dict[str, Any]]] = {
    "srprov": srprov,
    "sftp": sftp,
    "docker cp": docker_cp,
    "scp": scp,
    "rsync": rsync,
}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mib", type=int, default=100, help="size of the large file")
    parser.add_argument("--files", type=int, default=5000, help="number of the small files, of 2 KB each")
    parser.add_argument("--links", nargs="+", choices=list(LINKS), default=list(LINKS))
    parser.add_argument(
        "--ways",
        nargs="+",
        choices=list(WAYS),
        default=[one for one in WAYS if one != "rsync" or shutil.which("rsync")],
    )
    parser.add_argument("--cases", nargs="+", choices=["large", "small"], default=["large", "small"])
    parser.add_argument("--cut", action="store_true", help="srprov alone, over the slow link, which is cut")
    parser.add_argument("--scratch", dest="out", action="store_false", help="write no results")
    return parser.parse_args()


if __name__ == "__main__":
    main()
