"""The lab's faults as far as they need no lab: options, texts, the bridge's rules, the delaying proxy."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import socket
import subprocess
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from srprov.errors import DefinitionError, LabError
from srprov.lab import cgroups, config, delay, inventory, partition, users
from srprov.lab.places import Site
from srprov.lab.spec import Latency, Robot, Sshd, parse

TO_S, FROM_S = 0.15, 0.05
RTT_S = TO_S + FROM_S


def test_every_fault_is_read() -> None:
    text = """
robots:
  robot1:
    ssh_latency_ms: 80
    cpus: 0.5
    rate_mbit: 0.5
    loss_percent: 2.5
    disk_mib: 512
    docker_read_only: true
    clock_offset_s: -90.5
    sshd: {max_startups: 3, max_sessions: 2}
    bashrc: |
      echo welcome
    sudo_password: 1234
    unprivileged: yes
"""
    assert parse(text, "lab-spec.yml").build(1) == [
        Robot(
            "robot1",
            ssh_latency_ms=Latency(40, 40),
            cpus=0.5,
            rate_mbit=0.5,
            loss_percent=2.5,
            disk_mib=512,
            docker_read_only=True,
            clock_offset_s=-90.5,
            sshd=Sshd(3, 2),
            bashrc="echo welcome\n",
            sudo_password="1234",
            unprivileged=True,
        )
    ]


@pytest.mark.parametrize(
    ("option", "column", "message"),
    [
        ("ssh_latency: 5", 5, "unknown key 'ssh_latency'"),
        ("ssh_latency_ms: -1", 21, "expected a number from 0 to 10000, not '-1'"),
        ("ssh_latency_ms: {there: 5}", 22, "unknown key 'there'"),
        ("ssh_latency_ms: {to: 5001}", 26, "expected a number from 0 to 5000, not '5001'"),
        ("cpus: 0", 11, "expected a number from 0.05 to 1000, not '0'"),
        ("rate_mbit: 0", 16, "expected a number from 0.1 to 10000, not '0'"),
        ("loss_percent: 101", 19, "expected a number from 0 to 100, not '101'"),
        ("disk_mib: 4G", 15, "expected a whole number from 32 to 1000000, not '4G'"),
        ("docker_read_only: 1", 23, "expected true or false, not '1'"),
        ("clock_offset_s: 1h", 21, "expected a number from -100000000 to 100000000, not '1h'"),
        ("sshd: 5", 11, "expected a map, not '5'"),
        ("sshd: {startups: 5}", 12, "unknown key 'startups'"),
        ("sshd: {max_sessions: 0}", 26, "expected a whole number from 1 to 1000, not '0'"),
        ("bashrc: [a]", 13, "expected text, not a list"),
        ("sudo_password:", 19, "expected text, not nothing"),
        ("unprivileged: maybe", 19, "expected true or false, not 'maybe'"),
    ],
)
def test_a_wrong_fault_is_refused_at_its_place(option: str, column: int, message: str) -> None:
    with pytest.raises(DefinitionError) as raised:
        parse(f"robots:\n  robot1:\n    {option}\n", "lab-spec.yml")
    (problem,) = raised.value.problems
    assert (problem.location.line, problem.location.column, problem.message) == (3, column, message)


def test_a_fault_asks_for_a_reboot() -> None:
    plain = Robot("robot1").boot_digest
    for robot in (
        Robot("robot1", loss_percent=1),
        Robot("robot1", cpus=1),
        Robot("robot1", sshd=Sshd(1)),
        Robot("robot1", bashrc="x"),
    ):
        assert robot.boot_digest != plain


def test_nobody_but_robot_logs_in_where_that_is_all_there_is() -> None:
    assert inventory.user_of(Robot("robot1", unprivileged=True), "root") == "robot"
    assert "PermitRootLogin no\n" in config.sshd(Site(), Robot("robot1", unprivileged=True))


def test_sshd_config_keeps_high_limits_but_where_others_are_asked_for() -> None:
    plain = config.sshd(Site(), Robot("robot1"))
    assert "Port 22\n" in plain
    assert "MaxStartups 500:30:1000\nMaxSessions 200\n" in plain
    assert "MaxStartups 3\nMaxSessions 200\n" in config.sshd(Site(), Robot("robot1", sshd=Sshd(max_startups=3)))
    assert "ListenAddress 10.213.0.11:2022\n" in config.sshd(Site(), Robot("robot1", ssh_latency_ms=Latency(1, 0)))


def test_the_wrapper_changes_only_questions_for_the_time_of_now(tmp_path: Path) -> None:
    script = tmp_path / "date"
    script.write_text(config.date(-3600.5).replace("/run/lab/date", "date").replace("/run/lab", str(tmp_path)))

    def ask(*words: str) -> str:
        return subprocess.run(["sh", str(script), *words], capture_output=True, text=True, check=True).stdout.strip()

    assert float(ask("+%s.%N")) - time.time() == pytest.approx(-3600.5, abs=3)
    (tmp_path / "clock").write_text("+12.250000\n")
    assert float(ask("+%s.%N")) - time.time() == pytest.approx(12.25, abs=3)
    assert ask("-u", "-d", "@0", "+%Y") == ask("-u", "--date=@0", "+%Y") == "1970"


def test_rights_of_a_user_are_taken_and_given() -> None:
    assert users.drop_member("docker:x:107:ann,robot\nrobot:x:1001:robot\n", "docker", "robot") == (
        "docker:x:107:ann\nrobot:x:1001:robot\n"
    )
    shadow = "root:*:19700:0:99999:7:::\nrobot:*:19700:0:99999:7:::\n"
    assert users.with_password(shadow, "robot", "$6$a$b") == shadow.replace("robot:*", "robot:$6$a$b")
    first, second = users.hash_of("secret"), users.hash_of("secret")
    assert first.startswith("$6$") and len(first) > 90 and first != second


SAVED = """\
*filter
:INPUT ACCEPT
:FORWARD ACCEPT
-A INPUT -p ! ARP -i srlab-r1 -j DROP
-A INPUT -p IPv4 -i eth0 -j DROP
-A FORWARD -p ! ARP -i srlab-r1 -j DROP
-A FORWARD -p ! ARP -o srlab-r1 -j DROP
-A FORWARD -p ! ARP -i srlab-r3 -o srlab-r12 -j DROP
-A FORWARD -p ! ARP -i srlab-r12 -o srlab-r3 -j DROP
-A FORWARD -i srlab-r4 -j ACCEPT
-A OUTPUT -p ! ARP -o srlab-r1 -j DROP
"""


def test_the_bridges_rules_say_who_is_cut_off() -> None:
    found = partition.parse(Site(), SAVED)
    assert found == {*partition.rules(Site(), "robot1", "all"), *partition.rules(Site(), "robot3", "robot12")}
    cut_off = {name: partition.cut_off(Site(), name, found) for name in ("robot1", "robot2", "robot3", "robot12")}
    assert cut_off == {"robot1": ["all"], "robot2": [], "robot3": ["robot12"], "robot12": ["robot3"]}
    both = {*partition.rules(Site(), "robot1", "controller"), *partition.rules(Site(), "robot1", "robot2")}
    assert partition.cut_off(Site(), "robot1", both) == ["controller", "robot2"]


@contextlib.asynccontextmanager
async def proxy(
    serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]],
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A server behind a proxy, and a connection to it."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    running = asyncio.ensure_future(delay.serve("127.0.0.1", port, server.sockets[0].getsockname()[1], TO_S, FROM_S))
    until = time.monotonic() + 5
    while True:
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            break
        except ConnectionRefusedError:
            assert time.monotonic() < until
            await asyncio.sleep(0.01)
    yield reader, writer
    writer.close()
    running.cancel()
    server.close()


def test_the_proxy_is_late_by_two_round_trips_and_then_by_one() -> None:
    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"hello\n")
        while line := await reader.readline():
            writer.write(line)
        writer.write(b"bye\n")
        writer.close()

    async def talk() -> list[float]:
        async with proxy(echo) as (reader, writer):
            times = [time.monotonic()]
            for said, wanted in ((b"", b"hello\n"), (b"one\n", b"one\n")):
                writer.write(said)
                assert await reader.readline() == wanted
                times.append(time.monotonic())
            writer.write_eof()
            assert await reader.read() == b"bye\n"
            return [*times, time.monotonic()]

    talks = [asyncio.run(asyncio.wait_for(talk(), 10)) for _ in range(3)]
    waited = [[after - before for before, after in itertools.pairwise(times)] for times in talks]
    # a busy machine makes any of them longer
    assert [min(some) for some in zip(*waited, strict=True)] == pytest.approx([2 * RTT_S, RTT_S, RTT_S], abs=0.1)


def test_the_proxy_is_late_by_different_times_there_and_back() -> None:
    async def tell(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await reader.readline():
            writer.write(f"{time.monotonic()}\n".encode())

    async def talk() -> list[tuple[float, float]]:
        async with proxy(tell) as (reader, writer):
            times = []
            for _ in range(5):  # the first waits for the handshake, too
                asked = time.monotonic()
                writer.write(b"when\n")
                there = float(await reader.readline())
                times.append((there - asked, time.monotonic() - there))
            return times

    times = asyncio.run(asyncio.wait_for(talk(), 20))
    assert tuple(map(min, zip(*times, strict=True))) == pytest.approx((TO_S, FROM_S), abs=0.04)


def test_the_proxy_delays_but_does_not_slow_down() -> None:
    size = 8_000_000

    async def flood(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(bytes(range(250)) * (size // 250))
        writer.close()

    async def receive() -> tuple[bytes, float]:
        begun = time.monotonic()
        async with proxy(flood) as (reader, _):
            return await reader.read(), time.monotonic() - begun

    data, seconds = asyncio.run(asyncio.wait_for(receive(), 10))
    assert data == bytes(range(250)) * (size // 250)
    assert seconds < 2 * RTT_S + 6


def test_the_proxy_resets_where_nobody_serves() -> None:
    async def refuse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.transport.abort()

    async def receive() -> bytes:
        async with proxy(refuse) as (reader, writer):
            writer.write(b"x" * 1000)
            with contextlib.suppress(ConnectionResetError):
                return await reader.read()
            return b""

    assert asyncio.run(asyncio.wait_for(receive(), 10)) == b""


def test_a_limit_of_cpus_is_what_the_kernel_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, other = (tmp_path / name for name in ("cpu", "unified", "memory"))
    for folder in (first, second, other):
        folder.mkdir()
    for name in ("cpu.cfs_quota_us", "cpu.cfs_period_us"):
        (first / name).write_text("-1")
    (second / "cpu.max").write_text("max 100000")
    monkeypatch.setattr(cgroups, "version", lambda: 1)
    cgroups.limit_cpus([other, first], 0.5)
    assert [(first / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period")] == ["50000", "100000"]
    monkeypatch.setattr(cgroups, "version", lambda: 2)
    cgroups.limit_cpus([second], 1.5)
    assert (second / "cpu.max").read_text() == "150000 100000"
    with pytest.raises(LabError, match="cannot limit"):
        cgroups.limit_cpus([other], 1)
