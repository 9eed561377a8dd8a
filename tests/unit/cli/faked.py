"""`srprov` as a program of its own, with robots in memory: `python -m tests.unit.cli.faked VERB …`.

Every robot of the inventory is a fake one. What runs on them in the end is written to the file that FAKED_STATE names;
FAKED_FAULT is the number of the command that a robot refuses.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

from srprov.cli.main import entry
from srprov.controller import probe
from srprov.transport import pool
from tests.fakes import FakeRobot, Fault, World

WORLD = World()


class FakeSessions:
    """The robots of an inventory, in memory; all of them can be reached."""

    def __init__(self, hosts: Any, **_options: Any) -> None:
        WORLD.add(*hosts)

    def __enter__(self) -> FakeSessions:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        pass

    def get(self, host: str) -> FakeRobot:
        return WORLD.reader(host)

    def awaited(self) -> list[str]:
        return []

    def connected(self) -> dict[str, FakeRobot]:
        return WORLD.sessions()

    def prepare(self, hosts: Any) -> None:
        pass


def nothing_to_try(_planned: object) -> None:
    """Stand for `probe.probing_of`: robots in memory carry no packets."""


if __name__ == "__main__":
    if at := os.environ.get("FAKED_FAULT"):
        WORLD.fault = Fault(int(at))
    pool.Sessions = FakeSessions  # type: ignore[assignment,misc]
    probe.probing_of = nothing_to_try  # type: ignore[assignment]
    try:
        entry()
    finally:
        Path(os.environ.get("FAKED_STATE", os.devnull)).write_text(json.dumps(WORLD.running()))
