"""What is sent to robots: the programs of the package, and whom they are told to ask."""

from __future__ import annotations

import base64
import gzip
import hashlib
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from srprov.probing.request import MOST_ENDPOINTS, among, request_of
from srprov.probing.script import ARCHITECTURES, FOLDER, PROGRAMS, run, upload
from srprov.transport.shell.frames import batch
from tests.unit.probing.worlds import RECORD, request

ROOT = Path(__file__).parents[3]


def sums() -> dict[str, str]:
    lines = (PROGRAMS / "SHA256SUMS").read_text(encoding="ascii").splitlines()
    return {name: digest for digest, name in (line.split() for line in lines)}


def test_every_program_has_the_bytes_that_are_written_down() -> None:
    """And they are what is sent; all of them together are small."""
    assert sums().keys() == {f"probe-{name}" for name in ARCHITECTURES.values()}
    for arch, name in ARCHITECTURES.items():
        sent = upload("0a1b2c3d", arch).script.partition("printf %s '")[2].partition("'")[0]
        content = gzip.decompress(base64.b64decode(sent))
        assert hashlib.sha256(content).hexdigest() == sums()[f"probe-{name}"]
        assert content.startswith(b"\x7fELF") and len(content) < 64 * 1024


@pytest.mark.soak
def test_the_compiler_gives_the_same_bytes_again(tmp_path: Path) -> None:
    """It comes from PyPI, 80 MB, and builds its C library first: minutes."""
    subprocess.run([sys.executable, ROOT / "tools" / "build_probe.py", tmp_path], check=True, timeout=1800)
    assert (tmp_path / "SHA256SUMS").read_bytes() == (PROGRAMS / "SHA256SUMS").read_bytes()


def program(*words: str) -> subprocess.CompletedProcess[str]:
    """Run the program for this machine, from a file that may be run."""
    path = PROGRAMS / f"probe-{os.uname().machine}"
    return subprocess.run([sys.executable, "-c", RUN, path, *words], capture_output=True, text=True, timeout=30)


RUN = (
    "import os, sys; f = os.memfd_create('probe'); os.write(f, open(sys.argv[1], 'rb').read()); "
    "os.execve(f, ['probe', *sys.argv[2:]], {})"
)


@pytest.mark.skipif(os.uname().machine not in ARCHITECTURES.values(), reason="there is no program for this machine")
@pytest.mark.parametrize("shell", [("dash",), ("bash", "--posix"), ("busybox", "sh")])
def test_the_program_is_held_open_by_the_shell_and_has_no_file(shell: tuple[str, ...], tmp_path: Path) -> None:
    """A robot that cannot unpack it says so, and its shell goes on."""
    arch = next(arch for arch, name in ARCHITECTURES.items() if name == os.uname().machine)
    command = upload("0a1b2c3d", arch)
    assert command.in_place
    script = command.script.replace(FOLDER, str(tmp_path))
    broken = script.replace("gzip -dc", "gzip -d --nonsense")
    text = batch("0a", [broken, "exec /proc/self/fd/8", script, f"ls -A {tmp_path}", "exec /proc/self/fd/8"], {0, 2})
    done = subprocess.run(shell, input=text, capture_output=True, timeout=30, check=True)
    answers = [line.split()[1:] for line in done.stdout.decode().splitlines() if line.startswith("0a ")]
    assert answers[0] == ["begin", "0"] and [at for at, _ in answers[1:]] == ["0", "1", "2", "3", "4"]
    statuses = [status for _, status in answers[1:]]
    assert statuses[0] != "0" and statuses[1] in ("126", "127") and statuses[2:] == ["0", "0", "2"], done.stderr
    assert b"probe: MAGIC" in done.stderr and b".probe" not in done.stdout


@pytest.mark.skipif(os.uname().machine not in ARCHITECTURES.values(), reason="there is no program for this machine")
@pytest.mark.parametrize(
    "words",
    [
        (),
        ("0a1b2c3d", "1450", "1500", "10", "20"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "--", "r127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "1", "--", "r127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "0x", "--", "r127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "-1", "--", "r127.0.0.1"),
        ("0a1b2c3x", "1450", "1500", "10", "20", "0", "--", "r127.0.0.1"),
        ("0a1b2c3d", "-1", "1500", "10", "20", "0", "--", "r127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "99999999999", "20", "0", "--", "r127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "0", "--", "x127.0.0.1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "0", "--", "r::1"),
        ("0a1b2c3d", "1450", "1500", "10", "20", "0", "--", *["g127.0.0.1"] * 1025),
        ("0a1b2c3d", "1450", "1500", "10", "20", *["0"] * 129, "--", "g127.0.0.1"),
    ],
)
def test_the_program_refuses_words_that_make_no_sense(words: tuple[str, ...]) -> None:
    done = program(*words)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.startswith("probe: MAGIC")


@pytest.mark.skipif(os.uname().machine not in ARCHITECTURES.values(), reason="there is no program for this machine")
def test_a_namespace_that_is_gone_is_said_and_ends_nothing() -> None:
    done = program("0a1b2c3d", "1450", "1500", "10", "20", "0:/proc/0/ns/net", "--", "r127.0.0.1")
    assert done.returncode == 0 and '"failed":"namespace"' in done.stdout


def test_the_script_names_everybody_and_the_namespaces_that_are_here() -> None:
    whole = request()
    at = next(index for index, one in whole.of("r2").items() if one.container)
    script = run(whole, "r2", "0a1b2c3d", {at: 77}).script
    words = shlex.split(script.rsplit("/proc/self/fd/8", 1)[1])
    assert words[:5] == ["0a1b2c3d", "1450", "1500", "1200", "10000"]
    again = run(whole, "r2", "0a1b2c3d", {at: 77}, again=True).script
    assert shlex.split(again.rsplit("/proc/self/fd/8", 1)[1])[3] == "4000", "what decides is more patient"
    assert f"{at}:/proc/77/ns/net" in words and words[words.index("--") + 1 :] == [
        *(f"g10.128.0.{n}" for n in (1, 2, 3)),
        *(f"u192.0.2.{n}" for n in (1, 2, 3)),
        *(f"r10.128.1.{n}" for n in (1, 2, 3)),
    ]


def record(services: int, robots: int = 3) -> dict[str, Any]:
    placed = {
        f"s{n:04}": {"ip": f"10.128.{1 + n // 250}.{1 + n % 250}", "mac": "", "network": "overlay",
                     "robot": f"r{1 + n % robots}"}
        for n in range(services)
    }  # fmt: skip
    return {**RECORD, "services": placed}


def test_of_many_services_one_of_each_robot_is_asked_by_all() -> None:
    """So what is sent grows with services, not with their square."""
    few, many, most = (request_of("i", record(count)) for count in (100, 300, 2000))
    assert few and many and most
    assert not any(one.sparse for one in few.endpoints)
    dense = [one.service for one in many.endpoints if one.service and not one.sparse]
    assert dense == ["s0000", "s0001", "s0002"]
    assert len(most.endpoints) == MOST_ENDPOINTS


def test_what_is_not_on_the_overlay_is_not_probed() -> None:
    services = {name: {**one, "network": "host", "ip": ""} for name, one in RECORD["services"].items()}
    assert request_of("i", {**RECORD, "services": services}) is None
    assert request_of("i", None) is None
    both = {"s1": {**RECORD["services"]["s1"], "network": "both"}, "s2": RECORD["services"]["s2"]}
    made = request_of("i", {**RECORD, "services": both})
    assert made is not None
    assert {one.service: one.container for one in made.endpoints if one.service} == {"s1": "", "s2": "srprov.i.s2"}


def test_robots_that_are_away_are_left_out_with_their_services() -> None:
    made = among(request(), {"r1", "r2"}, {"s1"})
    assert [one.name for one in made.endpoints] == ["r1", "r2", "r1", "r2", "s1@r1"]
