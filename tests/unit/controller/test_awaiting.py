"""What `srprov wait` awaits: how conditions are read, which services they mean, and when one holds or never can."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.controller.awaiting import Awaited, awaited, standing, wait
from srprov.controller.located import Located, Whereabouts, locate
from srprov.definitions.model import Experiment
from srprov.errors import UsageError
from srprov.execution.watching import Seen
from srprov.facts.gather import Detail
from srprov.trials.reading import Reading
from tests import worlds
from tests.fakes import Behaviour, World
from tests.worlds import CHECK, apply, experiment, fleet, service


def there(world: World, what: Experiment) -> Whereabouts:
    """Return where the services of an instance are."""
    with worlds.remembering_all(world):
        return locate(fleet(world).gather(Detail.BASIC), "hello", what)


def two_kinds() -> Experiment:
    """Return a service that runs twice, and one with a healthcheck."""
    return experiment(replace(service("drone"), replicas=2), service("base", robot="r1", healthcheck=CHECK))


def names(some: tuple[Located, ...]) -> list[str]:
    """Return services and robots in words."""
    return [one.where for one in some]


def test_a_name_means_a_service_all_its_replicas_one_of_them_or_the_one_of_a_robot() -> None:
    w = World().add("r1", "r2", "r3")
    apply(w, two_kinds())
    found = there(w, two_kinds())
    both = found.named(["drone"])
    assert [one.service for one in both] == ["drone-1", "drone-2"]
    assert names(found.named(["drone-2"])) == [both[1].where]
    assert names(found.named([f"drone@{both[1].host}"])) == [both[1].where]
    assert names(found.named(["drone", "drone-1", "base"])) == ["base on r1", *names(both)]
    assert len(found.named([])) == 3
    for wrong in ("nobody", "base@r2", "", "@r1"):
        with pytest.raises(UsageError, match="has no") as refused:
            found.named([wrong])
        assert "there are: base, drone-1, drone-2" in refused.value.hint
        assert "did you mean" not in refused.value.hint
    for near, meant in (("bse", "base"), ("dron@r1", "drone"), ("drone-3", "drone-2")):
        with pytest.raises(UsageError, match="has no") as refused:
            found.named([near])
        assert refused.value.hint.startswith(f"did you mean '{meant}'?")


def test_a_container_elsewhere_than_its_service_was_placed_is_meant_only_with_its_robot() -> None:
    """Any robot may run something that carries the name of another's service."""
    w = World().add("r1", "r2")
    what = experiment(service("base", robot="r1"))
    apply(w, what)
    name = "srprov.hello.base"
    w.robots["r2"].engine.containers[name] = w.robots["r1"].engine.containers[name]
    assert names(there(w, what).named(["base"])) == ["base on r1"]
    assert names(there(w, what).named([])) == ["base on r1"]
    assert names(there(w, what).named(["base@r2"])) == ["base on r2"]


def test_what_is_placed_on_a_robot_that_is_away_is_known_from_others() -> None:
    w = World().add("r1", "r2")
    what = experiment(service("base", robot="r1"), service("other", robot="r2"))
    apply(w, what)
    w.robots["r1"].gone = True
    assert names(there(w, what).named(["base"])) == ["base on r1"]


def test_what_is_no_condition_is_refused_with_the_forms_there_are() -> None:
    w = World().add("r1", "r2", "r3")
    apply(w, two_kinds())
    found = there(w, two_kinds())
    for wrong in ("", "base", "ended:base", "completed", "completed:", "completed:base=x", "log:base", "log:=x", "log"):
        with pytest.raises(UsageError):
            awaited([wrong], found)
    with pytest.raises(UsageError, match="no regular expression of RE2"):
        awaited([r"log:base=(a)\1"], found)
    (one, other) = awaited(["log:base=a=b: c", "completed:drone", "log:base=a=b: c"], found)
    assert (one.kind, one.pattern, names(one.services)) == ("log", "a=b: c", ["base on r1"])
    assert (other.kind, len(other.services)) == ("completed", 2)


def test_every_service_being_healthy_needs_one_with_a_healthcheck() -> None:
    w = World().add("r1", "r2", "r3")
    apply(w, two_kinds())
    (one,) = awaited(["healthy"], there(w, two_kinds()))
    assert one.every and len(one.services) == 3
    other = World().add("r1")
    apply(other, experiment(service("base")))
    with pytest.raises(UsageError, match="no running service of hello has a healthcheck"):
        awaited(["healthy"], there(other, experiment(service("base"))))


PLACE = ("r1", "srprov.hello.base")
BASE = Located(service="base", host="r1", container="srprov.hello.base")
RUNS = Reading(state="running", started=1.0)


def ended(code: int) -> Reading:
    """Return a container that has ended."""
    return Reading(state="exited", exit_code=code, started=1.0, finished=2.0)


@pytest.mark.parametrize(
    ("kind", "reading", "matched", "is_read", "stands"),
    [
        ("completed", None, False, False, "open"),
        ("completed", Reading(state=""), False, False, "never"),
        ("completed", Reading(state="created"), False, False, "open"),
        ("completed", RUNS, False, False, "open"),
        ("completed", ended(0), False, False, "holds"),
        ("completed", ended(3), False, False, "never"),
        ("healthy", RUNS, False, False, "never"),
        ("healthy", Reading(state="running", health="starting"), False, False, "open"),
        ("healthy", Reading(state="running", health="unhealthy"), False, False, "open"),
        ("healthy", Reading(state="running", health="healthy"), False, False, "holds"),
        ("healthy", Reading(state="paused", health="healthy"), False, False, "open"),
        ("healthy", Reading(state="exited", health="healthy", finished=2.0), False, False, "never"),
        ("every", RUNS, False, False, "holds"),
        ("every", ended(3), False, False, "holds"),
        ("every", Reading(state="created"), False, False, "open"),
        ("every", Reading(state="running", health="unhealthy"), False, False, "open"),
        ("every", Reading(state="exited", health="unhealthy", finished=2.0), False, False, "holds"),
        ("every", Reading(state="exited", exit_code=1, health="unhealthy", finished=2.0), False, False, "never"),
        ("log", RUNS, False, True, "open"),
        ("log", RUNS, True, False, "holds"),
        ("log", ended(0), False, False, "open"),
        ("log", ended(0), False, True, "never"),
        ("log", ended(1), True, True, "holds"),
        ("log", Reading(state=""), False, True, "never"),
    ],
)
def test_when_a_condition_holds_and_when_it_cannot_any_more(
    kind: str, reading: Reading | None, matched: bool, is_read: bool, stands: str
) -> None:
    """A log that was not read to its end may still have the line; an unhealthy service may become well."""
    what = Awaited(
        text="x", kind="healthy" if kind == "every" else kind, every=kind == "every",
        pattern="p" if kind == "log" else "", services=(BASE,),
    )  # fmt: skip
    seen = Seen(
        readings={PLACE: reading} if reading else {},
        matched=frozenset([(PLACE, "p")] if matched else []),
        read=frozenset([PLACE] if is_read else []),
        failed={},
    )
    found = standing(what, BASE, seen)
    assert ("holds" if found.holds else "never" if found.never else "open") == stands
    assert found.holds or found.words.startswith("base on r1 ")


def test_a_robot_and_an_engine_that_come_back_are_waited_for_on_one_connection_each() -> None:
    """What is awaited is said at once, and who is away; a job that ended meanwhile is found."""
    w = World().add("r1", "r2")
    what = experiment(service("a", robot="r1", job=True), service("b", robot="r2", job=True))
    for name in ("a", "b"):
        w.robots["r1"].engine.behaviours[name] = w.robots["r2"].engine.behaviours[name] = Behaviour(exits=0, lives=4)
    apply(w, what)
    conditions = awaited(["completed:a", "completed:b"], there(w, what))
    w.robots["r1"].gone, w.robots["r2"].engine.down = True, True
    robots = fleet(w)
    renewed: list[str] = []

    def again(host: str) -> None:
        renewed.append(host)
        w.robots[host].gone = False

    robots.sessions.again = again  # type: ignore[method-assign,assignment]
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        if text.startswith("waiting for r2"):
            w.robots["r2"].engine.down = False

    assert wait(conditions, robots, 30, say).why == ""
    assert said[0] == "waiting up to 30 s for completed:a (a on r1); completed:b (b on r2)"
    assert any(line.startswith("waiting for r1, up to 120 s: the connection was lost") for line in said), said
    assert any(line.startswith("waiting for r2, up to 120 s: the Docker Engine did not answer") for line in said), said
    assert renewed == ["r1"], "an engine that is away is no lost connection"
    assert [line for line in said if line.startswith("completed:a holds after ")]


def test_a_line_that_is_awaited_is_found_and_one_that_nobody_can_print_is_not_waited_for() -> None:
    w = World().add("r1")
    what = experiment(service("a", robot="r1", job=True))
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=1, log="one\nREADY 7\n")
    apply(w, what)
    found = there(w, what)
    assert wait(awaited(["log:a=^READY [0-9]$"], found), fleet(w), 30, lambda text: None).why == ""
    why = wait(awaited(["log:a=^READY$"], found), fleet(w), 30, lambda text: None).why
    assert why.endswith("log:a=^READY$: a on r1 exited with code 1 and has not printed it"), why
