"""An experiment in a folder, and robots in memory that are the same in each run of a test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from srprov.controller import probe
from srprov.transport import pool
from tests.fakes import World
from tests.unit.cli import faked

CDF = "cdf: 1\nbase: busybox\nrun: ['echo {word} > /word']\n"
EDF = """\
edf: 1
name: demo
secrets: {key: {env: NOT_SET}}
services:
  a: {cdf: a.cdf, robot: r1, volumes: ["log:/log"]}
  b: {cdf: a.cdf, robot: r2, secrets: [key]}
  c: {image: "alpine:3", robot: r1}
placement: {slots_per_robot: 2}
"""


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "a.cdf").write_text(CDF.format(word="one"))
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}}}\n")
    monkeypatch.chdir(tmp_path)
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home"))
    monkeypatch.delenv("SRPROV_RUNS", raising=False)  # the lab's tests set it for all that they start
    world = World()

    class Sessions(faked.FakeSessions):
        """The same robots in each run of a test."""

        def __init__(self, hosts: Any, *, options: Any, **_more: Any) -> None:
            world.vault = options.vault
            world.add(*(name for name in hosts if name not in world.robots))

    monkeypatch.setattr(faked, "WORLD", world)
    monkeypatch.setattr(pool, "Sessions", Sessions)
    monkeypatch.setattr(probe, "probing_of", faked.nothing_to_try)
    return world
