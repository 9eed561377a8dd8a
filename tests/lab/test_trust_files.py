"""Files, names and variables on real robots: who can read what lies there, and what a hostile name or value does."""

from __future__ import annotations

import json
import subprocess
import tarfile
from pathlib import Path

import pytest
import yaml

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


def test_passwords_of_robots_beside_an_edf_are_shipped_by_nobody_unasked(lab: Lab, tmp_path: Path) -> None:
    """The user has put his inventory beside the EDF, as `init` does; a stranger's service mounts the whole folder."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "inventory.yml")
    (tmp_path / "group_vars").mkdir()
    (tmp_path / "group_vars" / "all.yml").write_text(f"ansible_become_password: {VALUE}\n", encoding="utf-8")
    path = tmp_path / "own.edf"
    path.write_text(edf("own", {"a": busybox(volumes=[".:/ws"])}), encoding="utf-8")
    words = (str(path), "-i", inventory)
    for verb in (("plan",), ("apply", "--yes"), ("build", "--yes")):
        refused = lab.srprov(*verb, *words)
        assert refused.code == 9 and f"a: outside ({tmp_path}/group_vars/all.yml)" in refused.err, refused
        assert VALUE not in refused.out + refused.err
    assert lab.leftovers(ROBOT) == NOTHING
    (tmp_path / "group_vars" / "all.yml").unlink()
    done = lab.srprov("apply", *words, "--yes", "--settle", "0", "--no-probe", "--runs", str(tmp_path.parent / "runs"))
    assert done.code == 0, done
    (tmp_path.parent / "runs").rename(tmp_path / "runs")
    (record,) = (tmp_path / "runs").iterdir()
    refused = lab.srprov("plan", *words)
    assert refused.code == 9 and f"a: outside ({record}/: it is srprov's own record" in refused.err, refused


def test_another_inventory_beside_an_edf_is_shipped_by_nobody_unasked(lab: Lab, tmp_path: Path) -> None:
    """The user names the one of the lab; that of the field, and what an editor kept of it, lie in the same folder."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    others = [tmp_path / "field.yml", tmp_path / "field.yml~"]
    for one in others:
        one.write_text(f"all: {{hosts: {{r9: {{ansible_become_password: {VALUE}}}}}}}\n", encoding="utf-8")
    path = tmp_path / "field.edf"
    path.write_text(edf("field", {"a": busybox(volumes=[".:/ws"])}), encoding="utf-8")
    for verb in (("apply", str(path), "-i", inventory, "--yes"), ("export", "compose", str(path), "-o", "out")):
        refused = lab.srprov(*verb)
        assert refused.code == 9 and all(f"a: outside ({one})" in refused.err for one in others), refused
    assert lab.leftovers(ROBOT) == NOTHING


def test_the_file_of_a_secret_is_shipped_by_no_later_version_unasked(lab: Lab, tmp_path: Path) -> None:
    """It was allowed for one service; then the project is pulled, and its EDF mounts the folder and names no secret."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "token").write_text(VALUE, encoding="utf-8")
    path = tmp_path / "later.edf"
    words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--no-probe")
    service, secrets = busybox(secrets=["token"]), {"token": {"file": "keys/token"}}
    path.write_text(edf("later", {"a": service}, secrets=secrets), encoding="utf-8")
    done = lab.srprov(*words, "--allow", "secret")
    assert done.code == 0, done
    path.write_text(edf("later", {"a": busybox(volumes=["./keys:/keys"])}), encoding="utf-8")
    refused = lab.srprov(*words)
    assert refused.code == 9 and f"a: outside ({tmp_path}/keys/token)" in refused.err, refused


def test_the_file_of_a_secret_is_shipped_by_no_later_version_where_the_first_one_failed(
    lab: Lab, tmp_path: Path
) -> None:
    """The first version also wants a secret that nobody has, so that nothing was done when its user allowed secrets."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "token").write_text(VALUE, encoding="utf-8")
    path = tmp_path / "failed.edf"
    words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--no-probe")
    secrets = {"token": {"file": "keys/token"}, "label": {"env": "NOBODY_HAS_THIS"}}
    path.write_text(edf("failed", {"a": busybox(secrets=["token", "label"])}, secrets=secrets), encoding="utf-8")
    failed = lab.srprov(*words, "--allow", "secret")
    assert failed.code == 5 and "NOBODY_HAS_THIS" in failed.err, failed
    path.write_text(edf("failed", {"a": busybox(volumes=["./keys:/keys"])}), encoding="utf-8")
    refused = lab.srprov(*words)
    assert refused.code == 9 and f"a: outside ({tmp_path}/keys/token)" in refused.err, refused
    assert VALUE not in lab.shell(ROBOT, "sh", "-c", "cat /var/lib/srprov/failed/trees/*/keys/token; :").out


def test_no_token_of_a_clone_is_shipped_whatever_the_project_is_called(lab: Lab, tmp_path: Path) -> None:
    """A project for computer vision, of the name that CVS gives its own folders; its EDF mounts all of it."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path = tmp_path / "CVS" / "vision.edf"
    (path.parent / ".git").mkdir(parents=True)
    (path.parent / ".git" / "config").write_text(f"url = https://me:{VALUE}@example.com/CVS\n", encoding="utf-8")
    path.write_text(edf("vision", {"a": busybox(volumes=[".:/ws"])}), encoding="utf-8")
    words = ("--yes", "--settle", "0", "--no-probe", "--runs", str(tmp_path / "runs"))
    done = lab.srprov("apply", str(path), "-i", inventory, *words)
    assert done.code == 0, done
    assert lab.shell(ROBOT, "docker", "exec", "srprov.vision.a", "ls", "-A", "/ws").out.split() == ["vision.edf"]
    recorded = "".join(one.read_text(errors="replace") for one in (tmp_path / "runs").rglob("*") if one.is_file())
    assert VALUE not in recorded


def test_no_file_from_elsewhere_is_shipped_by_a_name_that_an_archive_gave_it(lab: Lab, tmp_path: Path) -> None:
    """Maps that are to be unpacked above the clone: hard links to what says where that came from, and to a password."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path = tmp_path / "nav" / "maps.edf"
    (path.parent / ".git").mkdir(parents=True)
    (path.parent / ".git" / "config").write_text(f"url = https://me:{VALUE}@example.com/nav\n", encoding="utf-8")
    (tmp_path / ".aws").mkdir()
    (tmp_path / ".aws" / "credentials").write_text(VALUE, encoding="utf-8")
    with tarfile.open(tmp_path / "maps.tar", "w") as tar:
        for name, other in (("floor", "nav/.git/config"), ("walls", ".aws/credentials")):
            link = tarfile.TarInfo(f"nav/maps/{name}")
            link.type, link.linkname = tarfile.LNKTYPE, other
            tar.addfile(link)
    subprocess.run(["tar", "xf", str(tmp_path / "maps.tar")], cwd=tmp_path, check=True)
    path.write_text(edf("maps", {"a": busybox(volumes=["./maps:/maps"])}), encoding="utf-8")
    refused = lab.srprov("apply", str(path), "-i", inventory, "--yes")
    assert refused.code == 9, refused
    for name in ("floor", "walls"):
        assert f"a: outside ({path.parent}/maps/{name}: it has another name, elsewhere (a hard link))" in refused.err
    assert lab.leftovers(ROBOT) == NOTHING


def test_a_key_beside_an_edf_is_shipped_by_nobody_unasked(lab: Lab, tmp_path: Path) -> None:
    """The inventory has it by ssh's arguments; a stranger's service had it in its container, for every robot."""
    whole = yaml.safe_load(lab.inventory.read_text(encoding="utf-8"))
    shared, mine, inventory = whole["all"]["vars"], tmp_path / "keys" / "lab", tmp_path / "inventory.yml"
    mine.parent.mkdir()
    mine.write_bytes(Path(shared.pop("ansible_ssh_private_key_file")).read_bytes())
    mine.chmod(0o600)
    shared["ansible_ssh_common_args"] += f" -i {mine}"
    inventory.write_text(yaml.safe_dump(whole), encoding="utf-8")
    path = tmp_path / "key.edf"
    path.write_text(edf("key", {"a": busybox(volumes=[".:/ws"])}), encoding="utf-8")
    refused = lab.srprov("apply", str(path), "-i", str(inventory), "--yes")
    assert refused.code == 9 and f"a: outside ({mine})" in refused.err, refused
    assert lab.leftovers(ROBOT) == NOTHING


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


def test_another_file_s_container_of_the_same_name_gets_nothing_of_the_user_s(lab: Lab, tmp_path: Path) -> None:
    """He ended his own experiment, looked at a stranger's, which calls itself and its service as his, and goes on."""
    (tmp_path / "stranger").mkdir()
    own, other, file = tmp_path / "nav.edf", tmp_path / "stranger" / "nav.edf", tmp_path / "private.txt"
    file.write_text(VALUE, encoding="utf-8")
    own.write_text(edf("nav", {"planner": busybox()}), encoding="utf-8")
    other.write_text(edf("nav", {"planner": busybox()}), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    for verb in (("apply", str(own)), ("destroy", str(own)), ("apply", str(other))):
        assert lab.srprov(*verb, "-i", inventory, "--yes").code == 0
    send = ("cp", str(own), "-i", inventory, str(file), "planner:/tmp/")
    look = ("exec", str(own), "-i", inventory, "planner", "--", "tee", "/tmp/private.txt")
    bring = ("cp", str(own), "-i", inventory, "planner:/etc/hostname", str(tmp_path / "brought"))
    for verb, code in ((send, 9), (look, 255), (bring, 9)):
        done = lab.srprov(*verb, stdin=VALUE)
        assert done.code == code and str(other) in done.err and "planner@robot1" in done.err, done
    assert lab.shell(ROBOT, "docker", "exec", "srprov.nav.planner", "ls", "/tmp").out == ""
    assert not (tmp_path / "brought").exists()
    asked = ("status",), ("logs",), ("wait", "--until", "healthy"), ("collect", "-o", str(tmp_path / "home"))
    for file_, told in ((own, 1), (other, 0)):
        notes = [lab.srprov(verb, str(file_), "-i", inventory, *more).err for verb, *more in asked]
        assert [one.count(f"{other}, not from ") for one in notes] == [told] * 4, notes
    assert lab.srprov("cp", str(other), "-i", inventory, str(file), "planner:/tmp/").code == 0
    assert lab.srprov("cp", str(own), "-i", inventory, str(file), "planner@robot1:/tmp/").code == 0
