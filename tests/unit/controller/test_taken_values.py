"""What somebody allowed a container to have of the controller stands in no plan of an EDF that was not allowed it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.request import PlanRequest
from srprov.controller.services import _taken
from srprov.planning.markdown import plan_markdown
from srprov.planning.plan import plan_json
from srprov.planning.text import plan_text
from srprov.secret import forget
from tests.fakes import World
from tests.worlds import Experiment, apply, experiment, plan_for, service

VALUE = "quokka-9182736455"


@pytest.fixture(autouse=True)
def _none_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    forget()
    yield
    forget()


def one(variables: dict[str, str], **fields: Any) -> Experiment:
    return experiment(service("web", robot="r1", environment=MappingProxyType(variables)), **fields)


def plan_of(before: Experiment, now: Experiment) -> tuple[str, dict[str, tuple[str | None, str | None] | str]]:
    """Return all that a plan on what runs says, and its differences."""
    world = World().add("r1")
    allowed = PlanRequest(allowed=("env", "outside", "git"))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("tests.worlds.PlanRequest", lambda **_: allowed)
        assert apply(world, before).exit_code == 0
        plan = plan_for(world, now)
    (step,) = (step for step in plan.steps if step.module == "container")
    everything = "\n".join((plan_text(plan), plan_markdown(plan), str(plan_json(plan))))
    return everything, {d.field: d.note or (d.old, d.new) for d in step.differences}


@pytest.mark.parametrize("now", [{"RATE": "2"}, {"RATE": "2", "PLACE": "x"}, {"RATE": "2", "PLACE": ""}])
def test_a_variable_of_the_controller_is_in_no_plan_of_an_edf_that_does_not_take_it(now: dict[str, str]) -> None:
    """Whose plan may be a comment that everybody reads; its name need not say that it is a secret."""
    told, found = plan_of(one({"PLACE": VALUE, "RATE": "1"}, environment=(("web", "PLACE"),)), one(now))
    assert VALUE not in told
    assert found["environment.RATE"] == ("1", "2")
    new = {"x": "x", "": '""'}.get(now.get("PLACE", "none"))
    # what is put in its place is shown: no image's label hides what a plan does
    assert found["environment.PLACE"] == ("***", new)


@pytest.mark.parametrize(
    "elsewhere",
    [
        {"outside": (("web", "/shared/web.cdf"),)},
        {"outside": (("the experiment", "/shared/x.edf"),)},
        {"remote": (("web", "ssh://git@lab.example/cdfs", ""),)},
    ],
)
def test_no_value_of_a_file_from_elsewhere_is_in_a_plan_of_an_edf_without_one(elsewhere: dict[str, Any]) -> None:
    old, new = one({"PLACE": VALUE}, **elsewhere), one({"RATE": "1"})
    told, found = plan_of(old, new)
    assert VALUE not in told and found["environment.RATE"] == (None, "1")
    assert found["environment.PLACE"] == ("***", None)
    told, found = plan_of(old, replace(new, **elsewhere))  # that one was allowed them as well
    assert found["environment.PLACE"] == (VALUE, None)


def test_each_instance_of_a_service_takes_what_the_service_does() -> None:
    some = one({}, environment=(("web", "B"), ("web", "A"), ("db", "C")), outside=(("db", "/x"),))
    web = some.services["web"]
    assert _taken(some, web) == _taken(some, replace(web, name="web-2", instance_of="web")) == ["A", "B"]
    assert _taken(some, replace(web, name="db-1", instance_of="db")) == ["*", "C"]
    assert _taken(some, replace(web, name="other")) == []
