"""A Dask cluster of one's own for a test: certificates, a scheduler, and workers of sites, each a process."""

from __future__ import annotations

import contextlib
import datetime
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

START_S = 60.0


def certificates(folder: Path) -> dict[str, str]:
    """Write an authority and one certificate of it; return the variables that tell Dask of them."""
    authority, key = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    made = {
        "ca": _certificate("authority", authority, authority, is_authority=True),
        "cert": _certificate("member", key, authority, is_authority=False),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in made.items():
        (folder / f"{name}.pem").write_bytes(one.public_bytes(serialization.Encoding.PEM))
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    (folder / "key.pem").write_bytes(key.private_bytes(*form))
    (folder / "key.pem").chmod(0o600)
    told = {"DASK_DISTRIBUTED__COMM__TLS__CA_FILE": f"{folder}/ca.pem"}
    for role in ("CLIENT", "WORKER", "SCHEDULER"):
        for word in ("cert", "key"):
            told[f"DASK_DISTRIBUTED__COMM__TLS__{role}__{word.upper()}"] = f"{folder}/{word}.pem"
    return told


def _certificate(
    name: str, key: ec.EllipticCurvePrivateKey, authority: ec.EllipticCurvePrivateKey, *, is_authority: bool
) -> x509.Certificate:
    def called(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    now = datetime.datetime.now(datetime.timezone.utc)
    return (
        x509.CertificateBuilder()
        .subject_name(called(name))
        .issuer_name(called("authority"))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=7))
        .add_extension(x509.BasicConstraints(ca=is_authority, path_length=None), critical=True)
        .sign(authority, hashes.SHA256())
    )


@dataclass
class Cluster:
    """Processes of a cluster; `env` is what everybody needs who speaks to it."""

    folder: Path
    env: Mapping[str, str]
    address: str = ""
    scheduler: subprocess.Popen[bytes] | None = None
    workers: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start_scheduler(self, host: str = "127.0.0.1", inside: Sequence[str] = ()) -> None:
        """Start the scheduler, where it was before if there was one.

        Args:
            host: Where it listens.
            inside: Words before its command, such as those of a network namespace.
        """
        port = self.address.rpartition(":")[2] or "0"
        words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--protocol", "tls", "--host", host]
        self.scheduler = self._start("scheduler", [*inside, *words, "--port", port, "--no-dashboard"])
        self.address = self._said("scheduler", r"Scheduler at: +(tls://\S+)")

    def start_worker(
        self, site: str, *more: str, inside: Sequence[str] = (), env: Mapping[str, str] | None = None
    ) -> str:
        """Start a site's worker by `srprov worker`; return its address."""
        words = [*inside, sys.executable, "-m", "srprov", "worker", "--site", site, "--engine", self.address, *more]
        self.workers[site] = self._start(site, words, env)
        return self._said(site, r"serving at (tls://[^;]+);")

    def said(self, name: str) -> str:
        """Return what a process has said so far."""
        return (self.folder / f"{name}.log").read_text()

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to the scheduler or a site's worker, and wait for its end."""
        process = self.scheduler if name == "scheduler" else self.workers[name]
        assert process is not None
        process.send_signal(number)
        process.wait(60)

    @contextlib.contextmanager
    def member(self) -> Iterator[None]:
        """Let this process be one of the cluster, as `env` does for those that start."""
        import dask
        import distributed  # whose defaults must be there before something is set

        assert distributed
        folder = self.folder / "tls"
        words = {f"client.{word}": f"{folder}/{word}.pem" for word in ("cert", "key")} | {"ca-file": f"{folder}/ca.pem"}
        with dask.config.set({f"distributed.comm.tls.{name}": value for name, value in words.items()}):
            yield

    def stop(self) -> None:
        """End everything."""
        for process in (*self.workers.values(), self.scheduler):
            if process is not None and process.poll() is None:
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(20)
                process.kill()
                process.wait(20)

    def _start(self, name: str, words: Sequence[str], env: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env={**os.environ, **self.env, **(env or {})},
                start_new_session=True,
            )  # fmt: skip

    def _said(self, name: str, pattern: str) -> str:
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            process = self.scheduler if name == "scheduler" else self.workers[name]
            ended = process is not None and process.poll() is not None
            if match := re.search(pattern, self.said(name)):
                return match[1]
            if ended:
                break
            time.sleep(0.1)
        raise AssertionError(f"{name} did not start: {self.said(name)}")


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """Give a cluster without processes, which end with the block."""
    made = Cluster(folder, certificates(folder / "tls"))
    try:
        yield made
    finally:
        made.stop()
