"""A lock on real robots: a registry whose tag moves, and a branch that moves; what is built and run stays the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Lab, busybox, causes, edf, part_of_lab
from tests.lab.looks import log_of, wait_until
from tests.lab.test_cdf import Code

pytestmark = pytest.mark.lab

ROBOT = "robot1"
REGISTRY = "127.0.0.1:5077"
BASE = f"{REGISTRY}/base:1"
CONFIG = f'{{version: 0.1, storage: {{filesystem: {{rootdirectory: /run/reg}}}}, http: {{addr: "{REGISTRY}"}}}}'
SERVE = """\
mkdir -p /run/reg; echo "$0" > /run/reg.yml
OTEL_TRACES_EXPORTER=none docker-registry serve /run/reg.yml >/run/reg.log 2>&1 </dev/null &
"""
PUSH = """\
printf 'FROM busybox\\nRUN echo %s > /what\\n' "$0" | docker build -q -t "$1" - && docker push -q "$1" &&
docker image inspect -f '{{index .RepoDigests 0}}' "$1"
"""


def _push(lab: Lab, what: str) -> str:
    """Give the tag other content, and return its digest as Docker says it."""
    return lab.shell(ROBOT, "sh", "-c", PUSH, what, BASE).out.split()[-1].partition("@")[2]


@pytest.mark.soak
def test_a_locked_experiment_stays_what_it_was_when_tags_and_branches_move(lab: Lab, tmp_path: Path) -> None:
    """Of a base, an image and a branch; what is named is looked up again, and a changed file is told."""
    code = Code(tmp_path / "code")
    code.commit("1")
    lab.shell(ROBOT, "sh", "-c", SERVE, CONFIG)
    wait_until(
        lambda: lab.shell(ROBOT, "busybox", "wget", "-qO-", f"http://{REGISTRY}/v2/", check=False).code == 0, 10, "x"
    )
    old = _push(lab, "old")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "a.cdf").write_text(
        f"cdf: 1\nbase: {BASE}\nrepositories: [{{git: 'file://{code.folder}', ref: main, path: /opt/code}}]\n"
        "command: [sh, -c, 'cat /what; /opt/code/say.sh; sleep 86400']\nstop_signal: SIGKILL\n",
        encoding="utf-8",
    )
    services: dict[str, dict[str, Any]] = {"a": {"cdf": "a.cdf"}}
    services["b"] = {**busybox("sh", "-c", "cat /what; sleep 86400"), "image": BASE}
    path = tmp_path / "locked.edf"
    path.write_text(edf("locked", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    allowed = [word for kind in ("git", "outside", "engine-fetch") for word in ("--allow", kind)]
    words = (str(path), "-i", inventory, *allowed)

    def plan(*more: str) -> dict[str, str]:
        made = lab.srprov("plan", *words, "--json", *more, env=own)
        assert made.code == 0, made
        notes = " ".join(made.json["notes"])
        return {**causes(made.json), "notes": notes}

    free = plan()
    built = next(name for name in free if "image:srprov/a" in name)
    assert "base not pinned" in free[built] and "main of file://" in free["notes"]
    made = lab.srprov("lock", *words, env=own)
    assert made.code == 0 and f"+ {BASE}: {old}" in made.out, made
    locked = plan("--locked")
    held = next(name for name in locked if "image:srprov/a" in name)
    assert "base not pinned" not in locked[held] and held != built and "main of" not in locked["notes"]

    code.commit("2")
    new = _push(lab, "new")
    lab.shell(ROBOT, "sh", "-c", f"docker rmi {BASE}; docker image prune -f")
    done = lab.srprov("apply", *words, "--locked", "--yes", "--settle", "0", env=own)
    assert done.code == 0, done
    assert log_of(lab, ROBOT, "srprov.locked.a") == ["old", "version 1"]
    assert log_of(lab, ROBOT, "srprov.locked.b") == ["old"]
    assert lab.inspect(ROBOT, "srprov.locked.b")["Config"]["Image"] == f"{REGISTRY}/base@{old}"
    again = lab.srprov("plan", *words, "--locked", "--detailed-exitcode", env=own)
    assert again.code == 0, again

    update = lab.srprov("lock", *words, "--update", "code", env=own)
    assert update.code == 0 and "~ main of file://" in update.out and BASE not in update.out, update
    update = lab.srprov("lock", *words, "--update", BASE, env=own)
    assert update.code == 0 and f"~ {BASE}: {old} is {new} now" in update.out, update
    (tmp_path / "a.cdf").write_text((tmp_path / "a.cdf").read_text() + "# x\n", encoding="utf-8")
    stale = lab.srprov("plan", *words, "--locked", env=own)
    assert stale.code == 5 and "the file a.cdf has changed" in stale.err, stale
    assert json.dumps(new) in (tmp_path / "locked.lock").read_text(encoding="utf-8")

    (tmp_path / "locked.lock").unlink()
    services["b"]["pull_policy"] = "always"
    path.write_text(edf("locked", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    fresh = plan()
    assert any(f"image:{REGISTRY}/base@{new}" in name for name in fresh), fresh
    services["b"] |= {"pull_policy": "never", "image": f"{REGISTRY}/base:2"}
    path.write_text(edf("locked", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    never = lab.srprov("plan", *words, env=own)
    assert never.code == 5 and f"b: {REGISTRY}/base:2 is not on {ROBOT}" in never.err, never
