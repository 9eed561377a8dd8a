"""A volume that another service may write to has no mount below it: by a link that one would say where it goes."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.errors import DefinitionError, Diagnostic

HEAD = "edf: 1\nname: own\nsecrets: {token: {env: TOKEN}}\nservices:\n"
CAM = "  cam: {image: busybox, volumes: ['data:/data']}\n"
CDF = "cdf: 1\nname: planner\nimage: busybox\nvolumes: ['logs:/data/logs']\n"


def load(folder: Path, planner: str, others: str = CAM) -> None:
    (folder / "config").mkdir(exist_ok=True)
    (folder / "run.bag").touch()
    (folder / "planner.cdf").write_text(CDF)
    (folder / "e.edf").write_text(f"{HEAD}  planner:\n    {planner}\n{others}")
    load_experiment(str(folder / "e.edf"))


def refused(folder: Path, planner: str, others: str = CAM) -> Diagnostic:
    with pytest.raises(DefinitionError) as caught:
        load(folder, planner, others)
    (problem,) = caught.value.problems
    assert str(problem.code) == "SRP-117"
    return problem


@pytest.mark.parametrize(
    ("fields", "line", "place"),
    [
        ("volumes: ['data:/data', 'logs:/data/logs']", "volumes", "/data/logs"),
        ("volumes: ['logs:/data/a/b/c/logs', 'data:/data:ro']", "volumes", "/data/a/b/c/logs"),
        ("volumes: ['data:/data', 'logs:/x/..//data/./logs/']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', 'data:/data/logs']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', 'own:/own', 'logs:/data/logs']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', '/srv/logs:/data/logs']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', '~robot/logs:/data/logs']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', './config:/data/logs:ro']", "volumes", "/data/logs"),
        ("volumes: ['data:/data', {type: tmpfs, target: /data/logs}]", "volumes", "/data/logs"),
        ("volumes: ['data:/data', {type: volume, source: logs, target: /data/logs}]", "volumes", "/data/logs"),
        ("volumes: ['data:/data']\n    tmpfs: /data/logs:size=1m", "tmpfs", "/data/logs"),
        ("volumes: ['data:/data']\n    tmpfs: [/data/logs]", "tmpfs", "/data/logs"),
        ("volumes: ['data:/data']\n    data: [{path: run.bag, target: /data/logs}]", "data", "/data/logs"),
        ("volumes: ['data:/data']\n    data: [{path: config, target: /data/logs}]", "data", "/data/logs"),
        ("volumes: ['data:/data']\n    devices: ['/dev/video0:/data/logs']", "devices", "/data/logs"),
        ("volumes: ['data:/data']\n    secrets: [{source: token, target: /data/logs}]", "secrets", "/data/logs"),
        ("volumes: ['data:/data']\n    secrets: [{source: token, target: ../../data/logs}]", "secrets", "/data/logs"),
        ("volumes: ['data:/run']\n    secrets: [token]", "secrets", "/run/secrets/token"),
        ("volumes: ['data:/run', 'logs:/var/run/logs']", "volumes", "/run/logs"),
        ("volumes: ['data:/data']\n    cdf: planner.cdf", "volumes", "/data/logs"),
        ("cdf: planner.cdf\n    volumes: ['data:/data']", "volumes", "/data/logs"),
    ],
)
def test_what_lies_below_is_refused_at_its_line(tmp_path: Path, fields: str, line: str, place: str) -> None:
    own = "" if "cdf" in fields else "image: busybox\n    "
    problem = refused(tmp_path, own + fields)
    assert f"'{place}' lies in the volume 'data', which 'cam' may write to" in problem.message
    assert problem.location.file == str(tmp_path / "e.edf")
    shown = (tmp_path / "e.edf").read_text().splitlines()[problem.location.line - 1]
    assert shown.strip().startswith(f"{line}:") and problem.path == f"services.planner.{line}"
    assert f"at '/{place.rpartition('/')[2]}'" in problem.hint and "in 'cam'" in problem.hint


@pytest.mark.parametrize(
    ("fields", "place", "who"),
    [
        ("volumes: ['data:/etc']", "/etc/hostname", "the engine"),
        ("volumes: ['data:/etc/srprov']", "/etc/srprov", "srprov"),
        ("volumes: ['data:/dev']", "/dev/mqueue", "the engine"),
        ("volumes: ['data:/sbin']\n    init: true", "/sbin/docker-init", "the engine"),
        ("volumes: ['data:/sys/fs']\n    network: none", "/sys/fs/cgroup", "the engine"),
    ],
)
def test_what_nobody_wrote_lies_below_too(tmp_path: Path, fields: str, place: str, who: str) -> None:
    """It is told once, at the line of the volume, whatever else is mounted there."""
    problem = refused(tmp_path, f"image: busybox\n    {fields}")
    assert problem.message.startswith(f"'{place}', where {who} itself mounts something, lies in the volume 'data'")
    assert (problem.location.line, problem.path) == (7, "services.planner.volumes")
    assert problem.hint.startswith("mount the volume elsewhere")


@pytest.mark.parametrize(
    "others",
    [
        "  cam: {image: busybox, volumes: ['data:/data'], profiles: [sim]}\n",
        "  cam: {image: busybox, volumes: ['data:/data:ro', 'data:/again']}\n",
        "  cam: {image: busybox, volumes: [{type: volume, source: data, target: /d, read_only: false}]}\n",
        "  ann: {image: busybox, volumes: ['data:/data:ro']}\n" + CAM,
    ],
)
def test_whoever_may_write_there_counts(tmp_path: Path, others: str) -> None:
    nested = "image: busybox\n    volumes: ['data:/data', 'logs:/data/logs']"
    assert "which 'cam' may write to" in refused(tmp_path, nested, others).message


def test_a_shared_volume_beside_it_with_a_longer_name_hides_nothing(tmp_path: Path) -> None:
    """Its place sorts between the folder and what is in it."""
    nested = "image: busybox\n    volumes: ['data:/data', 'more:/data-x', 'logs:/data/logs']"
    problem = refused(tmp_path, nested, "  cam: {image: busybox, volumes: ['data:/data', 'more:/more']}\n")
    assert problem.message.startswith("'/data/logs' lies in the volume 'data'")


@pytest.mark.parametrize("planner", ["per_robot: {}", "per_robot: {tags: [arm]}"])
def test_each_robot_s_own_volume_is_shared_with_what_is_on_that_robot(tmp_path: Path, planner: str) -> None:
    nested = f"image: busybox\n    volumes: ['data:/data', 'logs:/data/logs']\n    {planner}"
    refused(tmp_path, nested, "  cam: {image: busybox, volumes: ['data:/data'], per_robot: {}}\n")


@pytest.mark.parametrize(
    ("planner", "others"),
    [
        ("volumes: ['data:/data', 'logs:/data/logs']", ""),
        ("volumes: ['data:/data', 'logs:/data/logs']\n    replicas: 3", ""),
        ("volumes: ['data:/data', 'logs:/data/logs']\n    per_robot: {}", ""),
        ("volumes: ['data:/data', 'logs:/data/logs']", "  cam: {image: busybox, volumes: ['data:/data:ro']}\n"),
        ("volumes: ['data:/data', 'logs:/data/logs']", "  cam: {image: busybox, volumes: ['logs:/logs']}\n"),
        ("volumes: ['data:/data', 'logs:/data-logs', 'x:/dat']", CAM),
        ("volumes: ['own:/own', 'data:/own/data']", CAM),
        ("volumes: ['data:/etcetera', 'logs:/data/logs']\n    secrets: [token]", CAM),
    ],
)
def test_what_no_other_one_writes_to_may_have_mounts_below(tmp_path: Path, planner: str, others: str) -> None:
    load(tmp_path, f"image: busybox\n    {planner}", others)
