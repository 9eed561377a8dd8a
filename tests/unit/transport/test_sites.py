"""Sites: a real scheduler and real workers over TLS on loopback; robots there are sessions as any other."""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov import datasets
from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError, RefusedError, TransportError, UsageError
from srprov.secret import Secret, Vault, forget
from srprov.session import Pulse
from srprov.transport import ConnectOptions
from srprov.transport.blobs import Blobs
from srprov.transport.pool import Sessions
from srprov.transport.sites import settings
from srprov.transport.turns import OwnTurns
from srprov.transport.workers import home_files
from srprov.transport.workers.far_session import FarSession
from srprov.transport.workers.home import Home
from srprov.transport.workers.home_files import LinkedFiles
from srprov.transport.workers.processes import Workers
from srprov.wire import Put, Query, Run, SendData
from tests.clusters import Cluster, cluster
from tests.unit.transport.test_workers import LOCK
from tests.unit.transport.waiting import wait_until

CANARY = "canary-7c20aa-mackerel"
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, as a robot's shell is root's")


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Give a cluster with a worker at two sites; those who end them use one of their own."""
    with cluster(tmp_path_factory.mktemp("cluster")) as made:
        made.start_scheduler()
        made.start_worker("west")
        made.start_worker("east")
        yield made


@pytest.fixture(autouse=True)
def _member(request: pytest.FixtureRequest) -> Iterator[None]:
    forget()
    used = "running" in request.fixturenames
    with request.getfixturevalue("running").member() if used else contextlib.nullcontext():
        yield
    forget()


def local(**sites: str) -> dict[str, Host]:
    """Return robots that are this machine, or that of a site's worker."""
    return {name: Host(name=name, address=name, connection="local", site=site) for name, site in sites.items()}


@contextlib.contextmanager
def reached(made: Cluster, hosts: dict[str, Host], **more: Any) -> Iterator[Sessions]:
    options = ConnectOptions(connect_timeout_s=20, warm_engine=False, vault=more.pop("vault", None) or Vault())
    with Sessions(hosts, options=options, scheduler=made.address, **more) as sessions:
        yield sessions


def parent(sessions: Sessions, name: str) -> int:
    """Return the process that has a robot's shell."""
    return int(sessions.get(name).ask([Query(command="echo $PPID")])[0].out)


def grandparent(sessions: Sessions, name: str) -> int:
    stat = Path(f"/proc/{parent(sessions, name)}/stat").read_text()
    return int(stat.rpartition(")")[2].split()[1])


@as_root
def test_a_robot_is_reached_by_the_worker_of_its_site_and_by_nobody_else(running: Cluster) -> None:
    """Those without a site by this process, or by its own workers; what they answer is the same."""
    hosts = local(a="west", b="west", c="east", d="")
    for workers in (1, 2):
        with reached(running, hosts, workers=workers) as sessions:
            assert sessions.failures() == {}
            assert grandparent(sessions, "a") == running.workers["west"].pid
            assert grandparent(sessions, "c") == running.workers["east"].pid
            assert parent(sessions, "a") == parent(sessions, "b") != parent(sessions, "c")
            assert (parent(sessions, "d") == os.getpid()) == (workers == 1)
            asked = [Query(command="printf 'a\\377b'; echo err >&2; exit 3")]
            assert len({str(sessions.get(name).ask(asked)) for name in hosts}) == 1
            said: list[str] = []
            assert sessions.get("a").execute(Run(script="for i in $(seq 300); do echo $i; done"), said.append).ok
            assert said == [str(number) for number in range(1, 301)]


def test_a_site_gets_what_a_robot_without_one_has() -> None:
    """An image from the robot on this desk for one at a site, when this process alone has the former."""
    hosts = {name: Host(name=name, address=name, site=site) for name, site in {"a": "west", "d": ""}.items()}

    class Starter:
        def start(self, site: str) -> Any: ...

        def close(self) -> None: ...

    session: Any = object()
    workers = Workers(hosts, ConnectOptions(), lambda _host: session, count=0, sites=Starter())
    home = workers._home("west", OwnTurns())
    assert home.peer("d") is session and home.peer("a") is None


@as_root
def test_without_a_scheduler_robots_at_sites_are_reached_from_here() -> None:
    with Sessions(local(a="west"), options=ConnectOptions(warm_engine=False)) as sessions:
        assert parent(sessions, "a") == os.getpid()


@as_root
def test_a_site_without_a_worker_costs_its_own_robots(running: Cluster) -> None:
    with reached(running, local(a="west", b="north", c="")) as sessions:
        (failure,) = sessions.failures().values()
        assert isinstance(failure, ConnectError) and failure.host == "b" and failure.code == Code.SITE
        assert "no worker of site north" in failure.message and "sites with one: east, west" in failure.message
        assert f"srprov worker --site north --engine {running.address}" in failure.hint
        assert sessions.get("a").ask([Query(command="echo up")])[0].out == "up\n"


def test_a_scheduler_that_is_not_there_is_named(running: Cluster) -> None:
    options = ConnectOptions(connect_timeout_s=2)
    with Sessions(local(a="west", b="east"), options=options, scheduler="tls://127.0.0.1:9") as sessions:
        failures = sessions.failures()
    assert sorted(failures) == ["a", "b"]
    assert all("tls://127.0.0.1:9 cannot be reached" in one.message for one in failures.values())


@pytest.mark.parametrize("address", ["tcp://10.0.0.2:8786", "ws://x:1", "http://x:1", "ucx://x:1"])
def test_a_scheduler_without_tls_is_refused(address: str) -> None:
    with pytest.raises(RefusedError, match="only tls:// is spoken"):
        settings.checked_address(address)


@pytest.mark.parametrize(
    "address", ["tls://", "tls://x", "tls://x:y", "tls://x:1/path", "tls://u@x:1", "tls://x:99999"]
)
def test_what_is_no_address_is_told(address: str) -> None:
    with pytest.raises(UsageError, match="no address of a scheduler"):
        settings.checked_address(address)


@pytest.mark.parametrize(("path", "words"), [(None, "is not set"), ("/none.pem", "is no file: /none.pem")])
def test_certificates_that_are_missing_are_named(running: Cluster, path: str | None, words: str) -> None:
    import dask

    with dask.config.set({"distributed.comm.tls.client.cert": path}), pytest.raises(UsageError) as missing:
        settings.security("client")
    assert "distributed.comm.tls.client.cert" in missing.value.message and words in missing.value.message
    assert "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT" in missing.value.hint


def test_who_has_certificates_of_somebody_else_reaches_nobody(running: Cluster, tmp_path: Path) -> None:
    with cluster(tmp_path) as other, other.member():
        options = ConnectOptions(connect_timeout_s=3)
        with Sessions(local(a="west"), options=options, scheduler=running.address) as sessions:
            assert list(sessions.failures()) == ["a"]


@as_root
def test_a_site_with_another_srprov_is_not_used(running: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "program_digest", lambda: "0" * 64)
    with reached(running, local(a="west")) as sessions:
        (failure,) = sessions.failures().values()
    assert "another version of srprov" in failure.message and "install the same" in failure.hint


@as_root
def test_a_secret_gets_to_its_robot_and_into_no_state_of_the_cluster(running: Cluster, tmp_path: Path) -> None:
    """Nor into what scheduler and workers log; the scheduler does not even carry it."""
    import distributed

    vault = Vault({"key": Secret(CANARY)})
    target = Path("/dev/shm") / f"srprov-{os.getpid()}"  # a file of secrets has to be in memory
    with reached(running, local(a="west"), vault=vault) as sessions:
        assert sessions.get("a").execute(Put(path=str(target), secret="key", mode=0o600)).ok
        assert target.read_text() == CANARY
        target.unlink()
        with distributed.Client(running.address, security=settings.security("client"), set_as_default=False) as client:
            client.dump_cluster_state(str(tmp_path / "dump"), format="yaml")
            client.dump_cluster_state(str(tmp_path / "dump2"))
        dumps = [path.read_bytes() for path in tmp_path.glob("dump*")]
        assert len(dumps) == 2 and all(len(one) > 1000 for one in dumps)
        assert b"srprov-west-" in dumps[0], "the actor is in it"
        for process in (running.scheduler, running.workers["west"], running.workers["east"]):
            assert process is not None and CANARY.encode() not in memory(process.pid), "not in its memory either"
    said = "".join(running.said(name) for name in ("scheduler", "west", "east"))
    assert CANARY.encode() not in b"".join(dumps) and CANARY not in said


def memory(pid: int) -> bytes:
    """Return the command line and environment of a process, which others of its user can read."""
    return b"".join(Path(f"/proc/{pid}/{name}").read_bytes() for name in ("cmdline", "environ"))


@as_root
def test_a_killed_worker_costs_its_own_robots_and_locks_end(tmp_path: Path) -> None:
    """Whoever waits is told; what ran there ends; nothing is begun a second time; the other site goes on."""
    with cluster(tmp_path) as made:
        made.start_scheduler()
        for site in ("west", "east"):
            made.start_worker(site)
        with made.member(), reached(made, local(a="west", b="east")) as sessions:
            channel = sessions.get("a").open_lock_channel(LOCK, [], Pulse(beat_s=1, controller_s=20, robot_s=30))
            assert channel.first_answer.startswith("locked")
            process = parent(sessions, "a")
            begun = threading.Timer(0.5, made.kill, ["west"])
            begun.start()
            with pytest.raises(TransportError, match="the worker of site west") as lost:
                sessions.get("a").execute(Run(script=f"echo $$ >>{tmp_path}/pids; sleep 300", timeout_s=400))
            assert lost.value.code == Code.LOST
            assert sessions.get("b").ask([Query(command="echo up")])[0].out == "up\n"
            wait_until(lambda: not Path(f"/proc/{process}").exists(), "the process to end with its worker", 20)
            (shell,) = (tmp_path / "pids").read_text().split()
            wait_until(lambda: not Path(f"/proc/{shell}").exists(), "what ran there to end", 40)


@as_root
def test_without_its_scheduler_a_site_is_lost_and_says_so(tmp_path: Path) -> None:
    """A worker whose scheduler is gone ends with 4; whoever watches over it starts it again."""
    with cluster(tmp_path) as made:
        made.start_scheduler()
        made.start_worker("west")
        with made.member(), reached(made, local(a="west", b="")) as sessions:
            assert sessions.get("a").ask([Query(command="echo up")])[0].out == "up\n"
            made.kill("scheduler")
            assert made.workers["west"].wait(60) == 4
            with pytest.raises(TransportError):
                sessions.get("a").ask([Query(command="echo up")])
            assert sessions.get("b").ask([Query(command="echo up")])[0].out == "up\n"
        assert "cannot be reached" in made.said("west")


CHILD = """
import sys, time
from srprov.definitions.model import Host
from srprov.transport import ConnectOptions
from srprov.transport.pool import Sessions
from srprov.wire import Query
robot = {"a": Host(name="a", address="a", connection="local", site="west")}
with Sessions(robot, options=ConnectOptions(warm_engine=False), scheduler=sys.argv[1]) as sessions:
    print(sessions.get("a").ask([Query(command="echo $PPID")])[0].out, flush=True)
    time.sleep(600)
"""


@as_root
@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.soak)])
def test_a_srprov_that_vanishes_leaves_nothing_at_the_site(running: Cluster, number: int) -> None:
    """One that was killed is missed at once, one that is cut off or stopped after half a minute."""
    words = [sys.executable, "-c", CHILD, running.address]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env={**os.environ, **running.env}) as child:
        assert child.stdout is not None
        process = int(child.stdout.readline())
        assert Path(f"/proc/{process}").exists()
        child.send_signal(number)
        wait_until(lambda: not Path(f"/proc/{process}").exists(), "the process to end by itself", 60)
        child.kill()


@as_root
def test_a_data_set_of_this_machine_gets_to_a_site_once(
    running: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And one that this run has no right to is not taken from what the site keeps."""
    asked: list[SendData] = []
    content = os.urandom(300_000)
    (tmp_path / "data").write_bytes(content)
    sha256, _ = datasets.digest(str(tmp_path / "data"))

    class Link:
        def call(self, _target: int, method: str, *words: Any) -> Any:
            assert method == "data_set"
            asked.append(words[0])
            return None

    given: list[int] = []

    class Pieces:
        def __init__(self, *_words: object) -> None: ...

        def __iter__(self) -> Iterator[bytes]:
            if asked[-1].timeout_s == 1:
                raise ValueError("no file here is known to have this hash")
            for start in range(0, len(content), 65_536):
                given.append(start)
                yield content[start : start + 65_536]

    monkeypatch.setattr(home_files, "FarItems", Pieces)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "site"))
    files = LinkedFiles(Link(), None, OwnTurns())  # type: ignore[arg-type]
    assert files.data_set(SendData(sha256=sha256)).read_bytes() == content and len(given) == 5
    assert files.data_set(SendData(sha256=sha256)).read_bytes() == content and len(given) == 6
    with pytest.raises(ValueError, match="no file here"):
        files.data_set(SendData(sha256=sha256, timeout_s=1))


def test_a_layer_of_this_machine_s_cache_is_in_the_site_s_then(tmp_path: Path) -> None:
    """Compressed as it is; one that is not there is nobody's error, one that is changed on the way is."""
    from srprov.transport.image_source import ImageSources

    here, site = Blobs(tmp_path / "here"), Blobs(tmp_path / "site")
    content = os.urandom(200_000)
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    sent = here.add_content(digest, [content])
    home = Home(lambda _host: None, bool, OwnTurns(), ConnectOptions(image_sources=ImageSources(here)))  # type: ignore[arg-type,return-value]
    pieces: list[bytes] = []

    class Link:
        def call(self, _target: int, method: str, *words: Any) -> Any:
            found = getattr(home, method)(*words)
            pieces[:] = [] if found is None else list(found)
            return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(home_files, "FarItems", lambda _link, _handle: list(pieces))
        files = LinkedFiles(Link(), site, OwnTurns())  # type: ignore[arg-type]
        got = files.layer(digest)
        assert got is not None and got.path.read_bytes() == sent.path.read_bytes() == b"".join(pieces)
        assert files.layer("sha256:" + "0" * 64) is None
        patch.setattr(home_files, "FarItems", lambda _link, _handle: [b"".join(pieces)[:-1] + b"x"])
        with pytest.raises(OSError, match="sha256"):
            files.layer(digest)


@as_root
def test_a_run_that_ends_leaves_no_process_at_the_site(running: Cluster) -> None:
    with reached(running, local(a="west")) as sessions:
        process = parent(sessions, "a")
        assert isinstance(sessions.get("a"), FarSession)
    wait_until(lambda: not Path(f"/proc/{process}").exists(), "the process to end with the run", 20)


def test_a_second_worker_of_a_site_is_refused_and_the_end_is_clean(running: Cluster, tmp_path: Path) -> None:
    with cluster(tmp_path) as other:
        other.address, other.env = running.address, running.env
        other.start_worker("north")
        other.kill("north", signal.SIGTERM)
        assert other.workers["north"].returncode == 0
        with pytest.raises(AssertionError, match="is connected to tls"):
            other.start_worker("west")
        assert other.workers["west"].wait(30) == 9
