"""What a plan file that was not written here is refused: what lies on robots already."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller.owners import read_owner
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.definitions.model import Definitions
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.errors import RefusedError
from srprov.planning.planfile import PlanFile
from srprov.secret import Secret, Vault
from tests.fakes import World
from tests.worlds import Experiment, experiment, fleet, made, run, service


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def with_secret(variable: str) -> Experiment:
    use = SecretUse(source="token", target="/run/secrets/token")
    secrets = {"token": SecretSource(name="token", env=variable)}
    return experiment(service("x", robot="r1", network="none", secrets=(use,)), name="fleet", secrets=secrets)


def after_a_failed_run(value: str) -> World:
    """Return a robot on which a run has written a secret, and then failed."""
    world = World().add("r1")
    world.vault = Vault({"token": Secret(value)})
    plan = planned(world, with_secret("OURS"), value).plan
    steps = tuple(replace(one, needs=()) for one in plan.steps if one.module != "container")
    assert run(world, replace(plan, steps=steps)).exit_code == 0
    return world


def planned(world: World, what: Experiment, value: str, source: str = "lab@desk:/e/fleet.edf") -> PlanFile:
    request = PlanRequest(exact=True, adopt=True, allowed=frozenset({"secret"}), owner=read_owner(what.name, what.file))
    with mock.patch("srprov.controller.plan.source_of", return_value=source):
        return plan_file(
            made(world, Definitions(experiment=what, containers={}), request, Vault({"token": Secret(value)}))
        )


@pytest.mark.parametrize(
    ("source", "why"),
    [("lab@desk:/e/fleet.edf", "not written on this controller.* on r1"), ("x@y:/z", "was made from")],
)
def test_a_secret_that_a_failed_run_left_is_given_to_no_plan_from_elsewhere(source: str, why: str) -> None:
    """It says that its secret is right already, and comes from another variable: its container had the user's."""
    world = after_a_failed_run("value-of-the-user")
    saved = planned(world, with_secret("HARMLESS"), "value-of-the-user", source)
    assert any(one.module == "secret" for one in saved.also_wanted)
    with pytest.raises(RefusedError, match=why):
        check_plan(saved, fleet(world))
    check_plan(saved, fleet(world), adopt=True)
