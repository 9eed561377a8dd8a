"""Volumes that an EDF shares with a service of a stranger's CDF, on real engines."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"
VALUE = "token-of-the-planner"


def test_what_a_service_reads_alone_gets_no_file_of_its_image(lab: Lab, tmp_path: Path) -> None:
    """An engine fills an empty volume with what the image has at that place, whether or not its container may write.

    The user's own service runs what lies there, with its secret.
    """
    (tmp_path / "run.sh").write_text("cp /run/secrets/token /ws/leak\n", encoding="utf-8")
    files = "[{src: run.sh, dest: /ws/run.sh}]"
    (tmp_path / "camera.cdf").write_text(
        f"cdf: 1\nbase: busybox\nfiles: {files}\ncommand: sleep 86400\nstop_signal: SIGKILL\n", encoding="utf-8"
    )
    script = "[ -e /ws/run.sh ] || echo ': own' >/ws/run.sh; sh /ws/run.sh; exec sleep 86400"
    services = {
        "camera": {"cdf": "camera.cdf", "volumes": ["ws:/ws:ro"]},
        "planner": busybox("sh", "-c", script, volumes=["ws:/ws"], secrets=["token"], depends_on=["camera"]),
    }
    path = tmp_path / "share.edf"
    more = {"secrets": {"token": {"env": "LAB_TOKEN"}}, "placement": {"slots_per_robot": 2}}
    path.write_text(edf("share", services, **more), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    words = (str(path), "-i", inventory, "--allow", "secret")
    done = lab.srprov("apply", *words, "--yes", "--settle", "0", env={"LAB_TOKEN": VALUE})
    assert done.code == 0, done
    for service in ("camera", "planner"):
        there = lab.shell(ROBOT, "docker", "exec", f"srprov.share.{service}", "sh", "-c", "cat /ws/run.sh; ls /ws").out
        assert there.split() == [":", "own", "run.sh"], there
    plan = lab.srprov("plan", *words, env={"LAB_TOKEN": VALUE})
    assert plan.code == 0 and "Nothing to do" in plan.out, plan
    lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")


def test_no_image_fills_a_volume_that_a_running_container_leads_elsewhere(lab: Lab, tmp_path: Path) -> None:
    """The engine copied as root, by links that the container put in the place of folders still to come."""
    for number in range(60):
        (tmp_path / f"x/d{number:02}").mkdir(parents=True)
        (tmp_path / f"x/d{number:02}/owned").write_bytes(bytes(200_000))
    (tmp_path / "second.cdf").write_text(
        "cdf: 1\nbase: busybox\nfiles: [{src: x, dest: /x}]\ncommand: sleep 86400\nstop_signal: SIGKILL\n",
        encoding="utf-8",
    )
    links = "for d in 5 4 3 2 1; do for i in 0 1 2 3 4 5 6 7 8 9; do ln -s /srv/led /v/d$d$i; done; done"
    script = f'until [ "$(ls /v)" ]; do :; done; {links}; exec sleep 86400'
    services = {
        "first": busybox("sh", "-c", script, volumes=["v:/v"]),
        "second": {"cdf": "second.cdf", "volumes": ["v:/x"], "depends_on": ["first"]},
    }
    path = tmp_path / "fill.edf"
    path.write_text(edf("fill", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    lab.shell(ROBOT, "mkdir", "-p", "/srv/led")
    try:
        done = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
        assert done.code == 0, done
        assert lab.shell(ROBOT, "ls", "/srv/led").out == ""
        assert lab.shell(ROBOT, "docker", "exec", "srprov.fill.second", "ls", "/x").out == ""
        plan = lab.srprov("plan", str(path), "-i", inventory)
        assert plan.code == 0 and "Nothing to do" in plan.out, plan
    finally:
        lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
        lab.shell(ROBOT, "rm", "-rf", "/srv/led")


def test_a_cdf_gets_no_data_of_a_service_that_is_gone(lab: Lab, tmp_path: Path) -> None:
    """The next version of a stranger's CDF names the volume of a service that the user took out of the EDF."""
    own = busybox("sh", "-c", "echo users >/data/list; exec sleep 86400", volumes=["users:/data"])
    path, cdf = tmp_path / "kept.edf", tmp_path / "cam.cdf"
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    more = {"placement": {"slots_per_robot": 2}}
    begins = "cdf: 1\nimage: busybox\ncommand: sleep 86400\nstop_signal: SIGKILL\n"
    cdf.write_text(begins, encoding="utf-8")
    path.write_text(edf("kept", {"db": own, "cam": {"cdf": "cam.cdf"}}, **more), encoding="utf-8")
    assert lab.srprov(*words).code == 0
    path.write_text(edf("kept", {"cam": {"cdf": "cam.cdf"}}, **more), encoding="utf-8")
    assert lab.srprov(*words).code == 0

    cdf.write_text(f"{begins}volumes: ['users:/x']\n", encoding="utf-8")
    refused = lab.srprov(*words)
    assert refused.code == 9 and "mounts 'users', whose data on robot1 is of db" in refused.err, refused
    path.write_text(edf("kept", {"cam": {"cdf": "cam.cdf", "volumes": ["users:/x"]}}, **more), encoding="utf-8")
    said = lab.srprov(*words)
    assert said.code == 0 and "has the data of db, and cam has it now" in said.out + said.err, said
    assert lab.shell(ROBOT, "docker", "exec", "srprov.kept.cam", "cat", "/x/list").out.strip() == "users"

    # its own stays its own, also behind a destroy
    lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
    path.write_text(edf("kept", {"cam": {"cdf": "cam.cdf"}}, **more), encoding="utf-8")
    assert lab.srprov(*words).code == 0
    lab.srprov("destroy", str(path), "-i", inventory, "--yes")
    assert lab.srprov(*words).code == 0
    lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
