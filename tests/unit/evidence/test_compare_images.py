"""Images of two runs are compared by content, and the packages that differ are named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from srprov.evidence.compare import compare
from srprov.evidence.grades import Line
from tests.unit.evidence.bundles import forged, packed, unpacked
from tests.unit.evidence.imaged import DEBIAN, JUDGE, NUMPY, RUNNER, STATUS, Image, bundled_with, layer, run_with

NEWER = Image((layer({**DEBIAN, "var/lib/dpkg/status": STATUS.replace("7.88.1-10", "8.5.0-2")}), layer(NUMPY)))
WITHOUT = Image((layer(DEBIAN),))
OTHER_BYTES = Image((layer({**DEBIAN, "etc/hostname": "x"}), layer(NUMPY)))


def lines(a: Path, b: Path) -> dict[str, Line]:
    (section,) = (one for one in compare([str(a)], [str(b)], {}).sections if one.id == "images")
    return {one.subject: one for one in section.lines}


def bundle_of(folder: Path, runner: Image) -> Path:
    folder.mkdir()
    return bundled_with(run_with(folder, runner), folder / "b.zip", runner, JUDGE)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        return bundle_of(home / "a", RUNNER)


def test_a_package_that_differs_is_named_with_both_versions(first: Path, tmp_path: Path) -> None:
    found = lines(first, bundle_of(tmp_path / "b", NEWER))
    assert (found["referee"].grade, found["runner"].grade) == ("identical", "different")
    assert found["runner"].text.endswith("; 1 package differs: curl (apt) 7.88.1-10, and 8.5.0-2"), found
    found = lines(first, bundle_of(tmp_path / "c", WITHOUT))
    assert found["runner"].text.endswith("; 1 package differs: numpy (pip) 1.26.4, and not there"), found


def test_images_with_the_same_packages_differ_unless_both_were_built_of_the_same(first: Path, tmp_path: Path) -> None:
    other = bundle_of(tmp_path / "b", OTHER_BYTES)
    assert lines(first, other)["runner"].grade == "different"
    assert lines(first, other)["runner"].text.endswith("the same packages")
    tag = b"srprov/runner:0123456789abcdef"
    built = []
    for number, one in enumerate((first, other)):
        run = Path(shutil.copytree(one.parent / "run", tmp_path / f"run{number}"))
        journal = run / "journal.jsonl"
        journal.write_bytes(journal.read_bytes().replace(b"runner:1", tag))
        built.append(bundled_with(run, tmp_path / f"{number}.zip", RUNNER, JUDGE, OTHER_BYTES))
    found = lines(*built)["runner"]
    assert found.grade == "equivalent" and "built of the same, with the same packages" in found.text


def test_without_lists_it_is_said_that_packages_are_not_recorded(first: Path, tmp_path: Path) -> None:
    folder = tmp_path / "b"
    folder.mkdir()
    found = lines(first, run_with(folder, NEWER))
    assert found["runner"].grade == "different" and "not recorded on both sides" in found["runner"].text
    same = tmp_path / "c"
    same.mkdir()
    assert {one.grade for one in lines(first, run_with(same)).values()} == {"identical"}


def test_an_image_that_came_from_a_bundle_is_the_one_in_it(first: Path, tmp_path: Path) -> None:
    """In another kind of store its id is another one; its name on robots has the digest of its configuration."""
    run = run_with(tmp_path)
    journal = run / "journal.jsonl"
    text = journal.read_text().replace(
        '"runner: image": "runner:1"', f'"runner: image": "srprov/bundled:{RUNNER.id[7:]}"'
    )
    journal.write_text(text.replace(RUNNER.id + '"', "sha256:" + "5" * 64 + '"'))
    assert lines(first, run)["runner"].grade == "identical"


def test_packages_that_locks_recorded_are_compared_too(tmp_path: Path) -> None:
    tag = "srprov/runner:0123456789abcdef"
    runs = []
    for version, image in (("1.0", RUNNER), ("1.1", NEWER)):
        home = tmp_path / version
        home.mkdir()
        run = run_with(home, image)
        journal = run / "journal.jsonl"
        journal.write_text(journal.read_text().replace('"runner: image": "runner:1"', f'"runner: image": "{tag}"'))
        lock = f'lock: 1\nsrprov: "0.1.0"\nimages: []\nrepositories: []\nfiles: {{}}\npackages:\n- image: "{tag}"\n'
        place = run / "sessions/1/inputs/race.lock"
        place.write_text(f'{lock}  platform: "linux/amd64"\n  apt:\n  - "tool={version}"\n')
        runs.append(run)
    assert lines(*runs)["runner"].text.endswith(": tool (apt) 1.0, and 1.1")


def test_a_list_that_is_none_is_an_error_and_no_crash(first: Path, tmp_path: Path) -> None:
    from srprov.errors import UsageError

    content = unpacked(first)
    name = f"sbom/{RUNNER.id[7:]}.cdx.json"
    broken = packed(forged({**content, name: b"[]"}), tmp_path / "b.zip")
    other = shutil.copy(first, tmp_path / "c.zip")
    with pytest.raises(UsageError, match="cannot be compared"):
        lines(broken, Path(other))


def test_ids_of_engines_that_name_images_otherwise_are_not_compared(tmp_path: Path) -> None:
    """With containerd's store an id is that of the manifest: it differs, whatever the image is."""
    runs = []
    for name, image in (("a", RUNNER), ("b", NEWER)):
        (tmp_path / name).mkdir()
        runs.append(run_with(tmp_path / name, image))
    assert lines(*runs)["runner"].grade == "different"
    for path in runs[1].rglob("facts.json"):
        path.chmod(0o600)
        path.write_text(path.read_text().replace("overlay2", "overlayfs"))
    found = lines(*runs)["runner"]
    assert found.grade == "unknown" and "do not compare" in found.text, found
