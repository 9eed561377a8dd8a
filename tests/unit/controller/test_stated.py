"""What of a plan file no EDF leads to, and which robots that is about."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.controller.authority import asked, wants_of
from srprov.controller.request import PlanRequest
from srprov.controller.saved import plan_file
from srprov.definitions.model import Definitions
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.errors import UsageError
from srprov.modules.params import ParameterError
from srprov.modules.wireguard_state import check_addresses
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.secret import Secret, Vault
from tests.fakes import World
from tests.worlds import experiment, made, service


def test_what_a_plan_file_has_on_a_robot_for_nobody_there_is_asked_for_as_such() -> None:
    """A lab's policy is about the robot of the service: another one would pull its image, or be sent its secret."""
    world = World().add("r1", "r4")
    name = "127.0.0.1:5000/x:1"
    token = SecretSource(name="token", env="TOKEN")
    here = experiment(service("x", robot="r4", image=name, secrets=(SecretUse(source="token", target="/t"),)),
                      name="fleet", secrets={"token": token})  # fmt: skip
    vault = Vault({"token": Secret("value-of-a-test")})
    request = PlanRequest(allowed=frozenset({"secret"}))
    saved = plan_file(made(world, Definitions(experiment=here, containers={}), request, vault))
    assert {one.service for one in asked(saved)} == {"x"}
    image, secret = (next(one for one in wants_of(saved) if one.module == kind) for kind in ("image", "secret"))
    more = {"other images": image, "": secret}
    for word, one in more.items():
        there = replace(saved.plan.steps[0], want=replace(one, host="r1"), host="r1", module=one.module, name=one.name)
        tampered = replace(saved, plan=replace(saved.plan, steps=(*saved.plan.steps, there)))
        assert {said.service for said in asked(tampered)} == {"x", word}


def test_what_comes_from_nowhere_or_goes_nowhere_is_refused_when_a_plan_file_is_read() -> None:
    """Each was a traceback: of a secret after the question was answered."""
    plan = Plan(instance="x", source="s", steps=(), secrets=(SecretSource(name="token"),))
    with pytest.raises(UsageError, match="'token' comes from nowhere"):
        load(dump(PlanFile(plan=plan, fingerprints={})), "plan.json")
    plan = Plan(instance="x", source="s", steps=(), secrets=(SecretSource(name="token", env="XDG_STATE_HOME"),))
    with pytest.raises(UsageError, match="a variable that srprov itself goes by"):
        load(dump(PlanFile(plan=plan, fingerprints={})), "plan.json")
    with pytest.raises(ParameterError, match="'' is no IPv4 address"):
        check_addresses("to", "10.0.0.1", "")
