"""Files in the shapes of published ones: what can be an experiment becomes one, what cannot says why at its line."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import pytest

from srprov.conversion.compose import Wanted, draft
from srprov.conversion.experiment import Draft
from srprov.conversion.folder import write
from srprov.definitions import check_files
from srprov.importing.normal import Refused
from tests.unit.importing.test_published_shapes import CASES, choices

NOT_EXPERIMENTS = {
    "37-underwater": {"services.dvl.network_mode", "services.logger.pid", "services.logger.volumes_from"},
    "42-macvlan": {"networks.robots.driver"},
}
"""What an experiment cannot have -> the keys that say so."""
NOT_VALID = {"30-one-letter-volume": "'m:/maps' is not an absolute path inside the container"}
"""What Compose takes, for a drive of Windows, and no engine on a robot does."""


def lay_out(case: Path, folder: Path) -> None:
    """Copy a case, and make what its services build and mount: cases have their Compose files alone."""
    shutil.copytree(case, folder)
    for name in ("config", "worlds", "weights", "common/calibration", "arm/urdf", "drive/params", "x", "cfg", "maps"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name in (
        "Dockerfile",
        "px4/Dockerfile.sitl",
        "px4/docker/Dockerfile.sitl",
        "arm/driver/Dockerfile",
        "docker/sonar.Dockerfile",
        "common/Dockerfile",
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("ARG DISTRO=x\nFROM busybox AS run\nFROM run AS runtime\n")
    for name in ("config/view.rviz", "router.json5", "sim-params.yaml", "zones.yaml", "mosquitto.conf", "x/Dockerfile"):
        (folder / name).write_text("FROM busybox\n")


def drafted(case: Path, tmp_path: Path) -> Draft:
    said = choices(case)
    lay_out(case, tmp_path / "in")
    return draft(
        Wanted(
            files=[str(tmp_path / "in" / name) for name in said["files"]],
            folder=str(tmp_path / "out"),
            root=str(tmp_path / "in"),
            settings=said.get("settings", {}),
            env_files=[str(tmp_path / "in" / name) for name in said.get("env_files", [])],
        )
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_published_shape_becomes_an_experiment_or_says_why_not(case: Path, tmp_path: Path) -> None:
    try:
        found = drafted(case, tmp_path)
    except Refused as refused:
        assert all(one.location.line > 0 for one in refused.problems)
        return
    assert {one.key for one in found.refused} == NOT_EXPERIMENTS.get(case.name, set()), found.refused
    if case.name in NOT_VALID:
        with pytest.raises(Refused) as refused_late:
            write(found, str(tmp_path / "out"), ["compose.yml"])
        assert [one.message for one in refused_late.value.problems] == [NOT_VALID[case.name]]
    elif not found.refused:
        write(found, str(tmp_path / "out"), ["compose.yml"])
        assert check_files([tmp_path / "out" / "experiment.edf"], ("*",) if "profiles" in str(found.edf) else ()) == []


def test_the_documentation_quotes_what_becomes_of_them(tmp_path: Path) -> None:
    """When a figure changes, somebody looks at why."""
    numbers: Counter[str] = Counter()
    for case in CASES:
        try:
            found = drafted(case, tmp_path / case.name)
        except Refused:
            numbers["not read"] += 1
            continue
        if found.refused or case.name in NOT_VALID:
            numbers["refused here"] += 1
            continue
        numbers["imported"] += 1
        numbers["services"] += len(found.edf["services"])
        numbers.update(one.kept.value for one in found.findings)
    said = (
        f"Of {len(CASES)} files in the shapes of published ones, {numbers['imported']} become experiments of"
        f" {numbers['services']} services: {numbers['exact']} keys exact, {numbers['adapted']} adapted,"
        f" {numbers['dropped']} dropped. {numbers['refused here']} are refused here,"
        f" {numbers['not read']} by Compose too"
    )
    page = (Path(__file__).parents[3] / "docs" / "from-compose.md").read_text(encoding="utf-8")
    assert said in " ".join(page.split())
