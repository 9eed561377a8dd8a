"""Robots with worn-out disks, odd sshds, noisy shells and bad links, all in one inventory: each is a clear state.

What is wrong is made by the lab and by hand; what came of it is read by Docker's own word on the robots. Every apply
has a deadline, so none of this may hang.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import ROBOTS, Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

FULL, READ_ONLY, STARTUPS, ONE_SESSION = "robot1", "robot2", "robot3", "robot4"
NOISY, LOSSY, THIN, THREE_SESSIONS, PLAIN = "robot5", "robot6", "robot7", "robot8", "robot9"
FINE = (STARTUPS, NOISY, LOSSY, THIN, THREE_SESSIONS, PLAIN)
SPEC = rf"""
robots:
  {FULL}: {{disk_mib: 64}}
  {READ_ONLY}: {{docker_read_only: true}}
  {STARTUPS}: {{sshd: {{max_startups: 2, max_sessions: 10}}}}
  {ONE_SESSION}: {{sshd: {{max_startups: 10, max_sessions: 1}}}}
  {NOISY}:
    bashrc: |
      echo "welcome, it is a nice day"
      printf '\377\376\200 not UTF-8 \303\050\n'
      printf '\377\376 nor this\n' >&2
      printf 'and no newline \377'
  {LOSSY}: {{loss_percent: 5}}
  {THIN}: {{rate_mbit: 2}}
  {THREE_SESSIONS}: {{sshd: {{max_startups: 10, max_sessions: 3}}}}
"""
DEADLINE_S = 300.0


@dataclass(frozen=True)
class Faulty:
    """The lab with those robots."""

    lab: Lab
    folder: Path

    def experiment(self, name: str, services: dict[str, dict[str, Any]], robots: Sequence[str]) -> tuple[str, ...]:
        """Write an experiment and an inventory of these robots; give both as arguments."""
        path = self.folder / f"{name}.edf"
        path.write_text(edf(name, services), encoding="utf-8")
        return str(path), "-i", part_of_lab(self.lab, robots, self.folder / f"{name}.yml")

    def apply(self, words: Sequence[str], *more: str) -> Done:
        """Apply within the deadline."""
        begun = time.monotonic()
        done = self.lab.srprov("apply", *words, "--yes", "--json", "--settle", "0.5", *more)
        assert time.monotonic() - begun < DEADLINE_S, done
        return done

    def running(self, robot: str, name: str) -> bool:
        """Ask Docker on the robot."""
        return name in self.lab.containers(robot, running=True)


@pytest.fixture(scope="module")
def faulty(lab_session: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Faulty]:
    """Give the lab with faulty robots, the disk of one of them full; in the end all are ordinary and empty."""
    folder = tmp_path_factory.mktemp("faulty")
    (folder / "lab-spec.yml").write_text(SPEC, encoding="utf-8")
    up = lab_session.srprov("lab", "up", "-n", str(ROBOTS), "--spec", str(folder / "lab-spec.yml"))
    assert up.code == 0, up
    fill = "dd if=/dev/zero of=/var/lib/docker/filler bs=64k 2>&1; df -k --output=avail /var/lib/docker | tail -1"
    assert int(lab_session.shell(FULL, "sh", "-c", fill).out.split()[-1]) < 100
    yield Faulty(lab_session, folder)
    up = lab_session.srprov("lab", "up", "-n", str(ROBOTS))
    assert up.code == 0, up


@pytest.fixture(scope="module")
def mixed(faulty: Faulty) -> Iterator[tuple[Faulty, tuple[str, ...], Done]]:
    """Give one apply over all of them, with a service on each; afterwards `destroy` takes away what there is."""
    robots = (FULL, READ_ONLY, *FINE)
    services = {f"on-{robot}": busybox(robot=robot) for robot in robots}
    words = faulty.experiment("mixed", services, (*robots, ONE_SESSION))
    yield faulty, words, faulty.apply(words)
    gone = faulty.lab.srprov("destroy", *words, "--yes")
    left = {robot: name for robot in FINE for name in faulty.lab.containers(robot) if name.startswith("srprov.mixed.")}
    assert left == {}, gone


@pytest.mark.parametrize(("robot", "words"), [(FULL, "no space left on device"), (READ_ONLY, "read-only file system")])
def test_a_disk_that_takes_nothing_fails_its_robot_alone(
    mixed: tuple[Faulty, tuple[str, ...], Done], robot: str, words: str
) -> None:
    """Exit 3; the step that could not write says so in Docker's words, and what needs it is skipped."""
    faulty, _, done = mixed
    assert done.code == 3, done
    steps = [step for step in done.json["steps"] if step["id"].startswith(f"{robot}/")]
    failed = [step for step in steps if step["outcome"] == "failed"]
    assert any(words in step["message"] for step in failed), done
    assert all(f"failed: #{step['number']} {step['id']}" in done.err for step in failed), done
    container = next(step for step in steps if step["id"].endswith(f"/container:srprov.mixed.on-{robot}"))
    assert container["outcome"] in ("failed", "skipped"), done
    assert not faulty.running(robot, f"srprov.mixed.on-{robot}")
    assert done.json["unreachable"] == [], done


@pytest.mark.parametrize("robot", FINE)
def test_what_works_on_a_bad_robot_is_done(mixed: tuple[Faulty, tuple[str, ...], Done], robot: str) -> None:
    """Few SSH sessions, a noisy shell, lost packets, a thin link: all of its steps are done while others fail."""
    faulty, _, done = mixed
    ends = {step["id"]: step["outcome"] for step in done.json["steps"] if step["id"].startswith(f"{robot}/")}
    assert ends and set(ends.values()) == {"changed"}, done
    assert faulty.running(robot, f"srprov.mixed.on-{robot}")


def test_room_on_the_disk_is_all_that_was_missing(mixed: tuple[Faulty, tuple[str, ...], Done]) -> None:
    """Once there is room the next apply finishes the robot whose disk was full; only the read-only one still fails."""
    faulty, words, _ = mixed
    faulty.lab.shell(FULL, "rm", "/var/lib/docker/filler")
    again = faulty.apply(words)
    assert again.code == 3, again
    assert faulty.running(FULL, f"srprov.mixed.on-{FULL}")
    wrong = {step["id"].split("/")[0] for step in again.json["steps"] if step["outcome"] != "changed"}
    assert wrong == {READ_ONLY}, again


def test_a_robot_with_one_session_is_not_used_and_says_why(faulty: Faulty) -> None:
    """sshd gives it a shell and nothing more: it can run no service, with the reason and what to set."""
    words = faulty.experiment("single", {"a": busybox(robot=ONE_SESSION)}, [ONE_SESSION, PLAIN])
    for verb in (("plan",), ("apply", "--yes")):
        begun = time.monotonic()
        refused = faulty.lab.srprov(*verb, *words)
        assert time.monotonic() - begun < 120, refused
        assert refused.code == 8, refused
        assert f"cannot run on {ONE_SESSION}: no Docker (sshd opens no session" in refused.err, refused
        assert "MaxSessions" in refused.err, refused
    assert "srprov.single.a" not in faulty.lab.containers(ONE_SESSION)

    words = faulty.experiment("elsewhere", {"a": busybox()}, [ONE_SESSION, PLAIN])
    fine = faulty.apply(words)
    assert (fine.code, fine.json["assignment"]) == (0, {"a": PLAIN}), fine
    assert faulty.running(PLAIN, "srprov.elsewhere.a")
    gone = faulty.lab.srprov("destroy", *words, "--yes")
    assert gone.code == 0, gone
    assert "srprov.elsewhere.a" not in faulty.lab.containers(PLAIN)


def test_an_sshd_whose_startups_are_taken_is_unreachable_until_they_are_free(faulty: Faulty) -> None:
    """Others hold all logins of an sshd: the robot is unreachable with a hint, exit 4, the rest is done."""
    words = faulty.experiment("startups", {"a": busybox(robot=PLAIN), "b": busybox(robot=STARTUPS)}, [STARTUPS, PLAIN])
    address = (str(faulty.lab.site.address(STARTUPS)), 22)
    held = [socket.create_connection(address, timeout=5) for _ in range(2)]
    try:
        assert [one.recv(4) for one in held] == [b"SSH-"] * 2
        alone = faulty.experiment("alone", {"a": busybox()}, [STARTUPS, PLAIN])
        begun = time.monotonic()
        done = faulty.apply(alone)
        assert time.monotonic() - begun < 120
        assert done.code == 4, done
        assert (done.json["unreachable"], done.json["assignment"]) == ([STARTUPS], {"a": PLAIN}), done
        assert "closed the connection before its banner" in done.err and "MaxStartups" in done.err, done
        assert faulty.running(PLAIN, "srprov.alone.a")
    finally:
        for one in held:
            one.close()
    gone = faulty.lab.srprov("destroy", *alone, "--yes")
    assert gone.code == 0, gone
    both = faulty.apply(words)
    assert both.code == 0, both
    assert faulty.running(STARTUPS, "srprov.startups.b") and faulty.running(PLAIN, "srprov.startups.a")
    gone = faulty.lab.srprov("destroy", *words, "--yes")
    assert gone.code == 0, gone
