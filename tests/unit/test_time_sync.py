"""What chrony and systemd-timesyncd say of a clock."""

from __future__ import annotations

import subprocess

import pytest

from srprov.time_sync import SCRIPT, TimeSync, parse

SYNCED = "C0A80101,192.168.1.1,3,1795338000.1,-0.000123,0.000045,0.000200,-12.3,0.002,0.05,0.0042,0.0010,64.2,Normal"
LOST = "00000000,,0,0.000000000,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised"


@pytest.mark.parametrize(
    ("said", "found"),
    [
        (f"/chrony:{SYNCED}\n", TimeSync(daemon="chrony", synchronised=True, bound_s=pytest.approx(0.003223))),
        (f"other\n/chrony:{LOST}\n/timesyncd:no\n", TimeSync(daemon="chrony", synchronised=False)),
        ("/chrony:506 Cannot talk to daemon\n", None),
        ("/chrony:506 Cannot talk to daemon\n/timesyncd:yes\n", TimeSync(daemon="timesyncd", synchronised=True)),
        ("/timesyncd:no\n", TimeSync(daemon="timesyncd", synchronised=False)),
        ("", None),
        ("/chrony:" + "," * 50, None),
        (f"/chrony:{SYNCED.replace('0.0010', 'nan')}", TimeSync(daemon="chrony", synchronised=False)),
        (f"/chrony:{SYNCED.replace('0.0010', '9' * 400)}", TimeSync(daemon="chrony", synchronised=False)),
    ],
)
def test_what_keeps_a_clock_is_read(said: str, found: TimeSync | None) -> None:
    assert parse(said) == found


def test_the_script_asks_chronyc_where_there_is_one() -> None:
    words = f"chronyc() {{ echo '{SYNCED}'; }}; timeout() {{ shift; \"$@\"; }}\n{SCRIPT}"
    done = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=True)
    found = parse(done.stdout)
    assert found is not None and found.in_words == "chrony: synchronised, within 3.2 ms of its source"
    assert done.stderr == ""
