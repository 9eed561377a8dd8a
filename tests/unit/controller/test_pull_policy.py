"""`pull_policy`: what each value does to a plan."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from srprov.controller.pull_policy import with_fresh
from srprov.definitions import check_files, load_experiment
from srprov.errors import RefusedError, UsageError
from srprov.wire import AnyQuery, EngineQuery, Reply

DIGEST = "sha256:" + "1" * 64


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.cdf").write_text("cdf: 1\nbase: debian\npull_policy: always\n")
    return tmp_path


def _edf(*services: str) -> str:
    Path("e.edf").write_text("edf: 1\nname: demo\nservices:\n" + "".join(f"  {one}\n" for one in services))
    return "e.edf"


def test_always_puts_in_what_the_tags_are_now_and_asks_robots_that_run_them(here: Path) -> None:
    asked: list[tuple[str, str]] = []

    def ask(questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        replies = {}
        for host, queries in questions.items():
            assert all(isinstance(one, EngineQuery) for one in queries)
            asked.extend((host, one.path) for one in queries if isinstance(one, EngineQuery))
            platforms = [{"os": "linux", "architecture": "amd64"}]
            body = json.dumps({"Descriptor": {"digest": DIGEST}, "Platforms": platforms})
            replies[host] = [Reply(status=200, ok=True, out=body)] * len(queries)
        return replies

    read = load_experiment(
        _edf("a: {cdf: a.cdf}", "b: {image: busybox, pull_policy: always}", "c: {image: busybox}"), {}
    )
    placed = {"a": "r1", "b": "r2", "c": "r3"}
    definitions, experiment, notes = with_fresh(read, read.experiment, placed, placed.values(), ask, ())
    assert notes == ()
    assert next(iter(definitions.containers.values())).base == f"debian@{DIGEST}"
    assert (experiment.services["b"].image, experiment.services["c"].image) == (f"busybox@{DIGEST}", "busybox")
    assert {host for host, _ in asked} == {"r1", "r2"}
    assert definitions.platforms == {f"{name}@{DIGEST}": ("linux/amd64",) for name in ("busybox", "debian")}
    asked.clear()
    same = with_fresh(read, read.experiment, placed, ["r3"], ask, ())
    assert same == (read, read.experiment, ()) and not asked, "nobody who runs them answers"
    with pytest.raises(UsageError, match="what busybox:latest is now, no robot could learn"):
        with_fresh(read, read.experiment, placed, placed.values(), lambda _questions: {}, ())
    local = load_experiment(_edf('a: {image: "127.0.0.1:9998/x", pull_policy: always}'), {})
    with pytest.raises(RefusedError, match="engine-fetch"):
        with_fresh(local, local.experiment, placed, placed.values(), ask, ())
    assert not asked


def test_a_robot_says_what_others_get_only_where_these_say_the_same(here: Path) -> None:
    """One of two services of a definition wants the newest, and its robot alone would pick the base of both."""

    def ask(questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        said = {host: json.dumps({"Descriptor": {"digest": f"sha256:{host[1] * 64}"}}) for host in questions}
        return {
            host: [Reply(status=200, ok=True, out=said[host])] * len(queries) for host, queries in questions.items()
        }

    read = load_experiment(_edf("a: {cdf: a.cdf}", "b: {cdf: a.cdf, pull_policy: missing}"), {})
    with pytest.raises(UsageError, match="robots disagree about debian"):
        with_fresh(read, read.experiment, {"a": "r1", "b": "r2"}, ["r1", "r2"], ask, ())


def test_a_digest_that_one_robot_alone_says_is_noted(here: Path) -> None:
    """Where another one cannot look it up, as its way to the registry is gone, it gets what that one likes."""
    known = Reply(status=200, ok=True, out=json.dumps({"Descriptor": {"digest": DIGEST}}))
    placed = {"a": "r1", "b": "r2"}
    read = load_experiment(_edf(*(f"{one}: {{image: busybox, pull_policy: always}}" for one in placed)), {})
    for other in ([Reply(status=500, ok=False, err="no way")], None):
        answers = {"r1": [known]} | ({"r2": other} if other else {})
        _, experiment, notes = with_fresh(
            read, read.experiment, placed, placed.values(), lambda _, said=answers: said, ()
        )
        assert experiment.services["b"].image == f"busybox@{DIGEST}"
        assert notes == ("what busybox:latest is now r1 alone says: no registry told it to r2",)


@pytest.mark.parametrize("policy", ["missing", "if_not_present", "always", "never"])
def test_values_of_compose_are_taken(here: Path, policy: str) -> None:
    read = load_experiment(_edf(f"a: {{image: busybox, pull_policy: {policy}}}"), {})
    assert read.experiment.services["a"].runtime.pull_policy == policy.replace("if_not_present", "missing")
    assert read.unsupported == ()


@pytest.mark.parametrize("policy", ["daily", "weekly", "every_12h", "sometimes"])
def test_a_plan_has_no_clock(here: Path, policy: str) -> None:
    (problem,) = check_files([_edf(f"a: {{image: busybox, pull_policy: {policy}}}")])
    assert problem.location.line == 4 and "a plan has no clock" in problem.message


def test_a_ready_image_is_not_built(here: Path) -> None:
    (problem,) = check_files([_edf("a: {image: busybox, pull_policy: build}")])
    assert (problem.location.line, problem.path) == (4, "services.a.pull_policy")
    (here / "b.cdf").write_text("cdf: 1\nimage: busybox\npull_policy: build\n")
    (problem,) = check_files([_edf("a: {cdf: b.cdf}")])
    assert (problem.location.file, problem.location.line) == ("b.cdf", 3)
    assert check_files([_edf("a: {cdf: a.cdf, pull_policy: build}")]) == []
