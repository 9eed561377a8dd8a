"""What all robots have names all of them: it is made, read, hashed and written down once, not once for each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from srprov.controller import plan as planning
from srprov.controller import remembering
from srprov.controller.plan import Planned
from srprov.controller.run import record_inputs
from srprov.controller.saved import plan_file
from srprov.definitions.model import Definitions
from srprov.execution import executor
from srprov.modules import MODULES
from srprov.modules.file import FileParams
from srprov.modules.params import AnyText, ParameterError
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from srprov.planning.rebuild import rebuild_stranded
from srprov.planning.steps import due_step
from srprov.record.folder import PlainFolder
from srprov.resource import Action
from tests import worlds
from tests.fakes import World
from tests.worlds import QUICK, experiment, run, service

ROBOTS = 80
"""With so many services the record is long; the hosts file is short."""


@pytest.fixture(scope="module")
def planned() -> tuple[World, Planned]:
    """Return robots, and the plan for a service on each."""
    world = World().add(*(f"r{number:02}" for number in range(ROBOTS)))
    what = experiment(*(service(f"a{name}", robot=name, network="host") for name in world.robots))
    definitions = Definitions(experiment=what, containers={})
    with mock.patch.object(planning, "source_of", return_value="lab@desk:/e/hello.edf"):
        return world, worlds.made(world, definitions)


def test_a_long_file_stands_once_in_a_plan_file_and_is_read_back(planned: tuple[World, Planned]) -> None:
    saved = plan_file(planned[1])
    text = dump(saved)
    blobs = json.loads(text)["blobs"]
    record, hosts = sorted(blobs.values(), key=len, reverse=True)
    assert len(record) > 4096 > len(hosts)
    assert '\\"ar79\\":{' not in text, "as text in what a robot should have"
    assert load(text, "plan.json") == saved


def test_a_long_file_stands_once_in_a_record(planned: tuple[World, Planned], tmp_path: Path) -> None:
    """By its hash in what each robot should be, and as it is in a file of that name."""
    world, made = planned
    record_inputs(PlainFolder(tmp_path), made, worlds.inventory(world), "apply")
    (shared,) = (tmp_path / "rendered" / "shared").iterdir()
    assert json.loads(shared.read_text())["services"].keys() == made.plan.assignment.keys()
    for robot in world.robots:
        stated = json.loads((tmp_path / "rendered" / f"{robot}.yml").read_text())
        assert [one["blob"] for one in stated if one.get("file", "").endswith("/placement.json")] == [shared.name]


def test_all_robots_share_the_bytes_of_a_long_file(planned: tuple[World, Planned]) -> None:
    """Also as commands: a thousand copies of what grows with a thousand robots are a hundred MiB."""
    found = [step for step in planned[1].plan.steps if step.name.endswith("/placement.json")]
    assert len(found) == ROBOTS
    assert len({id(step.commands[0].content) for step in found if step.commands}) == 1  # type: ignore[union-attr]


def test_the_record_of_all_robots_is_digested_once(planned: tuple[World, Planned]) -> None:
    remembering._digest.cache_clear()
    with mock.patch.object(remembering, "parse_json", wraps=remembering.parse_json) as parsed:
        assert len(dict(remembering._given(planned[1]))) == ROBOTS
    assert parsed.call_count == 1


def test_robots_are_not_looked_at_for_each_step_of_others(planned: tuple[World, Planned]) -> None:
    """Only steps that depend on what others say, such as a public key, look at all of them."""
    world, made = planned
    with mock.patch.object(executor, "told", side_effect=AssertionError):
        assert run(world, made.plan, QUICK).exit_code == 0


def test_what_stands_on_what_is_found_by_robot() -> None:
    """Not by a look at all that there is, for each update."""

    class Counted(dict[Any, Any]):
        looks = 0

        def items(self) -> Any:
            self.looks += 1
            return super().items()

    want = worlds.plan_for(World().add("r1"), experiment(service("a", robot="r1"))).steps
    updates = []
    there = Counted()
    for step in (one for one in want if one.module == "file" and one.want):
        found = MODULES["file"].parse([mock.Mock(out=f"{'0' * 64}  {step.name}\n")])[0]
        there[step.host, step.module, step.name] = found
        assert step.want is not None
        updates.append(due_step(step.want, found))
    steps = [one for one in updates if one is not None and one.change.action is Action.UPDATE]
    assert len(steps) > 1 and rebuild_stranded(steps, there) == steps
    assert there.looks == 1


@pytest.mark.parametrize(
    ("params", "says"), [({}, "the parameter 'content' is missing"), ({"content": AnyText(""), "blob": b""}, "beside")]
)
def test_a_file_has_content_or_a_blob(params: dict[str, Any], says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        FileParams(**params)


def test_a_blob_is_written_as_the_same_text_would_be() -> None:
    text, module = "hello\n", MODULES["file"]
    one, other = FileParams(content=AnyText(text)), FileParams(blob=text.encode())
    name = "/var/lib/srprov/x/hosts"
    assert module.check(name, one, None) == module.check(name, other, None)
    assert (one.text, one.data) == (other.text, other.data)
    assert module.between(one, other) == ()
