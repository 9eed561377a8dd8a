"""Data sets of an EDF and a CDF: what is shipped from where, and what is wrong with one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.definitions.containermodel import Mount
from srprov.errors import DefinitionError

SHA = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


def load(folder: Path, data: str, cdf: str = "") -> tuple[Mount, ...]:
    """Return the mounts of a service with these data sets; `run.bag` and the folder `maps` are there."""
    (folder / "maps").mkdir(exist_ok=True)
    (folder / "maps" / "a").write_text("a")
    (folder / "run.bag").write_text("test")
    (folder / "c.cdf").write_text(f"cdf: 1\nimage: busybox\n{cdf}")
    (folder / "e.edf").write_text(f"edf: 1\nname: demo\nservices:\n  a: {{cdf: c.cdf, data: {data}}}\n")
    return load_experiment(str(folder / "e.edf")).experiment.services["a"].runtime.mounts


def test_files_folders_and_downloads(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        f"[{{name: run, path: run.bag, sha256: {SHA}, doi: 10.1/2, target: /d/run}}, {{path: maps, target: /d/maps}}, "
        f"{{url: 'https://example.org:8443/x?y=1', sha256: {SHA}, target: /d/x}}]",
    )
    assert found == (
        Mount(kind="data", source=f"{tmp_path}/run.bag", target="/d/run", read_only=True, sha256=SHA),
        Mount(kind="tree", source=f"{tmp_path}/maps", target="/d/maps", read_only=True),
        Mount(kind="data", source="", target="/d/x", read_only=True, sha256=SHA, url="https://example.org:8443/x?y=1"),
    )


def test_a_service_adds_to_its_cdf_and_wins_at_a_target(tmp_path: Path) -> None:
    cdf = "data: [{path: run.bag, target: /a}, {path: run.bag, target: /b}]\n"
    found = load(tmp_path, f"[{{path: run.bag, target: /b, sha256: {SHA}}}]", cdf)
    assert [(one.target, one.sha256) for one in found] == [("/a", ""), ("/b", SHA)]


def test_a_large_file_is_no_problem_where_a_volume_would_be_refused(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        os.truncate(file.fileno(), 200 << 20)
    assert [one.kind for one in load(tmp_path, "[{path: large, target: /d}]")] == ["data"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("[{path: run.bag}]", "'target'"),
        ("[{target: /d}]", "a data set has either 'path' or 'url'"),
        (f"[{{path: run.bag, url: 'https://x/y', sha256: {SHA}, target: /d}}]", "either 'path' or 'url'"),
        ("[{url: 'https://x/y', target: /d}]", "what is downloaded needs its 'sha256'"),
        (f"[{{url: 'http://x/y', sha256: {SHA}, target: /d}}]", "https://"),
        (f"[{{url: 'https://u:p@x/y', sha256: {SHA}, target: /d}}]", "without a user"),
        ("[{path: run.bag, sha256: abc, target: /d}]", "64 hexadecimal digits"),
        (f"[{{path: maps, sha256: {SHA}, target: /d}}]", "is a folder, and a sha256 is that of a file"),
        ("[{path: ../x, target: /d}]", "leaves the folder"),
        ("[{path: /etc/passwd, target: /d}]", "must be a relative path"),
        ("[{path: none, target: /d}]", "does not exist"),
        ("[{path: run.bag, target: /d}, {path: maps, target: /d}]", "mounted twice"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, data: str, message: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        load(tmp_path, data)
    assert any(message in f"{one.message} {one.hint}" for one in caught.value.problems), caught.value.problems
