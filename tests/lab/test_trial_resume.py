"""Runs of trials whose controller was killed: an attempt that ended by itself meanwhile is adopted."""

from __future__ import annotations

import base64
import time
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf
from tests.lab.test_trial_kills import Race, killed

pytestmark = pytest.mark.lab

CANARY = "canary-7d1f0a6b22"
RACER = """
echo "go $SRPROV_TRIAL"
cat /run/secrets/key
sleep 1
echo GOAL
echo '{"time": 1}' >/out/result.json
exit "$CODE"
"""
GOAL = {"log": {"service": "racer", "matches": "GOAL"}}


def alone(wait: str = "sleep 1") -> str:
    """Return an EDF of two trials, all of whose services end by themselves."""
    return edf(
        "alone",
        {
            "racer": busybox("sh", "-c", RACER.replace("sleep 1", wait), robot="robot1", secrets=["key"]),
            "timer": busybox("sleep", "0.5", robot="robot2"),
        },
        secrets={"key": {"file": "./key"}},
        parameters={"CODE": {"values": [0, 3], "apply_to": "racer"}},
        trials={"order": "listed", "timeout": "20s", "success": {"all": [GOAL]}},
        results={"racer": ["/out/result.json"]},
        metrics={"time": {"service": "racer", "json": "/out/result.json#/time"}},
    )  # fmt: skip


def test_what_ended_by_itself_while_nobody_looked_is_adopted(lab: Lab, tmp_path: Path) -> None:
    """It is at home and judged as if somebody had looked, and not run again. Nothing in the folder has its secret."""
    (tmp_path / "key").write_text(CANARY + "\n")
    one = Race(lab, tmp_path, alone())
    killed(one, 5, "whole", "--allow", "secret")  # `ready` of the first trial
    time.sleep(2)  # longer than a trial
    again = one.run("--resume", "--allow", "secret")
    assert again.code == 0, again
    rows = one.rows()
    assert [(row["p_CODE"], row["status"], row["verdict"], row["attempt"], row["adopted"]) for row in rows] == [
        ("0", "ok", "success", "1", "true"), ("3", "crashed", "success", "1", ""),
    ], again  # fmt: skip
    adopted, watched = rows
    assert 0 < float(adopted["duration_s"]) < 2.5 and adopted["m_time"] == watched["m_time"] == "1.0"
    differs = [name for name in adopted if bool(adopted[name]) != bool(watched[name])]
    assert differs == ["stop_s", "clock_step", "controller_gap_s", "adopted"]
    for row in rows:
        log = (one.home / "trials" / row["trial"] / "logs" / "robot1.racer.log").read_text()
        assert f"go {row['trial']}\n" in log and "GOAL\n" in log and "***\n" in log
    files = [path for path in one.home.rglob("*") if path.is_file()]
    assert {"journal.jsonl", "trials.csv", "containers.json", "robot1.racer.log"} <= {path.name for path in files}
    for canary in (CANARY, base64.b64encode(CANARY.encode()).decode()):
        assert [str(path) for path in files if canary.encode() in path.read_bytes()] == []
    assert one.left() == set()


@pytest.mark.soak
def test_what_an_engine_ended_while_nobody_looked_is_not_adopted(lab: Lab, tmp_path: Path) -> None:
    """It stopped its containers in good order and came back: their ends look like their own."""
    (tmp_path / "key").write_text(CANARY + "\n")
    one = Race(lab, tmp_path, alone("trap 'exit 0' TERM; sleep 9 & wait $!"))
    killed(one, 5, "whole", "--allow", "secret")
    assert lab.srprov("lab", "stop-docker", "robot1").code == 0
    assert lab.srprov("lab", "restart", "robot1", "--docker").code == 0
    again = one.run("--resume", "--allow", "secret", "--only", one.events()[1]["trial"])
    assert again.code == 0, again
    lost, anew = one.rows()
    assert (lost["status"], anew["status"], anew["attempt"]) == ("interrupted", "ok", "2"), again
    assert "not adopted: the Docker Engine of robot1 began after racer" in lost["reason"]
    assert one.left() == set()
