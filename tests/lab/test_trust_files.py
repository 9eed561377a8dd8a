"""Files, names and variables on real robots: who can read what lies there, and what a hostile name or value does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"
VALUE = "key-of-the-cloud"


def test_only_root_can_enter_what_lies_on_a_robot_and_variables_need_permission(lab: Lab, tmp_path: Path) -> None:
    """By the modes of the folders, for root alone; the variable reaches its container and nothing else."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "file").write_text("shipped", encoding="utf-8")
    (tmp_path / "token").write_text("token-of-the-lab", encoding="utf-8")
    service = busybox(volumes=["./parts:/parts"], environment=["CLOUD_KEY"], secrets=["token"])
    path = tmp_path / "files.edf"
    path.write_text(edf("files", {"a": service}, secrets={"token": {"file": "token"}}), encoding="utf-8")
    words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--runs", str(tmp_path / "runs"))
    given = {"CLOUD_KEY": VALUE}

    refused = lab.srprov(*words, "--allow", "secret", env=given)
    assert refused.code == 9 and "a: env (CLOUD_KEY" in refused.err and VALUE not in refused.err, refused
    assert lab.leftovers(ROBOT) == NOTHING
    done = lab.srprov(*words, "--allow", "secret", "--allow", "env", "-v", env=given)
    assert done.code == 0, done

    folders = ["/var/lib/srprov", "/var/lib/srprov/files", "/run/srprov/files"]
    look = f"stat -c '%n %u %a' {' '.join(folders)}; cat /var/lib/srprov/*/placement.json"
    rows = lab.shell(ROBOT, "sh", "-c", look).out.splitlines()
    assert rows[:3] == [f"{folder} 0 700" for folder in folders]
    lab.shell(ROBOT, "docker", "exec", "srprov.files.a", "cat", "/parts/file", "/run/secrets/token")
    assert f"CLOUD_KEY={VALUE}" in lab.inspect(ROBOT, "srprov.files.a")["Config"]["Env"]
    recorded = "".join(one.read_text() for one in (tmp_path / "runs").rglob("*") if one.is_file())
    assert VALUE not in recorded + done.out + done.err + rows[3]


def test_hostile_names_reach_neither_robots_nor_folders_here(lab: Lab, tmp_path: Path) -> None:
    """As --instance, as a service's name, and as what a robot says of itself."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path = tmp_path / "names.edf"
    path.write_text(edf("names", {"a": busybox()}), encoding="utf-8")
    runs = tmp_path / "deep" / "runs"
    words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--runs", str(runs))
    out = lab.srprov(*words, "--instance", "../../../escaped")
    assert out.code == 5 and "cannot be the name of an instance" in out.err, out
    (tmp_path / "dot.edf").write_text(edf("names", {"example.com": busybox()}), encoding="utf-8")
    assert lab.srprov("apply", str(tmp_path / "dot.edf"), *words[2:]).code == 5
    assert lab.leftovers(ROBOT) == NOTHING and not list(tmp_path.rglob("*escaped*"))

    record = json.dumps({"instance": "../../../escaped", "serial": 9, "services": {"a": {"robot": "../x"}}})
    lie = (
        "mkdir -p /var/lib/srprov/lie && cat >/var/lib/srprov/lie/placement.json <<'_END_'\n"
        f"{record}\n_END_\ndocker volume create --label srprov.instance=../../../escaped liar >/dev/null"
    )
    lab.shell(ROBOT, "sh", "-c", lie)
    seen = lab.srprov("status", "-i", inventory, "--json")
    assert seen.code == 0 and seen.json["services"] == [], seen
    done = lab.srprov(*words)
    assert done.code == 0, done
    assert not list(tmp_path.rglob("*escaped*"))
    gone = lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--runs", str(runs))
    assert gone.code == 0, gone
    assert lab.leftovers(ROBOT)["volumes"] == ["liar"]
