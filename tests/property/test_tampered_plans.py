"""A plan file that somebody changed is refused, or does what the plan shows; nothing beyond it, whatever was changed.

The robots are in memory here; `tests/lab/test_tampered_plans.py` does the same to real ones.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller.owners import read_owner
from srprov.controller.permissions import permit_run
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, kept_plan
from srprov.controller.secrets import HeldSecrets, read_secrets
from srprov.controller.signature import signature
from srprov.controller.source import read_source
from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.errors import RefusedError, SrprovError, UsageError
from srprov.modules.image import ImageParams
from srprov.modules.module import canonical
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.steps import due_step
from srprov.planning.text import plan_text
from srprov.record.memory import built_for, note_images
from srprov.secret import forget
from srprov.wire import EngineCall
from tests.fakes import World
from tests.tampering import CANARY, TRACE, tampered
from tests.worlds import fleet, made, run

ALLOWED = frozenset({"secret"})
MUTATIONS = 200
BUSYBOX = "busybox@sha256:" + "a" * 64


def services(version: int) -> dict[str, Any]:
    """Return two versions of an experiment: the plan from one to the other makes, changes and removes."""
    both = {"web": {"image": BUSYBOX, "command": ["v", str(version)], "robot": "robot1", "volumes": ["data:/data"]}}
    if version == 1:
        return {**both, "old": {"image": BUSYBOX, "robot": "robot2"}}
    new = {"cdf": "new.cdf", "robot": "robot2", "secrets": ["token"], "volumes": ["./www:/www"]}
    return {**both, "new": new, "far": {"image": BUSYBOX, "robot": "robot3", "volumes": ["far:/data"]}}


def written(folder: Path, name: str, version: int) -> Definitions:
    """Write an experiment and read it."""
    folder.mkdir(exist_ok=True)
    (folder / "www").mkdir(exist_ok=True)
    (folder / "www" / "index.html").write_text("hello")
    (folder / "new.cdf").write_text('cdf: 1\nname: new\nbase: busybox\nrun: ["true"]\n')
    document = {"edf": 1, "name": name, "services": services(version), "secrets": {"token": {"env": "TOKEN"}}}
    if version == 1:
        del document["secrets"]
    else:
        document["volumes"] = {"far": {"seed": "./www", "user": "1000"}}
    (folder / "experiment.edf").write_text(json.dumps(document))
    return load_experiment(str(folder / "experiment.edf"))


def planned(world: World, definitions: Definitions, environ: pytest.MonkeyPatch) -> tuple[Plan, PlanFile]:
    """Plan it for the robots of a world."""
    environ.setenv("TOKEN", "value-of-today")
    vault = read_secrets(definitions, ALLOWED)
    owner = read_owner(definitions.experiment.name, definitions.experiment.file)
    whole = made(world, definitions, PlanRequest(allowed=ALLOWED, exact=True, owner=owner), vault)
    world.vault = vault
    return whole.plan, kept_plan(whole)


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Secrets are known to the whole process, owners of volumes to the whole user: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    yield
    forget()


class Stage:
    """Three robots, two with an experiment of somebody else and version 1 of ours, and the plan file to version 2."""

    def __init__(self, folder: Path, environ: pytest.MonkeyPatch) -> None:
        self.folder, self.environ = folder, environ
        self.world = self.fresh()
        self.text = dump(planned(self.world, written(folder / "ours", "ours", 2), environ)[1])

    def fresh(self) -> World:
        world = World().add("robot1", "robot2", "robot3")
        for name in ("theirs", "ours"):
            plan, _ = planned(world, written(self.folder / name, name, 1), self.environ)
            assert run(world, plan).exit_code == 0
        return world

    def apply(self, text: str, *, adopt: bool = False, signed: bool = False) -> Plan:
        """Do what `apply` does with a file of this text.

        Raises:
            SrprovError: It is refused.
        """
        file = self.folder / "plan.json"
        file.write_text(text)
        self.environ.setenv("TOKEN", "value-of-today")
        source = read_source(str(file))
        assert isinstance(source, PlanFile)
        secrets = HeldSecrets(source, ALLOWED)
        checked = check_plan(source, fleet(self.world), adopt=adopt, signed=signed)
        permit_run(checked.plan, ALLOWED)
        self.world.vault = secrets.vault
        checked = secrets.read(checked)
        run(self.world, checked.plan)
        return checked.plan

    def theirs(self) -> str:
        """Return all that belongs to the other experiment, and whatever a mutation would leave."""
        state = json.dumps(self.world.state(), default=str, sort_keys=True)
        return json.dumps([part for part in state.split('"') if "theirs" in part or CANARY in part])


def test_a_plan_file_that_nobody_changed_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It makes, changes and removes, with an image that is built, a secret, a shipped folder and a volume."""
    stage = Stage(tmp_path, monkeypatch)
    plan = stage.apply(stage.text)
    kinds = {"container", "file", "image", "network", "secret", "tree", "volume", "vxlan", "vxlan_filter"}
    assert {step.module for step in plan.steps} == kinds
    assert {step.change.action.name for step in plan.steps} >= {"CREATE", "REPLACE", "DELETE"}
    assert stage.world.running() == [
        ("far", "robot3"), ("new", "robot2"), ("old", "robot2"), ("web", "robot1"), ("web", "robot1"),
    ]  # fmt: skip
    assert not planned(stage.world, written(tmp_path / "ours", "ours", 2), monkeypatch)[0].steps


def test_an_image_that_was_built_before_needs_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file has its context, so that its tag is known to be its content's, though nothing is built."""
    stage = Stage(tmp_path, monkeypatch)
    stage.apply(stage.text)
    _, saved = planned(stage.world, written(tmp_path / "ours", "ours", 3), monkeypatch)
    assert [step.name for step in saved.plan.steps] == ["srprov.ours.web"]
    assert {one.kind for one in saved.plan.permissions} == {"secret"}
    assert [step.name for step in stage.apply(dump(saved)).steps] == ["srprov.ours.web"]


def test_of_200_changed_plan_files_none_does_what_its_plan_does_not_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is refused with 5, 6 or 9; or all that robots heard stands in the shown plan, and none of it is strange.

    As files of a signer: of others none is done where the instance is there.
    """
    stage = Stage(tmp_path, monkeypatch)
    before, codes = stage.theirs(), Counter[int]()
    for name, text in tampered(stage.text, MUTATIONS):
        heard = len(stage.world.done())
        try:
            plan = stage.apply(text, adopt=True, signed=True)
        except SrprovError as error:
            assert error.exit_code in (5, 6, 9), (name, error)
            assert len(stage.world.done()) == heard, name
            codes[error.exit_code] += 1
            continue
        codes[0] += 1
        shown = plan_text(plan, commands=True)
        for entry in stage.world.done()[heard:]:
            told = entry.what.text()  # type: ignore[union-attr]
            # how long a container has to stop is the run's own option
            assert told.splitlines()[0].partition("?t=")[0] in shown and CANARY not in told, (name, told)
            if isinstance(entry.what, EngineCall) and entry.what.path == "/containers/create":
                assert not json.loads(entry.what.body)["HostConfig"]["Privileged"], name
        assert stage.theirs() == before, name
        stage.world = stage.fresh()
    assert stage.theirs() == before
    assert not Path(TRACE).exists()
    assert codes[0] < MUTATIONS / 10 and codes[5] > MUTATIONS / 2, codes


def test_a_secret_is_not_read_before_the_question(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a plan file names is taken out of the environment, and into the vault only when it is to be written."""
    stage = Stage(tmp_path, monkeypatch)
    file = tmp_path / "plan.json"
    file.write_text(stage.text)
    source = read_source(str(file))
    assert isinstance(source, PlanFile)
    monkeypatch.setenv("TOKEN", "value-of-today")
    secrets = HeldSecrets(source, ALLOWED)
    checked = check_plan(source, fleet(stage.world))
    assert "token" not in secrets.vault and "TOKEN" not in os.environ
    secrets.read(checked)
    assert "token" in secrets.vault


def test_with_signers_every_changed_plan_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 9 for all 200, before a byte of them is parsed; the one that was signed is read."""
    stage = Stage(tmp_path, monkeypatch)
    key, signers = tmp_path / "key", tmp_path / "signers"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    signers.write_text(f"anna@lab {key.with_suffix('.pub').read_text()}")
    file = tmp_path / "plan.json"
    file.write_text(stage.text)
    (tmp_path / "plan.json.sig").write_bytes(signature(file.read_bytes(), "plan.json", str(key)))
    assert isinstance(read_source(str(file), str(signers)), PlanFile)
    with mock.patch("srprov.planning.planread.load", side_effect=AssertionError("it was read")):
        for name, text in tampered(stage.text, MUTATIONS):
            file.write_text(text)
            with pytest.raises(RefusedError) as caught:
                read_source(str(file), str(signers))
            assert caught.value.exit_code == 9, name


def copying(saved: PlanFile, name: str, source: str, **of: str) -> str:
    """Return a plan file in which an image that is built or pulled is copied from another robot instead."""
    steps = []
    for step in saved.plan.steps:
        if step.module == "image" and step.name == name and step.host != source:
            assert step.want is not None
            params = ImageParams(source="copy", from_=source, **of)
            want = replace(step.want, params=params, written={"source": "copy", "from": source, **of})
            due = due_step(want, None)
            assert due is not None
            steps.append(replace(step, want=want, change=due.change))
        else:
            steps.append(step)
    return dump(replace(saved, plan=replace(saved.plan, steps=tuple(steps)), proof=""))


def test_a_plan_file_copies_only_images_that_were_built_under_their_tag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not any tag, not what a robot says to be it, and not what only the file says to be it."""
    stage = Stage.__new__(Stage)
    stage.folder, stage.environ, stage.world = tmp_path, monkeypatch, World().add("robot1", "robot2", "robot3")
    _, saved = planned(stage.world, written(tmp_path / "fresh", "fresh", 2), monkeypatch)
    built = next(step.name for step in saved.plan.steps if step.name.startswith("srprov/new:"))
    for name, source, of in ((BUSYBOX, "robot2", {}), (BUSYBOX, "robot2", {"id": "sha256:1"}), (built, "robot3", {})):
        with pytest.raises(UsageError, match=rf"{name[:20]}\S* asks for playbook"):
            stage.apply(copying(saved, name, source, **of))
    text = copying(saved, built, "robot3", id="sha256:1")
    for ids in ([], ["sha256:2 robot3 local"]):
        note_images({built_for(built, "amd64"): ids})
        with pytest.raises(RefusedError, match="only this plan, which was not written here, says that srprov/new"):
            stage.apply(text)


@pytest.mark.parametrize(
    "forged",
    [
        {"subnet": "10.0.0.0/8"}, {"vni": 1}, {"mtu": 68}, {"port": 1}, {"extra": {"any": "thing"}}, {"serial": 2**40},
        {"robots": {"robot1": {"gateway": "10.1.2.3", "vtep": ""}}}, {"services": {"web": {"ip": "10.1.2.3"}}},
    ],
)  # fmt: skip
def test_a_plan_file_records_the_placement_of_its_own_resources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forged: dict[str, Any]
) -> None:
    """Robots believe a record: a subnet that it names is taken for everybody else."""
    world = World().add("robot1", "robot2", "robot3")
    _, saved = planned(world, written(tmp_path / "fresh", "fresh", 2), monkeypatch)
    steps = []
    for step in saved.plan.steps:
        if step.want is not None and step.name.endswith("/placement.json"):
            value = json.loads(step.want.params.content)
            for key, one in forged.items():
                value[key] = {**value[key], **one} if key in ("robots", "services") else one
            written_as = {**step.want.written, "content": canonical(value) + "\n"}
            params = replace(step.want.params, content=written_as["content"])
            due = due_step(replace(step.want, params=params, written=written_as), None)
            assert due is not None
            steps.append(replace(step, want=due.want, change=due.change))
        else:
            steps.append(step)
    (tmp_path / "plan.json").write_text(dump(saved))
    assert read_source(str(tmp_path / "plan.json"))
    plan = replace(saved.plan, steps=tuple(steps))
    (tmp_path / "plan.json").write_text(dump(replace(saved, plan=plan, proof="")))
    with pytest.raises(UsageError, match=r"placement\.json asks for playbook"):
        read_source(str(tmp_path / "plan.json"))
