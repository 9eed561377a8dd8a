"""Recorders on real robots are killed in the middle: each recording is named, and recovered beside."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from srprov.record.mcap import MAGIC
from tests.lab.conftest import Lab, edf, part_of_lab

pytestmark = pytest.mark.lab

TRIALS = 10
RECORDER = """
import itertools, os, signal, time
from mcap.writer import CompressionType, Writer

over = []
signal.signal(signal.SIGINT, lambda *_: over.append(1))
with open("/bags/run.mcap", "wb") as stream:
    writer = Writer(stream, chunk_size=16384, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema(name="S", encoding="jsonschema", data=b"{}")
    channel = writer.register_channel(topic="/odom", message_encoding="json", schema_id=schema)
    print("recording", flush=True)
    for number in itertools.count():
        now = time.time_ns()
        data = b"%08d" % number + os.urandom(500)
        writer.add_message(channel_id=channel, log_time=now, publish_time=now, data=data)
        if number % 20 == 0:
            time.sleep(0.001)
        if over:
            break
    writer.finish()
"""
CDF = """
cdf: 1
base: debian:bookworm
packages: {apt: [python3, python3-pip], pip: [mcap]}
files: [{src: recorder.py, dest: /opt/}]
command: [python3, /opt/recorder.py]
"""
DRIVER = "sleep \"$(echo $SRPROV_SEED | awk '{print 0.5 + ($1 % 1000) / 700}')\""


def recorded(lab: Lab, folder: Path, signal: str) -> list[Path]:
    """Run ten trials, each of a length of its own, with a recorder that is ended by a signal; return their folders."""
    home = folder / signal
    (folder / "recorder.py").write_text(RECORDER)
    (folder / "recorder.cdf").write_text(CDF)
    services = {
        "recorder": {"cdf": "recorder.cdf", "robot": "robot1"},
        "driver": {"image": "busybox", "command": ["sh", "-c", DRIVER], "robot": "robot2"},
    }
    trials = {"repetitions": TRIALS, "until": {"all": [{"completed": "driver"}]}, "timeout": "60s",
              "stop": {"signal": signal, "grace": "20s", "first": ["recorder"]}}  # fmt: skip
    results = {"recorder": [{"path": "/bags", "required": True}]}
    (folder / "bags.edf").write_text(edf("bags", services, trials=trials, results=results))
    inventory = part_of_lab(lab, ["robot1", "robot2"], folder / "lab.yml")
    done = lab.srprov("run", str(folder / "bags.edf"), "-i", inventory, "-o", str(home), "--yes")
    assert done.code == 0, done
    with (home / "trials.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["unclosed"] for row in rows} == ({"1"} if signal == "SIGKILL" else {"0"})
    assert (f"{TRIALS} recordings not closed" in done.err) == (signal == "SIGKILL"), done
    return sorted((home / "trials").iterdir())


def readable(path: Path) -> list[int]:
    """Return the messages that a lenient reader finds in whole chunks."""
    found: list[int] = []
    with path.open("rb") as stream, contextlib.suppress(Exception):  # the library raises this and that at a cut
        for record in StreamReader(stream, record_size_limit=1 << 28).records:
            if hasattr(record, "log_time"):
                found.append(int(record.data[:8]))
    return found


@pytest.mark.soak
def test_a_killed_recorders_bag_is_named_and_recovered_and_one_that_is_asked_closes_it(
    lab: Lab, tmp_path: Path
) -> None:
    counts = []
    for trial in recorded(lab, tmp_path, "SIGKILL"):
        bags = trial / "results" / "recorder" / "bags"
        (one,) = json.loads((trial / "collected.json").read_text())["results"]["recorder/bags"]
        assert one["unclosed"] and one["recovered"] == "run.recovered.mcap"
        assert hashlib.sha256((bags / "run.mcap").read_bytes()).hexdigest() == one["sha256"], "it is left as it was"
        with (bags / "run.recovered.mcap").open("rb") as stream:
            found = [int(message.data[:8]) for _, _, message in make_reader(stream).iter_messages()]
        assert found == list(range(len(found))) and len(found) >= len(readable(bags / "run.mcap")) > 0
        counts.append(len(found))
    assert len(counts) == TRIALS == len(set(counts)), counts
    closed = [trial / "results" / "recorder" / "bags" / "run.mcap" for trial in recorded(lab, tmp_path, "SIGINT")]
    assert [path.read_bytes()[-8:] for path in closed] == [MAGIC] * TRIALS
