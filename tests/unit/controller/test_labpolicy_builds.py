"""A lab's policy and the robot that builds an image, which need not be the one that runs it."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.labpolicy import enforce
from srprov.controller.permissions import may_trigger
from srprov.images.context import context_tar
from srprov.modules.image import ImageParams
from srprov.planning.plan import Plan, Step
from srprov.planning.policy import Permission
from srprov.resource import Resource
from tests.unit.controller.test_labpolicy import ARMS, plan, policies, refused


def built_on(robot: str, text: str) -> Plan:
    """Return a plan in which a robot builds the image of a service that another one runs."""
    made = plan()
    image = next(step for step in made.steps if step.module == "image")
    build = Resource(
        host=robot, module="image", name="srprov/x:1", written={},
        params=ImageParams(source="build", blob=context_tar(text, ())),
    )  # fmt: skip
    return replace(made, steps=(replace(image, host=robot, name=build.name, want=build),))


@pytest.mark.parametrize(
    ("text", "asks"),
    [
        ("FROM debian\nADD http://127.0.0.1:8099/token /token\n", "engine-fetch"),
        ("FROM robot2:5000/x\n", "engine-fetch"),
        ("FROM debian\nCOPY --from=srprov/victim:1 /a /a\n", "built-image"),
        ("ARG X=debian\nFROM $X\n", "built-image"),
    ],
)
def test_what_a_build_asks_for_is_allowed_on_the_robot_that_builds(tmp_path: Path, text: str, asks: str) -> None:
    """`a` runs on r1, which may be asked; r2 is the first of its architecture, and has other images and neighbours."""
    given = policies(tmp_path, "allow:\n  all: []\n  arms: [engine-fetch, built-image]\n")
    assert f"policy.yml:2 does not allow {asks} on r2, which builds srprov/x:1" in refused(built_on("r2", text), given)
    for fine in (built_on("r1", text), built_on("r2", "FROM debian\nRUN x\n")):
        enforce(fine, ARMS, given)


def test_what_a_base_brings_runs_only_where_a_policy_allows_it(tmp_path: Path) -> None:
    """ONBUILD instructions stand in no plan, so the flag of one run counts on robots, not for all."""
    both = ("built-image", "engine-fetch")
    assert may_trigger(both, ARMS) == may_trigger(("all",), ARMS) == {"r1", "r2"}
    assert may_trigger(both[:1], ARMS) == set()
    given = policies(tmp_path, "allow:\n  all: [built-image]\n  arms: [all]\n", "allow: {all: [all]}\n")
    assert may_trigger(both, ARMS, given) == may_trigger(("all",), ARMS, given) == {"r1"}
    assert may_trigger(both, ARMS, policies(tmp_path, "limits: {pids: {max: 9}}\n", "")) == {"r1", "r2"}
    strict = policies(tmp_path, "allow:\n  arms: [all]\n", "allow: {all: [built-image]}\n")
    assert may_trigger(both, ARMS, strict) == set()


@pytest.mark.parametrize("kind", ["outside", "env", "git"])
def test_what_goes_into_an_image_is_allowed_on_the_robot_that_builds(tmp_path: Path, kind: str) -> None:
    """`a` runs on r1, and the files of its image are sent to r2: not where another service's image is built there."""
    asks = Permission(kind=kind, service="a", what="/home/me/notes")
    given = policies(tmp_path, f"allow:\n  all: []\n  arms: [{kind}]\n")
    made = plan()
    runs = next(step for step in made.steps if step.module == "container")
    assert runs.want
    built = replace(runs, want=replace(runs.want, params=replace(runs.want.params, image="srprov/x:1")))

    def on(robot: str, *more: Step) -> Plan:
        build = built_on(robot, "FROM debian\n")
        return replace(build, permissions=(asks,), steps=(*build.steps, *more))

    assert f"does not allow {kind} on r2" in refused(on("r2", built), given)
    assert f"does not allow {kind} on r2" in refused(on("r2"), given)
    for fine in (on("r1", built), on("r2", runs)):
        enforce(fine, ARMS, given)
