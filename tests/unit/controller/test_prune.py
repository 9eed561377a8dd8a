"""Which images on robots are srprov's, and which of those go: never one that somebody uses, or did not get from us."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.codes import Code
from srprov.controller.image_rows import rows
from srprov.controller.prune import choose, freed_by
from srprov.controller.stored_images import RobotStore, StoredImage, stores
from srprov.errors import TransportError, UsageError
from srprov.execution import Outcome
from srprov.record.wanted import named_images
from srprov.wire import EngineQuery, Reply
from tests.bounded import bounded

MIB = 1 << 20
BASE, TOP, OTHER = (f"sha256:{letter * 64}" for letter in "abc")
"""Diff ids."""
OURS = {"srprov.cdf": "x", "srprov.instance": ""}
PART = {"srprov.instance": ".build"}
ENDS = "/bin/sh -c #(nop)  LABEL srprov.instance="


def key(number: int) -> str:
    return f"sha256:{number:064x}"


class Engine:
    """A robot's engine with images and containers, as a reader."""

    host = "r1"

    def __init__(self) -> None:
        self.images: list[dict[str, Any]] = []
        self.layers: dict[str, list[str]] = {}
        self.last: dict[str, str] = {}
        self.containers: list[dict[str, Any]] = []
        self.round_trips = 0

    def add(
        self, number: int, *tags: str, labels: Any = None, layers: Sequence[str] = (BASE,), parent: int = 0,
        last: str = ENDS, created: int = 1000, digests: Sequence[str] = (),
    ) -> Engine:  # fmt: skip
        """Add an image with layers of 1 MiB each."""
        item = {"Id": key(number), "ParentId": key(parent) if parent else "", "Labels": labels, "Created": created}
        self.images.append({**item, "RepoTags": list(tags) or None, "RepoDigests": [*digests], "Size": 5 * MIB})
        self.layers[key(number)], self.last[key(number)] = list(layers), last
        return self

    def contain(self, number: int, name: str, instance: str = "") -> Engine:
        labels = {"srprov.instance": instance} if instance else {}
        self.containers.append({"ImageID": key(number), "Names": [f"/{name}"], "Labels": labels, "State": "exited"})
        return self

    def ask(self, queries: Sequence[Any]) -> list[Reply]:
        self.round_trips += 1
        return [Reply(status=200, out=json.dumps(self._answer(query))) for query in queries]

    def _answer(self, query: EngineQuery) -> Any:
        if query.path == "/containers/json":
            return self.containers
        if query.path == "/images/json":
            parents = {one["ParentId"] for one in self.images}
            every = dict(query.params)["all"] == "true"
            return [one for one in self.images if every or one["RepoTags"] or one["Id"] not in parents]
        _, _, image, what = query.path.split("/")
        if what == "json":
            return {"Id": image, "RootFS": {"Layers": self.layers[image]}, "Architecture": "arm64"}
        made = [{"Size": MIB, "CreatedBy": "x"} for _ in self.layers[image]]
        return [{"Size": 0, "CreatedBy": self.last[image]}, *made]


def fleet(**readers: Any) -> Any:
    return SimpleNamespace(
        forks=4, inventory=SimpleNamespace(hosts=readers), sessions=SimpleNamespace(get=readers.__getitem__)
    )


def store(engine: Engine, *, whole: bool = True) -> RobotStore:
    found, unreachable = stores(fleet(r1=engine), whole=whole)
    assert not unreachable
    return found["r1"]


def goes(engine: Engine, named: Any = (), **more: Any) -> list[str]:
    """Return what the engine is told to remove."""
    made = choose({"r1": store(engine)}, {}, dict.fromkeys(named, ("i",)), **more)
    return [command.path.removeprefix("/images/") for step in made.planned.plan.steps for command in step.commands]


A, B, C = (f"srprov/{letter}:{'0' * 15}{number}" for number, letter in enumerate("abc"))


def test_an_image_is_ours_by_its_content_tag_and_label_or_by_how_it_ends() -> None:
    """Whoever builds on one of ours inherits its labels; whoever names an image so has no label."""
    engine = Engine().add(1, A, labels=OURS).add(2, labels=OURS).add(3, labels=PART, parent=7)
    engine.add(4, "mine:1", labels=OURS).add(5, labels=OURS, last="/bin/sh -c make").add(6, B).add(7, "debian:12")
    engine.add(10, labels={**OURS, **PART}, last="/bin/sh -c make", parent=7)
    engine.add(8, "srprov/a:latest", labels=OURS).add(9, labels={"srprov.cdf": "x"}, last="LABEL srprov.instance=")
    assert [one.id for one in store(engine).images] == [key(1), key(2), key(3), key(9), key(10)]
    assert goes(engine) == [A, key(2), key(3), key(9), key(10)]


@pytest.mark.parametrize("names", [("published/base:1",), ()], ids=["named", "published anew"])
def test_what_is_built_on_a_published_image_with_the_mark_is_no_step_of_ours(names: tuple[str, ...]) -> None:
    """Somebody's older build, and what he kept of a container by `docker commit`, went with the first prune."""
    engine = Engine().add(1, *names, labels=PART).add(2, parent=1, labels=PART).add(3, parent=2, labels=PART)
    engine.add(4, labels=PART).add(5, parent=9, labels=PART).add(6, parent=6, labels=PART)
    engine.add(7, parent=2, labels=PART).add(8, A, parent=7, labels=OURS)
    assert goes(engine) == [A]
    assert [one.steps for one in store(engine).images] == [()]


@pytest.mark.parametrize(
    "why",
    [
        lambda engine: engine.contain(1, "srprov.i.s", "i"),
        lambda engine: engine.contain(1, "redis"),
        lambda engine: engine.images[0]["RepoTags"].append("mine:1"),
        lambda engine: engine.images[0]["RepoDigests"].append("registry.lab/a@sha256:1"),
    ],
)
def test_what_somebody_uses_or_named_stays(why: Any) -> None:
    """Also with a container that is stopped."""
    engine = Engine().add(1, A, labels=OURS, digests=["srprov/a@sha256:1"])
    assert goes(engine) == [A]
    why(engine)
    assert goes(engine) == []


def test_what_the_last_run_named_stays_and_what_is_too_new() -> None:
    engine = Engine().add(1, A, labels=OURS).add(2, B, labels=OURS, created=2000).add(3, labels=PART, parent=9)
    engine.add(9, "debian:12")
    assert goes(engine, named=[B]) == [A, key(3)]
    assert goes(engine, before=1500.0) == [A, key(3)]
    assert goes(engine, only={"srprov/b"}) == [B], "what has no name belongs to no experiment"


def test_the_newest_goes_first_with_the_steps_of_its_build_and_nothing_below_those() -> None:
    """The base has no name any more, and is somebody's; a step that has a name ends the row, and is a base itself."""
    engine = Engine().add(1).add(2, parent=1, labels=PART).add(3, parent=2, labels=PART)
    engine.add(4, A, parent=3, labels=OURS)
    engine.add(5, B, parent=4, labels=OURS, created=2000).add(6, "kept:1", labels=PART)
    engine.add(7, parent=6, labels=PART).add(8, C, parent=7, labels=OURS)
    assert goes(engine) == [B, A, key(3), key(2), C]
    made = choose({"r1": store(engine)}, {}, {})
    calls = [command for step in made.planned.plan.steps for command in step.commands]
    assert {call.method for call in calls} == {"DELETE"}  # type: ignore[union-attr]
    assert all(dict(call.params) == {"noprune": "true"} for call in calls)  # type: ignore[union-attr]
    assert all((409 in call.accept) == call.path.startswith("/images/sha256:") for call in calls)  # type: ignore[union-attr]


def test_only_layers_that_nothing_else_has_become_free() -> None:
    """Each once; those of others and of what stays are not counted, and what was not removed frees nothing."""
    engine = Engine().add(1, "debian:12").add(2, A, labels=OURS, layers=(BASE, TOP))
    engine.add(3, B, labels=OURS, layers=(BASE, TOP, OTHER)).add(4, C, labels=OURS, layers=(OTHER,))
    there = {"r1": store(engine)}
    made = choose(there, {}, {C: ["i"]})
    assert made.freed == {"r1": 2 * MIB} and made.stay == 1
    assert choose(there, {}, {}).freed == {"r1": 3 * MIB}
    assert there["r1"].bytes_of(there["r1"].images) == 4 * MIB

    steps = {step.name: step for step in made.planned.plan.steps}
    outcomes = {A: Outcome.CHANGED, B: Outcome.FAILED}
    result: Any = SimpleNamespace(results=[SimpleNamespace(step=steps[k], outcome=v) for k, v in outcomes.items()])
    assert freed_by(result, made, there) == 0, "the other one has the layer"


def test_a_list_takes_two_round_trips_and_one_where_nothing_is_ours() -> None:
    engine = Engine().add(1, "debian:12")
    assert store(engine, whole=False).images == () and engine.round_trips == 1
    engine.add(2, A, labels=OURS, parent=1).contain(2, "srprov.i.s", "i").contain(2, "other")
    seen = store(engine, whole=False)
    assert engine.round_trips == 3
    (one,) = seen.images
    assert (one.arch, one.instances, one.definition, one.bytes_) == ("arm64", ["i"], "x", 5 * MIB)
    now = dt.datetime.fromtimestamp(1000 + 7200, dt.timezone.utc)
    (row,) = rows("r1", seen.images, {A: ["i", "k"]}, now)
    assert row["used by"] == "i; a container of others; the last run of k" and row["built"] == "2 h ago"
    left = store(Engine().add(1).add(2, parent=1, labels=PART).contain(2, "pensive_curie", ".build"))
    (row,) = rows("r1", left.images, {}, now)
    assert row["used by"] == "a container that a build left" and row["image"].endswith("(no name)")


def test_a_robot_that_fails_is_a_reason_and_the_others_are_told() -> None:
    class Broken(Engine):
        def ask(self, queries: Sequence[Any]) -> list[Reply]:
            if self.images:
                raise TransportError("r2", "gone", hint="is it on?", code=Code.LOST)
            return [Reply(status=0, out="", err="no\nsocket", ok=False) for _ in queries]

    crowd = Engine()
    for number in range(501):
        crowd.add(number, f"x:{number}")
    robots = fleet(a=Engine().add(1, A, labels=OURS), b=Broken().add(1), c=Broken(), d=crowd)
    found, unreachable = stores(robots, whole=True)
    assert len(found["a"].images) == 1 and found.keys() == {"a"}
    assert unreachable["b"] == "gone [SRP-310]\n  is it on?" and "no socket" in unreachable["c"]
    assert "more than 500 images" in unreachable["d"]
    assert choose(found, unreachable, {}).planned.plan.unreachable == unreachable


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8) | st.sampled_from([A, key(1), "srprov.cdf"]),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(
        st.sampled_from(["Id", "ParentId", "RepoTags", "RepoDigests", "Labels", "srprov.cdf", "Created", "Size",
                         "Names", "ImageID", "RootFS", "Layers", "CreatedBy", "Architecture"]), inner, max_size=9),
    max_leaves=20,
)  # fmt: skip


@given(st.lists(JSON, min_size=1, max_size=6), st.booleans())
@settings(deadline=None)
def test_no_answer_of_a_robot_is_more_than_an_answer(answers: list[Any], valid: bool) -> None:
    class Liar(Engine):
        def ask(self, queries: Sequence[Any]) -> list[Reply]:
            said = [answers[number % len(answers)] for number in range(len(queries))]
            if valid and len(queries) == 2 and "all" in str(queries[0]):
                image = {"Id": key(1), "RepoTags": [A], "Labels": OURS, "ParentId": key(1)}
                said = [[{**image, **(answers[0] if isinstance(answers[0], dict) else {})}], answers]
            return [Reply(status=200, out=json.dumps(one)) for one in said]

    found, _ = stores(fleet(r1=Liar()), whole=True)
    made = choose(found, {}, {})
    for step in made.planned.plan.steps:
        assert all(call.path.startswith(("/images/srprov/", "/images/sha256:")) for call in step.commands)  # type: ignore[union-attr]


def test_a_robot_with_all_that_it_may_say_costs_little() -> None:
    """Chains of steps that share their ends are walked, each to its limit."""
    engine = Engine()
    for number in range(1, 6000):
        engine.add(number, parent=number + 1 if number % 50 else 5999, labels=PART)
    engine.add(6000, "debian:12").images[5998]["ParentId"] = key(6000)
    for number in range(10_000, 10_300):
        engine.add(number, f"srprov/a:{number:016x}", labels=OURS, parent=1, layers=(BASE,) * 120)
    calls = bounded(lambda: goes(engine))
    assert 300 < len(calls) == len(set(calls)) < 7000


def test_any_number_of_images_on_one_chain_of_steps_is_read_in_time() -> None:
    """Each went through the whole chain."""
    engine = Engine()
    for number in range(1, 501):
        engine.add(number, parent=number - 1, labels=PART)
    for number in range(1000, 6000):
        engine.add(number, parent=500, labels=PART)
    assert bounded(lambda: store(engine, whole=False)).images == ()


def record(root: Path, name: str, plan: Any, *, cut: bool = False) -> None:
    (root / name).mkdir(parents=True)
    (root / name / "environment.json").write_text("{}")
    if not cut:
        (root / name / "plan.json").write_text(plan if isinstance(plan, str) else json.dumps(plan))


def test_the_newest_record_of_each_instance_says_what_is_named(tmp_path: Path) -> None:
    """Built, pulled, and right already; a run that never had a plan does not count, a destroy names nothing."""
    image = {"module": "image", "name": B, "want": {"params": {"source": "pull"}}}
    old = {"contexts": {A: "x"}, "steps": [image], "also_wanted": []}
    new = {"contexts": {C: "x"}, "steps": [{"module": "file", "name": "f"}], "also_wanted": [image]}
    record(tmp_path, "20260101T000000Z-one-00000000", old)
    record(tmp_path, "20260102T000000Z-one-00000000", new)
    record(tmp_path, "20260103T000000Z-one-00000000", {}, cut=True)
    record(tmp_path, "20260101T000000Z-two-00000000", old)
    record(tmp_path, "20260101T000000Z-gone-00000000", old)
    record(tmp_path, "20260102T000000Z-gone-00000000", {"contexts": {}, "steps": []})
    record(tmp_path, "20260102T000000Z-.images-00000000", {"steps": [{**image, "want": None}]})
    assert named_images(tmp_path) == {A: {"two"}, B: {"one", "two"}, C: {"one"}}
    assert named_images(tmp_path / "none") == {}
    record(tmp_path, "20260104T000000Z-two-00000000", "[")
    with pytest.raises(UsageError, match="is no record that can be read") as told:
        named_images(tmp_path)
    assert "20260104T000000Z-two" in told.value.message


def test_an_image_says_who_it_is() -> None:
    one = StoredImage(id=key(1))
    assert one.names == (key(1),) and one.repositories == frozenset()
    assert StoredImage(id=key(1), tags=(A, B)).repositories == {"srprov/a", "srprov/b"}
