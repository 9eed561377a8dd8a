"""Whose data a volume holds: that of the services that it was made for, also when they are gone from the EDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.data import data_now
from srprov.controller.data_plan import plan_data
from srprov.controller.request import PlanRequest
from srprov.definitions import load_experiment
from srprov.definitions.containermodel import Mount
from srprov.definitions.expand import expand
from srprov.errors import RefusedError
from srprov.facts.model import HostFacts, Snapshot
from srprov.resource import Observed
from tests.fakes import World
from tests.unit.controller.test_data import MINE
from tests.worlds import experiment, plan_for, service


def planned(
    made_for: list[str], volume: str = "users", robots: tuple[str, ...] = ("r1",), **more: Any
) -> tuple[str, ...]:
    """Return the notes of a plan for `cam`, which mounts `users`; the robot has data of some services by that name."""
    name = f"srprov.x.{volume}"
    said = {"services": made_for} if made_for else {}
    state = {"owner": MINE.label("r1", name), "copy": "", "created": "", "half": False, **said}
    seen = Snapshot(
        facts={one: HostFacts(name=one) for one in robots},
        observed={"r1": (Observed(module="volume", name=name, instance="x", state=state),)},
    )
    cam = replace(service("cam", mounts=(Mount(kind="volume", source="users", target="/u"),)), **more)
    what = expand(experiment(cam, name="x"), dict.fromkeys(robots, ()))
    request = PlanRequest(owner=MINE)
    now = data_now(what, seen, "x", {}, request)
    return plan_data(what, {name: one.robot or "r1" for name, one in what.services.items()}, now, seen, request).notes


CDF = frozenset({"users"})


def test_a_cdf_gets_no_data_of_a_service_that_is_gone() -> None:
    """A CDF may be a stranger's, and what the EDF named for another service is kept when that one goes."""
    with pytest.raises(RefusedError, match="the CDF of cam mounts 'users', whose data on r1 is of db") as caught:
        planned(["db"], by_cdf=CDF)
    assert "in the EDF" in caught.value.hint
    with pytest.raises(RefusedError, match="the CDF of cam-2 mounts 'users-2'"):
        planned(["db"], volume="users-2", by_cdf=CDF, replicas=2)


@pytest.mark.parametrize("made_for", [["cam"], ["cam", "db"], []])
def test_what_was_made_for_a_service_or_by_an_older_srprov_stays_its_own(made_for: list[str]) -> None:
    assert planned(made_for, by_cdf=CDF) == ()
    assert planned(made_for) == ()


def test_a_service_of_each_robot_has_the_data_of_its_robot_alone() -> None:
    """What is kept on another one, to which its instances do not go, is in nobody's way."""
    planned(["db"], by_cdf=CDF, per_robot=("no-robot-has-it",))
    with pytest.raises(RefusedError, match="the CDF of cam-r1 mounts 'users', whose data on r1 is of db"):
        planned(["db"], by_cdf=CDF, per_robot=())
    with pytest.raises(RefusedError) as caught:
        planned(["db"], by_cdf=CDF, per_robot=(), robots=("r1", "r2"))
    assert caught.value.message.count("mounts") == 1


def test_services_of_one_cdf_have_their_data_in_common(tmp_path: Path) -> None:
    """One comes to those that are there, or is of another profile: the EDF cannot name the volume for it alone."""
    (tmp_path / "cam.cdf").write_text("cdf: 1\nimage: busybox\nvolumes: ['users:/u']\n")
    (tmp_path / "own.cdf").write_text("cdf: 1\nimage: busybox\n")
    one = "{cdf: cam.cdf, profiles: [%s]}"
    edf = f"edf: 1\nname: x\nservices:\n  cam: {one % 'real'}\n  sim: {one % 'sim'}\n  db: {{cdf: own.cdf}}\n"
    (tmp_path / "e.edf").write_text(edf)
    cam = load_experiment(str(tmp_path / "e.edf"), profiles=["real"]).experiment.services["cam"]
    given = {"by_cdf": cam.by_cdf, "same_cdf": cam.same_cdf}
    planned(["sim"], **given)
    with pytest.raises(RefusedError, match="whose data on r1 is of db"):
        planned(["db"], **given)


def test_who_only_reads_has_no_claim_to_more_later() -> None:
    mount = Mount(kind="volume", source="users", target="/u")
    reader = service("viewer", mounts=(replace(mount, read_only=True),))
    plan = plan_for(World().add("r1"), experiment(service("db", mounts=(mount,)), reader))
    (made,) = (step.want.params for step in plan.steps if step.want and step.module == "volume")
    assert made.services == ("db",)


def test_what_is_only_read_is_of_those_that_read_it() -> None:
    """As a map from a seed: without a label the volume would be anybody's, also what is written there later."""
    mount = Mount(kind="volume", source="maps", target="/m", read_only=True)
    readers = [service(name, mounts=(mount,)) for name in ("nav", "viewer")]
    plan = plan_for(World().add("r1"), experiment(*readers))
    (made,) = (step.want.params for step in plan.steps if step.want and step.module == "volume")
    assert made.services == ("nav", "viewer")


def test_what_the_edf_names_is_had_and_the_plan_says_whose_it_was() -> None:
    """The other way round: a user's own service may run what a stranger's left there."""
    assert planned(["db"]) == ("data volume srprov.x.users on r1 has the data of db, and cam has it now",)
