"""What a container gets of real robots by their paths and namespaces, beyond its name: the plan says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

WRITTEN = "root may run or believe what is written there"
MAY_BE = "may be as good as root on the robot, where it, or another container, runs or believes what is written there"
READ = "a key there may let somebody in, and a socket there may do as root what it is told"


def planned(lab: Lab, tmp_path: Path, *volumes: str | dict[str, Any], **fields: Any) -> dict[str, Any]:
    path = tmp_path / "experiment.edf"
    path.write_text(edf("paths", {"a": busybox(robot="robot1", volumes=list(volumes), **fields)}))
    done = lab.srprov("plan", str(path), "-i", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml"), "--json")
    assert done.code == 0, done
    found: dict[str, Any] = json.loads(done.out)
    return found


def test_what_a_path_gives_away_is_said_before_it_does(lab: Lab, tmp_path: Path) -> None:
    """By a socket of tmux's, mounted read-only, a container typed into root's shell."""
    lab.shell("robot1", "mkdir", "-p", "/tmp/tmux-0", "/home/robot/bin", "/srv/paths")
    plan = planned(lab, tmp_path, "/tmp/tmux-0:/t:ro", "/root:/r:ro", "~robot/bin:/b", "/srv/paths:/s")
    said = [one["what"] for one in plan["permissions"]]
    only = "read-only, but for what is mounted below it"
    assert said == [
        f"/home/robot/bin ({WRITTEN})",
        f"/root ({only}; {READ})",
        f"/srv/paths ({MAY_BE})",
        f"/tmp/tmux-0 ({only}; {READ})",
    ]
    lab.shell("robot1", "rmdir", "/tmp/tmux-0", "/home/robot/bin", "/srv/paths")


LAYERS = "lowerdir=/etc,upperdir=/data/overlay-etc/upper,workdir=/data/overlay-etc/work"
SET_UP = f"""mkdir -p /data /srv/people &&
mount -t tmpfs data /data && mkdir -p /data/overlay-etc/upper /data/overlay-etc/work /data/maps &&
mount -t overlay -o {LAYERS} overlay /etc &&
mv /home/robot /srv/people/robot && sed 's#:/home/robot:#:/srv/people/robot:#' /etc/passwd >/etc/passwd.new &&
cp /etc/passwd.new /etc/passwd"""
TAKE_DOWN = "umount /etc; umount /data; mv /srv/people/robot /home/robot; rmdir /data /srv/people"


def test_a_path_is_what_the_robot_has_there_whatever_its_name(lab: Lab, tmp_path: Path) -> None:
    """By the layer of `/etc` below `/data` a container had root's shell run something, and by `.ssh` it logged in."""
    lab.shell("robot1", "sh", "-c", SET_UP)
    try:
        data = planned(lab, tmp_path, "/data:/d")["notes"]
        maps = planned(lab, tmp_path, "/data/maps:/m")["notes"]
        people = planned(lab, tmp_path, "/srv/people:/p:ro", "~robot/.ssh:/s:ro")["notes"]
    finally:
        lab.shell("robot1", "sh", "-c", TAKE_DOWN)
    assert [one for one in data if "/data" in one] == [
        f"robot1: /data, which 'a' mounts, is, holds or lies in /etc: {WRITTEN}"
    ]
    assert not [one for one in maps if "/data" in one]
    assert f"robot1: /srv/people, which 'a' mounts, is, holds or lies in /srv/people/robot: {READ}" in people


def test_what_begins_a_shell_of_root_s_or_a_unit_is_no_data(lab: Lab, tmp_path: Path) -> None:
    """By the workspace that `.bashrc` of root's goes by, a container ran what it wrote there with the next verb."""
    unit = "[Service]\\nWorkingDirectory=/srv/nav\\nExecStart=/usr/bin/docker compose up\\n"
    begins = "mkdir -p /srv/nav /srv/ws; touch /srv/ws/setup.bash; echo 'source /srv/ws/setup.bash' >/root/.bashrc"
    lab.shell("robot1", "sh", "-c", f"{begins}; printf '{unit}' >/etc/systemd/system/nav.service")
    try:
        notes = planned(lab, tmp_path, "/srv/nav:/n", "/srv/ws:/w")["notes"]
    finally:
        lab.shell("robot1", "sh", "-c", "rm -r /root/.bashrc /etc/systemd/system/nav.service /srv/nav /srv/ws")
    assert f"robot1: /srv/nav, which 'a' mounts, is, holds or lies in /srv/nav: {WRITTEN}" in notes
    assert f"robot1: /srv/ws, which 'a' mounts, is, holds or lies in /srv/ws, /srv/ws/setup.bash: {WRITTEN}" in notes


def test_what_a_container_of_others_has_too_is_said(lab: Lab, tmp_path: Path) -> None:
    """By a script in a workspace that one with `/etc` runs, a stranger's container wrote to the robot's `/etc`."""
    lab.shell("robot1", "mkdir", "-p", "/srv/both/ws")
    own = ["docker", "create", "--name", "others-nav", "-v", "/srv/both/ws:/ws", "-v", "/etc:/e", "busybox:latest"]
    lab.shell("robot1", *own)
    try:
        notes = planned(lab, tmp_path, "/srv/both:/b")["notes"]
        read = planned(lab, tmp_path, "/srv/both:/b:ro")["notes"]
    finally:
        lab.shell("robot1", "sh", "-c", "docker rm others-nav; rm -r /srv/both")
    said = "robot1: /srv/both, which 'a' mounts, is had by the container others-nav of others: they may run or believe"
    assert [one for one in notes if one.startswith(said)]
    assert [one for one in read if one.endswith("the container others-nav of others: what lies there may be theirs")]


def test_what_a_namespace_of_the_robot_reaches_is_said(lab: Lab, tmp_path: Path) -> None:
    """By a connection of ssh's in `/dev/shm` a container was root on another robot, by an engine on 127.0.0.1 here."""
    plan = planned(lab, tmp_path, network="host", ipc="host")
    network, ipc = plan["permissions"]
    assert (network["kind"], ipc["kind"]) == ("host-network", "host-ipc")
    assert "on the loopback" in network["what"] and "a socket in it" in ipc["what"]


def test_what_an_engine_sends_for_a_container_may_be_an_order(lab: Lab, tmp_path: Path) -> None:
    """By a redirect of the experiment's own, `splunk` told an engine on 127.0.0.1 to build: root by `logging` alone."""
    options = {"splunk-url": "http://127.0.0.1:8088", "splunk-token": "x"}
    driver, *_ = planned(lab, tmp_path, logging={"driver": "splunk", "options": options})["permissions"]
    assert driver["kind"] == "logging" and "by sockets in any folder" in driver["what"]


CONSOLE = """
import socket, subprocess
server = socket.create_server(("127.0.0.1", 4444))
while True:
    subprocess.Popen(["/bin/sh"], stdin=server.accept()[0])
"""
"""A console that root left on the loopback."""


def test_what_an_engine_sends_logs_to_is_told_lines_by_root_and_the_plan_says_so(lab: Lab, tmp_path: Path) -> None:
    lines = {"syslog-address": "tcp://127.0.0.1:4444", "tag": "x\nid -u >/root/told\n: "}
    logging = {"driver": "syslog", "options": lines}
    said = [one["what"] for one in planned(lab, tmp_path, logging=logging)["permissions"]]
    assert "by sockets in any folder" in said[0], said
    begun = f"setsid python3 -c '{CONSOLE}' </dev/null >/dev/null 2>&1 & echo $! >/root/console; sleep 1"
    lab.shell("robot1", "sh", "-c", begun)
    path, inventory = tmp_path / "experiment.edf", str(tmp_path / "lab.yml")
    path.write_text(
        edf("paths", {"a": busybox("sh", "-c", "echo x; exec sleep 86400", robot="robot1", logging=logging)}),
        encoding="utf-8",
    )
    try:
        done = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "2", "--allow", "logging")
        told = lab.shell("robot1", "sh", "-c", "cat /root/told").out
    finally:
        lab.srprov("destroy", str(path), "-i", inventory, "--yes")
        lab.shell("robot1", "sh", "-c", "kill $(cat /root/console); rm -f /root/told /root/console")
    assert (done.code, told) == (0, "0\n"), done


LISTEN = "import socket, sys; socket.create_server((sys.argv[1], 5000))"
"""What a registry does that is the robot's own."""


def test_a_published_port_takes_no_place_beside_a_program_of_the_robot(lab: Lab, tmp_path: Path) -> None:
    """At `::1` a container answered for the registry at 127.0.0.1 of whoever asked `localhost`, and no plan knew."""
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")

    def apply(port: str) -> Done:
        path.write_text(edf("paths", {"a": busybox(robot="robot1", ports=[port])}))
        return lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")

    for port in ("[::1]:5000:80", "[::]:5000:80"):
        refused = apply(port)
        assert (refused.code, "where others may have it: at an address of IPv6 alone" in refused.err) == (5, True), (
            refused
        )
    for port, address in (("5000:80", "127.0.0.1"), ("5000:80", "0.0.0.0"), ("127.0.0.1:5000:80", "127.0.0.1")):
        done = apply(port)
        assert done.code == 0, done
        later = lab.shell("robot1", "python3", "-c", LISTEN, address, check=False)
        assert (later.code, "Address already in use" in later.err) == (1, True), (port, address, later)
    assert lab.srprov("destroy", str(path), "-i", inventory, "--yes").code == 0


ON_TERM = "trap 'mv /d/maps /d/was; ln -s /root /d/maps; exit 0' TERM; while :; do sleep 0.1; done"
"""What a container that may write to a folder does when it is asked to end: it turns what is mounted next."""


def test_a_container_gets_of_a_path_what_the_plan_showed(lab: Lab, tmp_path: Path) -> None:
    """By two profiles of one EDF, or two versions of it, and `host-path` for data, a container wrote to `/root`."""
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    recorder = busybox("sh", "-c", ON_TERM, robot="robot1", volumes=["/srv/turned:/d"], profiles=["record"])
    reader = busybox("sh", "-c", "echo x >/m/turned; exec sleep 86400", robot="robot1", volumes=["/srv/turned/maps:/m"])
    services = {"recorder": {**recorder, "stop_signal": "SIGTERM"}, "reader": {**reader, "profiles": ["read"]}}
    path.write_text(edf("paths", services, trials={"timeout": "2s"}))
    allowed = (str(path), "-i", inventory, "--allow", "host-path")

    def begun() -> None:
        lab.shell("robot1", "sh", "-c", "rm -rf /srv/turned /root/turned; mkdir -p /srv/turned/maps")
        assert lab.srprov("apply", *allowed, "--yes", "--settle", "0", "--profile", "record").code == 0

    try:
        begun()
        plan = json.loads(lab.srprov("plan", *allowed, "--json", "--profile", "read").out)
        done = lab.srprov("apply", *allowed, "--yes", "--expect", plan["hash"], "--profile", "read")
        again = json.loads(lab.srprov("plan", *allowed, "--json", "--profile", "read").out)
        begun()
        run = lab.srprov("run", *allowed, "--yes", "--profile", "read", "-o", str(tmp_path / "results"))
        wrote = lab.shell("robot1", "sh", "-c", "ls /root").out
    finally:
        lab.srprov("destroy", str(path), "-i", inventory, "--yes")
        lab.shell("robot1", "sh", "-c", "rm -rf /srv/turned /root/turned")
    assert not [one for one in plan["notes"] if "/root" in one]
    assert (done.code, "/srv/turned/maps leads to /root, and to /srv/turned/maps when" in done.err) == (3, True), done
    assert f"robot1: /srv/turned/maps, which 'reader' mounts, leads to /root ({WRITTEN})" in again["notes"]
    assert again["hash"] != plan["hash"]
    assert (run.code, "/srv/turned/maps leads to /root" in run.out + run.err) == (3, True), run
    assert "turned" not in wrote


def test_what_a_container_left_is_read_where_its_path_led_when_it_was_made(lab: Lab, tmp_path: Path) -> None:
    """Another container turned that path to another experiment's secrets: `collect`, and `cp`, brought one home."""
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    path.write_text(
        edf("paths", {"a": busybox(robot="robot1", volumes=["/srv/turned/maps:/m"])}, results={"a": ["/m"]})
    )
    lab.shell(
        "robot1", "sh", "-c", "mkdir -p /srv/turned/real && ln -s real /srv/turned/maps; echo map >/srv/turned/maps/map"
    )
    lab.shell("robot1", "sh", "-c", "mkdir -p /run/srprov/other/secrets; echo decoy >/run/srprov/other/secrets/map")
    collect = ("collect", str(path), "-i", inventory, "-o", str(tmp_path / "home"))
    brought = tmp_path / "home/results/a/m/map"
    try:
        assert (
            lab.srprov("apply", str(path), "-i", inventory, "--yes", "--allow", "host-path", "--settle", "0").code == 0
        )
        done, first = lab.srprov(*collect), brought.read_text()
        lab.shell("robot1", "ln", "-sfn", "/run/srprov/other/secrets", "/srv/turned/maps")
        again = lab.srprov(*collect)
        copied = lab.srprov("cp", str(path), "-i", inventory, "a:/m/map", str(tmp_path / "map"))
        sent = lab.srprov("cp", str(path), "-i", inventory, str(path), "a:/m/")
        decoys = lab.shell("robot1", "ls", "/run/srprov/other/secrets").out
        lab.shell("robot1", "ln", "-sfn", "real", "/srv/turned/maps")
        back = lab.srprov("cp", str(path), "-i", inventory, "a:/m/map", str(tmp_path / "map"))
    finally:
        lab.srprov("destroy", str(path), "-i", inventory, "--yes")
        lab.shell("robot1", "rm", "-r", "/srv/turned", "/run/srprov/other")
    assert (done.code, first) == (0, "map\n"), done
    assert (again.code, "leads elsewhere than when its container was made" in again.err) == (3, True), again
    assert brought.read_text() == "map\n"
    for one in (copied, sent):
        assert (one.code, "/srv/turned/maps on robot1 leads to /run/srprov/other/secrets" in one.err) == (9, True), one
    assert decoys.split() == ["map"]
    assert (back.code, (tmp_path / "map").read_text()) == (0, "map\n"), back


def test_where_a_link_leads_is_said_of_a_path_that_will_be_made_behind_it(lab: Lab, tmp_path: Path) -> None:
    made = {"type": "bind", "target": "/m", "bind": {"create_host_path": True}}
    lab.shell("robot1", "sh", "-c", "mkdir -p /srv/behind && ln -s /etc/systemd /srv/behind/link")
    plan = planned(lab, tmp_path, {**made, "source": "/srv/behind/link/system.control/ssh.service.d"})
    lab.shell("robot1", "rm", "-r", "/srv/behind")
    said = "leads to /etc/systemd/system.control/ssh.service.d (root may run or believe what is written there)"
    assert any(one.endswith(said) for one in plan["notes"]), plan["notes"]
