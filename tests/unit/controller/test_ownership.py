"""What robots say of an instance."""

from __future__ import annotations

import pytest

from srprov.controller.ownership import check_source, owned
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.network.identity import link_names
from srprov.resource import Observed
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service


def test_a_half_made_link_belongs_to_its_instance() -> None:
    """A link with our name and no alias was left by a run that was cut off; only the instance of that name owns it."""
    _, link = link_names("hello")
    half = Observed(module="vxlan", name=link, instance="", state={"instance": ""})
    other = Observed(module="vxlan", name="srpvffffffff", instance="", state={"instance": ""})
    found = Snapshot(facts={}, observed={"r1": (half, other)})

    assert [item.instance for item in owned(found, "hello")["r1"]] == ["hello", ""]
    assert [item.instance for item in owned(found, "else")["r1"]] == ["", ""]


def test_two_more_robots_know_where_services_run() -> None:
    """The record lies on members and on two witnesses, and no service is started elsewhere while a witness is left."""
    w = World().add("r1", "r2", "r3", "r4", "r5")
    what = experiment(service("a"))
    apply(w, what)
    (home,) = (name for name, robot in w.robots.items() if robot.engine.containers)
    keepers = [name for name, robot in w.robots.items() if "/var/lib/srprov/hello/placement.json" in robot.disk.files]
    assert len(keepers) == 3 and home in keepers

    w.robots[home].gone = True
    plan = plan_for(w, what)

    assert [step.id for step in plan.steps if step.module == "container"] == []
    assert plan.assignment == {"a": home}
    assert home in plan.unreachable


def test_a_robot_that_names_a_source_gives_away_nothing_of_what_others_have() -> None:
    """Its label, and its record with the highest serial, speak for its own container alone."""

    def box(service: str, source: str) -> Observed:
        state = {"source": source, "state": "running", "service": service}
        return Observed(module="container", name=f"srprov.x.{service}", instance="x", state=state)

    def record(source: str, serial: int) -> dict[str, object]:
        return {"instance": "x", "source": source, "serial": serial}

    theirs = {"r2": {"x": record("theirs", 1)}}
    lies = {"r1": (box("w", "mine"),), "r2": (box("v", "theirs"),)}
    for said in ({}, {"x": record("mine", 900)}):
        placements = {"x": said["x"]} if said else {}
        found = Snapshot(facts={}, observed=lies, records={"r1": said, **theirs}, placements=placements)
        with pytest.raises(RefusedError, match=r"'x' on (r2|these robots) was made from theirs, not from mine"):
            check_source(found, "x", "mine", adopt=False)
        check_source(found, "x", "mine", adopt=True)
    taken_over = {"r1": {"x": record("mine", 2)}, "r2": {"x": record("mine", 2)}}
    after = Snapshot(facts={}, observed=lies, records=taken_over, placements={"x": record("mine", 2)})
    check_source(after, "x", "mine", adopt=False)
