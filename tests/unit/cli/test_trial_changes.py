"""A run of trials is gone on with only as the same experiment; each difference is named, and nothing else is one."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.controller.trials import Trials
from srprov.errors import RefusedError
from tests.fakes import World

EDF = """\
edf: 1
name: race
secrets: {key: {file: ./key}}
services:
  racer:
    image: "alpine:3"
    robot: r1
    command: [sh, -c, "race"]
    environment: {MODE: fast}
    volumes: ["./config:/config", "log:/log"]
    depends_on: [judge]
    secrets: [key]
  judge:
    image: "alpine:3"
    robot: r2
    user: "1000"
  camera:
    image: "alpine:3"
    robot: r2
    command: [film]
  lamp:
    image: "alpine:3"
    robot: r2
placement: {slots_per_robot: 4}
parameters:
  SPEED: {values: [1, 2], apply_to: racer, unit: m/s}
  TURN: [left, right]
trials:
  repetitions: 2
  seed: 7
  order: random
  until: {any: [{completed: racer}]}
  ready: 30s
  timeout: 20s
  stop: {signal: SIGINT, grace: 5s}
  success: {all: [{exit: {service: racer, code: 0}}]}
  keep: [camera, lamp]
results:
  racer: [/out/result.json]
metrics:
  time: {service: racer, json: /out/result.json#/time, unit: s}
  ticks: {service: judge, log: "^tick", reduce: count}
"""
UNTIL = (
    'trials: until: {"every": false, "items": [{"code": 0, "kind": "completed", "seconds": 0.0, "services": ["%s"]}]}'
)
REFUSED = {
    'image: "alpine:3"\n    robot: r1 -> image: "alpine:4"\n    robot: r1': ["racer: image: alpine:3 -> alpine:4"],
    '"race" -> "race harder"': ['racer: command: [["sh", "-c", "race"], null] -> [["sh", "-c", "race harder"], null]'],
    "MODE: fast -> MODE: slow": ["racer: environment MODE: fast -> slow"],
    "MODE: fast -> MODE: fast, FLAG: on": ["racer: environment FLAG: nothing -> on"],
    "MODE: fast -> ": ["racer: environment MODE: fast -> nothing"],
    'user: "1000" -> user: "1001"': ["judge: options: "],
    'user: "1000" -> healthcheck: {test: [CMD, ok]}': ["judge: healthcheck: null -> ", "judge: options: "],
    'user: "1000" -> user: "1000"\n    cap_add: [NET_RAW]': ["judge: privileges: "],
    'user: "1000" -> user: "1000"\n    ports: ["8080:80"]': ["judge: ports: "],
    'user: "1000" -> user: "1000"\n    logging: {driver: local}': ['judge: logging: default -> ["local", {}]'],
    "log:/log -> log:/logs": ["racer: volumes: sha256 "],
    "[judge] -> {judge: {condition: completed}}": ['racer: depends_on: {"judge": "started"} -> {"judge": "completed"}'],
    "command: [film] -> command: [film, twice]": ['camera: command: [["film"], null] -> [["film", "twice"], null]'],
    "keep: [camera, lamp] -> keep: [camera]": ['trials: keep: ["camera", "lamp"] -> ["camera"]'],
    "seed: 7 -> seed: 8": ["trials: seed: 7 -> 8"],
    "order: random -> order: listed": ["trials: order: random -> listed"],
    "seed: 7 -> seed: 7\n  design: zip": ["trials: design: product -> zip"],
    "seed: 7 -> seed: 7\n  seeds: per-repetition": ["trials: paired_seeds: false -> true"],
    "{completed: racer} -> {completed: judge}": [
        f"{UNTIL % 'racer'} -> {(UNTIL % 'judge').removeprefix('trials: until: ')}"
    ],
    "ready: 30s -> ready: 31s": ["trials: ready_s: 30.0 -> 31.0"],
    "timeout: 20s -> timeout: 25s": ["trials: timeout_s: 20.0 -> 25.0"],
    "signal: SIGINT -> signal: SIGTERM": ["trials: stop_signal: SIGINT -> SIGTERM"],
    "grace: 5s -> grace: 6s": ["trials: stop_grace_s: 5.0 -> 6.0"],
    "success: {all: -> success: {any:": ["trials: success: "],
    "[/out/result.json] -> [/out/result.json, /out/more.txt]": ["results: racer: "],
    "^tick -> ^tock": ["metrics: ticks pattern: ^tick -> ^tock"],
    "apply_to: racer -> apply_to: [racer, judge]": ['parameters: SPEED: ["racer"] -> ["racer", "judge"]'],
    "TURN: [left, right] -> WIND: [left, right]": [
        "parameters: TURN: all services -> nothing", "parameters: WIND: nothing -> all services",
    ],
}  # fmt: skip
"""What is changed -> what must be said of it, line by line, at least from its beginning."""
FREE = (
    "edf: 1 -> # a comment\nedf: 1",
    'robot: r1\n    command: [sh, -c, "race"] -> command: [sh, -c, "race"]\n    robot: r1',
    "ready: 30s\n  timeout: 20s -> timeout: 20s\n  ready: 0.5m",
    "{completed: racer} -> completed: [racer]",
    "repetitions: 2 -> repetitions: 5",
    "[1, 2] -> [1, 2, 3]",
    "seed: 7 -> seed: 7\n  retries: 3",
    "unit: m/s -> unit: km/h",
    "[left, right] -> [right]",
)


@pytest.fixture
def race(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    """Give robots in memory, and a run that was begun: no trial of it was run, as these robots run none."""
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "map").write_text("a map")
    (tmp_path / "race.edf").write_text(EDF)
    (tmp_path / "key").write_text("sesame-open-wide")
    monkeypatch.setattr(Trials, "all", lambda *_arguments: None)
    assert run([*WORDS, "-q"]) == 3
    return world


WORDS = ("run", "race.edf", "-i", "inv.yml", "-o", "out", "--yes", "--allow", "all")


def refused(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Go on, be refused, and return the differences."""
    capsys.readouterr()
    code = run([*WORDS, "-q", "--resume"])
    said = capsys.readouterr().err
    assert code == RefusedError.exit_code, said
    head, *lines = said.splitlines()
    assert head == "error[SRP-903]: this is not the experiment of out any more:"
    assert lines[-1].startswith("  run it as it was, or begin a new run in another folder")
    return [line.strip() for line in lines[:-1]]


def test_each_change_is_refused_with_exactly_this_difference(
    race: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(REFUSED) >= 20
    for change, expected in REFUSED.items():
        old, new = change.split(" -> ")
        assert EDF.count(old) == 1, old
        (tmp_path / "race.edf").write_text(EDF.replace(old, new))
        found = refused(capsys)
        assert len(found) == len(expected), (change, found)
        assert all(map(str.startswith, found, expected)), (change, found)
    (tmp_path / "race.edf").write_text(EDF)
    (tmp_path / "config" / "map").write_text("another map")
    (volumes,) = refused(capsys)
    assert volumes.startswith("racer: volumes: sha256 "), "a file beside the EDF has changed"
    (tmp_path / "config" / "map").write_text("a map")
    assert run([*WORDS, "-q", "--resume"]) == 3, "all is as it was"


def test_what_is_no_other_experiment_is_gone_on_with(race: World, tmp_path: Path) -> None:
    for change in FREE:
        old, new = change.split(" -> ")
        assert EDF.count(old) == 1
        (tmp_path / "race.edf").write_text(EDF.replace(old, new))
        assert run([*WORDS, "-q", "--resume"]) == 3, f"{change}: none has ended, as no trial is run here"
