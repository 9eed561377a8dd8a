"""A robot that does not answer is named while it is waited for."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any, cast

import pytest

from srprov.cli import inputs
from srprov.cli.main import run
from srprov.definitions.model import Host
from srprov.transport import ConnectOptions, pool
from tests.fakes import World
from tests.unit.cli import faked


def test_robots_that_are_late_are_named(
    world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Unless there is none, or the user wants it quiet."""
    late: list[str] = []
    looked = threading.Event()

    def awaited(_self: faked.FakeSessions) -> list[str]:
        looked.set()
        return late

    def told(*words: str) -> str:
        looked.clear()
        assert run(["restart", "e.edf", "-i", "inv.yml", "--instance", "x", "a", "--yes", *words]) == 5
        return capsys.readouterr().err

    gathered = faked.FakeSessions.get

    def slow(self: faked.FakeSessions, host: str) -> Any:
        looked.wait(0.3)
        return gathered(self, host)

    monkeypatch.setattr(inputs, "_LATE_S", 0.01)
    monkeypatch.setattr(faked.FakeSessions, "awaited", awaited)
    monkeypatch.setattr(faked.FakeSessions, "get", slow)
    assert "waiting" not in told()
    late += [f"r{number}" for number in range(1, 11)]
    assert "waiting for r1, r2, r3, r4, r5, r6, r7, r8 and 2 more: no answer yet; --timeout is 10 s\n" in told()
    assert "waiting" not in told("--quiet")


def test_who_is_connected_or_has_failed_is_not_awaited(monkeypatch: pytest.MonkeyPatch) -> None:
    go = threading.Event()

    def connect(host: Host, **_options: object) -> object:
        if host.name == "slow":
            go.wait(10)
        return SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(pool, "connect", connect)
    hosts = {name: Host(name=name, address="192.0.2.1") for name in ("fast", "slow")}
    with pool.Sessions(hosts, options=ConnectOptions()) as sessions:
        assert sessions.get("fast") is not None
        assert sessions.awaited() == ["slow"]
        go.set()
        assert sessions.get("slow") is not None
        assert sessions.awaited() == cast("list[str]", [])
