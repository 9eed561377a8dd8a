"""Volumes with a seed: a folder of the experiment's that a service may write to, on its robot, from then on."""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.controller.pins import file_hashes
from srprov.controller.request import PlanRequest
from srprov.controller.saved import kept_plan
from srprov.definitions import load_experiment
from srprov.disk import tree_tar
from srprov.execution import run_plan
from srprov.modules import MODULES
from srprov.modules.module import Names
from srprov.modules.params import ParameterError
from srprov.modules.volume import VolumeParams
from srprov.planning.plan import Plan
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from tests.fakes import Fault, World
from tests.worlds import QUICK, made

EDF = """\
edf: 1
name: hello
services:
  a: {image: busybox, robot: ROBOT, volumes: ["config:/config"]}
volumes: {config: {seed: ./config}}
"""
NAME = "srprov.hello.config"


class Robots:
    """Two robots, and an experiment in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.world = folder, World().add("r1", "r2")
        (folder / "config").mkdir()
        self.write("one")

    def write(self, text: str, robot: str = "r1", edf: str = EDF) -> str:
        """Write the experiment with this content of its seed; give the name of what a volume is made with."""
        (self.folder / "config" / "a.yaml").write_text(text)
        (self.folder / "e.edf").write_text(edf.replace("ROBOT", robot))
        return hashlib.sha256(tree_tar(str(self.folder / "config"))).hexdigest()

    def plan(self, data: str = "") -> Plan:
        """Plan it."""
        return made(self.world, load_experiment(self.folder / "e.edf"), PlanRequest(data=data)).plan

    def apply(self, data: str = "") -> Plan:
        """Plan and do."""
        plan = self.plan(data)
        assert run_plan(plan, self.world.sessions(), lambda event: None, QUICK).exit_code == 0
        return plan


@pytest.fixture
def robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robots]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "e").mkdir()
    yield Robots(tmp_path / "e")


def test_a_seed_is_brought_once_and_what_services_wrote_since_stays(robots: Robots) -> None:
    """A changed seed is named by the plan, and changes nothing, not even a file beside the volume."""
    first = robots.write("one")
    (step,) = [one for one in robots.apply().steps if one.module == "volume"]
    assert step.change.cause.startswith("not there, made with its seed config (")
    engine = robots.world.robots["r1"].engine
    assert engine.data[NAME] == first and engine.volumes.keys() == {NAME}
    engine.data[NAME] = "what a service wrote"
    assert robots.plan().notes == () and not robots.plan().steps
    robots.write("two")
    plan = robots.apply()
    assert not plan.steps
    assert [note for note in plan.notes if NAME in note] == [
        f"{NAME} on r1 was made with another state of its seed, and its data is kept as it is; "
        "it is made anew only once it was removed there"
    ]
    assert engine.data[NAME] == "what a service wrote"
    assert not [path for path in robots.world.robots["r1"].disk.files if "seed" in path]


def test_a_volume_that_was_there_before_its_seed_is_kept(robots: Robots) -> None:
    robots.write("one", edf=EDF.replace("volumes: {config: {seed: ./config}}\n", ""))
    robots.apply()
    robots.world.robots["r1"].engine.data[NAME] = "data"
    robots.write("one")
    (note,) = (note for note in robots.apply().notes if NAME in note)
    assert "was made with no seed" in note
    assert robots.world.robots["r1"].engine.data[NAME] == "data"


def test_data_that_moves_is_no_seed(robots: Robots) -> None:
    """The data goes with its service, and its copy still says what it was made with."""
    robots.apply()
    robots.world.robots["r1"].engine.data[NAME] = "data"
    robots.write("one", robot="r2")
    robots.apply("move")
    there = robots.world.robots["r2"].engine
    assert there.data[NAME] == "data" and not robots.plan().steps
    assert not [note for note in robots.plan().notes if "seed" in note]


def test_a_replica_has_a_copy_of_its_own(robots: Robots) -> None:
    seed = robots.write("one", edf=EDF.replace("robot: ROBOT", "replicas: 2"))
    robots.apply()
    data = {name: one for robot in robots.world.robots.values() for name, one in robot.engine.data.items()}
    assert data == {f"{NAME}-1": seed, f"{NAME}-2": seed}


def test_a_killed_seed_is_brought_again(robots: Robots) -> None:
    """What is left of it is neither used nor left behind."""
    count = len([command for step in robots.plan().steps for command in step.commands])
    seed = robots.write("one")
    for at in range(1, count + 1):
        robots.world = World().add("r1", "r2")
        robots.world.robots["r1"].fault = Fault(at=at, how="half")
        run_plan(robots.plan(), robots.world.sessions(), lambda event: None, QUICK)
        robots.world.robots["r1"].fault = None
        robots.apply()
        robot = robots.world.robots["r1"]
        assert robot.engine.data[NAME] == seed and robot.engine.volumes.keys() == {NAME}
        assert not [path for path in robot.disk.files if "seed" in path]


def test_a_lock_has_the_files_of_a_seed(robots: Robots) -> None:
    found = load_experiment(robots.folder / "e.edf").experiment
    assert "config/a.yaml" in file_hashes(found, ())


def test_a_plan_file_holds_the_seed(robots: Robots) -> None:
    """Bytes and all; without them it is no plan."""
    whole = made(robots.world, load_experiment(robots.folder / "e.edf"), PlanRequest(exact=True))
    text = dump(kept_plan(whole))
    (volume,) = (step.want for step in load(text, "plan.json").plan.steps if step.module == "volume")
    assert volume is not None and volume.params.blob == tree_tar(str(robots.folder / "config"))


@pytest.mark.parametrize("entry", ["../../etc/cron.d/x", "/etc/x", "config/link/x", "config/../../x"])
def test_a_seed_in_a_plan_file_stays_in_its_volume(entry: str) -> None:
    """Whatever its tar says: one that srprov would not write is not the volume's own, and needs `playbook`."""
    names = Names(instance="hello", source="s", bridge="", link="", network="", tunnel="", vteps=frozenset())
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for name, kind, link in (("config", tarfile.DIRTYPE, ""), ("config/link", tarfile.SYMTYPE, "/etc")):
            one = tarfile.TarInfo(name)
            one.type, one.linkname, one.mode = kind, link, 0o755
            tar.addfile(one)
        good = buffer.getvalue()
        odd = tarfile.TarInfo(entry)
        odd.mode = 0o644
        tar.addfile(odd)
    module = MODULES["volume"]
    for blob, own in ((good.ljust(10_240, b"\0"), True), (buffer.getvalue(), False)):
        params = VolumeParams(instance="hello", source="s", blob=blob)
        assert module.is_own(NAME, params, names) is own
    with pytest.raises(ParameterError):
        VolumeParams(instance="hello", source="s", blob=good, user="0; reboot")
