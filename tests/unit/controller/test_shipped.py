"""All that an experiment ships together has one limit, and a file that it ships often is read once."""

from __future__ import annotations

import io
import os
import tarfile
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from srprov import disk, regular_file
from srprov.definitions import load_experiment
from srprov.errors import SrprovError
from srprov.images.context import entries_of, folder_entries
from srprov.planning import plan, planfile
from srprov.planning.plan import Plan
from srprov.regular_file import MIB
from tests.bounded import bounded
from tests.fakes import World
from tests.worlds import made


def cdf(folder: Path, *sources: str, name: str = "a") -> None:
    """Write a CDF that ships files."""
    files = "".join(f"  - {{src: {source}, dest: /x{number}}}\n" for number, source in enumerate(sources))
    (folder / f"{name}.cdf").write_text(f"cdf: 1\nname: {name}\nbase: busybox\nfiles:\n{files}")


def sparse(path: Path, mib: int) -> None:
    """Make a file that takes no room on the disk."""
    path.touch()
    os.truncate(path, mib * MIB)


@pytest.mark.parametrize("kind", ["one image", "images", "folders"])
def test_all_that_is_shipped_together_has_one_limit(tmp_path: Path, kind: str) -> None:
    """Twelve times 40 MiB in one image, one image for each, and twelve folders: refused, in little memory."""
    sparse(tmp_path / "big", 40)
    names = [f"s{number}" for number in range(12)]
    if kind == "one image":
        cdf(tmp_path, *["big"] * 12)
        services = ["a: {cdf: a.cdf, network: none}"]
    elif kind == "images":
        for name in names:
            cdf(tmp_path, "big", name=name)
        services = [f"{name}: {{cdf: {name}.cdf, network: none}}" for name in names]
    else:
        for name in names:
            (tmp_path / name).mkdir()
            os.link(tmp_path / "big", tmp_path / name / "big")
        mounts = ", ".join(f"'./{name}:/{name}:ro'" for name in names)
        services = [f"a: {{image: busybox, network: none, volumes: [{mounts}]}}"]
    lines = "".join(f"  {one}\n" for one in services)
    (tmp_path / "e.edf").write_text(f"edf: 1\nname: big\nplacement: {{slots_per_robot: 12}}\nservices:\n{lines}")
    definitions, world = load_experiment(tmp_path / "e.edf"), World().add("r1")
    tracemalloc.start()
    try:
        with pytest.raises(SrprovError) as refused:
            made(world, definitions)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    told = str(refused.value) + str([one.message for one in getattr(refused.value, "problems", ())])
    assert "all that is shipped is more than 96 MiB or 50000 files" in told
    assert (refused.value.exit_code, peak < 220 * MIB) == (5, True), peak / MIB


def test_a_file_that_is_shipped_often_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "small").write_text("x")
    (tmp_path / "link").symlink_to("small")  # definitions name what a link leads to, never the link
    opened: list[str] = []
    read = regular_file.read
    monkeypatch.setattr(
        regular_file, "read", lambda path, most, **how: (opened.append(str(path)), read(path, most, **how))[1]
    )
    with disk.together():
        assert [disk.read(str(tmp_path / "small")) for _ in range(3)] == [b"x"] * 3
        with pytest.raises(OSError, match="changed while it was read"):
            disk.read(str(tmp_path / "link"))
    assert len(opened) == 2


def test_files_count_over_all_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk._Budget, "__init__", lambda self: self.__dict__.update(left=9, files=5, contents={}))
    for number in range(3):
        (tmp_path / str(number)).write_text("x")
    with disk.together():
        assert len(list(disk.listing(str(tmp_path)))) == 3
        with pytest.raises(OSError, match="more than 96 MiB or 50000 files"):
            disk.tree_tar(str(tmp_path))


def test_a_thousand_containers_are_put_in_order_without_being_compared_with_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each container is named a few times, not once for each of the others."""
    named: list[str] = []
    name_of = plan.resource_id
    monkeypatch.setattr(plan, "resource_id", lambda *words: (named.append(""), name_of(*words))[1])
    (tmp_path / "e.edf").write_text(
        "edf: 1\nname: many\nplacement: {slots_per_robot: 300}\n"
        "services: {s: {image: busybox, replicas: 300, network: none}}\n"
    )
    steps = made(World().add("r1"), load_experiment(tmp_path / "e.edf")).plan.steps
    assert len(named) < 20 * len(steps)


def test_a_large_dockerignore_is_refused_before_it_is_split(tmp_path: Path) -> None:
    (tmp_path / "Dockerfile").write_text("FROM a\n")
    (tmp_path / ".dockerignore").write_bytes(b"\n" * (30 << 20))
    with pytest.raises(ValueError, match="larger than 64 KiB"):
        bounded(lambda: folder_entries(str(tmp_path), disk.listing, disk.read))


@pytest.mark.parametrize("kind", ["volume", "file of an image"])
def test_what_is_shipped_leaves_git_out(tmp_path: Path, kind: str) -> None:
    """It may hold tokens; who names the folder itself gets it."""
    inner = tmp_path / "src" / ".git"
    inner.mkdir(parents=True)
    (tmp_path / "src" / "below" / ".hg").mkdir(parents=True)
    (tmp_path / "src" / "below" / ".hg" / "hgrc").write_text("default = https://me:token@example.com\n")
    (inner / "config").write_text("url = https://token@example.com\n")
    (tmp_path / "src" / "_darcs").mkdir()
    (tmp_path / "src" / "_darcs" / "defaultrepo").write_text("https://me:token@example.com\n")
    (tmp_path / "src" / "a.py").touch()

    def shipped(path: Path) -> list[str]:
        if kind == "volume":
            return tarfile.open(fileobj=io.BytesIO(disk.tree_tar(str(path)))).getnames()
        return [one.path for one in entries_of("0", str(path), "", disk.listing, disk.read)]

    assert "a.py" in " ".join(shipped(tmp_path / "src")) and ".git" not in " ".join(shipped(tmp_path / "src"))
    assert ".hg" not in " ".join(shipped(tmp_path / "src"))
    assert "_darcs" not in " ".join(shipped(tmp_path / "src"))
    assert "config" in " ".join(shipped(inner))


@pytest.mark.parametrize("above", ["CVS", "_MTN/robots", ".repo"])
def test_what_is_shipped_leaves_git_out_whatever_the_folders_above_are_called(tmp_path: Path, above: str) -> None:
    """Who clones a project takes its name for the folder, and a stranger gave it that name."""
    clone = tmp_path / above
    (clone / ".git").mkdir(parents=True)
    (clone / ".git" / "config").write_text("url = https://me:token@example.com\n")
    (clone / "a.py").touch()
    with tarfile.open(fileobj=io.BytesIO(disk.tree_tar(str(clone)))) as tar:
        assert tar.getnames() == [clone.name, f"{clone.name}/a.py"]
    assert [one.path for one in disk.shipped(str(clone))] == ["a.py"]


def _large(saved: planfile.PlanFile, blobs: dict[str, bytes]) -> dict[str, Any]:
    blobs["x"] = bytes(planfile.MAX_CHARACTERS * 3 // 4 + 3)
    return {}


def test_a_plan_file_that_is_too_large_is_refused_before_it_is_encoded(monkeypatch: pytest.MonkeyPatch) -> None:
    saved = planfile.PlanFile(plan=Plan(instance="a", source="", steps=()), fingerprints={})
    monkeypatch.setattr(planfile, "_document", _large)
    monkeypatch.setattr(planfile, "pieces", lambda _: pytest.fail("it was encoded"))
    with pytest.raises(ValueError, match="larger than 96 MiB"):
        planfile.dump(saved)
