"""What robots and containers used in a trial, compared with what was done and with other counters than those read."""

from __future__ import annotations

import csv
import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")
MIB = 1 << 20
WRITTEN, HELD, SENT, BURNED_S = 24 * MIB, 48 * MIB, 3_000_000, 0.5
BURNER = f"""
dd if=/dev/zero of=/out/written bs={MIB} count={WRITTEN // MIB} oflag=direct
rm /out/written
dd if=/dev/zero of=/dev/null bs={HELD} count=1
spent() {{ set -- $(cat /proc/1/stat); spent=$((${{14}} + ${{15}} + ${{16}} + ${{17}})); }}
spent=0
until [ $spent -ge {BURNED_S * 100:.0f} ]; do n=0; while [ $n -lt 5000 ]; do n=$((n + 1)); done; spent; done
until wget -q -O - http://server/data | wc -c >/out/got && [ "$(cat /out/got)" != 0 ]; do sleep 0.1; done
cat /sys/class/net/eth0/statistics/rx_bytes >/out/received
spent
echo $spent >/out/spent
sleep 0.7
"""
"""What it used stands in files that srprov does not read; the pause is for its last reading."""
SERVER = f"mkdir /www; head -c {SENT} /dev/zero >/www/data; exec httpd -f -h /www"
COUNT_DISKS = """
for group in /sys/fs/cgroup/blkio /sys/fs/cgroup/blkio/docker; do
  [ -d $group ] || continue
  for disk in /sys/block/*/device; do
    disk=${disk%/device}
    echo "$(cat $disk/dev) $1" >$group/blkio.throttle.write_bps_device
  done
done
"""


def table(path: Path, key: str) -> dict[str, dict[str, str]]:
    with path.open(newline="") as stream:
        return {one[key]: one for one in csv.DictReader(stream)}


@pytest.fixture
def counting(lab: Lab) -> Iterator[Lab]:
    """Give the lab with a limit on robot1's containers: kernels with cgroup v1 count bytes only where there is one."""
    lab.shell("robot1", "sh", "-c", COUNT_DISKS, "sh", str(1 << 40), check=False)
    yield lab
    lab.shell("robot1", "sh", "-c", COUNT_DISKS, "sh", "0", check=False)


def run(lab: Lab, folder: Path) -> Path:
    """Run one trial of three services; return the folder of the run."""
    text = edf(
        "use",
        {
            "burner": busybox("sh", "-c", BURNER, robot="robot1", cpus=0.25, depends_on=["server"]),
            "server": busybox("sh", "-c", SERVER, robot="robot2"),
            "short": busybox("true", robot="robot2"),
        },
        trials={"timeout": "30s", "until": {"any": [{"completed": "burner"}]}},
        results={"burner": ["/out"]},
    )
    (folder / "use.edf").write_text(text)
    inventory = part_of_lab(lab, ROBOTS, folder / "inventory.yml", robot2={"srprov_slots": 2})
    done = lab.srprov("run", str(folder / "use.edf"), "-i", inventory, "-o", str(folder / "run"), "--yes")
    assert done.code == 0, done
    return folder / "run"


def test_what_a_trial_used_is_counted(counting: Lab, tmp_path: Path) -> None:
    """CPU seconds, memory, bytes on disk and overlay, and time that a limit took; what a robot has not is empty."""
    home = run(counting, tmp_path)
    links = {robot: json.loads(counting.shell(robot, "ip", "-j", "-s", "link").out) for robot in ROBOTS}
    (out,) = (one / "results" / "burner" / "out" for one in (home / "trials").iterdir())
    spent_s, received = (int((out / name).read_text()) / unit for name, unit in (("spent", 100), ("received", 1)))
    assert (out / "got").read_text().strip() == str(SENT)
    used = table(home / "containers.csv", "service")
    burner, server, short = used["burner"], used["server"], used["short"]

    assert float(burner["cpu_s"]) == pytest.approx(spent_s, abs=0.1), burner
    assert 0.1 < float(burner["throttled_s"]) < 30, "it had a quarter of a processor"
    assert float(server["throttled_s"]) == 0, "it has no limit"
    assert HELD <= int(burner["memory_peak_bytes"]) <= HELD + 16 * MIB
    assert 0 < int(server["memory_anon_bytes"]) < int(server["memory_peak_bytes"]), "what it wrote is cached"
    assert WRITTEN <= int(burner["disk_written_bytes"]) <= WRITTEN + MIB, burner
    assert received <= int(burner["net_received_bytes"]) <= received + 2000
    assert SENT <= int(server["net_sent_bytes"]) <= 1.1 * SENT
    assert float(burner["unread_s"]) < 5
    assert [key for key, value in short.items() if value] == ["trial", "attempt", "robot", "service"], short

    hosts = table(home / "hosts.csv", "robot")
    for robot, what, other in (("robot1", "received", "rx"), ("robot2", "sent", "tx")):
        one = hosts[robot]
        (overlay,) = (link for link in links[robot] if link["ifname"].startswith("srpv"))
        counted = int(one[f"overlay_{what}_bytes"])
        assert SENT <= counted <= overlay["stats64"][other]["bytes"] <= counted + 20_000
        assert counted < int(one[f"net_{what}_bytes"]) < 1.3 * counted, "the same in its packets"
        assert one["temperature_end_c"] == one["battery_end_percent"] == one["throttled"] == ""
        assert spent_s < float(one["cpu_s"]) <= 1.05 * int(one["cpus"]) * float(one["measured_s"])


@pytest.mark.soak
def test_status_shows_what_services_use_at_the_moment(lab: Lab, tmp_path: Path) -> None:
    """A third of a processor by its limit, and 24 MiB that a shell holds; it ends by Ctrl-C and changes nothing."""
    hog = "held=$(head -c 25165824 /dev/zero | tr '\\0' x); while :; do :; done"
    services = {"hog": busybox("sh", "-c", hog, robot="robot1", cpus=0.3), "idle": busybox(robot="robot2")}
    (tmp_path / "use.edf").write_text(edf("use", services))
    words = (str(tmp_path / "use.edf"), "-i", part_of_lab(lab, ROBOTS, tmp_path / "inventory.yml"))
    assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
    time.sleep(3)
    running = begin(lab, "status", *words, "--watch")
    time.sleep(12)
    running.send_signal(signal.SIGINT)
    out, said = running.communicate(timeout=120)
    looks = [look.strip().splitlines() for look in out.split("\n\n") if "hog" in look]
    assert len(looks) >= 2, (out, said)
    assert "CPU" not in looks[0][0], "one look says nothing of speed"
    for header, *rows in looks[1:]:
        at = {name: header.index(name) for name in ("CPU", "MEMORY")}
        hog_row, idle_row = sorted(rows, key=lambda row: "idle" in row)
        assert 15 <= int(hog_row[at["CPU"] :].split()[0]) <= 40, out
        assert 24 <= float(hog_row[at["MEMORY"] :].split()[0]) <= 80, out
        assert int(idle_row[at["CPU"] :].split()[0]) <= 3 and float(idle_row[at["MEMORY"] :].split()[0]) < 5, out
