"""A bundle comes to a folder in which another one was before: no verb takes what that left for this one's."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab


def test_who_names_a_bundle_s_edf_means_nothing_of_another_one(lab: Lab, tmp_path: Path) -> None:
    """What runs is of the first one, with the user's words in it. The second one brings a further EDF of its name."""
    inventory, bundles = part_of_lab(lab, ["robot1"], tmp_path / "inventory.yml"), []
    given = {"until": {"any": [{"completed": "planner"}]}, "timeout": "20s"}
    logs = busybox("sh", "-c", "echo private; sleep 86400")
    files = {"first": {"tour": edf("tour", {"planner": logs}, trials={"timeout": "2s"})}}
    shipping = busybox("true", volumes=["./tour.edf:/tour.edf:ro"])
    second = edf("other", {"planner": shipping}, trials=given)
    files["second"] = {"other": second, "tour": edf("tour", {"planner": logs})}
    for name, texts in files.items():
        (tmp_path / name).mkdir()
        for file, text in texts.items():
            (tmp_path / name / f"{file}.edf").write_text(text)
        file, run = str(tmp_path / name / f"{next(iter(texts))}.edf"), str(tmp_path / name / "run")
        assert lab.srprov("run", file, "-i", inventory, "-o", run, "--yes").code == 0
        assert lab.srprov("bundle", run, "-o", str(tmp_path / f"{name}.zip")).code == 0
        assert lab.srprov("destroy", file, "-i", inventory, "--yes").code == 0
        bundles.append(str(tmp_path / f"{name}.zip"))
    again, beside = tmp_path / "again", ("-i", inventory)
    words, file = (*beside, "-o", str(again), "--yes"), str(again / "experiment/tour.edf")
    assert lab.srprov("replay", bundles[0], *words).code == 0
    assert lab.srprov("apply", file, *beside, "--yes").code == 0
    assert lab.srprov("exec", file, "planner", *beside, "--", "true").code == 0
    shutil.rmtree(again)
    assert lab.srprov("replay", bundles[1], *words).code == 0, "its trials are of another name"
    mine = tmp_path / "mine"
    mine.write_text("mine")
    refused = {
        "apply": lab.srprov("apply", file, *beside, "--yes"),
        "collect": lab.srprov("collect", file, *beside, "-o", str(again / "experiment/out")),
        "cp": lab.srprov("cp", file, str(mine), "planner:/tmp/mine", *beside),
        "stop": lab.srprov("stop", file, *beside, "--yes"),
    }
    assert {verb: one.code for verb, one in refused.items()} == dict.fromkeys(refused, 9), refused
    assert not (again / "experiment/out").exists()
    typed = lab.srprov("exec", file, "planner", *beside, "--", "true")
    assert typed.code == 255 and typed.err.count("tour.edf, bundle ") == 2, typed
    for one in ("--instance", "tour"), (str(again / "experiment/other.edf"),):
        gone = lab.srprov("destroy", *one, *beside, "--yes")
        assert gone.code == 0, gone
