"""Whose placement record counts: a robot speaks for itself, and for others only where a run gave it the words."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller import ownership, remembering
from srprov.definitions.model import Definitions
from srprov.errors import RefusedError
from srprov.facts.gather import Detail
from srprov.facts.model import Snapshot
from srprov.facts.placements import parse_placements
from srprov.network.belief import believe
from srprov.record.memory import Memory, digest, recall, remember
from srprov.wire import Reply
from tests import worlds
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service


def record(serial: int = 3, **more: Any) -> dict[str, Any]:
    """Return a record of services a on r1 and b on r2."""
    entry = {"ip": "10.200.0.2", "mac": "02:00:00:00:00:01", "network": "overlay"}
    services = {"a": {**entry, "robot": "r1"}, "b": {**entry, "robot": "r2"}}
    robots = {name: {"gateway": "10.200.0.1", "vtep": f"10.0.0.{name[1:]}"} for name in ("r1", "r2")}
    return {"instance": "hello", "serial": serial, "services": services, "robots": robots, "source": "x", **more}


FORGED = record(999_999, robots={"r1": {"vtep": "10.0.0.66"}, "r2": {"vtep": "10.0.0.66"}})


def seen(unreachable: tuple[str, ...] = (), **held: dict[str, Any]) -> Snapshot:
    records = {robot: {"hello": one} for robot, one in held.items()}
    return Snapshot(facts={}, observed={}, records=records, unreachable=dict.fromkeys(unreachable, "down"))


def test_a_robot_that_no_run_gave_a_record_is_not_believed_and_named() -> None:
    belief = believe("hello", seen(r1=record(), r2=record(), r9=FORGED), {"r1", "r2"})
    assert belief.record == record() and belief.holders == {"r1", "r2"} and not belief.doubts
    assert len(belief.notes) == 1 and belief.notes[0].startswith("r9 holds another record")


def test_a_witness_that_lies_is_outdone_by_what_this_machine_wrote() -> None:
    """Also alone against one: the record that was given wins over any serial."""
    known = [digest(record(2)), digest(record())]
    order = lambda one: known.index(digest(one)) if digest(one) in known else -1  # noqa: E731
    for held in ({"r1": record(), "r9": FORGED}, {"r1": record(2), "r9": FORGED}):
        belief = believe("hello", seen(**held), {"r1", "r2", "r9"}, order)
        assert belief.record == held["r1"] and [note[:2] for note in belief.notes] == ["r9"]


def test_what_another_machine_wrote_on_most_of_our_robots_counts() -> None:
    belief = believe("hello", seen(r1=record(7), r2=record(7), r3=FORGED), {"r1", "r2", "r3"}, lambda _one: -1)
    assert belief.record == record(7)


def test_while_a_keeper_is_away_a_record_that_is_not_ours_is_a_doubt() -> None:
    """One robot cuts others off, or waits for that: only its word for itself counts. When all answer, most decide."""
    keepers = {"r1", "r2", "r3"}
    alone = believe("hello", seen(("r2", "r3"), r1=FORGED), keepers)
    assert alone.record is not None and set(alone.record["services"]) == {"a"} and set(alone.record["robots"]) == {"r1"}
    assert alone.disputes == ("r1 does not hold what this machine wrote, and r2, r3 cannot be asked",)
    assert believe("hello", seen(("r1", "r2", "r3"), r9=FORGED), keepers).disputes, "nor does a stranger's word count"
    newer = record(7)
    assert not believe("hello", seen(r1=newer, r2=newer, r3=newer), keepers).doubts
    assert believe("hello", seen(r1=newer, r2=FORGED, r3=record(8)), keepers).disputes


def test_robots_that_hold_no_record_any_more_are_no_voice_for_the_one_that_does() -> None:
    """Somebody ended the instance on all of them; one says that it goes on, or one that never had a part in it."""
    keepers = {"r1", "r2", "r3"}
    for liar in ("r1", "r9"):
        belief = believe("hello", seen(**{liar: FORGED}), keepers, lambda _one: -1)
        assert belief.disputes == (
            f"{liar} does not hold what this machine wrote, and no record is on more than half of r1, r2, r3",
        )
        assert belief.record is not None and set(belief.record["services"]) == ({"a"} if liar == "r1" else set())
    assert not believe("hello", seen(r1=record(7), r2=record(7)), keepers, lambda _one: -1).doubts


def test_the_one_robot_that_was_given_a_record_says_nothing_of_others() -> None:
    """It alone is more than half; one that it speaks of is away, or answers and holds nothing of it, or another one."""
    away, why = seen(("r2",), r1=FORGED), "no other robot holds what r1 says of r2"
    answers: Any = {"r1": None, "r2": None}
    for held in (away, replace(away, unreachable={}, facts=answers), seen(("r2",), r1=FORGED, r3=record())):
        belief = believe("hello", held, {"r1"})
        assert belief.record is not None and "r2" not in {*belief.record["robots"]}
        assert "b" not in belief.record["services"]
        assert any(why in one for one in belief.disputes)
    assert believe("hello", away, {"r1"}).disputes == (f"r1 does not hold what this machine wrote, and {why}",)
    assert not believe("hello", away, {"r1"}, lambda _one: 0).doubts, "this machine wrote it"
    assert not believe("hello", seen(r1=record(7)), {"r1"}).doubts, "from who is not in the inventory, nothing follows"
    assert not believe("hello", seen(("r2",), r1=record(7), r3=record(7)), {"r1"}).doubts, "r3 has it from a run, too"
    own = record(7, services={"a": record()["services"]["a"]}, robots={"r1": record()["robots"]["r1"]})
    assert not believe("hello", seen(("r2",), r1=own), {"r1"}).doubts, "it speaks of itself"


def test_an_older_record_of_ours_is_unsure_while_one_that_may_have_the_newer_one_is_silent() -> None:
    """A run did not come to its end, as a robot let it fail, which kept what it had; the other one is away now."""
    order = [record(2), record(3)].index
    for silent in (seen(("r1",), r2=record(2)), seen(r2=record(2))):
        belief = believe("hello", silent, {"r1", "r2"}, order, 1)
        assert belief.record == record(2) and not belief.doubts, "that run may have written nothing"
        assert belief.unsure == ("r1",)
        assert belief.notes == (
            "r2 has an older record of it than a run of this machine wrote; r1 may have the newer one",
        )
    assert not believe("hello", seen(r1=record(2), r2=record(2)), {"r1", "r2"}, order, 1).unsure
    assert not believe("hello", seen(("r1",), r2=record(3)), {"r1", "r2"}, order, 1).unsure


def test_without_a_memory_each_record_counts_for_its_own_robot() -> None:
    belief = believe("hello", seen(("r2",), r1=record()), ())
    assert belief.record is not None and set(belief.record["services"]) == {"a"} == {"a"}
    assert set(belief.record["robots"]) == {"r1"} and belief.claimed == record()
    assert belief.doubts == ("r1 says that b runs on r2, which cannot be reached",)
    assert not believe("hello", seen(r1=record(), r2=record()), ()).doubts


def test_without_a_memory_records_that_differ_are_a_doubt() -> None:
    belief = believe("hello", seen(r1=record(), r2=record(), r9=FORGED), ())
    assert belief.claimed == record(), "one robot outvotes nobody"
    assert belief.doubts == ("r1 and r9 hold different records of it (serial 3 and 999999)",)


def test_of_one_against_one_the_word_of_whom_it_is_about_counts_more() -> None:
    assert believe("hello", seen(("r2",), r1=record(), r9=FORGED), ()).claimed == record()


def test_no_record_is_no_belief() -> None:
    assert believe("hello", seen(), {"r1"}).record is None
    assert believe("other", seen(r1=record()), {"r1"}).record is None
    assert believe("hello", seen(), {"r1"}).notes == () == believe("hello", seen(("r3",)), {"r1"}).notes


def test_that_no_robot_has_a_record_is_said_while_one_that_was_given_it_is_away() -> None:
    """Root on one removes its own, and what runs on the one that is away would run twice without a remark."""
    belief = believe("hello", seen(("r1",)), {"r1", "r2"})
    assert belief.record is None and not belief.doubts
    assert belief.notes == (
        "no robot that answers holds a record of this instance, and r1, to which a run of this machine gave one, "
        "cannot be asked what runs there",
    )


# --- in a plan ----------------------------------------------------------------------------------------------------

TWO = experiment(service("one", robot="a", network="overlay"), service("two", robot="b", network="overlay"))


def forged(world: World, host: str, liar: str) -> None:
    """Let a robot that runs nothing hold a record that sends what is meant for `host` to itself."""
    path = "/var/lib/srprov/hello/placement.json"
    said = json.loads(world.robots["a"].disk.files[path])
    said["robots"][host]["vtep"], said["serial"] = world.robots[liar].kernel.address, 999_999
    world.robots[liar].disk.files[path] = json.dumps(said).encode()


def remembered(world: World, *robots: str) -> Any:
    """Let this machine remember that it gave the record of `a` to some robots."""
    (held,) = parse_placements(Reply(status=0, out=world.robots["a"].disk.records())).values()
    proofs = {name: world.robots[name].identity for name in robots}
    memory = Memory(robots=frozenset(robots), records=(digest(held),), proofs=proofs)
    return recalling(memory)


def recalling(memory: Memory) -> Any:
    """Let plans of a world find this memory, whatever the instance."""
    found = mock.patch.object(ownership, "recall", lambda _name: memory)
    return mock.patch.object(worlds, "remembering_all", lambda _world: found)


@pytest.mark.parametrize("keepers", [("a", "b"), ("a", "b", "c", "d")])
def test_a_robot_that_runs_nothing_does_not_redirect_what_others_send(keepers: tuple[str, ...]) -> None:
    """Neither a stranger nor a witness, while a member is out of reach."""
    world = World().add("a", "b", "c", "d")
    apply(world, TWO)
    forged(world, "b", "d")
    world.robots["b"].gone = True
    with remembered(world, *keepers):
        plan = plan_for(world, TWO)
    assert [step.id for step in plan.steps if step.host == "a"] == []
    assert any("d holds another record" in note for note in plan.notes)
    assert plan.assignment == {"one": "a", "two": "b"}


def test_without_a_memory_the_plan_is_refused_with_what_robots_say() -> None:
    world = World().add("a", "b", "c", "d")
    apply(world, TWO)
    forged(world, "b", "d")
    nothing = recalling(Memory())
    with nothing, pytest.raises(RefusedError, match="a and d hold different records of it") as caught:
        plan_for(world, TWO)
    assert caught.value.exit_code == 9 and "--adopt" in caught.value.hint
    with nothing:
        assert [step for step in plan_for(world, TWO, adopt=True).steps if step.host == "a"] == []


def test_a_plan_is_refused_when_the_keepers_that_could_contradict_are_away() -> None:
    world = World().add("a", "b", "c", "d")
    apply(world, TWO)
    with worlds.remembering_all(world):
        memory = ownership.recall("hello")
    forged(world, "b", "a")
    for name in ("b", "c", "d"):
        world.robots[name].gone = True
    with recalling(memory), pytest.raises(RefusedError, match="does not hold what this machine wrote") as caught:
        plan_for(world, TWO)
    assert caught.value.exit_code == 9 and "--adopt" in caught.value.hint


def test_a_record_is_this_machines_word_only_from_the_robot_that_it_gave_it_to() -> None:
    """Another inventory gives the name to another robot, which had the record under another one."""
    world = World().add("a", "b", "c", "d")
    apply(world, TWO)
    with worlds.remembering_all(world):
        memory = ownership.recall("hello")
    snapshot = worlds.fleet(world).gather(Detail.BASIC)
    assert snapshot.proofs == memory.proofs
    for proofs, others in (({}, set("abcd")), ({**memory.proofs, "a": "a other"}, {"a"})):
        with mock.patch.object(ownership, "recall", lambda _name, proofs=proofs: replace(memory, proofs=proofs)):
            assert ownership.strangers(snapshot, ownership.recall("hello")) == others
            assert ownership.sure_homes(snapshot, "hello").keys() == {"one", "two"} - {
                service for service, robot in (("one", "a"), ("two", "b")) if robot in others
            }


def test_a_run_remembers_what_robots_proved_to_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = World().add("a", "b")
    with worlds.remembering_all(world):
        planned = worlds.made(world, Definitions(experiment=TWO, containers={}))
    assert remembering.begin(planned, world.sessions()) == ""
    assert recall("hello").proofs == {"a": "a key", "b": "b key"}


# --- the memory ---------------------------------------------------------------------------------------------------


def test_a_memory_comes_back_and_is_its_users_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    kept = Memory(robots=frozenset({"r1", "r2"}), records=("a", "b"), proofs={"r1": "r1 key"})
    assert recall("hello") == Memory() and remember("hello", kept) == "" and recall("hello") == kept
    (file,) = (tmp_path / "srprov" / "placements").iterdir()
    assert file.stat().st_mode & 0o077 == 0 and file.parent.stat().st_mode & 0o077 == 0
    for broken in ("", "[]", "{", '{"robots": 7, "records": {}}', "\0", "[" * 5000):
        file.write_text(broken, encoding="utf-8")
        assert recall("hello") == Memory()
    assert remember("hello", Memory()) == "" and not file.exists() and remember("hello", Memory()) == ""
    assert recall("../../x") == Memory()


def test_a_memory_that_cannot_be_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "srprov").write_text("a file", encoding="utf-8")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert "srprov" in remember("hello", Memory(robots=frozenset({"r1"})))


def test_one_text_on_all_robots_is_read_once_and_judged_once() -> None:
    """It names all robots: read for each of them, it would take the square of time and of memory."""
    text = "/var/lib/srprov/hello/placement.json:" + json.dumps(record())
    held = [parse_placements(Reply(status=0, out=text))["hello"] for _ in range(3)]
    assert held[0] is held[1] is held[2]
    judged: list[Mapping[str, Any]] = []

    def judge(one: Mapping[str, Any]) -> int:
        judged.append(one)
        return 0

    belief = believe("hello", seen(r1=held[0], r2=held[1], r3=dict(held[2])), {"r1", "r2"}, judge)
    assert belief.holders == {"r1", "r2", "r3"} and len(judged) == 1
