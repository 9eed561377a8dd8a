"""Plan files that somebody changed, on real robots: each is refused, or does only what its plan shows.

A few mutations; `make soak` takes 200. What robots hold is looked at with Docker's,
the kernel's and the disk's own means: what belongs to another experiment, and whatever has the canary's name.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab
from tests.tampering import CANARY, TRACE, tampered

pytestmark = pytest.mark.lab

FEW, MANY = 4, 200
ROBOTS = ("robot1", "robot2", "robot3")
LOOK = (
    f"find /tmp /root /etc /opt /run /var/lib/srprov /var/lib/docker/volumes -xdev -name '*{CANARY}*' 2>/dev/null; "
    f"ls -a /; grep -rl {CANARY} /var/lib/srprov 2>/dev/null; "
    "docker ps -a --no-trunc --filter label=srprov.instance=theirs --format '{{.ID}} {{.State}}'; "
    "docker volume ls -q --filter label=srprov.instance=theirs; docker network ls -q --filter name=theirs; "
    "find /var/lib/srprov/theirs -type f -exec sha256sum {} + 2>/dev/null | sort; "
    "for l in $(ls /sys/class/net | grep -v veth); do echo $l $(readlink /sys/class/net/$l/master); done; "
    "docker inspect -f '{{.Name}} {{.HostConfig.Privileged}} {{range .Mounts}}{{.Source}} {{end}}' $(docker ps -aq) "
    "| grep -v -e ' false \\(/var/lib/srprov/\\|/run/srprov/\\|/var/lib/docker/volumes/\\|$\\)'; :"
)
"""Prints nothing for what ours is, but for its links; the same before and after."""


@dataclass
class Stage:
    """Three robots with an experiment of somebody else and version 1 of ours, and the plan file to version 2."""

    lab: Lab
    folder: Path
    inventory: str

    def srprov(self, *words: str) -> Done:
        return self.lab.srprov(*words, "-i", self.inventory, "--allow", "secret", env={"TOKEN": "value-of-today"})

    def begin(self, name: str) -> None:
        """Have version 1 of an experiment run, and nothing else of it."""
        done = self.srprov("apply", self.edf(name, 1), "--yes", "--settle", "0")
        assert done.code == 0, done

    def end(self, name: str) -> None:
        """Have nothing of an experiment there."""
        done = self.lab.srprov("destroy", self.edf(name, 1), "-i", self.inventory, "--yes", "--volumes")
        assert done.code == 0, done

    def edf(self, name: str, version: int) -> str:
        """Write an experiment."""
        folder = self.folder / name
        (folder / "www").mkdir(parents=True, exist_ok=True)
        (folder / "www" / "index.html").write_text("hello")
        (folder / "new.cdf").write_text('cdf: 1\nname: new\nbase: busybox\nrun: ["true"]\n')
        services: dict[str, Any] = {"web": busybox("sleep", f"8640{version}", robot="robot1", volumes=["data:/data"])}
        if version == 1:
            services["old"] = busybox(robot="robot2")
        else:
            new = {"cdf": "new.cdf", "command": ["sleep", "86400"], "stop_signal": "SIGKILL"}
            services["new"] = {**new, "robot": "robot2", "secrets": ["token"], "volumes": ["./www:/www"]}
            services["far"] = busybox(robot="robot3", volumes=["far:/data"])
        more = {"secrets": {"token": {"env": "TOKEN"}}} if version == 2 else {}
        path = folder / "experiment.edf"
        path.write_text(edf(name, services, **more))
        return str(path)

    def plan(self) -> str:
        """Return the text of the plan file to version 2."""
        file = self.folder / "made.json"
        made = self.srprov("plan", self.edf("ours", 2), "-o", str(file))
        assert made.code == 0, made
        return file.read_text()

    def apply(self, text: str, *words: str) -> Done:
        """Apply a plan file of this text."""
        file = self.folder / "plan.json"
        file.write_text(text)
        return self.srprov("apply", str(file), "--yes", "--settle", "0", *words)

    def look(self) -> dict[str, str]:
        """Return robot -> all that no mutation may change or make; and of this machine."""
        with ThreadPoolExecutor(len(ROBOTS)) as pool:
            looks = pool.map(lambda robot: self.lab.shell(robot, "sh", "-c", LOOK).out, ROBOTS)
            seen = dict(zip(ROBOTS, looks, strict=True))
        return {**seen, "here": str(Path(TRACE).exists())}


@pytest.fixture(scope="module")
def stage(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Stage:
    """Give robots on which both experiments run."""
    folder = tmp_path_factory.mktemp("tampered")
    stage = Stage(lab_of_module, folder, part_of_lab(lab_of_module, ROBOTS, folder / "lab.yml"))
    for name in ("theirs", "ours"):
        stage.begin(name)
    return stage


@pytest.fixture(scope="module")
def plan(stage: Stage) -> str:
    """Give the text of a plan file."""
    return stage.plan()


def added_command(document: dict[str, Any]) -> None:
    document["permissions"] = []
    params = {"argv": ["touch", TRACE], "creates": TRACE}
    step = {
        "number": len(document["steps"]) + 1, "robot": "robot1", "module": "command", "name": "c", "action": "run",
        "cause": "", "destructive": False, "needs": [], "waits": [],
        "commands": [{"run": f"touch {TRACE}", "timeout_s": 60.0}],
        "before": None, "want": {"params": params, "needs": [], "source": "x"}, "found": None,
    }  # fmt: skip
    document["steps"].append(step)
    document["counts"]["run"] += 1


def removal_runs_anything(document: dict[str, Any]) -> None:
    one = next(step for step in document["steps"] if step["action"] == "delete")
    one["commands"] = [{"run": f"touch {TRACE}", "timeout_s": 60.0}]


def nothing_is_stale(document: dict[str, Any]) -> None:
    document["fingerprints"] = {}


def secret_runs_a_program(document: dict[str, Any]) -> None:
    document["secrets"]["token"] = {"command": ["touch", TRACE], "folder": "/", "at": ["experiment.edf", 1, 1]}


def privileged(document: dict[str, Any]) -> None:
    one = next(step for step in document["steps"] if step["module"] == "container" and step["want"])
    one["want"]["params"]["run"]["privileged"] = True


@pytest.mark.parametrize(
    ("change", "code", "named"),
    [
        (added_command, 5, "robot1/command:c asks for playbook"),
        # the file's proof is gone, too, and said first
        (removal_runs_anything, 9, "a plan that was written here may use what was made here"),
        (nothing_is_stale, 5, "fingerprints: robot1 has none"),
        (secret_runs_a_program, 5, "asks for secret-command (token, from the command touch"),
        (privileged, 5, "asks for privileged"),
    ],
)
def test_what_a_plan_file_claims_gives_no_authority(
    stage: Stage, plan: str, change: Callable[[dict[str, Any]], None], code: int, named: str
) -> None:
    """Each is refused in words that name what does not follow, and nothing is done, neither there nor here."""
    document, before = json.loads(plan), stage.look()
    change(document)

    refused = stage.apply(json.dumps(document, indent=2) + "\n")

    assert refused.code == code, refused
    assert named in refused.err
    assert stage.look() == before


def apply_all(stage: Stage, count: int) -> Counter[int]:
    """Apply mutations without a question; each is refused with 5, 6 or 9, or nothing strange is found afterwards.

    Of an instance that is not there, and with `--adopt`: else no plan is done that was changed.
    """
    stage.end("ours")
    before, codes = stage.look(), Counter[int]()
    mutations = tampered(stage.plan(), count)
    for number in range(count):
        name, text = mutations[number]
        done = stage.apply(text, "--adopt")
        assert done.code in (0, 3, 5, 6, 9), (name, done)
        assert "Traceback" not in done.err, (name, done)
        codes[done.code] += 1
        if done.code in (0, 3):
            assert settled(stage.look()) == settled(before), name
            stage.end("ours")
            mutations, before = tampered(stage.plan(), count), stage.look()  # else all others would be stale
        else:
            assert stage.look() == before, name
    stage.begin("ours")
    return codes


def test_of_changed_plan_files_none_does_what_its_plan_does_not_show(stage: Stage) -> None:
    assert apply_all(stage, FEW).total() == FEW


def test_no_changed_plan_file_changes_what_is_there(stage: Stage) -> None:
    """Whatever was changed, and with `--adopt`, too: what it leaves out nobody would see."""
    before = stage.look()
    for name, text in tampered(stage.plan(), FEW):
        refused = stage.apply(text, "--adopt")
        assert refused.code in (5, 6, 9), (name, refused)
    assert stage.look() == before


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_of_200_changed_plan_files_none_does_what_its_plan_does_not_show(
    stage: Stage, record_property: Callable[[str, object], None]
) -> None:
    codes = apply_all(stage, MANY)
    record_property("codes", dict(codes))
    assert codes.total() == MANY
    print(f"exit codes of {MANY} changed plan files: {dict(codes)}")  # noqa: T201 - figures for the documentation


def settled(seen: dict[str, str]) -> dict[str, list[str]]:
    """Return what was seen without links, which an applied plan may add."""
    return {robot: [line for line in text.splitlines() if not line.startswith("srp")] for robot, text in seen.items()}


def test_with_signers_a_changed_plan_file_is_refused(stage: Stage) -> None:
    """The signed one is done; changed ones exit with 9."""
    key, file = stage.folder / "key", stage.folder / "plan.json"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    signers = stage.folder / "signers"
    signers.write_text(f"anna@lab {key.with_suffix('.pub').read_text()}")
    made = stage.srprov("plan", stage.edf("ours", 2), "-o", str(file), "--sign", str(key))
    assert made.code == 0, made
    text, before = file.read_text(), stage.look()
    for name, changed in tampered(text, MANY if os.environ.get("SRPROV_SOAK") else 2):
        refused = stage.apply(changed, "--signers", str(signers))
        assert refused.code == 9, (name, refused)
    assert stage.look() == before

    done = stage.apply(text, "--signers", str(signers))

    assert done.code == 0, done
    assert set(stage.lab.containers("robot3", running=True)) == {"srprov.ours.far"}
