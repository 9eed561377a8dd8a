"""What this machine remembers of an instance once something of it was removed."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller import ownership
from srprov.controller.ownership import looking
from srprov.controller.plan import Planned
from srprov.controller.remembering import end
from srprov.controller.remove import make_removal
from srprov.facts.gather import Detail
from srprov.record.memory import Memory, digest, recall, remember
from tests.fakes import World
from tests.worlds import apply, experiment, fleet, remembering_all, run, service


def _begun(monkeypatch: pytest.MonkeyPatch, folder: Path) -> World:
    """Return robots with an instance, of which this machine remembers that it gave each a record."""
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    w = World().add("r1", "r2", "r3")
    apply(w, experiment(service("a", robot="r2")))
    record = fleet(w).gather(Detail.BASIC).records["r2"]["hello"]
    proofs = {name: robot.identity for name, robot in w.robots.items()}
    assert remember("hello", Memory(robots=frozenset(w.robots), records=(digest(record),), proofs=proofs)) == ""
    return w


def _destroyed(w: World, *robots: str) -> None:
    with remembering_all(w):
        planned: Planned = make_removal(fleet(w), "hello", volumes=False).limited(robots or tuple(w.robots))
    assert end(planned, run(w, planned.plan), "destroy", w.sessions()) == ""


def test_what_was_removed_on_some_robots_is_forgotten_of_these_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Else what one of the others then says of the instance would be as good as what this machine wrote."""
    w = _begun(monkeypatch, tmp_path)
    _destroyed(w, "r3")
    assert recall("hello").robots == {"r1", "r2"}
    snapshot = fleet(w).gather(Detail.BASIC)
    record = snapshot.records["r2"]["hello"]
    snapshot.records["r1"]["hello"] = {**record, "serial": 900, "services": {}}  # type: ignore[index]
    assert ownership.recall is recall and looking(snapshot, "hello").snapshot.placements["hello"] == record
    assert looking(snapshot, "hello").disputes == ()

    _destroyed(w)
    assert recall("hello") == Memory()


def test_a_robot_of_the_same_name_elsewhere_has_nothing_forgotten_of_this_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    w = _begun(monkeypatch, tmp_path)
    before = recall("hello")
    remember("hello", Memory(robots=before.robots, records=before.records, proofs={**before.proofs, "r3": "r3 other"}))
    _destroyed(w)
    assert recall("hello").robots == {"r3"}
