"""Secrets through a whole plan: what it shows, what its file keeps, and what comes of it on robots."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.cli.plan import write_plan
from srprov.controller.plan import Planned
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.controller.secrets import HeldSecrets, read_secrets, secret_sources
from srprov.definitions.model import Definitions
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.errors import DefinitionError, Location, RefusedError
from srprov.planning.plan import plan_json
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.planning.text import plan_text
from srprov.secret import Secret, Vault, forget
from tests.fakes import World
from tests.worlds import experiment, fleet, removal_for, run, service
from tests.worlds import made as plan_with

VALUE = "hunter2-plan"
TOKEN = SecretSource(name="token", env="TOKEN", location=Location("e.edf", 7, 3))
PATH = "/run/srprov/hello/secrets/token"
USES = (SecretUse(source="token", target="/run/secrets/token"),)


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


def wanted(**more: object) -> Definitions:
    """Return an experiment whose service `web` gets the secret, on robot r1."""
    what = experiment(service("web", robot="r1", **more), service("other", robot="r1"))
    web = replace(what.services["web"], secrets=USES)
    services = {**what.services, "web": web}
    return Definitions(experiment=replace(what, services=services, secrets={"token": TOKEN}), containers={})


def planned(world: World, value: str = VALUE, **more: object) -> Planned:
    """Plan with this value."""
    world.vault = Vault({"token": Secret(value)})
    return plan_with(world, wanted(**more), PlanRequest(allowed=frozenset({"secret"})), world.vault)


def file_of(made: Planned) -> PlanFile:
    """Return the plan as a file, without inputs."""
    return plan_file(replace(made, definitions=None))


def steps(made: Planned) -> dict[str, str]:
    """Return name -> cause of every step that is not about images and networks."""
    return {step.name: step.change.cause for step in made.plan.steps if step.module in ("secret", "container")}


def test_no_text_of_a_plan_holds_the_value_or_its_hash() -> None:
    """Neither the text with all commands, nor the JSON, nor the file; each names the secret and where it is from."""
    made = planned(World().add("r1"))
    shown = (
        plan_text(made.plan, commands=True),
        json.dumps(plan_json(made.plan)),
        dump(file_of(made)),
        repr(made.plan),
    )
    digest = hashlib.sha256(VALUE.encode()).hexdigest()
    for text in shown:
        assert PATH in text and "token" in text
        assert not [form for form in (VALUE, digest[:12], base64.b64encode(VALUE.encode()).decode()) if form in text]
    assert "token  from the variable TOKEN" in shown[0]
    assert f"$ write {PATH} (<secret token>, mode 0400)" in shown[0]


def test_a_container_gets_it_read_only_and_starts_after_it() -> None:
    """The mount is part of the container's configuration, the value is not."""
    made = planned(World().add("r1"))
    by_name = {step.name: step for step in made.plan.steps}
    web, secret = by_name["srprov.hello.web"], by_name[PATH]
    assert secret.number in web.needs
    body = json.loads(web.commands[0].body)  # type: ignore[union-attr]
    assert {"Type": "bind", "Source": PATH, "Target": "/run/secrets/token", "ReadOnly": True} in body["HostConfig"][
        "Mounts"
    ]
    other = json.loads(by_name["srprov.hello.other"].commands[0].body)  # type: ignore[union-attr]
    assert "/run/secrets" not in json.dumps(other)


def test_the_value_arrives_and_a_second_plan_is_empty() -> None:
    """The file holds the very value, with its permissions."""
    world = World().add("r1")
    assert run(world, planned(world).plan).exit_code == 0
    disk = world.robots["r1"].disk
    assert (disk.files[PATH], disk.modes[PATH]) == (VALUE.encode(), 0o400)
    assert planned(world).plan.empty


def test_a_changed_value_rewrites_the_file_and_restarts_nothing() -> None:
    """In place, so that the mounted file is the same file."""
    world = World().add("r1")
    run(world, planned(world).plan)
    disk = world.robots["r1"].disk
    inode = disk.inodes[PATH]
    changed = planned(world, "another-value")
    assert steps(changed) == {PATH: "secret differs"}
    assert run(world, changed.plan).exit_code == 0
    assert (disk.files[PATH], disk.inodes[PATH]) == (b"another-value", inode)


def test_after_a_reboot_it_is_not_there_and_comes_back() -> None:
    """Memory is empty then, and the plan says so."""
    world = World().add("r1")
    run(world, planned(world).plan)
    world.robots["r1"].disk.forget()
    healed = planned(world)
    assert steps(healed) == {PATH: "not there"}
    assert run(world, healed.plan).exit_code == 0
    assert planned(world).plan.empty


def test_destroy_removes_it() -> None:
    """Without knowing its value, after the container."""
    world = World().add("r1")
    run(world, planned(world).plan)
    removal = removal_for(world)
    order = [step.name for step in removal.steps]
    assert order.index("srprov.hello.web") < order.index(PATH)
    assert run(world, removal).exit_code == 0
    assert PATH not in world.robots["r1"].disk.files


def test_a_plan_file_takes_the_value_of_the_day(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file says where the value comes from; apply reads it then, and writes that one."""
    world = World().add("r1")
    saved = load(dump(file_of(planned(world))), "plan.json")
    assert dump(saved) == dump(file_of(planned(world)))
    assert secret_sources(saved.plan) == (TOKEN,)
    monkeypatch.setenv("TOKEN", "value-of-the-day")
    held = HeldSecrets(saved, ("secret",))
    assert "TOKEN" not in os.environ
    world.vault = held.vault
    plan = held.read(check_plan(saved, fleet(world), adopt=True)).plan
    assert run(world, plan).exit_code == 0
    assert world.robots["r1"].disk.files[PATH] == b"value-of-the-day"


def test_a_plan_file_takes_no_file_by_a_name_that_an_archive_gave_it(
    tmp_path: Path,
) -> None:
    """The plan was made where an ordinary file has that name; here it is a second name of a file of the user's."""
    world, file = World().add("r1"), tmp_path / "nav" / "token.txt"
    file.parent.mkdir()
    file.write_text("just-a-demo-token")
    made = planned(world)
    source = SecretSource(name="token", file=str(file))
    saved = load(dump(file_of(replace(made, plan=replace(made.plan, secrets=(source,))))), "plan.json")
    HeldSecrets(saved, ("secret",))
    file.unlink()
    (file.parent / "credentials").write_text("the user's")
    os.link(file.parent / "credentials", file)
    with pytest.raises(RefusedError, match=r"token\.txt: it has another name, elsewhere \(a hard link\)"):
        HeldSecrets(saved, ("secret",))
    HeldSecrets(saved, ("secret", "outside"))


def test_a_plan_file_without_a_secret_to_write_needs_no_value() -> None:
    """What is there already is not read again."""
    world = World().add("r1")
    run(world, planned(world).plan)
    assert secret_sources(load(dump(file_of(planned(world, command=("new",)))), "plan.json").plan) == ()


def test_a_missing_value_is_told_before_any_robot_is_changed() -> None:
    """It is said at which line of the EDF."""
    world = World().add("r1")
    with pytest.raises(DefinitionError) as caught:
        read_secrets(wanted(), ("secret",))
    assert str(caught.value.problems[0].location) == "e.edf:7:3"
    assert world.done() == []


def test_a_plan_file_with_the_value_in_clear_is_refused(tmp_path: object) -> None:
    """In an environment, say: the file would be done as it stands, so `***` would be wrong and the value too."""
    world = World().add("r1")
    made = planned(world, environment={"TOKEN": VALUE})
    target = f"{tmp_path}/plan.json"
    with pytest.raises(RefusedError, match="secret 'token'") as caught:
        write_plan(target, file_of(made), world.vault)
    assert VALUE not in f"{caught.value} {caught.value.hint}"
    write_plan(target, replace(file_of(planned(world)), inputs={"e.edf": f"# {VALUE}\n"}), world.vault)
    with open(target, encoding="utf-8") as stream:
        assert json.load(stream)["inputs"] == {"e.edf": "# ***\n"}
