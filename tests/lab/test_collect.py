"""What an applied experiment left on real robots comes home whole, under harmless names, and only once."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import wait_until

pytestmark = pytest.mark.lab

WRITER = r"""
echo begun
mkdir -p /bags/run
head -c 20000000 /dev/urandom >/bags/run/large
for n in $(seq 1 50); do echo "$n" >"/bags/run/$n.txt"; done
echo hostile >"/bags/$(printf 'line\nfeed')"
echo long >"/bags/$(head -c 255 /dev/zero | tr '\0' x)"
echo upper >/bags/Case; echo lower >/bags/case
mkdir '/bags/..up'; echo up >'/bags/..up/..%2f'
ln -s /etc/shadow /bags/shadow; ln -s / /bags/root; ln -s .. /bags/up
mkfifo /bags/pipe
trap exit TERM
while :; do echo "a line that is one of many" >>/bags/grows; usleep 200; done
"""
JOB = "echo '{\"time\": 3}' >/out/result.json"


def bags(lab: Lab) -> Path:
    """Return the folder of the writer's results as the test sees it."""
    mounts = {one["Destination"]: one["Source"] for one in lab.inspect("robot1", "srprov.kept.writer")["Mounts"]}
    return Path(mounts["/bags"])


def hashes(lab: Lab, folder: Path) -> dict[str, str]:
    script = 'cd "$0" && find . -type f ! -name grows -print0 | xargs -0 sha256sum -z | tr "\\0\\n" "\\n?"'
    lines = lab.shell("robot1", "sh", "-c", script, str(folder)).out.splitlines()
    return {line[68:].replace("?", "\n"): line[:64] for line in lines}


def test_what_an_applied_experiment_left_comes_home(lab: Lab, tmp_path: Path) -> None:
    file, home = tmp_path / "kept.edf", tmp_path / "home"
    services = {
        "writer": busybox("sh", "-c", WRITER, robot="robot1", stop_signal="SIGTERM"),
        "job": busybox("sh", "-c", JOB, robot="robot2", job=True),
    }
    results = {"writer": ["/bags"], "job": [{"path": "/out/result.json", "required": True}, "/out/none.txt"]}
    file.write_text(edf("kept", services, results=results))
    inventory = part_of_lab(lab, ("robot1", "robot2"), tmp_path / "inventory.yml")
    applied = lab.srprov("apply", str(file), "-i", inventory, "--yes")
    assert applied.code == 0, applied
    wait_until(
        lambda: (lab.shell("robot1", "test", "-e", f"{bags(lab)}/grows", check=False)).code == 0, 20, "all files"
    )

    def collect(*more: str) -> Any:
        return lab.srprov("collect", str(file), "-i", inventory, "-o", str(home), *more)

    for _ in range(5):  # on a busy machine the writer may stand still for long enough, and its file comes whole
        first = collect("--json")
        if first.code != 0:
            break
        shutil.rmtree(home)
    assert first.code == 3, first
    assert first.json["failed"] == ["writer on robot1: /bags: grows: it changed while it was read"], first
    assert list(Draft202012Validator(data.schema("collect")).iter_errors(first.json)) == []
    listed = {one["path"]: one for one in first.json["results"]["writer/bags"]}
    real = hashes(lab, bags(lab))
    assert len(real) == 56 and real == {path: one["sha256"] for path, one in listed.items() if one.get("name")}
    for path, one in listed.items():
        if one.get("name"):
            inside = (home / "results" / "writer" / "bags" / one["name"]).resolve()
            assert inside.is_relative_to(home.resolve()), path
            assert hashlib.sha256(inside.read_bytes()).hexdigest() == one["sha256"], path
    assert {path: one["note"] for path, one in listed.items() if one.get("note", "").startswith(("a link", "nei"))} == {
        "shadow": "a link to /etc/shadow",
        "root": "a link to /",
        "up": "a link to ..",
        "pipe": "neither file nor folder nor link",
    }
    assert json.loads((home / "results" / "job" / "out" / "result.json").read_text()) == {"time": 3}
    assert first.json["missing"] == ["/out/none.txt of job"]
    assert (home / "logs" / "robot1.writer.log").read_text().endswith("Z begun\n")
    assert set(json.loads((home / "facts.json").read_text())["robots"]) == {"robot1", "robot2"}
    assert json.loads((home / "containers.json").read_text())["job"]["State"]["ExitCode"] == 0

    # the container's end may kill the shell that asked for it: `docker exec` exits with 137 then
    end = lab.shell("robot1", "docker", "exec", "srprov.kept.writer", "sh", "-c", "rm /bags/grows; kill 1", check=False)
    assert end.code in (0, 137), end
    wait_until(lambda: not lab.inspect("robot1", "srprov.kept.writer")["State"]["Running"], 20, "the writer's end")
    lab.shell("robot1", "sh", "-c", f"rm -f {bags(lab)}/grows; echo new >{bags(lab)}/run/7.txt")
    (home / "results" / "writer" / "bags" / "run" / "9.txt").unlink()
    second = collect("--json")
    assert second.code == 0, second
    assert (second.json["fetched_files"], second.json["fetched_bytes"]) == (2, 6), "what is missing or has changed"
    second_containers = json.loads((home / "containers.json").read_text())
    lab.srprov("lab", "partition", "robot2", "--from", "controller")
    try:
        third = collect("--timeout", "2")
    finally:
        lab.srprov("lab", "heal", "robot2")
    assert third.code == 4 and "unreachable: robot2" in third.err and "0 files fetched" in third.out, third
    files = {name: json.loads((home / f"{name}.json").read_text()) for name in ("collected", "containers", "facts")}
    assert "job/out/result.json" in files["collected"]["results"], "it is here still"
    assert files["containers"]["job"] == second_containers["job"] and "robot2" in files["facts"]["robots"]
    assert files["collected"]["brought_utc"]["robot2"] == second.json["brought_utc"]["robot2"]
    assert files["collected"]["brought_utc"]["robot1"] > second.json["brought_utc"]["robot2"]
    assert bags(lab) and hashes(lab, bags(lab)), "nothing was deleted there"
    other = lab.srprov("collect", str(file), "-i", inventory, "-o", str(home), "--instance", "other")
    assert other.code == 5 and "is of kept" in other.err, other
    gone = lab.srprov("destroy", str(file), "-i", inventory, "--yes")
    assert gone.code == 0 and lab.shell("robot1", "docker", "volume", "ls", "-q").out == "", gone


def test_no_robot_learns_from_its_log_how_a_password_begins(lab: Lab, tmp_path: Path) -> None:
    """With blanks behind it, as a wrap has them, a right beginning was hidden; and the time told which one it was."""
    file, home = tmp_path / "guess.edf", tmp_path / "home"
    guesses = ["w", "wal", "walnut42-walnu", "x", "way"]
    blanks = "$(head -c 17000 /dev/zero | tr '\\0' ' ')"
    script = f'b="{blanks}"; ' + "".join(f'echo "guess {one}\\\\n$b"; echo .; ' for one in guesses)
    file.write_text(edf("guess", {"liar": busybox("sh", "-c", f"{script} sleep 86400", robot="robot2")}))
    robots = {"robot3": {"ansible_become_password": "walnut42-walnut"}}
    inventory = part_of_lab(lab, ("robot2", "robot3"), tmp_path / "inventory.yml", **robots)
    applied = lab.srprov("apply", str(file), "-i", inventory, "--yes")
    assert applied.code == 0, applied
    collected = lab.srprov("collect", str(file), "-i", inventory, "-o", str(home))
    assert collected.code == 0, collected
    log = (home / "logs/robot2.liar.log").read_text()
    assert re.findall(r"guess (\S+?)\\n {17000}$", log, re.MULTILINE) == guesses
    followed = lab.srprov("logs", str(file), "-i", inventory, "--since", "1h")
    assert [followed.out.count(f"guess {one}\\n   ") for one in guesses] == [1] * len(guesses)
