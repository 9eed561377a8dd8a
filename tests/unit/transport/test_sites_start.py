"""Sites before they can be used: who waits for a cluster has a deadline, may be interrupted, and is told the reason."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.errors import UsageError
from srprov.transport.sites import settings
from srprov.transport.sites.cluster import Cluster as Client
from srprov.transport.workers.program import SiteError
from tests.clusters import Cluster, certificates, cluster

AWAY = "tls://127.0.0.1:9"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Give a cluster with one site."""
    with cluster(tmp_path_factory.mktemp("cluster")) as running:
        running.start_scheduler()
        running.start_worker("west")
        yield running


@contextlib.contextmanager
def silent() -> Iterator[socket.socket]:
    """Give a listener that accepts nobody and says nothing."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(8)
        listener.settimeout(60)
        yield listener


def worker(made: Cluster, scheduler: str, **env: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "srprov", "worker", "--site", "north", "--engine", scheduler]
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env={**os.environ, **made.env, **env}
    )


def test_a_scheduler_that_stops_answering_is_waited_for_with_a_deadline(made: Cluster) -> None:
    assert made.scheduler is not None
    with made.member():
        client = Client(made.address, 3.0)
        client.start("west").kill()
        made.scheduler.send_signal(signal.SIGSTOP)
        failed: list[BaseException] = []

        def start() -> None:
            try:
                client.start("east")
            except BaseException as error:
                failed.append(error)

        waiting = threading.Thread(target=start, daemon=True)
        try:
            waiting.start()
            waiting.join(30)
        finally:
            made.scheduler.send_signal(signal.SIGCONT)
            client.close()
    assert [type(one) for one in failed] == [SiteError] and "cannot be reached" in str(failed[0])


def test_a_scheduler_that_says_nothing_behind_its_certificate_is_waited_for_with_a_deadline(
    made: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dask itself waits without end for what comes after the connection, and so did all robots."""
    monkeypatch.setattr("srprov.transport.sites.cluster._LATE_S", 0.5)
    key = "DASK_DISTRIBUTED__COMM__TLS__SCHEDULER__"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(made.env[f"{key}CERT"], made.env[f"{key}KEY"])

    def serve() -> None:
        with contextlib.suppress(OSError):
            kept = []
            while True:
                kept.append(context.wrap_socket(listener.accept()[0], server_side=True))

    with made.member(), silent() as listener:
        threading.Thread(target=serve, daemon=True).start()
        client, begin = Client(f"tls://127.0.0.1:{listener.getsockname()[1]}", 2.0), time.monotonic()
        failed: list[BaseException] = []

        def start() -> None:
            try:
                client.start("west")
            except SiteError as error:
                failed.append(error)

        starting = threading.Thread(target=start, daemon=True)
        starting.start()
        starting.join(30)
        assert failed and "cannot be reached: no answer within 2 s" in str(failed[0])
        assert time.monotonic() - begin < 20
        client.close()


def test_a_scheduler_that_is_not_there_costs_one_timeout_and_not_one_for_each_site(
    made: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    import distributed

    tries: list[str] = []

    def connect(address: str, **_more: object) -> None:
        tries.append(address)
        raise OSError("nobody is there")

    with made.member():
        client = Client(AWAY, 3.0)
        monkeypatch.setattr(distributed, "Client", connect)
        for site in ("west", "east"):
            with pytest.raises(SiteError, match="nobody is there"):
                client.start(site)
        client.close()
    assert tries == [AWAY]


def test_the_end_does_not_wait_for_a_scheduler_that_has_not_answered_yet(
    made: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C comes at any moment; a connection that is made afterwards is ended by who made it."""
    import distributed

    begun, go_on, ended = threading.Event(), threading.Event(), threading.Event()

    class Late:
        def __init__(self, *_words: object, **_more: object) -> None:
            begun.set()
            go_on.wait(60)

        def close(self, **_more: object) -> None:
            ended.set()

    def start() -> None:
        with contextlib.suppress(SiteError):
            client.start("west")

    with made.member():
        client = Client(AWAY, 60.0)
        monkeypatch.setattr(distributed, "Client", Late)
        threading.Thread(target=start, daemon=True).start()
        assert begun.wait(30)
        closing = threading.Thread(target=client.close, daemon=True)
        closing.start()
        closing.join(10)
        waited = closing.is_alive()
        go_on.set()
        assert not waited and ended.wait(30)
        with pytest.raises(SiteError, match="were closed"):
            client.start("west")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_worker_that_waits_for_its_scheduler_ends_when_it_is_told_to(made: Cluster, number: int) -> None:
    with silent() as listener:
        process = worker(made, f"tls://127.0.0.1:{listener.getsockname()[1]}")
        with process, listener.accept()[0]:
            begun = time.monotonic()
            process.send_signal(number)
            assert process.wait(60) == 0 and time.monotonic() - begun < 10


def test_a_worker_says_why_its_scheduler_does_not_take_it(made: Cluster, tmp_path: Path) -> None:
    """And does so at once when waiting cannot help."""
    with worker(made, made.address, **certificates(tmp_path / "tls")) as process:
        _, said = process.communicate(timeout=60)
    assert process.returncode == 4 and re.search(r"cannot be reached: .*certificate", said), said


@pytest.mark.parametrize("words", [["--port", ""], ["--host", "192.0.2.1"], ["--host", "none.invalid"]])
def test_a_worker_that_cannot_listen_does_not_blame_the_scheduler(made: Cluster, words: list[str]) -> None:
    with silent() as listener:
        given = [word or str(listener.getsockname()[1]) for word in words]
        with pytest.raises(AssertionError, match="cannot listen at"):
            made.start_worker("north", *given)
    assert made.workers["north"].wait(30) == 5


def test_a_key_of_another_certificate_is_told_before_anything_is_reached(made: Cluster, tmp_path: Path) -> None:
    import dask

    certificates(tmp_path / "tls")
    key = {"distributed.comm.tls.client.key": f"{tmp_path}/tls/key.pem"}
    with made.member(), dask.config.set(key), pytest.raises(UsageError, match="cannot be used") as wrong:
        settings.security("client")
    assert f"{tmp_path}/tls/key.pem" in wrong.value.hint


@pytest.mark.parametrize("text", ["distributed: {comm: [", "hello"])
def test_a_configuration_that_cannot_be_read_is_no_bug(made: Cluster, tmp_path: Path, text: str) -> None:
    (tmp_path / "distributed.yaml").write_text(text)
    with worker(made, AWAY, DASK_CONFIG=str(tmp_path)) as process:
        _, said = process.communicate(timeout=60)
    assert process.returncode == 5 and f"{tmp_path}/distributed.yaml" in said, said


def test_reasons_have_no_objects_of_python_in_them() -> None:
    error = OSError("late")
    error.__cause__ = OSError("in <TLSConnector object at 0x7f>: OSError: refused")
    assert settings.reason(error) == "OSError: refused"
