"""Ctrl-C and SIGTERM while robots are asked: nobody waits for a robot that does not answer."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def silent(tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    """Return an inventory with a robot that accepts connections and says nothing, and its socket."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(30)
        path = tmp_path / "silent.yml"
        host = f"{{ansible_host: 127.0.0.1, ansible_port: {server.getsockname()[1]}}}"
        path.write_text(f"all: {{hosts: {{r1: {host}}}}}\n", encoding="utf-8")
        yield str(path), server


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("verb", ["facts", "locks", "status"])
def test_an_interrupt_does_not_wait_for_a_silent_robot(
    silent: tuple[str, socket.socket], verb: str, number: signal.Signals
) -> None:
    """Exit 130 with one word and no traceback, within moments, although the robot has a minute to answer."""
    inventory, server = silent
    run = subprocess.Popen(
        [sys.executable, "-m", "srprov", verb, "-i", inventory, "--timeout", "60"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    connection, _ = server.accept()
    time.sleep(0.3)
    begun = time.monotonic()
    run.send_signal(number)
    out, err = run.communicate(timeout=60)
    connection.close()
    assert time.monotonic() - begun < 10
    assert (run.returncode, out, err.strip()) == (130, "", "interrupted")


def test_a_signal_in_the_middle_of_a_wait_hangs_nobody() -> None:
    """`Event.wait` holds the event's lock for a moment; a handler that sets the event there would wait for itself."""
    script = """
import os, signal, threading
from srprov.cli.interrupt import soft_interrupt
stop = threading.Event()
with soft_interrupt(stop):
    with stop._cond:
        os.kill(os.getpid(), signal.SIGINT)
    assert stop.wait(5)
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        print("left")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=30)
    assert (done.returncode, done.stdout) == (0, "left\n"), done.stderr


@pytest.mark.parametrize(("body", "out"), [("return 'released'", "released\nleft\n"), ("while True: pass", "left\n")])
def test_a_signal_in_a_line_of_paramiko_waits_for_its_lock(body: str, out: str) -> None:
    """Between the line that takes a lock and the `try` below it; whoever closed the channel then hung for ever."""
    code = f"def read():\n    os.kill(os.getpid(), signal.SIGINT)\n    {body}"
    script = f"""
import os, signal, time
from srprov.cli.interrupt import as_interrupt
as_interrupt()
exec(compile({code!r}, "/lib/paramiko/buffered_pipe.py", "exec"))
try:
    print(read())
    time.sleep(20)
except KeyboardInterrupt:
    print("left")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=15)
    assert (done.returncode, done.stdout) == (0, out), done.stderr


def test_a_signal_in_a_destructor_is_not_lost() -> None:
    """Python prints what is raised there, and goes on: Ctrl-C would have done nothing."""
    script = """
import os, signal, time
from srprov.cli.interrupt import as_interrupt
as_interrupt()
class Held:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.3)
class Wrong:
    def __del__(self):
        1 / 0
Wrong()
try:
    Held()
    for _ in range(100):
        time.sleep(0.1)
except KeyboardInterrupt:
    print("left")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=30)
    assert (done.returncode, done.stdout) == (0, "left\n"), done.stderr
    assert "ZeroDivisionError" in done.stderr and "KeyboardInterrupt" not in done.stderr


def test_a_signal_in_the_middle_of_an_import_waits_for_its_end(tmp_path: Path) -> None:
    """An import that is left in its middle leaves importlib's lock held, and whoever imports next waits for ever."""
    lines = "import os, signal, time", "os.kill(os.getpid(), signal.SIGTERM)", "time.sleep(0.3)", "print('imported')"
    code = "\n".join(lines)
    (tmp_path / "slow.py").write_text(code)
    script = """
import sys, time
from srprov.cli.interrupt import as_interrupt
as_interrupt()
try:
    import slow
    time.sleep(20)
except KeyboardInterrupt:
    print("left")
"""
    env = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=15, env=env
    )
    assert (done.returncode, done.stdout) == (0, "imported\nleft\n"), done.stderr


def test_a_signal_that_another_thread_receives_wakes_the_main_thread() -> None:
    """It is the same as one that comes just before the main thread sleeps: nothing interrupts its wait."""
    script = """
import signal, threading, time
from srprov.cli.interrupt import as_interrupt, soft_interrupt
as_interrupt()
stop = threading.Event()
def receive():
    time.sleep(0.3)
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
    time.sleep(20)
threading.Thread(target=receive, daemon=True).start()
with soft_interrupt(stop):
    print("stopped" if stop.wait(10) else "nobody noticed", flush=True)
threading.Thread(target=receive, daemon=True).start()
try:
    time.sleep(10)
except KeyboardInterrupt:
    print("left")
"""
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=30)
    assert (done.returncode, done.stdout) == (0, "stopped\nleft\n"), done.stderr
    assert time.monotonic() - begun < 8
