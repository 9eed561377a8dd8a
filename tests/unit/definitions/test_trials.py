"""What an EDF says of its trials, and what is wrong about it, each at its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.definitions.trialsmodel import Condition, Conditions, Limits, Margin, Metric, Result, TrialDefinitions
from srprov.errors import DefinitionError

SERVICES = """\
edf: 1
name: race
services:
  navigator: {image: x, environment: {OWN: 1}}
  referee: {image: x}
  camera: {image: x, restart: always}
"""


def load(folder: Path, text: str) -> TrialDefinitions:
    """Return what an EDF with these lines says of trials."""
    path = folder / "race.edf"
    path.write_text(SERVICES + text)
    found = load_experiment(path, {})
    assert found.unsupported == ()
    assert found.experiment.trials is not None
    return found.experiment.trials


@pytest.mark.parametrize(
    ("written", "values"),
    [
        ("[0.5, 1.0, 1, 1e3, -0.25, .5e-3]", ("0.5", "1.0", "1", "1000.0", "-0.25", "0.0005")),
        ("[on, true, dwb, '0.50', 0x10, 010]", ("on", "true", "dwb", "0.50", "16", "010")),
        ("{values: [a, b]}", ("a", "b")),
        ("{range: {from: 0, to: 20, steps: 3}}", ("0", "10", "20")),
        ("{range: {from: 0, to: 1, steps: 3}}", ("0.0", "0.5", "1.0")),
        ("{range: {from: 0.1, to: 0.5, steps: 5}}", ("0.1", "0.2", "0.3", "0.4", "0.5")),
        ("{range: {from: 2, to: -2, steps: 2}}", ("2", "-2")),
        ("{range: {from: 0x10, to: 18, steps: 2}}", ("16", "18")),
        ("{range: {from: 0.0, to: 2, steps: 3}}", ("0.0", "1.0", "2.0")),
    ],
)
def test_values_are_the_texts_that_containers_see(tmp_path: Path, written: str, values: tuple[str, ...]) -> None:
    (parameter,) = load(tmp_path, f"parameters: {{SPEED: {written}}}\n").parameters
    assert parameter.values == values


def test_a_number_of_trials_is_its_repetitions(tmp_path: Path) -> None:
    settings = load(tmp_path, "parameters: {SPEED: [1, 2]}\ntrials: 5\n").settings
    assert (settings.repetitions, settings.design, settings.order) == (5, "product", "listed")


def test_everything_about_trials_is_read(tmp_path: Path) -> None:
    found = load(tmp_path, FULL)
    settings = found.settings
    assert found.parameters[0].services == ("navigator",)
    assert (settings.repetitions, settings.order, settings.seed, settings.paired_seeds) == (10, "random", 2026, True)
    assert settings.exclude == ({"PLANNER": "mppi", "SPEED": "1.0"},)
    assert settings.include == ({"PLANNER": "dwb", "SPEED": "2.0"},)
    assert settings.until == Conditions(
        items=(
            Condition(kind="completed", services=("navigator",)),
            Condition(kind="log", services=("referee",), pattern="^GOAL [0-9]+"),
            Condition(kind="after", seconds=90.0),
        ),
        every=False,
    )
    assert settings.success == Conditions(
        items=(
            Condition(kind="exit", services=("navigator",), code=0),
            Condition(kind="metric", metric="time_to_goal", below=60.0),
        ),
        every=True,
    )
    assert (settings.timeout_s, settings.ready_s, settings.settle_s, settings.pause_s) == (300.0, 30.0, 2.0, 10.0)
    assert (settings.stop_signal, settings.stop_grace_s, settings.stop_first) == ("SIGINT", 20.0, ("referee",))
    assert (settings.retries, settings.stop_on_failure, settings.max_failures) == (2, True, 5)
    assert settings.keep == ("camera",)
    assert settings.limits == Limits(
        clock_offset_s=0.02, disk_free_bytes=2 << 30, battery_percent=30, temperature_c=80.0, wait_s=600.0
    )
    assert found.results == {
        "navigator": (Result(path="/out/result.json", required=True), Result(path="/bags", most_bytes=5 << 30)),
        "referee": (Result(path="/log"),),
    }
    assert found.metrics == (
        Metric(name="goals", service="referee", pattern="^GOAL", reduce="count", better="more", margin=Margin(2)),
        Metric(
            name="time_to_goal",
            service="navigator",
            file="/out/result.json",
            pointer="/time",
            unit="s",
            margin=Margin(0.125, relative=True),
        ),
    )


FULL = """\
parameters:
  PLANNER: {values: [dwb, mppi], description: Local planner, apply_to: navigator}
  SPEED: {values: [0.5, 1.0], unit: m/s}
trials:
  repetitions: 10
  exclude: [{PLANNER: mppi, SPEED: 1.0}]
  include: [{PLANNER: dwb, SPEED: 2.00}]
  order: random
  seed: 2026
  seeds: per-repetition
  ready: 30s
  settle: 2s
  until: {any: [{completed: navigator}, {log: {service: referee, matches: '^GOAL [0-9]+'}}, {after: 1m30s}]}
  timeout: 5m
  stop: {signal: SIGINT, grace: 20s, first: [referee]}
  success:
    all:
      - exit: {service: navigator, code: 0}
      - metric: {time_to_goal: {below: 60}}
  retries: 2
  on_failure: stop
  max_failures: 5
  between: {sleep: 10s}
  keep: camera
  limits: {clock_offset: 20ms, disk_free: 2GB, battery: 30, temperature: 80, wait: 10m}
results:
  navigator: [{path: /out/result.json, required: true}, {path: /bags, max: 5g}]
  referee: [/log]
metrics:
  time_to_goal: {service: navigator, json: /out/result.json#/time, unit: s, margin: 12.5%}
  goals: {service: referee, log: '^GOAL', reduce: count, better: more, margin: 2}
"""


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("parameters: {speed: [1]}", 7, "'speed' is not a variable's name"),
        ("parameters: {SPEED: []}", 7, "must not be empty"),
        ("parameters: {SPEED: [1, 0.5, 0.50]}", 7, "SPEED has the value '0.5' twice"),
        ("parameters: {P: {range: {from: 1e-9999999, to: 1, steps: 3}}}", 7, "more than 30 digits"),
        ("parameters: {SPEED: {unit: m}}", 7, "needs 'values' or 'range'"),
        ("parameters: {SRPROV_SEED: [1]}", 7, "one of srprov's own variables"),
        ("parameters: {OWN: [1, 2]}", 7, "'navigator' sets OWN itself"),
        ("parameters: {A: {values: [1], apply_to: nobody}}", 7, "there is no service 'nobody'"),
        ("trials: 0", 7, "less than 1"),
        ("trials: {repetitions: 3}", 7, "the key 'timeout' is missing"),
        ("trials: {timeout: 5}", 7, "not a duration"),
        ("trials: {timeout: 5s, limits: {}}", 7, "must not be empty"),
        ("trials: {timeout: 5s, limits: {clock_offset: 20}}", 7, "not a duration"),
        ("trials: {timeout: 5s, limits: {clock: 20ms}}", 7, "unknown key 'clock'"),
        ("trials: {timeout: 5s, limits: {battery: 101}}", 7, "more than 100"),
        ("trials: {timeout: 5s, limits: {disk_free: 99999999999999999g}}", 7, "more than any machine has"),
        ("trials: {timeout: 25h}", 7, "longer than 24h"),
        ("parameters: {A: [1]}\ntrials: {timeout: 5s}", 8, "a random order needs a 'seed'"),
        ("parameters: {A: [1]}\ntrials: {timeout: 5s, seed: 1, exclude: [{B: 1}]}", 8, "there is no parameter 'B'"),
        ("parameters: {A: [1]}\ntrials: {timeout: 5s, seed: 1, exclude: [{A: 2}]}", 8, "A never is '2'"),
        ("parameters: {A: [1], B: [1]}\ntrials: {timeout: 5s, seed: 1, include: [{A: 2}]}", 8, "it gives no B"),
        ("parameters: {A: [1], B: [1, 2]}\ntrials: {timeout: 5s, seed: 1, design: zip}", 8, "of one length"),
        ("parameters: {A: [1]}\ntrials: {timeout: 5s, seed: 1, design: list}", 8, "there are none"),
        ("trials: {timeout: 5s, keep: nobody}", 7, "there is no service 'nobody'"),
        ("trials: {timeout: 5s, until: {}}", 7, "it needs 'any' or 'all'"),
        ("trials: {timeout: 5s, until: {any: [{completed: nobody}]}}", 7, "there is no service 'nobody'"),
        ("trials: {timeout: 5s, until: {any: [{completed: camera}]}}", 7, "'camera' never ends for good"),
        ("trials: {timeout: 5s, until: {any: [{metric: {a: {below: 1}}}]}}", 7, "unknown key 'metric'"),
        (
            "trials: {timeout: 5s, keep: referee, until: {any: [{completed: referee}]}}",
            7,
            "'referee' is kept over all trials",
        ),
        ("trials: {timeout: 5s, until: {any: [{log: {service: referee, matches: '('}}]}}", 7, "no regular expression"),
        ("trials: {timeout: 5s, success: {any: [{metric: {a: {below: 1}}}]}}", 7, "there is no metric 'a'"),
        ("results: {nobody: [/x]}", 7, "there is no service 'nobody'"),
        ("results: {referee: [x]}", 7, "not an absolute path"),
        ("results: {referee: [/w/.git]}", 7, "'/w/.git' would make a repository here"),
        ("results: {referee: [/w/head, x]}", 7, "not an absolute path"),
        ("results: {referee: [{path: /w/.hg/x}]}", 7, "'/w/.hg/x' would make a repository here"),
        ("metrics: {a: {service: referee}}", 7, "a metric needs 'json' or 'log'"),
        ("metrics: {a: {service: referee, log: x}}", 7, "has no group"),
        ("metrics: {a: {service: referee, log: '(?=x)'}}", 7, "no regular expression of RE2"),
        ("metrics: {a: {service: referee, log: '(x)', margin: 0}}", 7, "not a number above 0"),
        ("metrics: {a: {service: referee, log: '(x)', margin: -1}}", 7, "not a number above 0"),
        ("metrics: {a: {service: referee, log: '(x)', margin: 0%}}", 7, "a percentage between 0% and 100%"),
        ("metrics: {a: {service: referee, log: '(x)', margin: 100%}}", 7, "a percentage between 0% and 100%"),
        ("metrics: {a: {service: referee, log: '(x)', margin: [1]}}", 7, "a list"),
        ("metrics: {a: {service: referee, json: '/x#/a'}}", 7, "/x is not among the results of 'referee'"),
    ],
)
def test_what_is_wrong_about_trials_is_told_at_its_line(tmp_path: Path, text: str, line: int, message: str) -> None:
    with pytest.raises(DefinitionError) as error:
        load(tmp_path, text + "\n")
    assert [(one.location.line, message in one.message) for one in error.value.problems] == [(line, True)], [
        one.message for one in error.value.problems
    ]


ONE = "parameters: {A: [1, 2]}\ntrials:\n  timeout: 5s\n  seed: 1\n"
KEPT = "trials: {timeout: 5s, keep: camera"


@pytest.mark.parametrize(
    ("text", "at", "message"),
    [
        ("parameters: {PATH: [1, 2]}", "7:14", "'PATH' says where programs are found"),
        ("trials: {timeout: 0s}", "7:19", "a trial of no time"),
        ("trials: {timeout: 5s, stop: {signal: SIGFOO}}", "7:38", "not a signal that Linux has"),
        ("trials: {timeout: 5s, stop: {signal: RTMIN+16}}", "7:38", "not a signal that Linux has"),
        ("results: {referee: ['/out/*.bag']}", "7:21", "'/out/*.bag' is a pattern"),
        ("results: {referee: [{required: true, path: '/out/[ab]'}]}", "7:44", "'/out/[ab]' is a pattern"),
        ("trials:\n  timeout: 5s\n  keep: [navigator, referee, camera]", "9:9", "all services are kept"),
        ("parameters: {A: {values: [1], apply_to: [referee, camera]}}\ntrials: {timeout: 5s, seed: 1, keep: camera}",
         "7:51", "'camera' is kept over all trials, so it gets no parameter"),
        (KEPT + "}\nresults: {camera: [/x]}", "8:11", "no trial brings its results home"),
        (KEPT + "}\nmetrics: {a: {log: '(x)', service: camera}}", "8:36", "a trial has no log or file of it"),
        (KEPT + ", stop: {first: [referee, camera]}}", "7:61", "no trial stops it"),
        (KEPT + ", until: {any: [{healthy: [referee, camera]}]}}", "7:71", "no condition of a trial sees it"),
        (KEPT + ", until: {any: [{log: {matches: x, service: camera}}]}}", "7:79", "no condition of a trial sees it"),
        ("trials: {timeout: 5s, until: {any: [{completed: [referee, nobody]}]}}", "7:59", "no service 'nobody'"),
        ("trials: {timeout: 5s, until: {any: [{exit: {code: 0, service: nobody}}]}}", "7:63", "no service 'nobody'"),
        ("trials: {timeout: 5s, until: {all: [{completed: [referee, camera]}]}}", "7:59", "never ends for good"),
        ("trials: {timeout: 5s, success: {any: [{metric: {a: {below: 1}}}]}}", "7:49", "there is no metric 'a'"),
        (ONE + "  exclude: [{A: 1}, {A: 2}]", "11:12", "no trial is left"),
        (ONE.replace("[1, 2]", str(list(range(1000)))) + "  repetitions: 11", "7:1", "11000 trials are more than"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_told_where_it_stands(tmp_path: Path, text: str, at: str, message: str) -> None:
    with pytest.raises(DefinitionError) as error:
        load(tmp_path, text + "\n")
    found = [(f"{one.location.line}:{one.location.column}", one.message) for one in error.value.problems]
    assert len(found) == 1 and found[0][0] == at and message in found[0][1], found


@pytest.mark.parametrize(
    ("environment", "at"), [("{OTHER: 1, SRPROV_SEED: 2}", "5:53"), ("[OTHER=1, SRPROV_SEED=2]", "5:39")]
)
def test_a_service_that_sets_a_variable_of_srprovs_own_is_told(tmp_path: Path, environment: str, at: str) -> None:
    path = tmp_path / "race.edf"
    text = f"edf: 1\nname: race\nservices:\n  a:\n    {{image: x, environment: {environment}}}\n"
    path.write_text(text)
    load_experiment(path, {})  # only trials give such variables
    path.write_text(text + "trials: {timeout: 5s}\n")
    with pytest.raises(DefinitionError) as error:
        load_experiment(path, {})
    (one,) = error.value.problems
    assert "sets SRPROV_SEED, which is one of srprov's own" in one.message
    assert f"{one.location.line}:{one.location.column}" == at
    path.write_text(text + "  b: {image: x}\ntrials: {timeout: 5s, keep: a}\n")
    load_experiment(path, {})


@pytest.mark.parametrize("signal", ["SIGINT", "INT", "SIGRTMIN+3", "RTMAX-14", "9"])
def test_signals_of_linux_are_taken(tmp_path: Path, signal: str) -> None:
    path = tmp_path / "race.edf"
    path.write_text(f"edf: 1\nname: race\nservices: {{a: {{image: x, stop_signal: {signal}}}}}\n")
    assert load_experiment(path, {}).experiment.services["a"].runtime.stop_signal == signal


def test_a_metric_may_come_from_a_file_below_a_folder_that_is_brought_home(tmp_path: Path) -> None:
    text = "results: {referee: [/out]}\nmetrics: {a: {service: referee, json: '/out/deep/x.json#/a'}}\n"
    assert load(tmp_path, text).metrics[0].file == "/out/deep/x.json"
