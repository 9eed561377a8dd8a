"""What a plan's line says of a container, or an image, that is made: whole, whatever its author calls a secret."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.cli.output import clean
from srprov.cli.plan import show_plan
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, kept_plan
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Definitions
from srprov.errors import UsageError
from srprov.images.context import context_tar
from srprov.modules.image import ImageParams
from srprov.planning.markdown import plan_markdown
from srprov.planning.plan import Plan, Step, plan_json
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.planning.steps import step_of
from srprov.planning.text import plan_text
from srprov.report.page import page
from srprov.report.read import of_plan
from srprov.resource import Action, Change, Resource
from srprov.secret import Secret, forget
from tests.fakes import World
from tests.worlds import experiment, fleet, made, plan_for, service

PRIVATE = "reg.lab.example/private/nav:1.2"
LAST = "127.0.0.1:5000:5000/tcp"
PORTS = (*(("", 8000 + 2 * one, 80, "tcp") for one in range(200)), ("127.0.0.1", 5000, 5000, "tcp"))
TOLD = f"image {PRIVATE}; publishes 8000:80/tcp, 8002:80/tcp, "


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    yield
    forget()


def step(action: Action, cause: str, want: Resource) -> Step:
    change = Change(action=action, cause=cause)
    return replace(step_of(want, change), number=1)


def container() -> Resource:
    """Return a container that somebody wants."""
    bag = Mount(kind="volume", source="bag", target="/bag")
    what = experiment(service("a", image=PRIVATE, ports=PORTS, mounts=(bag,)))
    plan = plan_for(World().add("r1"), what)
    return next(one.want for one in plan.steps if one.want is not None and one.module == "container")


def built(context: bytes) -> Resource:
    """Return an image that somebody wants."""
    return replace(container(), module="image", name="srprov/a:1", params=ImageParams(source="build", blob=context))


@pytest.mark.parametrize("action", [Action.CREATE, Action.REPLACE])
def test_neither_a_length_nor_a_secret_hides_what_a_container_runs_and_publishes(action: Action) -> None:
    want = container()
    new = step(action, "ports differ", want)
    for one in (new.makes, LAST, PRIVATE, f"; image {PRIVATE}", "volume bag"):
        Secret(one)
    plan = Plan(instance="x", source="here", steps=(new,))
    line = next(one for one in plan_text(plan, hide=clean).splitlines() if "#1" in one)
    assert TOLD in line and line.endswith(f", 8398:80/tcp, {LAST}; mounts volume bag at /bag")
    text = plan_markdown(plan, hide=clean).replace("\\", "")
    assert TOLD in text and f"{LAST}; mounts volume bag at /bag |" in text


def test_a_name_by_which_others_find_a_container_is_told() -> None:
    """An engine answers to it on that robot: a container of a plan from elsewhere was called as a host of others."""
    what = experiment(service("a", hostname="vault.lab.example"), service("b"))
    told = {one.name: one.makes for one in plan_for(World().add("r1"), what).steps if one.module == "container"}
    assert told["srprov.hello.a"] == "image busybox:latest; hostname vault.lab.example"
    assert told["srprov.hello.b"] == "image busybox:latest"


def test_a_cause_is_hidden_where_it_may_hold_a_secret() -> None:
    """As one that a robot says."""
    Secret("hunter2-is-a-password")
    said = step(Action.REPLACE, "it said hunter2-is-a-password", container())
    shown = plan_text(Plan(instance="x", source="here", steps=(said,)), hide=clean)
    assert "hunter2" not in shown and f"it said ***; image {PRIVATE}" in shown


def test_the_plan_says_what_an_image_is_built_of() -> None:
    """A robot may have it by a login of its owner's."""
    text = f"FROM {PRIVATE} AS one\nFROM debian:bookworm\nCOPY --from=one /x /x\nCOPY --from=tool:1 /y /y\n"
    want = built(context_tar(text, ()))
    Secret(PRIVATE)
    shown = plan_text(Plan(instance="x", source="here", steps=(step(Action.CREATE, "built here", want),)), hide=clean)
    assert f"built here; made of debian:bookworm, {PRIVATE}, tool:1" in shown


@pytest.mark.parametrize("blob", [b"no tar", b"\0" * 1024])
def test_a_context_that_is_none_says_nothing(blob: bytes) -> None:
    plan = Plan(instance="x", source="here", steps=(step(Action.CREATE, "built here", built(blob)),))
    assert "built here\n" in plan_text(plan)


def test_no_secret_hides_it_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    want = container()
    anew = step(Action.REPLACE, "robots say this", want)
    image = step(Action.CREATE, "built here", built(context_tar(f"FROM {PRIVATE}\n", ())))
    for one in (anew.makes, LAST, PRIVATE, "volume bag", "robots say this"):
        Secret(one)
    plan = Plan(instance="x", source="here", steps=(image, replace(anew, number=2)))
    show_plan(plan, plan_json(plan), verbose=False)
    steps = json.loads(capsys.readouterr().out)["steps"]
    assert [(one["cause"], one["makes"]) for one in steps] == [
        ("built here", f"made of {PRIVATE}"),
        ("***", anew.makes),
    ]


def test_a_page_of_a_plan_says_it(tmp_path: Path) -> None:
    """It has the commands of no step, and may be all that is looked at before `apply`."""
    image = step(Action.CREATE, "built here", built(context_tar(f"FROM {PRIVATE}\n", ())))
    anew = replace(step(Action.REPLACE, "volumes differ", container()), number=2)
    plan = Plan(instance="x", source="here", steps=(image, anew))
    text = page(of_plan(tmp_path / "plan.json", dump(PlanFile(plan=plan, fingerprints={})).encode()))
    assert f"built here; made of {PRIVATE}" in text
    assert f"volumes differ; {TOLD}" in text and f"{LAST}; mounts volume bag at /bag" in text


@pytest.mark.parametrize("other", ["image busybox", ""])
def test_a_plan_file_that_says_something_else_of_it_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world, what = World().add("r1"), experiment(service("a", image=PRIVATE))
    planned = made(world, Definitions(experiment=what, containers={}), PlanRequest(exact=True, adopt=True))
    saved = load(dump(kept_plan(replace(planned, definitions=None))), "plan.json")
    check_plan(saved, fleet(world), adopt=True)
    steps = tuple(replace(one, makes=other) if one.makes else one for one in saved.plan.steps)
    with pytest.raises(UsageError, match=f"makes.*{PRIVATE}"):
        check_plan(replace(saved, plan=replace(saved.plan, steps=steps)), fleet(world), adopt=True)
