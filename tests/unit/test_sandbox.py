"""A folder is read, or filled, by root without anything else of the robot, whatever is put in the way of a name."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from srprov.sandbox import ELSEWHERE, MISSING, ended_with_channel, sandboxed, sandboxed_writing
from srprov.session import Traffic
from srprov.transport.shell.pipes import PipeStreams
from srprov.wire import quote

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="who is not root has no sandbox")


def wait_until(true: Callable[[], bool]) -> None:
    """Wait for something that happens soon."""
    end = time.monotonic() + 20
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def ran(root: Path, script: str, *before: str) -> subprocess.CompletedProcess[str]:
    """Run a script in the sandbox of a folder."""
    command = [*before, "sh", "-c", sandboxed(str(root), script)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=30)


def test_the_folder_is_read_and_its_programs_are_those_of_the_robot(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("harmless")
    done = ran(tmp_path, "cat file; sha256sum file | head -c 4; echo mine >&2; exit 7")
    assert (done.stdout, done.stderr, done.returncode) == ("harmless98fc", "mine\n", 7)


@pytest.mark.parametrize("link", ["{tmp}", "..", "/proc/self/root{tmp}", "../../../..{tmp}", "/"])
def test_a_link_leads_nowhere_else(tmp_path: Path, link: str) -> None:
    (tmp_path / "decoy").write_text("secret")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "out").symlink_to(link.format(tmp=tmp_path))
    done = ran(tmp_path / "in", f"cat out/decoy out{tmp_path}/decoy out/etc/passwd; ls /etc /proc /sys /root /var")
    assert (done.stdout, done.returncode) == ("", 2)


@pytest.mark.parametrize("kind", [("c", "1", "5"), ("b", "7", "0")])
def test_a_device_is_not_opened(tmp_path: Path, kind: tuple[str, str, str]) -> None:
    subprocess.run(["mknod", tmp_path / "device", *kind], check=True)
    done = ran(tmp_path, "head -c 4 device")
    assert (done.stdout, "Permission denied" in done.stderr) == ("", True)


def test_nothing_is_written_and_no_mount_stays(tmp_path: Path) -> None:
    before = Path("/proc/self/mounts").read_text().count(str(tmp_path))
    assert "Read-only file system" in ran(tmp_path, "touch new").stderr
    assert not list(tmp_path.iterdir())
    assert Path("/proc/self/mounts").read_text().count(str(tmp_path)) == before


def test_a_script_that_writes_has_that_folder_alone(tmp_path: Path) -> None:
    """Neither the robot's programs nor what lies beyond can be written to, or get a second name there."""
    folder, program = tmp_path / "in", f"/usr/bin/srprov-{os.getpid()}"
    folder.mkdir()
    (tmp_path / "decoy").write_text("secret")
    linked = f"ln /usr/bin/env program; ln ..{tmp_path}/decoy {tmp_path}/decoy ."
    asked = f"echo new >file; touch {program} /etc/new /new; {linked}"
    script = f"root={quote(str(folder))}; {sandboxed_writing(asked)}"
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=False, timeout=30)
    assert done.stderr.count("Read-only file system") == 3 and "Invalid cross-device link" in done.stderr, done
    assert not os.path.exists(program)
    assert [(one.name, one.read_text()) for one in folder.iterdir()] == [("file", "new\n")]


def test_who_is_not_root_reads_the_folder_as_it_is() -> None:
    done = ran(
        Path("/usr/bin"), "id -u; pwd -P; [ -e env ] && echo read", "setpriv", "--reuid", "65534", "--clear-groups"
    )
    assert done.stdout.split() == ["65534", "/usr/bin", "read"]


def test_nothing_is_read_where_a_link_took_the_folder_s_place(tmp_path: Path) -> None:
    here, other = tmp_path / "here", tmp_path / "other"
    here.mkdir()
    other.mkdir()
    (other / "decoy").write_text("secret")
    script = sandboxed(str(here), "cat decoy; ls", str(here))
    assert subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=False).returncode == 0
    here.rmdir()
    here.symlink_to(other)
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("", ELSEWHERE)
    led = sandboxed(str(here), "ls", str(other))
    assert subprocess.run(["sh", "-c", led], capture_output=True, text=True, check=False).stdout == "decoy\n"


def test_a_folder_that_is_gone_has_its_own_status(tmp_path: Path) -> None:
    assert ran(tmp_path / "gone", "true").returncode == MISSING


def test_what_runs_ends_with_its_channel(tmp_path: Path) -> None:
    """Also what it started; and at its own end the script's status comes."""
    mark = tmp_path / "pids"
    streams = PipeStreams("sh", Traffic())
    script = ended_with_channel(f"sleep 611 & echo $! >>{mark}; sleep 612", 3600)
    streams.write(memoryview(f"{script}\n".encode()))
    wait_until(lambda: mark.exists() and mark.read_text().endswith("\n"))
    sleeper = Path("/proc", mark.read_text().strip())
    assert sleeper.exists()
    streams.close()
    wait_until(lambda: not sleeper.exists())


def test_a_script_that_ends_by_itself_has_its_status() -> None:
    shell = subprocess.Popen(["sh"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert shell.stdin and shell.stdout
    shell.stdin.write(f"( {ended_with_channel('echo here; exit 5', 60)} ); echo $?; exit\n".encode())
    shell.stdin.flush()  # the channel stays open, as a robot's does
    started = time.monotonic()
    assert shell.stdout.read() == b"here\n5\n"
    assert time.monotonic() - started < 20
    shell.stdin.close()
    shell.wait(20)


def test_outputs_end_with_the_script_though_what_watches_the_channel_lives_on() -> None:
    """A shell that is killed right after its fork may ignore it; here no kill does anything."""
    script = f"kill() {{ :; }}; ( {ended_with_channel('echo here; exit 5', 60)} ); echo $?"
    streams, out = PipeStreams(script, Traffic()), bytearray()

    def at_end() -> bool:
        out.extend(streams.read()[0])
        return streams.ended

    wait_until(at_end)
    assert out == b"here\n5\n"
    streams.close()
