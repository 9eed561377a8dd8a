"""Which container is meant, where only the robots say where services are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller import located
from srprov.controller.located import Located, Whereabouts
from srprov.controller.sent_to import trusted
from srprov.definitions.model import Service
from srprov.errors import RefusedError, UsageError
from srprov.facts.model import HostFacts, Snapshot
from srprov.record.memory import Memory, digest, remember
from srprov.resource import Observed

DB = Located(service="db", host="r1", container="srprov.x.db")


def there(*, away: bool, remembered: bool, one: Located = DB) -> Whereabouts:
    unreachable = {"r2": "no answer"} if away else {}
    return Whereabouts(
        instance="x", services=(one,), by_name={}, families={}, unreachable=unreachable, remembered=remembered
    )


def test_a_robot_s_word_that_nobody_can_contradict_gets_no_file_and_no_command() -> None:
    """Root there makes a container with the service's label, and a record; the one that has the service is away."""
    with pytest.raises(UsageError, match=r"only r1 says that db is there: .* r2 cannot be asked") as caught:
        trusted(there(away=True, remembered=False), "db", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r1")
    assert trusted(there(away=True, remembered=False), "db@r1", "s") == DB


def test_what_another_file_made_gets_no_file_and_no_command_by_a_service_s_name() -> None:
    """A stranger's EDF calls itself, and a service, as one of the user's, which does not run just now."""
    container = Observed(module="container", name="srprov.x.db", instance="x", state={"source": "git:example.org/nav"})
    found = there(away=False, remembered=True, one=replace(DB, found=container))
    with pytest.raises(RefusedError, match=r"^db on r1 was made from git:example.org/nav, not from s$") as caught:
        trusted(found, "db", "s")
    assert caught.value.code == Code.OWNER and caught.value.hint.endswith("db@r1")
    assert trusted(found, "db@r1", "s").host == trusted(found, "db", "git:example.org/nav").host == "r1"


def test_what_a_run_of_this_machine_took_over_is_the_user_s() -> None:
    """With --adopt a container keeps the label of who made it."""
    container = Observed(module="container", name="srprov.x.db", instance="x", state={"source": "before"})
    found = there(away=False, remembered=True, one=replace(DB, found=container))
    assert trusted(replace(found, source="s"), "db", "s").host == "r1"
    for other in (replace(found, source="before"), replace(found, source="s", remembered=False)):
        with pytest.raises(RefusedError, match="was made from before"):
            trusted(other, "db", "s")


@pytest.mark.parametrize(("away", "remembered"), [(False, False), (True, True), (False, True)])
def test_where_it_could_be_contradicted_it_counts(away: bool, remembered: bool) -> None:
    assert trusted(there(away=away, remembered=remembered), "db", "s") == DB


def test_a_service_that_the_edf_wants_elsewhere_is_not_there_by_its_robot_s_word_alone() -> None:
    """No run of this machine knows better."""

    def pinned(robot: str, *, remembered: bool = False) -> Whereabouts:
        return replace(there(away=False, remembered=remembered), by_name={"db": Service(name="db", robot=robot)})

    with pytest.raises(UsageError, match=r"only r1 says that db is there: .* the EDF wants it on r2") as caught:
        trusted(pinned("r2"), "db", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r1")
    assert trusted(pinned("r2"), "db@r1", "s") == trusted(pinned("r1"), "db", "s") == DB
    assert trusted(pinned("r2", remembered=True), "db", "s") == DB, "an EDF may have been changed since"


@pytest.mark.parametrize("away", [True, False])
def test_what_this_machine_knew_before_its_last_run_is_no_more_than_a_robot_s_word(away: bool) -> None:
    """The service was moved away from r1 by a run that r1 let fail; its new robot is away, or has lost its record."""
    before = replace(there(away=away, remembered=True), unsure=("r2",))
    with pytest.raises(UsageError, match=r"only r1 says .* a later run .* which r2 could tell") as caught:
        trusted(before, "db", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r1")
    assert trusted(before, "db@r1", "s") == DB


def test_what_no_run_placed_is_nowhere_by_a_robot_s_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The service is new in the EDF, or only wanted with a profile; r2 has a container with its label."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    entry = {"robot": "r1", "ip": "", "mac": "", "network": "none"}
    record = {"instance": "x", "serial": 1, "services": {"db": entry}, "robots": {}, "source": "s"}
    label = {"service": "new", "source": "s", "state": "running"}
    decoy = Observed(module="container", name="srprov.x.new", instance="x", state=label)
    seen = Snapshot(facts={}, observed={"r2": (decoy,)}, unreachable={}, records={"r1": {"x": record}})
    remember("x", Memory(robots=frozenset({"r1"}), records=(digest(record),)))
    found = located.locate(seen, "x")
    assert trusted(found, "db", "s").host == "r1" and trusted(found, "new@r2", "s").host == "r2"
    with pytest.raises(UsageError, match=r"only r2 says that new is there: .* has it nowhere") as caught:
        trusted(found, "new", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("new@r2")


def test_without_a_run_of_this_machine_s_another_robot_has_to_have_it_in_its_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody ended the instance, here or elsewhere, and r2 has a container and a record of its own making."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    entry = {"robot": "r2", "ip": "", "mac": "", "network": "none"}
    record = {"instance": "x", "serial": 1, "services": {"db": entry}, "robots": {}, "source": "s"}
    decoy = Observed(module="container", name="srprov.x.db", instance="x", state={"service": "db", "state": "running"})

    def placed(robots: str, holders: str) -> Located:
        facts = {robot: HostFacts(name=robot) for robot in robots.split()}
        records = {robot: {"x": dict(record)} for robot in holders.split()}
        seen = Snapshot(facts=facts, observed={"r2": (decoy,)}, unreachable={}, records=records)
        return trusted(located.locate(seen, "x"), "db", "s")

    for holders in ("", "r2"):
        with pytest.raises(UsageError, match=r"only r2 says that db is there: .* no other robot has it in its record"):
            placed("r1 r2", holders)
    assert placed("r1 r2", "r1 r2").host == "r2", "as whoever places an instance tells all robots"
    assert placed("r2", "r2").host == "r2", "there is no other one"


def test_a_service_on_a_robot_that_is_away_is_what_others_say_of_it() -> None:
    """The connection fails, and says so."""
    lost = Located(service="db", host="r2", container="srprov.x.db")
    assert trusted(there(away=True, remembered=False, one=lost), "db", "s") == lost


def test_a_record_that_this_machine_did_not_write_is_no_word_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The instance was placed with an inventory of r2 alone, which has been more than half of its robots since."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    def record(*services: str) -> dict[str, Any]:
        entry = {"robot": "r2", "ip": "", "mac": "", "network": "none"}
        return {"instance": "x", "serial": 1, "services": dict.fromkeys(services, entry), "robots": {}, "source": "s"}

    def seen(said: dict[str, Any]) -> Whereabouts:
        facts = {robot: HostFacts(name=robot) for robot in ("r1", "r2")}
        decoy = Observed(module="container", name="srprov.x.db", instance="x", state={"service": "db", "state": ""})
        return located.locate(
            Snapshot(facts=facts, observed={"r2": (decoy,)}, unreachable={}, records={"r2": {"x": said}}), "x"
        )

    remember("x", Memory(robots=frozenset({"r2"}), records=(digest(record("db")),)))
    assert trusted(seen(record("db")), "db", "s").host == "r2"
    remember("x", Memory(robots=frozenset({"r2"}), records=(digest(record("a")),)))
    with pytest.raises(UsageError, match=r"only r2 says .*: no run of this machine put it there") as caught:
        trusted(seen(record("a", "db")), "db", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r2")


@pytest.mark.parametrize("witness", [False, True])
def test_a_robot_that_is_called_as_one_of_another_laboratory_gets_nothing_for_it(
    witness: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was r2 where this machine placed the instance, and has that record; here it is r1, with a decoy."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    entry = {"robot": "r1", "ip": "", "mac": "", "network": "none"}
    record = {"instance": "x", "serial": 1, "services": {"db": entry}, "robots": {}, "source": "s"}
    decoy = Observed(module="container", name="srprov.x.db", instance="x", state={"service": "db", "state": "running"})
    proofs = {robot: f"{robot} key of {robot}" for robot in ("r1", "r2", "r3")}
    remember("x", Memory(robots=frozenset(proofs), records=(digest(record),), proofs=proofs))

    def seen(proved: str) -> Snapshot:
        robots = ("r1", "r3")
        facts = {robot: HostFacts(name=robot) for robot in robots}
        records = {robot: {"x": dict(record)} for robot in robots if robot == "r1" or witness}
        known = {"r1": f"r1 {proved}", "r3": proofs["r3"]}
        return Snapshot(facts=facts, observed={"r1": (decoy,)}, unreachable={}, records=records, proofs=known)

    assert trusted(located.locate(seen("key of r1"), "x"), "db", "s").host == "r1"
    assert [label for label, *_ in located.containers_of(seen("key of r1"), "x", ())] == ["db"]
    why = "a run of this machine knows another robot by that name" if witness else "not sure where db was placed"
    with pytest.raises(UsageError, match=why) as caught:
        trusted(located.locate(seen("key of r2"), "x"), "db", "s")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r1")
    assert [label for label, *_ in located.containers_of(seen("key of r2"), "x", ())] == ["db@r1"]
