"""Which values a plan changes: exactly those, in the user's words, read where something changes and nowhere else."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.old_values import _is_masked, as_reviewed, masked, without_old_lines
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.definitions.model import Definitions
from srprov.errors import StalePlan, UsageError
from srprov.modules import MODULES
from srprov.planning.plan import Plan, Step, plan_json
from srprov.planning.planfile import dump
from srprov.planning.planhash import check_hash, expected_hash, plan_hash
from srprov.planning.planread import load
from srprov.planning.text import plan_text
from srprov.resource import Action, Difference
from srprov.secret import Secret, forget
from srprov.wire import EngineQuery
from tests.fakes import World
from tests.worlds import CHECK, Experiment, Mount, apply, experiment, fleet, made, plan_for, service

BASE: dict[str, Any] = {
    "robot": "r1",
    "command": ("serve", "--level", "1"),
    "environment": {"RATE": "2", "NAME": "a b", "OLD": "x"},
    "ports": (("", 8080, 80, "tcp"),),
}


@pytest.fixture(autouse=True)
def _none_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Secrets are known to the whole process, owners to the user: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    forget()
    yield
    forget()


def one(**fields: Any) -> Experiment:
    """Return an experiment of one service."""
    return experiment(service("web", **{**BASE, **fields}))


def running(what: Experiment | None = None, *more: str) -> World:
    """Return a robot on which it runs."""
    world = World().add("r1", *more)
    assert apply(world, what or one()).exit_code == 0
    return world


def step_of(plan: Plan, kind: str = "container") -> Step:
    """Return the plan's one step of a kind."""
    (step,) = (step for step in plan.steps if step.module == kind and step.want)
    return step


def told(plan: Plan, kind: str = "container") -> dict[str, tuple[str | None, str | None] | str]:
    """Return field -> old and new value, or the note."""
    return {d.field: d.note or (d.old, d.new) for d in step_of(plan, kind).differences}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"environment": {"RATE": "4", "NAME": "a b", "OLD": "x"}}, {"environment.RATE": ("2", "4")}),
        (
            {"environment": {"RATE": "2", "NAME": "a b", "NEW": ""}},
            {"environment.NEW": (None, '""'), "environment.OLD": ("x", None)},
        ),
        ({"command": ("serve", "a b")}, {"command": ("serve --level 1", "serve 'a b'")}),
        ({"command": None}, {"command": ("serve --level 1", None)}),
        ({"entrypoint": ("run",)}, {"entrypoint": (None, "run")}),
        ({"ports": (("127.0.0.1", 9090, 80, "tcp"),)}, {"ports": ("8080:80/tcp", "127.0.0.1:9090:80/tcp")}),
        ({"image": "busybox:1.36"}, {"image": ("busybox:latest", "busybox:1.36")}),
        ({"restart": "on-failure:3"}, {"restart": ("no", "on-failure:3")}),
        ({"user": "1000", "working_dir": "/w"}, {"user": (None, "1000"), "working_dir": (None, "/w")}),
        ({"mem_limit": 1 << 26, "cpus": 0.5}, {"mem_limit": (None, "64m"), "cpus": (None, "0.5")}),
        ({"cap_add": ("NET_ADMIN",)}, {"cap_add": (None, "NET_ADMIN")}),
        ({"privileged": True}, {"privileged": (None, "true")}),
        ({"expose": ((99, "tcp"),)}, {"expose.99/tcp": (None, "exposed")}),
        ({"labels": {"team": "a"}}, {"labels.team": (None, "a")}),
        ({"shm_size": 1 << 27}, {"shm_size": ("64m", "128m")}),
        ({"stop_grace_s": 3.0}, {"stop_grace_period": ("10s", "3s")}),
        (
            {"healthcheck": CHECK},
            {
                "healthcheck.test": (None, "CMD true"), "healthcheck.interval": (None, "1s"),
                "healthcheck.timeout": (None, "1s"), "healthcheck.retries": (None, "3"),
            },
        ),
        (
            {"mounts": (Mount(kind="bind", source="/d", target="/data"), Mount(kind="tmpfs", source="", target="/t"))},
            {"volumes./data": (None, "bind /d"), "tmpfs./t": (None, "no options")},
        ),
        ({"devices": (("/dev/x", "/dev/y", "rw"),)}, {"devices": (None, "/dev/x:/dev/y:rw")}),
        ({"network": "host", "ports": ()}, {}),
    ],
    ids=lambda value: ",".join(value) if isinstance(value, dict) else None,
)  # fmt: skip
def test_exactly_what_changes_is_told(fields: dict[str, Any], expected: dict[str, Any]) -> None:
    """One field of a service changed: that one, and nothing that the engine or the image fills in."""
    before = one() if "image" not in fields else one(image="busybox")
    found = told(plan_for(running(before), one(**fields)))

    if "network" in fields:
        assert found["network"] == ("overlay", "host")
        assert found["ports"] == ("8080:80/tcp", None)
    else:
        assert found == expected


def test_the_text_has_a_line_for_each() -> None:
    """Field, old and new; what would be misread is quoted."""
    plan = plan_for(running(), one(environment={"RATE": "4", "NAME": "", "OLD": " x"}))
    lines = plan_text(plan).splitlines()

    at = next(n for n, line in enumerate(lines) if "container srprov.hello.web: environment differs" in line)
    assert lines[at + 1 : at + 4] == [
        '      environment.NAME: a b -> ""',
        '      environment.OLD: x -> " x"',
        "      environment.RATE: 2 -> 4",
    ]


def test_nothing_to_do_asks_nothing_more() -> None:
    """A plan of what is right already inspects no container."""
    world = running()
    world.log.clear()

    assert plan_for(world, one()).empty
    asked = [entry.what for entry in world.log if isinstance(entry.what, EngineQuery)]
    assert asked
    assert not [query for query in asked if query.path.startswith("/containers/srprov.")]


def test_what_cannot_be_read_is_said() -> None:
    """A container that went away between two questions: its step stands, with a note."""
    world = running()
    engine = world.robots["r1"].engine
    whole = engine._inspect
    engine._inspect = lambda name: whole("gone")  # type: ignore[method-assign]

    assert told(plan_for(world, one(command=("b",)))) == {"container": "its old values were not read"}


def test_a_service_that_moves_and_changes_tells_its_values() -> None:
    """The old ones are on the robot that it leaves."""
    world = running(one(), "r2")

    plan = plan_for(world, one(robot="r2", environment={**BASE["environment"], "RATE": "4"}))

    assert step_of(plan).host == "r2"
    assert told(plan)["environment.RATE"] == ("2", "4")


def shipped(path: Path) -> Experiment:
    return one(mounts=(Mount(kind="tree", source=str(path), target="/etc/app", read_only=True),))


def test_a_shipped_file_is_shown_as_a_diff(tmp_path: Path) -> None:
    """Old lines and new ones; of one that is no text its size and hash."""
    path = tmp_path / "app.yml"
    path.write_text("a: 1\nrate: 2\nz: 3\n")
    world = running(shipped(path))
    path.write_text("a: 1\nrate: 4\nz: 3\n")

    plan = plan_for(world, shipped(path))

    (found,) = step_of(plan).differences
    assert found.field == "volumes./etc/app"
    assert found.diff == ("@@ -1,3 +1,3 @@", " a: 1", "-rate: 2", "+rate: 4", " z: 3")
    assert "        -rate: 2\n        +rate: 4\n" in plan_text(plan)

    path.write_bytes(b"\0\xff")
    (found,) = step_of(plan_for(world, shipped(path))).differences
    assert found.note.startswith("no text; new: ")


def test_of_a_shipped_folder_the_names_are_shown(tmp_path: Path) -> None:
    """What is changed, new and gone; not what is as it was."""
    folder = tmp_path / "conf"
    (folder / "sub").mkdir(parents=True)
    for name, text in {"same": "s", "sub/edited": "1", "gone": "g"}.items():
        (folder / name).write_text(text)
    world = running(shipped(folder))
    (folder / "gone").unlink()
    (folder / "sub" / "edited").write_text("2")
    (folder / "new").write_text("n")

    (found,) = step_of(plan_for(world, shipped(folder))).differences

    assert found.note == "1 changed: sub/edited; 1 new: new; 1 gone: gone"


def test_secrets_are_in_no_difference() -> None:
    """A known value, a name or a form that says secret: neither the old nor the new one is shown."""
    Secret("canary-8271")
    world = running(
        one(environment={"DB_PASSWORD": "first-1", "URL": "http://u:pw123456@h/", "A": "canary-8271", "B": "b"})
    )

    plan = plan_for(
        world,
        one(environment={"DB_PASSWORD": "second-2", "URL": "http://h/", "A": "plain", "B": "is canary-8271"}),
    )

    found = told(plan)
    assert found["environment.DB_PASSWORD"] == found["environment.B"] == "secret, changed"
    assert found["environment.A"] == ("***", "plain")
    shown = json.dumps([d.field + str(d.old) + str(d.new) + d.note for d in step_of(plan).differences])
    for hidden in ("canary-8271", "first-1", "second-2", "pw123456"):
        assert hidden not in shown


def test_a_secret_in_a_file_hides_its_lines() -> None:
    """A value that is known hides all of the diff; what only looks like one is masked in its line."""
    Secret("canary-8271")

    assert masked(Difference(field="content", diff=("-a", "+canary-8271"))).note == "a secret stands in it: not shown"
    assert masked(Difference(field="content", diff=("-password: hunter22", "+x"))).diff == ("-password: ***", "+x")


def kept(world: World, what: Experiment) -> str:
    request = PlanRequest(exact=True, adopt=True)
    planned = made(world, Definitions(experiment=what, containers={}), request)
    return dump(plan_file(replace(planned, definitions=None)))


def test_a_plan_file_tells_the_values_and_cannot_lie() -> None:
    """They are derived again from the robots when it is applied; others in the file are refused by name."""
    world = running()
    text = kept(world, one(environment={**BASE["environment"], "RATE": "4"}))
    step = next(step for step in json.loads(text)["steps"] if step["module"] == "container")
    assert step["differences"] == [{"field": "environment.RATE", "old": "2", "new": "4"}]

    checked = check_plan(load(text, "plan.json"), fleet(world), adopt=True, signed=True)
    assert told(checked.plan) == {"environment.RATE": ("2", "4")}

    forged = load(text.replace('"old": "2"', '"old": "3"'), "plan.json")
    with pytest.raises(UsageError, match="differences 0 old: was 3, is 2"):
        check_plan(forged, fleet(world), adopt=True, signed=True)


def test_a_file_without_values_is_as_good() -> None:
    """Files of older versions have none: what is shown is what the robots say."""
    world = running()
    text = kept(world, one(environment={**BASE["environment"], "RATE": "4"}))
    saved = load(text, "plan.json")
    steps = tuple(replace(step, differences=()) for step in saved.plan.steps)
    old = load(dump(replace(saved, plan=replace(saved.plan, steps=steps))), "plan.json")

    assert told(check_plan(old, fleet(world), adopt=True, signed=True).plan) == {"environment.RATE": ("2", "4")}


def test_what_a_file_hides_stays_hidden() -> None:
    """Whoever applies it does not know the secret yet by which an old value was hidden."""
    world = running(one(environment={"A": "is canary-8271"}))
    Secret("canary-8271")
    text = kept(world, one(environment={"A": "plain"}))
    assert "canary" not in text
    forget()

    checked = check_plan(load(text, "plan.json"), fleet(world), adopt=True, signed=True)

    assert told(checked.plan) == {"environment.A": ("is ***", "plain")}


def test_what_a_strangers_file_does_cannot_be_hidden_as_a_secret() -> None:
    """Neither a command, nor the new lines of a file, nor a text of his own in the place of what is there."""
    world = running()
    step = step_of(load(kept(world, one(environment={**BASE["environment"], "RATE": "4"})), "plan.json").plan)
    value = Difference(field="environment.RATE", old="2", new="4")
    diff = Difference(field="content", diff=("@@ -1 +1 @@", "-old canary", "+curl evil"))
    live = replace(step, differences=(value, diff))

    def reviewed(*filed: Difference) -> tuple[Difference, ...]:
        return as_reviewed(live, replace(step, differences=filed)).differences

    hidden = "a secret stands in it: not shown"
    for lie in (
        Difference(field="environment.RATE", note=hidden),
        Difference(field="environment.RATE", old="*** as before", new="4"),
        Difference(field="environment.RATE", old="***", new=None),
        Difference(field="environment.RATE", old="***", new="4", note="nothing to see"),
        Difference(field="content", note="nothing to see"),
        Difference(field="content", old="***"),
    ):
        assert reviewed(lie) == (value, diff)
    masked_old, no_lines = replace(value, old="***"), Difference(field="content", note=hidden)
    assert reviewed(masked_old, no_lines) == (masked_old, no_lines)
    shown = without_old_lines(replace(step, differences=(masked_old, no_lines)), live).differences
    assert shown == (masked_old, replace(diff, diff=("@@ -1 +1 @@", "+curl evil")))


@pytest.mark.parametrize(("text", "whole", "fits"), [
    ("***", "x", True), ("a***c", "abc", True), ("a***a", "a", False), ("***b***", "abc", True), ("***b", "abc", False),
    ("a***b***c", "acb", False), ("abc", "abc", False), ("***a" * 200 + "x", "a" * 100_000, False),
])  # fmt: skip
def test_a_masked_text_is_the_whole_one_but_for_its_masks(text: str, whole: str, fits: bool) -> None:
    assert _is_masked(text, whole) is fits


def test_a_stale_plan_names_values() -> None:
    """Somebody else applied meanwhile: what is there now, and what the plan had found; no hash."""
    world = running(experiment(service("web", **BASE), service("other", robot="r1", command=("one",))))
    now = experiment(
        service("web", **{**BASE, "environment": {"RATE": "4"}}), service("other", robot="r1", command=("one",))
    )
    saved = load(kept(world, now), "plan.json")
    theirs = experiment(
        service("web", **{**BASE, "environment": {**BASE["environment"], "RATE": "3"}}),
        service("other", robot="r1", command=("two",)),
    )
    assert apply(world, theirs).exit_code == 0

    with pytest.raises(StalePlan) as refused:
        check_plan(saved, fleet(world), adopt=True, signed=True)

    lines = refused.value.message.splitlines()
    assert "  r1: container:srprov.hello.web: environment.RATE: was 2, is 3" in lines
    assert "  r1: container:srprov.hello.other: command: was one, is two" in lines
    assert not [line for line in lines if " hash" in line or " parts" in line]


def test_the_hash_is_of_what_is_done() -> None:
    """Two plans of one state have the same; another value, and it is another one; notes and causes do not count."""
    world = running()
    first, second = (plan_for(world, one(command=("b",))) for _ in range(2))
    other = plan_for(world, one(command=("c",)))

    assert plan_hash(first) == plan_hash(second) == plan_hash(replace(first, notes=("n",), cost=9.0))
    assert plan_hash(other) != plan_hash(first)
    check_hash(first, expected_hash(f"sha256:{plan_hash(first)}"))
    check_hash(first, expected_hash(plan_hash(first)[:32].upper()))
    with pytest.raises(StalePlan, match="not the plan that was reviewed"):
        check_hash(other, expected_hash(plan_hash(first)))
    for wrong in ("abc", "x" * 64, plan_hash(first)[:15], "0" * 65):
        with pytest.raises(UsageError):
            expected_hash(wrong)


def test_json_tells_old_and_new() -> None:
    """Null stands for what is not set."""
    plan = plan_for(running(), one(environment={"RATE": "2", "NAME": "a b"}))

    (step,) = (step for step in plan_json(plan)["steps"] if step["module"] == "container")
    assert step["differences"] == [{"field": "environment.OLD", "old": "x", "new": None}]


@pytest.mark.parametrize(
    ("above", "line", "beside"),
    [
        ("", "203.0.113.9\tdb", ""),
        ("", "203.0.113.9\tdb", "#-----BEGIN PRIVATE KEY-----\n#AAAA\n#-----END PRIVATE KEY-----\n"),
        ("".join(f"10.128.255.{n}\tsensor{n}\n" for n in range(100)), "203.0.113.9\tdb", ""),
        ("", "203.0.113.9\tdb", "# maps\n" * 1600),
        ("", "203.0.113.9\tdb", f"#{'x' * 70_000}\n"),
        ("", "203.0.113.9\tdb", "#\ufffd\n"),
        ("", f"203.0.113.9\t{'camera ' * 60}db", ""),
    ],
    ids=["plainly", "secret", "behind many lines", "too many lines", "too long", "no text", "at the end of a line"],
)
def test_what_changes_in_srprovs_own_files_is_shown_of_a_plan_from_elsewhere(
    above: str, line: str, beside: str
) -> None:
    """Its writer could have one service take his host for another one, and the plan said `srprov's own file`."""
    both = (service("db", robot="r1"), service("web", robot="r2"))
    world = running(experiment(*both), "r2")
    text = kept(world, experiment(*both, service("new", robot="r2")))
    step = next(one for one in load(text, "plan.json").plan.steps if one.id == "r2/file:/var/lib/srprov/hello/hosts")
    assert step.want is not None
    lines = step.want.params.text.splitlines(keepends=True)
    his = above + "".join(f"{line}\n" if one.endswith("\tdb\n") else one for one in lines) + beside
    written = {**step.want.written, "content": his}
    want = replace(step.want, params=replace(step.want.params, content=his), written=written)
    change = MODULES["file"].check(want.name, want.params, step.change.before)
    assert change is not None
    saved = load(text, "plan.json")
    steps = tuple(replace(one, want=want, change=change) if one == step else one for one in saved.plan.steps)
    theirs = replace(saved, plan=replace(saved.plan, steps=steps))
    shown = plan_text(check_plan(theirs, fleet(world), adopt=True, signed=True).plan)
    assert f"\n        +{line}\n".replace("\t", "\\t") in shown
    assert "placement.json" not in shown
    assert "203.0.113.9" not in plan_text(check_plan(saved, fleet(world), adopt=True, signed=True).plan)


def test_what_is_in_a_new_file_of_srprovs_own_is_shown_of_a_plan_from_elsewhere() -> None:
    """The plan moves `web` to a robot that has no hosts file yet, and said `srprov's own file: 1 to add` of it."""
    world = running(experiment(service("db", robot="r1"), service("web", robot="r2")), "r2", "r3")
    moved = experiment(service("db", robot="r1"), service("web", robot="r3"))
    saved = load(kept(world, moved), "plan.json")
    step = next(one for one in saved.plan.steps if one.id == "r3/file:/var/lib/srprov/hello/hosts")
    assert step.want is not None and step.change.action is Action.CREATE
    his = re.sub(r"(?m)^.*\tdb$", "203.0.113.9\tdb", step.want.params.text)
    written = {**step.want.written, "content": his}
    want = replace(step.want, params=replace(step.want.params, content=his), written=written)
    change = MODULES["file"].check(want.name, want.params, None)
    assert change is not None
    steps = tuple(replace(one, want=want, change=change) if one == step else one for one in saved.plan.steps)
    plan = check_plan(replace(saved, plan=replace(saved.plan, steps=steps)), fleet(world), adopt=True, signed=True).plan
    assert "\n        +203.0.113.9\\tdb\n" in plan_text(plan)
    assert "placement.json" not in plan_text(plan)
    assert "content:" not in plan_text(plan_for(world, moved))


def test_what_changes_in_srprovs_own_files_follows_from_the_definitions_here() -> None:
    both = (service("db", robot="r1"), service("web", robot="r2"))
    world = running(experiment(*both), "r2")
    plan = plan_for(world, experiment(*both, service("new", robot="r2")), adopt=True)
    assert "srprov's own file" in plan_text(plan) and "content:" not in plan_text(plan)
