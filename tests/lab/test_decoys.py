"""A robot that says to have the service of another one, which nobody has any more: it gets nothing of the user's."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

RECORD = "/var/lib/srprov/decoy/placement.json"
DECOY = f"""\
mkdir -p {RECORD.rpartition("/")[0]} && printf %s "$1" >{RECORD} &&
docker run -d --name srprov.decoy.b --label srprov.instance=decoy --label srprov.service=b --label "srprov.source=$2" \
  busybox sh -c 'echo hello; sleep 86400'
"""
KEPT = """\
cd /var/lib/srprov/moved && mount --bind . . && mount -o remount,bind,ro /var/lib/srprov/moved &&
docker commit srprov.moved.db decoy:latest
"""
AGAIN = "docker run -d --name srprov.moved.db decoy:latest sleep 86400"
LET_GO = "umount /var/lib/srprov/moved; docker rm -f srprov.moved.db; docker rmi -f decoy:latest"
HONEST = f"docker rm -f srprov.decoy.b; rm -rf {RECORD.rpartition('/')[0]}"


def test_where_a_service_was_that_nobody_has_any_more_is_no_robot_s_word(lab_of_module: Lab, tmp_path: Path) -> None:
    """Somebody ended the instance from another machine; root on robot1 makes a container and a record."""
    lab, path, file = lab_of_module, tmp_path / "decoy.edf", tmp_path / "private.txt"
    services = {name: busybox(robot=robot, network="overlay") for name, robot in (("a", "robot1"), ("b", "robot2"))}
    path.write_text(edf("decoy", services), encoding="utf-8")
    file.write_text("nobody else's\n", encoding="utf-8")
    robots = part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "lab.yml")
    mine, other, fresh = ({"XDG_STATE_HOME": str(tmp_path / name)} for name in ("mine", "other", "fresh"))
    words = (str(path), "-i", robots)
    assert lab.srprov("apply", *words, "--yes", "--settle", "0", "--no-probe", env=mine).code == 0
    said = json.loads(lab.shell("robot1", "cat", RECORD).out)
    assert lab.srprov("destroy", *words, "--yes", env=other).code == 0
    said["services"]["b"]["robot"], said["serial"] = "robot1", 7
    lab.shell("robot1", "sh", "-c", DECOY, "sh", json.dumps(said), said["source"])
    try:
        for home, why in ((mine, "it is not sure where b was placed"), (fresh, "the EDF wants it on robot2")):
            for verb in (("cp", *words, str(file), "b:/tmp/"), ("exec", *words, "b", "--", "true")):
                done = lab.srprov(*verb, env=home)
                assert done.code and why in done.err and "b@robot1" in done.err, done
        assert lab.shell("robot1", "docker", "exec", "srprov.decoy.b", "ls", "/tmp").out == ""
        logs = lab.srprov("logs", *words, env=mine)
        assert "b@robot1 | hello" in logs.out, logs
        assert lab.srprov("cp", *words, str(file), "b@robot1:/tmp/", env=mine).code == 0
    finally:
        lab.shell("robot1", "sh", "-c", HONEST)


def test_who_had_a_service_before_it_was_moved_gets_nothing_of_the_user_s(lab_of_module: Lab, tmp_path: Path) -> None:
    """Root there lets the run fail that moves it, keeps the record, and makes the container anew."""
    lab, path, file = lab_of_module, tmp_path / "moved.edf", tmp_path / "private.txt"
    file.write_text("nobody else's\n", encoding="utf-8")
    both = part_of_lab(lab, ["robot1", "robot2"], tmp_path / "lab.yml")
    liar = part_of_lab(lab, ["robot2"], tmp_path / "liar.yml")  # as if robot1 was away
    mine = {"XDG_STATE_HOME": str(tmp_path / "mine")}
    apply = ("apply", str(path), "-i", both, "--yes", "--settle", "0", "--no-probe")
    path.write_text(edf("moved", {"db": busybox(robot="robot2", network="overlay")}), encoding="utf-8")
    assert lab.srprov(*apply, env=mine).code == 0
    lab.shell("robot2", "sh", "-c", KEPT)
    try:
        path.write_text(edf("moved", {"db": busybox(robot="robot1", network="overlay")}), encoding="utf-8")
        assert lab.srprov(*apply, env=mine).code == 3
        assert "moved" in lab.shell("robot1", "docker", "ps", "--format", "{{.Names}}").out
        lab.shell("robot2", "sh", "-c", AGAIN)
        words = (str(path), "-i", liar)
        for verb in (("cp", *words, str(file), "db:/tmp/"), ("exec", *words, "db", "--", "true")):
            done = lab.srprov(*verb, env=mine)
            assert done.code and "which robot1 could tell" in done.err and "db@robot2" in done.err, done
        assert lab.shell("robot2", "docker", "exec", "srprov.moved.db", "ls", "/tmp").out == ""
        assert "robot1 may have the newer one" in lab.srprov("status", *words, env=mine).err
        assert lab.srprov("cp", str(path), "-i", both, str(file), "db:/tmp/", env=mine).code == 0
        assert "private.txt" in lab.shell("robot1", "docker", "exec", "srprov.moved.db", "ls", "/tmp").out
    finally:
        lab.shell("robot2", "sh", "-c", LET_GO)
        lab.srprov("destroy", str(path), "-i", both, "--yes", env=mine)


def test_a_service_that_is_only_in_the_edf_is_on_no_robot_that_says_so(lab_of_module: Lab, tmp_path: Path) -> None:
    """It was added, and not applied yet; root on robot1 makes a container that is called so."""
    lab, path, file = lab_of_module, tmp_path / "new.edf", tmp_path / "private.txt"
    file.write_text("nobody else's\n", encoding="utf-8")
    words = (str(path), "-i", part_of_lab(lab, ["robot1", "robot2"], tmp_path / "lab.yml"))
    first = {"a": busybox(robot="robot2", network="none")}
    path.write_text(edf("new", first), encoding="utf-8")
    assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
    path.write_text(edf("new", {**first, "vault": busybox(robot="robot2", network="none")}), encoding="utf-8")
    labels = ("--label", "srprov.instance=new", "--label", "srprov.service=vault")
    lab.shell("robot1", "docker", "run", "-d", "--name", "srprov.new.vault", *labels, "busybox", "sleep", "86400")
    try:
        for verb in (("cp", *words, str(file), "vault:/tmp/"), ("exec", *words, "vault", "--", "true")):
            done = lab.srprov(*verb)
            assert done.code and "has it nowhere" in done.err and "vault@robot1" in done.err, done
        assert lab.shell("robot1", "docker", "exec", "srprov.new.vault", "ls", "/tmp").out == ""
        assert lab.srprov("cp", *words, str(file), "a:/tmp/").code == 0
    finally:
        lab.shell("robot1", "docker", "rm", "-f", "srprov.new.vault")
        lab.srprov("destroy", *words, "--yes")


def test_a_service_that_was_ended_is_on_no_robot_that_says_so(lab_of_module: Lab, tmp_path: Path) -> None:
    """Here, and on a machine that never ran it, to which honest robots tell the same."""
    lab, path, file = lab_of_module, tmp_path / "ended.edf", tmp_path / "private.txt"
    file.write_text("nobody else's\n", encoding="utf-8")
    words = (str(path), "-i", part_of_lab(lab, ["robot1", "robot2"], tmp_path / "lab.yml"))
    path.write_text(edf("ended", {"db": busybox(network="overlay")}), encoding="utf-8")
    mine, fresh = ({"XDG_STATE_HOME": str(tmp_path / name)} for name in ("mine", "fresh"))
    send = ("cp", *words, str(file), "db:/tmp/")
    assert lab.srprov("apply", *words, "--yes", "--settle", "0", "--no-probe", env=mine).code == 0
    assert lab.srprov(*send, env=mine).code == lab.srprov(*send, env=fresh).code == 0
    assert lab.srprov("destroy", *words, "--yes", env=mine).code == 0
    labels = ("--label", "srprov.instance=ended", "--label", "srprov.service=db")
    lab.shell("robot1", "docker", "run", "-d", "--name", "srprov.ended.db", *labels, "busybox", "sleep", "86400")
    try:
        for home in (mine, fresh):
            for verb in (send, ("exec", *words, "db", "--", "true")):
                done = lab.srprov(*verb, env=home)
                assert done.code and "no other robot has it" in done.err and "db@robot1" in done.err, done
        assert lab.shell("robot1", "docker", "exec", "srprov.ended.db", "ls", "/tmp").out == ""
    finally:
        lab.shell("robot1", "docker", "rm", "-f", "srprov.ended.db")


def test_the_one_robot_of_an_inventory_does_not_say_what_it_has_for_another_one(
    lab_of_module: Lab, tmp_path: Path
) -> None:
    """It alone was given a record, so its own one is that of more than half of these; by then there are two robots."""
    lab, path, file = lab_of_module, tmp_path / "one.edf", tmp_path / "private.txt"
    file.write_text("nobody else's\n", encoding="utf-8")
    one = part_of_lab(lab, ["robot1"], tmp_path / "one.yml")
    words = (str(path), "-i", part_of_lab(lab, ["robot1", "robot2"], tmp_path / "two.yml"))
    path.write_text(edf("one", {"a": busybox(network="none")}), encoding="utf-8")
    assert lab.srprov("apply", str(path), "-i", one, "--yes", "--settle", "0").code == 0
    assert lab.srprov("cp", *words, str(file), "a:/tmp/").code == 0
    path.write_text(edf("one", {"a": busybox(network="none"), "vault": busybox(robot="robot2")}), encoding="utf-8")
    where = "/var/lib/srprov/one/placement.json"
    said = json.loads(lab.shell("robot1", "cat", where).out)
    said["services"]["vault"] = said["services"]["a"]
    labels = ("--label", "srprov.instance=one", "--label", "srprov.service=vault")
    lab.shell("robot1", "docker", "run", "-d", "--name", "srprov.one.vault", *labels, "busybox", "sleep", "86400")
    lab.shell("robot1", "sh", "-c", f'printf %s "$1" >{where}', "sh", json.dumps(said))
    try:
        done = lab.srprov("cp", *words, str(file), "vault:/tmp/")
        assert done.code and "the EDF wants it on robot2" in done.err and "vault@robot1" in done.err, done
        assert lab.shell("robot1", "docker", "exec", "srprov.one.vault", "ls", "/tmp").out == ""
    finally:
        lab.shell("robot1", "docker", "rm", "-f", "srprov.one.vault")
        lab.srprov("destroy", *words, "--yes", "--adopt")


def test_the_one_robot_of_an_inventory_says_nowhere_where_another_one_is(lab_of_module: Lab, tmp_path: Path) -> None:
    """It alone was given a record; in one of its own, a robot that is away has a service, and its own address."""
    lab, path = lab_of_module, tmp_path / "way.edf"
    one = part_of_lab(lab, ["robot2"], tmp_path / "one.yml")
    away = {"robot3": {"ansible_port": 9}}
    words = (str(path), "-i", part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "all.yml", **away))
    services = {"cam": busybox(robot="robot2", network="none")}
    path.write_text(edf("way", services), encoding="utf-8")
    assert lab.srprov("apply", str(path), "-i", one, "--yes", "--settle", "0").code == 0
    services |= {name: busybox(robot=robot, network="overlay") for name, robot in (("nav", "robot1"), ("db", "robot3"))}
    path.write_text(edf("way", services), encoding="utf-8")
    where = "/var/lib/srprov/way/placement.json"
    said = json.loads(lab.shell("robot2", "cat", where).out)
    said["services"]["db"] = {"ip": "10.200.0.7", "mac": "02:00:00:00:00:07", "network": "overlay", "robot": "robot3"}
    said["robots"]["robot3"] = {"gateway": "10.200.0.8", "vtep": said["robots"]["robot2"]["vtep"]}
    lab.shell("robot2", "sh", "-c", f'printf %s "$1" >{where}', "sh", json.dumps(said))
    try:
        done = lab.srprov("apply", *words, "--yes", "--settle", "0", "--no-probe")
        assert done.code == 9 and "no other robot holds what robot2 says of robot3" in done.err, done
        assert lab.shell("robot1", "ip", "link", "show", "type", "vxlan").out == ""
    finally:
        lab.srprov("destroy", "--instance", "way", "-i", words[2], "--yes")
