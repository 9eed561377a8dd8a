"""Large layers that are cut off on their way go on where they were; nothing is left of them afterwards."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import BEGUN, ROOT, Lab, part_of_lab
from tests.lab.test_image_copies import received, root

pytestmark = pytest.mark.soak
MIB = 1 << 20
SPOOL = "var/lib/srprov/.images"
ROBOTS = ["robot1", "robot2"]


def sent(lab: Lab, robot: str) -> int:
    """Give the bytes that a robot sent, by the kernel's word."""
    return int(lab.shell(robot, "cat", "/sys/class/net/eth0/statistics/tx_bytes").out)


def inside(lab: Lab, robot: str, *words: str) -> None:
    """Run a command of this machine's root in a robot's view of the disk: robots may not mount."""
    pid = root(lab, robot).parts[2]
    subprocess.run(["nsenter", "-t", pid, "-m", *words], check=True, timeout=100)


class Heavy:
    """An experiment whose one service runs an image with a layer of random bytes that only robot1 has."""

    def __init__(self, lab: Lab, folder: Path, size_mib: int) -> None:
        self.lab, self.folder, self.size, self.name = lab, folder, size_mib * MIB, f"heavy-{size_mib}"
        make = (
            f"mkdir -p /tmp/base && cd /tmp/base && head -c {self.size} /dev/urandom > noise && "
            "printf 'FROM busybox\\nCOPY noise /noise\\n' > Dockerfile && "
            f"docker build -q -t {self.name}:1 . && rm -rf /tmp/base"
        )
        lab.shell("robot1", "sh", "-c", make)
        (folder / "x.cdf").write_text(
            f"cdf: 1\nname: {self.name}\nbase: {self.name}:1\ncommand: [sleep, '86400']\n", encoding="utf-8"
        )
        self.inventory = part_of_lab(lab, ROBOTS, folder / "lab.yml")
        self.env = {**os.environ, "PYTHONPATH": str(ROOT), "SRPROV_HEARTBEAT": "1,10,15"}
        self.env |= {"XDG_STATE_HOME": str(folder / "state"), "XDG_CACHE_HOME": str(folder / "cache")}
        self.edf = str(folder / "heavy.edf")
        self.on("robot1")
        done = self.begin()
        assert done.wait(250) == 0, done.communicate()

    def on(self, *robots: str) -> None:
        """Place the service."""
        services = {f"on-{one}": {"cdf": "x.cdf", "robot": one, "stop_signal": "SIGKILL"} for one in robots}
        text = json.dumps({"edf": 1, "name": self.name, "services": services})
        Path(self.edf).write_text(text, encoding="utf-8")

    def begin(self, *more: str) -> subprocess.Popen[str]:
        """Start to apply it."""
        words = ["apply", self.edf, "-i", self.inventory, "--yes", "--settle", "0", "--json", *more]
        run = subprocess.Popen(
            [sys.executable, "-m", "srprov", *words], cwd=self.folder, env=self.env, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        BEGUN.append(run)
        return run

    def arrived(self) -> int:
        """Give the bytes that robot2 has of the archive, by its own disk."""
        return sum(one.stat().st_size for one in root(self.lab, "robot2").joinpath(SPOOL, "load").glob("*"))

    def forget(self) -> None:
        """Take the image from robot2."""
        self.lab.shell("robot2", "sh", "-c", "docker rm -f $(docker ps -aq); docker rmi -f $(docker images -q); true")

    def until(self, share: float, run: subprocess.Popen[str]) -> int:
        """Wait until so much has arrived; give how much it is."""
        end = time.monotonic() + 200
        while (there := self.arrived()) < share * self.size:
            assert run.poll() is None and time.monotonic() < end, run.communicate()
            time.sleep(0.02)
        return there

    def finish(self, there: int) -> int:
        """Apply again to the end; give the bytes that robot2 received meanwhile. Nothing is left of the copy."""
        before = received(self.lab, "robot2")
        run = self.begin()
        out, err = run.communicate(timeout=250)
        assert run.returncode == 0, (out[-2000:], err[-2000:])
        got = received(self.lab, "robot2") - before
        self.check()
        assert there == 0 or got <= self.size - there + 32 * MIB, (got, there)
        return got

    def check(self) -> None:
        """Both robots have the same image, and nothing is left of the copy."""
        words = ("docker", "images", "-q", "--no-trunc", f"srprov/{self.name}")
        ids = {self.lab.shell(robot, *words).out for robot in ROBOTS}
        assert len(ids) == 1 and not any(root(self.lab, robot).joinpath(SPOOL).exists() for robot in ROBOTS), ids


@pytest.fixture(scope="module")
def heavy(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Heavy]:
    """Give one with 300 MiB."""
    yield Heavy(lab_of_module, tmp_path_factory.mktemp("heavy"), 300)
    for robot in ROBOTS:
        clean = "docker rm -f $(docker ps -aq); docker image prune -af; rm -rf /var/lib/srprov/.images"
        lab_of_module.shell(robot, "sh", "-c", clean, check=False)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("how", ["cut", "killed"])
def test_what_has_arrived_is_not_sent_again(heavy: Heavy, share: float, how: str) -> None:
    lab = heavy.lab
    heavy.on("robot1", "robot2")
    heavy.forget()
    run = heavy.begin()
    heavy.until(share, run)
    if how == "killed":
        os.killpg(run.pid, signal.SIGKILL)
        run.wait(10)
    else:
        assert lab.srprov("lab", "partition", "robot2").code == 0
        assert run.wait(60) != 0
        assert lab.srprov("lab", "heal", "robot2").code == 0
    time.sleep(8)  # the robot's end of the lock notices
    there = heavy.arrived()
    assert there > 0
    heavy.finish(there)


def test_a_flipped_byte_in_what_has_arrived_is_noticed_and_nothing_wrong_is_tagged(heavy: Heavy) -> None:
    lab = heavy.lab
    heavy.on("robot1", "robot2")
    heavy.forget()
    lab.shell("robot2", "docker", "run", "-d", "--name", "old", "busybox", "sleep", "86400")
    run = heavy.begin()
    heavy.until(0.3, run)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait(10)
    time.sleep(8)
    (part,) = root(lab, "robot2").joinpath(SPOOL, "load").iterdir()
    with part.open("r+b") as file:
        file.seek(20 * MIB)
        byte = file.read(1)
        file.seek(20 * MIB)
        file.write(bytes([byte[0] ^ 1]))
    assert heavy.finish(0) > heavy.size, "all of it went over again"
    assert lab.inspect("robot2", "old")["State"]["Running"]


def test_a_builder_that_is_cut_off_while_it_is_read_is_read_anew(heavy: Heavy) -> None:
    """The layer that was cut is read from its beginning, once; nothing of it is kept half."""
    lab, cache = heavy.lab, Path(heavy.env["XDG_CACHE_HOME"], "srprov/blobs")
    heavy.on("robot1", "robot2")
    heavy.forget()
    for one in cache.glob("*"):
        one.unlink()
    run = heavy.begin()
    end = time.monotonic() + 200
    while not any(one.stat().st_size > heavy.size // 2 for one in cache.glob("*.part")):
        assert run.poll() is None and time.monotonic() < end, run.communicate()
        time.sleep(0.02)
    assert lab.srprov("lab", "partition", "robot1").code == 0
    _, err = run.communicate(timeout=120)
    assert run.returncode != 0 and "robot1: lost contact" in err, err
    assert lab.srprov("lab", "heal", "robot1").code == 0
    assert not list(cache.glob("*.part")) and sum(one.stat().st_size for one in cache.iterdir()) < 32 * MIB
    time.sleep(8)  # the robot's end of the lock notices
    before = sent(lab, "robot1")
    heavy.finish(0)
    assert heavy.size < sent(lab, "robot1") - before < 1.1 * heavy.size


def test_a_disk_that_is_50_mib_short_is_refused_before_the_first_byte(heavy: Heavy) -> None:
    """Both sizes are named; what runs there goes on."""
    lab, place = heavy.lab, "/var/lib/srprov"
    heavy.on("robot1", "robot2")
    heavy.forget()
    size = f"size={heavy.size + 14 * MIB}"
    lab.shell("robot2", "mkdir", "-p", place)
    inside(lab, "robot2", "mount", "-t", "tmpfs", "-o", size, "tmpfs", place)
    try:
        lab.shell("robot2", "docker", "run", "-d", "--name", "old", "busybox", "sleep", "86400")
        before = received(lab, "robot2")
        run = heavy.begin()
        _, err = run.communicate(timeout=120)
        assert run.returncode == 3 and received(lab, "robot2") - before < MIB, err
        told = re.search(rf"the disk of {place} is too small: (\d+) MiB are needed, (\d+) MiB are free", err)
        assert told and 48 <= int(told[1]) - int(told[2]) <= 52, err
        assert lab.inspect("robot2", "old")["State"]["Running"]
        assert not root(lab, "robot2").joinpath(SPOOL).exists()
    finally:
        lab.shell("robot2", "sh", "-c", "docker rm -f old")
        inside(lab, "robot2", "umount", place)


@pytest.mark.timeout(900)
def test_a_gibibyte_of_noise_passes_and_the_controller_stays_small(lab_of_module: Lab, tmp_path: Path) -> None:
    heavy = Heavy(lab_of_module, tmp_path, 1024)
    heavy.on("robot1", "robot2")
    heavy.forget()
    events = tmp_path / "events"
    run = heavy.begin("--events", str(events))
    for pipe in (run.stdout, run.stderr):
        threading.Thread(target=pipe.read, daemon=True).start()
    _, status, used = os.wait4(run.pid, 0)
    assert status == 0, events.read_text(encoding="utf-8")[-4000:]
    assert used.ru_maxrss < 150 * 1024, used.ru_maxrss
    heavy.check()
