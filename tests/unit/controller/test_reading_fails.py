"""What reading a robot's words raises is that robot's failure: parsers do not raise, and one that does ends nothing."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.codes import Code
from srprov.controller import collection
from srprov.controller.collection import _Found, _of_robot, _Service, _told
from srprov.controller.live import Live
from srprov.errors import RefusedError, TransportError
from srprov.execution import watching
from srprov.execution.probing import _everywhere
from srprov.execution.watching import Watch
from srprov.session import Session
from srprov.wire import Reply


class Robot:
    """A robot that answers every question in the same way."""

    host = "r1"

    def ask(self, queries: Any) -> list[Reply]:
        """Say little."""
        return [Reply(status=200, out="{}") for _ in queries]


def odd(*_words: object, **_more: object) -> Any:
    """Fail as a parser that met what its author had not thought of."""
    raise KeyError("odd")


ROBOT: Session = Robot()  # type: ignore[assignment]  # as much of a session as is used


def test_a_probe_goes_on_with_the_others() -> None:
    done, failed = _everywhere({"r1": ROBOT, "r2": ROBOT}, lambda robot: odd() if robot == "r1" else robot)
    assert done == {"r2": "r2"} and "answers cannot be read: KeyError" in failed["r1"]


def test_the_screen_goes_on_without_its_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srprov.controller.live.Totals.find", odd)
    (row,) = Live().rows([{"robot": "r1", "container": "a"}], {"r1": ROBOT})
    assert (row["cpu_percent"], row["memory_bytes"]) == (None, None)


def test_a_wait_looks_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a robot that cannot be read, for which it waits as for one that is away; its thread does not die."""
    monkeypatch.setattr(watching, "read", odd)
    watch = Watch(lambda _host: ROBOT, lambda _host: None, {("r1", "a"): ()}, lambda _text: None)
    with pytest.raises(TransportError, match="cannot be read: KeyError"):
        watch._look("r1")


def test_what_an_engine_says_of_a_container_has_a_length(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """That of all containers is kept until all is here: of 8 MiB each it would be a gigabyte."""
    answers = {"a": "{}", "b": json.dumps({"x": "x" * (600 << 10)}), "c": json.dumps({"x": [[]] * 30_000})}
    robot = Robot()
    robot.ask = lambda queries: [Reply(status=200, out=answers[one.path.split("/")[2]]) for one in queries]  # type: ignore[method-assign]
    monkeypatch.setattr(collection, "bring_log", lambda *_: None)
    services = [_Service(name, "r1", name, ()) for name in answers]
    found = _of_robot(SimpleNamespace(do=lambda work: work(robot)), services, tmp_path, lambda _text: None)  # type: ignore[arg-type]
    assert found.inspected == {"a": {}, "b": None, "c": None}
    assert found.failed == [f"{name}: what its engine says of it is longer than any container needs" for name in "bc"]


def test_what_is_collected_of_others_is_kept() -> None:
    found = _Found()
    with _told("a", found):
        odd()
    assert found.failed == ["a: what its robot says cannot be read: KeyError: 'odd'"]
    with pytest.raises(RefusedError), _told("a", found):
        raise RefusedError("no", code=Code.NOT_ALLOWED)
