"""action.yml and templates/gitlab.yml, run step by step as their runners do, against forges on this machine."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.integration.forges import BOT, TOKEN, FakeForge
from tools.ci import forge as told

ROOT = Path(__file__).resolve().parents[2]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS = str(ROOT / "tools/ci/steps.sh")
PASSED = {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "SSL_")) or name == "PATH"}
"""Of this machine's environment: where programs are, and packages."""
EDF = "edf: 1\nname: demo\nservices:\n  a: {image: busybox}\n"
WRONG = "edf: 1\nname: demo\nservices: {a: {image: x, cots: 3}}\n"
PROGRAM = """\
#!/bin/sh
env >>"{kept}"
case $1 in
    plan | facts) exec "{python}" -m tests.unit.cli.faked "$@" ;;
    *) exec "{python}" -m srprov "$@" ;;
esac
"""
HOSTILE = 'edf: 1\nname: a\nservices: {a: {image: x, "::add-mask::a": 3, "100%\\n::error::no": 3}}\n'


@pytest.fixture
def forge() -> Iterator[FakeForge]:
    with FakeForge() as running:
        yield running


class Repository:
    """A repository with an experiment, and the action in it. Robots are in memory; srprov's environment is kept."""

    def __init__(self, folder: Path, forge: FakeForge) -> None:
        self.folder, self.home = folder / "repository", folder / "home"
        self.home.mkdir()
        self.folder.mkdir()
        self.git("init", "--quiet")
        self.write("e.edf", EDF)
        self.write("inv.yml", "all: {hosts: {r1: {}, r2: {}}}\n")
        self.program, self.kept = folder / "program", folder / "environment"
        self.program.write_text(PROGRAM.format(kept=self.kept, python=sys.executable), encoding="utf-8")
        self.program.chmod(0o755)
        event = folder / "event.json"
        event.write_text(json.dumps({"pull_request": {"number": 7}}), encoding="utf-8")
        self.environment = {
            **PASSED, "HOME": str(self.home), "PYTHONPATH": str(ROOT), "RUNNER_TEMP": str(folder),
            "GITHUB_ACTIONS": "true", "GITHUB_API_URL": forge.address, "GITHUB_REPOSITORY": "lab/experiments",
            "GITHUB_EVENT_PATH": str(event), "GITHUB_SHA": "c0ffee", "GITHUB_REF": "refs/pull/7/merge",
            "GITHUB_STEP_SUMMARY": str(folder / "summary"), "GITHUB_OUTPUT": str(folder / "output"),
        }  # fmt: skip

    def git(self, *words: str) -> None:
        subprocess.run(("git", *words), cwd=self.folder, check=True)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text, encoding="utf-8")
        self.git("add", "--all")

    def action(self, step: str, **inputs: str) -> subprocess.CompletedProcess[str]:
        """Run one step of the action with these inputs, as GitHub's runner does."""
        given = {name: about.get("default", "") for name, about in ACTION["inputs"].items()}
        assert inputs.keys() <= given.keys()
        given |= {"token": TOKEN, "program": str(self.program), **inputs}
        values = {**{f"inputs.{name}": value for name, value in given.items()}, "github.action_path": str(ROOT)}
        (one,) = (each for each in ACTION["runs"]["steps"] if each["run"].endswith(f" {step}"))
        environment = {name: evaluated(str(text), values) for name, text in one["env"].items()}
        script = evaluated(one["run"], values)
        return self.run(
            {**self.environment, **environment}, "bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script
        )

    def gitlab(self, step: str, forge: FakeForge, **variables: str) -> subprocess.CompletedProcess[str]:
        """Run a step as the template for GitLab does, or lines of it."""
        environment = {name: self.environment[name] for name in (*PASSED, "HOME", "PYTHONPATH")}
        environment |= {
            "GITLAB_CI": "true", "CI_API_V4_URL": forge.address + "/api/v4", "CI_PROJECT_ID": "12",
            "CI_MERGE_REQUEST_IID": "7", "SRPROV_CI_WORK": str(self.folder / ".srprov-ci"), "SRPROV_CI_TOKEN": TOKEN,
            "SRPROV_CI_PROGRAM": str(self.program), "SRPROV_CI_COMMENT": "true", **variables,
        }  # fmt: skip
        lines = ("bash", "-eo", "pipefail", "-c", step) if " " in step else (STEPS, step)
        return self.run(environment, *lines)

    def run(self, environment: Mapping[str, str], *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(words, cwd=self.folder, env=dict(environment), capture_output=True, text=True)

    @property
    def outputs(self) -> dict[str, str]:
        """What the steps gave out so far."""
        text = Path(self.environment["GITHUB_OUTPUT"]).read_text(encoding="utf-8")
        return dict(line.split("=", 1) for line in text.splitlines())


@pytest.fixture
def repository(tmp_path: Path, forge: FakeForge) -> Repository:
    return Repository(tmp_path, forge)


def evaluated(text: str, values: Mapping[str, str]) -> str:
    """Put values in the place of `${{ … }}`."""
    return re.sub(r"\$\{\{ (.+?) \}\}", lambda match: values[match[1]], text)


def commands(output: str) -> list[str]:
    """Return what GitHub's runner takes for commands in an output."""
    found, stopped = [], ""
    for line in (line.lstrip() for line in output.splitlines()):
        if stopped:
            stopped = "" if line == f"::{stopped}::" else stopped
        elif line.startswith("::stop-commands::"):
            stopped = line.removeprefix("::stop-commands::")
        elif line.startswith("::"):
            found.append(line)
    assert not stopped
    return found


def test_no_input_becomes_a_part_of_a_command() -> None:
    for step in ACTION["runs"]["steps"]:
        assert "${{" not in step["run"] and "uses" not in step, step


def test_a_wrong_file_is_marked_uploaded_and_ends_the_step(repository: Repository, forge: FakeForge) -> None:
    repository.write("e.edf", WRONG)
    done = repository.action("validate", sarif="true")
    assert done.returncode == 5, done
    assert commands(done.stdout) == [
        "::error file=e.edf,line=3,col=26,title=SRP-105::unknown key 'cots' (did you mean 'cost'?)"
    ]
    assert repository.outputs == {"valid": "false"}
    (upload,) = forge.sarif
    assert (upload["commit_sha"], upload["ref"]) == ("c0ffee", "refs/pull/7/merge")
    log = json.loads(gzip.decompress(base64.b64decode(upload["sarif"])))
    (result,) = log["runs"][0]["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "e.edf"
    repository.write("e.edf", EDF)
    done = repository.action("validate", sarif="true")
    assert (done.returncode, commands(done.stdout), repository.outputs) == (0, [], {"valid": "true"}), done


def test_what_a_hostile_file_says_is_no_command(repository: Repository) -> None:
    """Neither in the text, where its lines are shown, nor in a mark; nor does its name end a mark's properties."""
    (repository.folder / "e.edf").unlink()
    repository.git("rm", "--quiet", "--cached", "e.edf")
    repository.write("::add-path::x,y%0A.edf", HOSTILE)
    done = repository.action("validate")
    assert done.returncode == 5 and "::add-mask::a" in done.stdout, done
    marks = commands(done.stdout)
    assert len(marks) == 2 and all(
        mark.startswith("::error file=%3A%3Aadd-path%3A%3Ax%2Cy%250A.edf,line=3,col=") for mark in marks
    ), marks


def test_nothing_of_a_branch_that_is_checked_is_run(repository: Repository) -> None:
    """Also where a pattern of the workflow's own finds it, and it would do as an inventory that is a program."""
    ran = repository.folder / "ran"
    (repository.folder / "experiments").mkdir()
    repository.write("experiments/a.yml", EDF)
    repository.write("experiments/b.yml", f"#!/bin/sh\ntouch {ran}\necho '{{}}'\n")
    (repository.folder / "experiments/b.yml").chmod(0o755)
    done = repository.action("validate", files="experiments/*.yml")
    assert not ran.exists() and done.returncode == 5, done
    assert any("file=experiments/b.yml" in line for line in commands(done.stdout)), done.stdout


def test_the_plan_is_one_comment_that_is_updated(repository: Repository, forge: FakeForge) -> None:
    """Among many of others, one of which has its mark; srprov never sees the token."""
    name = told.marker("plan e.edf")
    mallory = forge.add("mallory", f"{name}\nall is well")
    for number in range(told.PER_PAGE + 20):
        forge.add("ada", f"comment {number}")
    wanted = {"experiment": "e.edf", "inventory": "inv.yml", "options": "--unreachable\nskip"}
    done = repository.action("plan", **wanted)
    assert done.returncode == 0 and repository.outputs["changes"] == "true", done
    (first,) = forge.bodies()
    assert first.startswith(f"{name}\n### srprov plan: demo") and "srprov.demo.a" in first.replace("\\", "")
    assert first.partition("\n")[2] == Path(repository.environment["GITHUB_STEP_SUMMARY"]).read_text(encoding="utf-8")
    repository.write("e.edf", EDF + "  b: {image: busybox}\n")
    assert repository.action("plan", **wanted).returncode == 0
    (second,) = forge.bodies()
    assert "srprov.demo.b" in second.replace("\\", "") and len(forge.comments) == told.PER_PAGE + 22
    assert mallory["body"] == f"{name}\nall is well"
    assert ("PATCH", f"/repos/lab/experiments/issues/comments/{forge.comments[-1]['id']}") in forge.asked
    assert TOKEN not in repository.kept.read_text(encoding="utf-8") and forge.strangers == 0


def test_with_a_base_the_difference_is_told_and_no_robot_is_asked(repository: Repository, forge: FakeForge) -> None:
    """From the facts and the files of the target branch, in a folder beside."""
    base = repository.folder / ".base"
    base.mkdir()
    facts = repository.run(repository.environment, str(repository.program), "facts", "-i", "inv.yml", "--json").stdout
    for name, text in (("e.edf", EDF), ("inv.yml", "all: {hosts: {r1: {}, r2: {}}}\n"), ("facts.json", facts)):
        (base / name).write_text(text, encoding="utf-8")
    wanted = {"experiment": "e.edf", "inventory": ".base/inv.yml", "base": ".base", "facts": ".base/facts.json"}
    done = repository.action("plan", **wanted)
    assert done.returncode == 0 and repository.outputs["changes"] == "false", done
    repository.write("e.edf", EDF.replace("busybox", "busybox, environment: {RATE: 4}"))
    done = repository.action("plan", **wanted)
    assert done.returncode == 0 and repository.outputs["changes"] == "true", done
    (body,) = forge.bodies()
    assert body.startswith(told.marker("diff e.edf")) and "RATE" in body, body


def test_a_plan_that_cannot_be_made_ends_the_step_and_is_told(repository: Repository, forge: FakeForge) -> None:
    repository.write("e.edf", WRONG)
    done = repository.action("plan", experiment="e.edf", inventory="inv.yml")
    assert done.returncode == 5 and "unknown key 'cots'" in done.stdout, done
    (body,) = forge.bodies()
    assert "srprov plan ended with exit code 5" in body and repository.outputs["changes"] == "false"


def test_a_token_that_may_not_write_is_a_warning(repository: Repository, forge: FakeForge) -> None:
    """As on pull requests from forks; one that is wrong ends the step."""
    forge.may_write = False
    done = repository.action("validate", sarif="true")
    assert done.returncode == 0, done
    (warning,) = commands(done.stdout)
    assert warning.startswith("::warning::POST ") and "the token may not write here" in warning
    environ = {**repository.environment, "SRPROV_CI_TOKEN": ""}
    (repository.folder / "plan.md").write_text("### a plan\n", encoding="utf-8")
    words = ["comment", "plan", str(repository.folder / "plan.md")]
    assert told.main(words, environ) == 0
    assert told.main(words, {**environ, "SRPROV_CI_TOKEN": "wrong"}) == 1
    assert told.main(words, {**environ, "SRPROV_CI_TOKEN": TOKEN}) == 0 and forge.comments == []


def test_the_token_follows_no_redirection(repository: Repository, forge: FakeForge) -> None:
    (repository.folder / "log.sarif").write_text("{}", encoding="utf-8")
    with FakeForge() as other:
        forge.elsewhere = other.address
        environ = {**repository.environment, "SRPROV_CI_TOKEN": TOKEN}
        assert told.main(["sarif", str(repository.folder / "log.sarif")], environ) == 1
        assert other.asked == [] and forge.asked == [("POST", "/repos/lab/experiments/code-scanning/sarifs")]


@pytest.mark.parametrize(
    ("step", "inputs"),
    [
        ("validate", {"files": "*.edf; touch pwned\n$(touch pwned)\n`touch pwned`"}),
        ("plan", {"experiment": "$(touch pwned)", "inventory": "inv.yml\n$(touch pwned)"}),
        ("plan", {"experiment": "e.edf", "inventory": "inv.yml", "options": "`touch pwned`\n; touch pwned"}),
        ("plan", {"experiment": "--help", "inventory": "inv.yml"}),
    ],
)  # fmt: skip
def test_inputs_are_words(repository: Repository, step: str, inputs: dict[str, str]) -> None:
    done = repository.action(step, **inputs)
    assert not list(repository.folder.rglob("*pwned*")), done
    assert done.returncode == 5, done


def test_without_an_experiment_nobody_is_asked(repository: Repository, forge: FakeForge) -> None:
    """And where there is no EDF there is nothing to be wrong."""
    repository.git("rm", "--quiet", "--cached", "e.edf")
    assert repository.action("validate").returncode == 0 and repository.outputs == {"valid": "true"}
    assert repository.action("plan").returncode == 0
    assert not repository.kept.exists() and forge.asked == []


def test_gitlab_gets_code_quality_and_one_note(repository: Repository, forge: FakeForge) -> None:
    """The job's files lie in its folder, where GitLab takes artifacts from."""
    repository.write("e.edf", WRONG)
    done = repository.gitlab("validate", forge)
    assert done.returncode == 5 and "::" not in done.stdout, done
    work = repository.folder / ".srprov-ci"
    (problem,) = json.loads((work / "validate.codequality").read_text(encoding="utf-8"))
    assert problem["location"] == {"path": "e.edf", "lines": {"begin": 3}}
    assert json.loads((work / "validate.sarif").read_text(encoding="utf-8"))["version"] == "2.1.0"
    repository.write("e.edf", EDF)
    forge.add("mallory", told.marker("plan e.edf") + "\nall is well", 3)
    plan = {"SRPROV_CI_EXPERIMENT": "e.edf", "SRPROV_CI_INVENTORY": "inv.yml"}
    for _ in range(2):
        done = repository.gitlab("plan", forge, **plan)
        assert done.returncode == 0, done
    (body,) = forge.bodies(BOT)
    assert "### srprov plan: demo" in body and forge.bodies("mallory") == [told.marker("plan e.edf") + "\nall is well"]
    notes = "/api/v4/projects/12/merge_requests/7/notes"
    assert [one for one in forge.asked if one[0] != "GET"] == [
        ("POST", notes),
        ("PUT", f"{notes}/{forge.comments[-1]['id']}"),
    ]
    assert TOKEN not in repository.kept.read_text(encoding="utf-8") and forge.strangers == 0


def test_the_template_for_gitlab_uses_the_same_steps() -> None:
    template: dict[str, Any] = yaml.safe_load((ROOT / "templates/gitlab.yml").read_text(encoding="utf-8"))
    words = [line for job in template.values() for key in ("before_script", "script") for line in job.get(key, ())]
    steps = '"$SRPROV_CI_WORK/source/tools/ci/steps.sh" '
    assert [line.removeprefix(steps) for line in words if "steps.sh" in line] == ["install", "validate", "plan"]
    kept = [path for job in template.values() for path in job.get("artifacts", {}).get("paths", ())]
    assert kept == [".srprov-ci/validate.sarif", ".srprov-ci/plan.md"]


def test_a_plan_that_is_too_long_for_a_comment_is_cut_and_says_so() -> None:
    text = "head\n<details>\n" + "| a step |\n" * 10_000 + "</details>\n"
    cut = told.fitting(text)
    assert len(cut) <= told.LONGEST and cut.count("<details>") == cut.count("</details>") == 1
    assert "Too long for a comment" in cut.splitlines()[-1]
    assert told.fitting("short") == "short"


@pytest.mark.parametrize("hook", yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8")))
def test_the_name_of_a_file_is_no_option_of_a_hook(repository: Repository, hook: dict[str, Any]) -> None:
    """It stands where a stranger put it, and pre-commit gives names as they are."""
    repository.write("--profile=x.edf", "edf: 1\nservices: {a: {image: x, cots: 3}, a: {image: x}}\n")
    words = [*hook["entry"].split()[1:], *hook.get("args", ()), "--profile=x.edf", "e.edf"]
    done = repository.run(repository.environment, str(repository.program), *words)
    assert done.returncode == 5 and "--profile=x.edf:2:" in done.stdout + done.stderr
