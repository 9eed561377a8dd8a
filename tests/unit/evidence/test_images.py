"""Images in bundles: what is written, that it is always the same, and what `verify` finds."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.cli.main import run as cli
from srprov.errors import RefusedError, UsageError
from srprov.evidence import checks_images, make_images
from srprov.evidence.make import bundle
from srprov.evidence.verify import Report, verify
from srprov.oci import layout as oci
from srprov.secret import Secret
from tests.bounded import bounded
from tests.unit.evidence.bundles import Content, forged, packed, unpacked, with_manifest
from tests.unit.evidence.imaged import DEBIAN, JUDGE, RUNNER, Image, bundled_with, layer, run_with, sha


@pytest.fixture(scope="module")
def imaged_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose images are known."""
    home = tmp_path_factory.mktemp("imaged")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        return run_with(home)


@pytest.fixture(scope="module")
def imaged(imaged_run: Path) -> Path:
    """Its bundle with images."""
    return bundled_with(imaged_run, imaged_run.parent / "race.zip")


@pytest.fixture
def content(imaged: Path) -> Content:
    return unpacked(imaged)


def results(report: Report) -> dict[str, str]:
    return {one.id: one.result for one in report.findings}


def failed(report: Report) -> dict[str, tuple[str, ...]]:
    return {one.id: one.details for one in report.findings if one.result == "fail"}


def test_images_are_in_it_as_a_layout_that_docker_loads_too(imaged: Path, content: Content) -> None:
    report = verify(str(imaged))
    assert failed(report) == {} and {results(report)[one] for one in ("I1", "I2", "I3", "I4", "S1", "S2")} == {"pass"}
    assert report.unproven[2:] == ("that an image in it was built of the definitions beside it",)
    index = json.loads(content["images/index.json"])
    assert json.loads(content["images/oci-layout"]) == {"imageLayoutVersion": "1.0.0"}
    names = {one["annotations"]["org.opencontainers.image.ref.name"]: one for one in index["manifests"]}
    own = {one: f"srprov/bundled:{one.id[7:]}" for one in (RUNNER, JUDGE)}
    assert set(names) == {*own.values()}, "whoever loads them has no name moved that he has"
    said = {key: one["annotations"]["srprov.image.names"] for key, one in names.items()}
    assert said == {own[RUNNER]: "runner:1", own[JUDGE]: "judge:latest"}
    manifest = json.loads(content["images/blobs/sha256/" + names[own[RUNNER]]["digest"][7:]])
    assert manifest["config"]["digest"] == RUNNER.id
    layers = [gzip.decompress(content["images/blobs/sha256/" + one["digest"][7:]]) for one in manifest["layers"]]
    assert layers == list(RUNNER.layers)
    listed = json.loads(content["images/manifest.json"])
    assert {one["RepoTags"][0]: one["Config"] for one in listed} == {
        own[one]: f"blobs/sha256/{one.id[7:]}" for one in (RUNNER, JUDGE)
    }  # fmt: skip
    base = {one for one in content if one.startswith("images/blobs/")}
    assert len(base) == 3 + 2 * 2  # the base is there once
    assert json.loads(content["bundle.json"])["images"] == {"with": "all", "left_out": []}
    assert "docker load" in content["README.md"].decode()


def test_lists_of_packages_are_of_each_image(content: Content) -> None:
    listed = json.loads(content[f"sbom/{RUNNER.id[7:]}.cdx.json"])
    assert (listed["bomFormat"], listed["specVersion"]) == ("CycloneDX", "1.6")
    assert [one["purl"] for one in listed["components"] if one["type"] == "library"] == [
        "pkg:deb/debian/curl@7.88.1-10?arch=amd64&distro=debian-12", "pkg:pypi/numpy@1.26.4",
    ]  # fmt: skip
    other = json.loads(content[f"sbom/{JUDGE.id[7:]}.cdx.json"])
    assert [one["name"] for one in other["components"]] == ["debian", "curl"]
    graph = {one["@id"]: one for one in json.loads(content["ro-crate-metadata.json"])["@graph"]}
    image = graph["#image-runner"]
    assert image["subjectOf"] == {"@id": f"sbom/{RUNNER.id[7:]}.cdx.json"} and image["identifier"] == RUNNER.id
    assert (image["registry"], image["tag"]) == ("docker.io", "1")
    assert graph[image["subjectOf"]["@id"]]["@type"] == "File"


def test_two_bundles_are_equal_whoever_makes_them(imaged: Path, imaged_run: Path, tmp_path: Path) -> None:
    other = shutil.copytree(imaged_run, tmp_path / "elsewhere")
    os.utime(other / "journal.jsonl", (1, 1))
    assert bundled_with(other, tmp_path / "again.zip").read_bytes() == imaged.read_bytes()


def test_a_bundle_without_images_is_as_before_and_says_so(imaged_run: Path, tmp_path: Path) -> None:
    bundle(imaged_run, tmp_path / "b.zip")
    report = verify(str(tmp_path / "b.zip"))
    assert not report.failed and results(report)["I2"] == "skipped"
    assert any("they are named by their ids, and are not in the bundle" in one for one in report.unproven)
    assert not [one for one in unpacked(tmp_path / "b.zip") if one.startswith(("images/", "sbom/"))]


def test_ours_are_those_that_srprov_built(imaged_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(imaged_run, tmp_path / "run")
    text = (run / "journal.jsonl").read_text()
    (run / "journal.jsonl").write_text(
        text.replace('"runner: image": "runner:1"', '"runner: image": "srprov/runner:0123456789abcdef"')
    )
    found = unpacked(bundled_with(run, tmp_path / "b.zip", way="ours"))
    assert len([one for one in found if one.startswith("sbom/")]) == 1
    about = json.loads(found["bundle.json"])["images"]
    assert about == {"with": "ours", "left_out": [{"id": JUDGE.id, "names": ["judge:latest"]}]}
    report = verify(str(tmp_path / "b.zip"))
    assert failed(report) == {} and "judge:latest are named by their ids" in report.unproven[-1]
    assert "Not in it are judge:latest" in found["README.md"].decode()


def test_images_of_a_containerd_store_are_known_by_what_leads_to_them(imaged_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(imaged_run, tmp_path / "run")
    manifest = json.dumps({"config": {"digest": RUNNER.id}}).encode()
    index = json.dumps({"manifests": [{"digest": sha(b"another platform")}, {"digest": sha(manifest)}]}).encode()
    for path in run.rglob("*.json*"):
        path.write_text(path.read_text().replace(RUNNER.id, sha(index)))

    class Containerd:
        def read(self, image: str, *_more: object) -> Any:
            from tests.unit.evidence.imaged import Engine

            found = Engine(tmp_path, RUNNER, JUDGE).read(RUNNER.id if image == sha(index) else image, "", (), None)
            return replace(found, documents=(*found.documents, index, manifest, b"of nobody"))

    bundle(run, tmp_path / "b.zip", images=make_images.Wish(way="all", giver=Containerd(), say=lambda _text: None))
    assert failed(verify(str(tmp_path / "b.zip"))) == {}
    found = unpacked(tmp_path / "b.zip")
    assert {f"images/blobs/sha256/{sha(one)[7:]}" in found for one in (index, manifest)} == {True}
    assert f"images/blobs/sha256/{sha(b'of nobody')[7:]}" not in found
    without = {name: data for name, data in found.items() if not name.endswith(sha(manifest)[7:])}
    assert "nothing leads from the id" in failed(verify(str(packed(forged(without), tmp_path / "c.zip"))))["I2"][0]


@pytest.mark.parametrize("where", ["layer", "half", "config"])
def test_a_secret_in_an_image_stops_it(tmp_path: Path, where: str) -> None:
    Secret("correct horse")
    noise = b"\xff\x00" * (1 << 19)
    content = {"layer": b"\0\xffcorrect horse\xfe", "half": noise[:-6] + b"correct horse" + noise, "config": b""}[where]
    runner = Image((layer({"x": content}),), environment=("HORSE=correct horse",) if where == "config" else ())
    run = run_with(tmp_path, runner)
    with pytest.raises(RefusedError, match=r"images/blobs/sha256/.*the value of a secret") as refused:
        bundled_with(run, tmp_path / "b.zip", runner, JUDGE)
    assert not (tmp_path / "b.zip").exists() and not list(tmp_path.glob(".srprov-*"))
    name = str(refused.value.message).split("  ")[1].partition(":")[0]
    if where != "config":
        assert bundled_with(run, tmp_path / "b.zip", runner, JUDGE, no_secret=(name,)).exists()


def test_what_does_not_fit_is_told_before_anything_is_written(
    imaged_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make_images, "_MARGIN", 1 << 60)
    with pytest.raises(OSError, match=r"MiB are needed, .* MiB are free"):
        bundled_with(imaged_run, tmp_path / "b.zip")
    assert [one.name for one in tmp_path.iterdir()] == ["engine"]


def test_an_engine_that_lies_gives_no_bundle(imaged_run: Path, tmp_path: Path) -> None:
    class Liar:
        def read(self, image: str, *_more: object) -> Any:
            from tests.unit.evidence.imaged import Engine

            found = Engine(tmp_path, RUNNER, JUDGE).read(image, "", (), None)
            wrong = replace(found.layers[0], path=found.layers[1].path)
            return replace(found, layers=(wrong, *found.layers[1:]))

    with pytest.raises(UsageError, match="is not what its digest says"):
        bundle(imaged_run, tmp_path / "b.zip", images=make_images.Wish(way="all", giver=Liar(), say=lambda _text: None))
    assert not (tmp_path / "b.zip").exists()


def relaid(content: Content, change: Callable[[dict[str, Any], Content], None]) -> Content:
    """Return a bundle with another index, in which everything else follows."""
    found = dict(content)
    index = json.loads(found["images/index.json"])
    change(index, found)
    found["images/index.json"] = oci.as_json(index)
    return with_manifest(found)


def manifest_of(index: dict[str, Any], content: Content, number: int = 0) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(content["images/blobs/sha256/" + index["manifests"][number]["digest"][7:]])
    return found


def put(index: dict[str, Any], content: Content, manifest: dict[str, Any], number: int = 0) -> None:
    """Put another manifest in the place of one."""
    data = oci.as_json(manifest)
    del content["images/blobs/sha256/" + index["manifests"][number]["digest"][7:]]
    content[f"images/blobs/sha256/{sha(data)[7:]}"] = data
    index["manifests"][number] |= {"digest": sha(data), "size": len(data)}


def _traversal(index: dict[str, Any], _content: Content) -> None:
    index["manifests"][0]["digest"] = "sha256:../../../../etc/passwd"


def _other_size(index: dict[str, Any], _content: Content) -> None:
    index["manifests"][0]["size"] += 1


def _size_of_layer(index: dict[str, Any], content: Content) -> None:
    manifest = manifest_of(index, content)
    manifest["layers"][0]["size"] += 1
    put(index, content, manifest)


def _huge_size(index: dict[str, Any], _content: Content) -> None:
    index["manifests"][0]["size"] = 10**400


def _twice(index: dict[str, Any], _content: Content) -> None:
    index["manifests"].append(index["manifests"][0])


def _many(index: dict[str, Any], _content: Content) -> None:
    index["manifests"] *= 1000


def _deep(_index: dict[str, Any], content: Content) -> None:
    content["images/oci-layout"] = b"[" * 100_000 + b"]" * 100_000


def _deep_manifest(index: dict[str, Any], content: Content) -> None:
    data = b'{"config":' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    content[f"images/blobs/sha256/{sha(data)[7:]}"] = data
    index["manifests"][0] |= {"digest": sha(data), "size": len(data)}


def _missing(_index: dict[str, Any], content: Content) -> None:
    del content[next(one for one in content if one.startswith("images/blobs/"))]


def _orphan(_index: dict[str, Any], content: Content) -> None:
    content[f"images/blobs/sha256/{sha(b'x')[7:]}"] = b"x"


def _stray(_index: dict[str, Any], content: Content) -> None:
    content["images/run.sh"] = b"#!/bin/sh\n"


def _other_content(_index: dict[str, Any], content: Content) -> None:
    largest = max((one for one in content if one.startswith("images/blobs/")), key=lambda one: len(content[one]))
    content[largest] = gzip.compress(b"something else")[: len(content[largest])].ljust(len(content[largest]), b"\0")


def _other_list(_index: dict[str, Any], content: Content) -> None:
    listed = json.loads(content["images/manifest.json"])
    listed[0]["RepoTags"] = ["busybox:latest"]
    content["images/manifest.json"] = oci.as_json(listed)


def _layer(index: dict[str, Any], content: Content, data: bytes) -> None:
    """Put something in the place of an image's own layer, under its own right digest."""
    manifest = manifest_of(index, content)
    old = "blobs/sha256/" + manifest["layers"][1]["digest"][7:]
    new = f"blobs/sha256/{sha(data)[7:]}"
    del content[f"images/{old}"]
    content[f"images/{new}"] = data
    manifest["layers"][1] |= {"digest": sha(data), "size": len(data)}
    content["images/manifest.json"] = content["images/manifest.json"].replace(old.encode(), new.encode())
    put(index, content, manifest)


def _other_layer(index: dict[str, Any], content: Content) -> None:
    _layer(index, content, gzip.compress(layer({"etc/passwd": "root::0:0::/:/bin/sh\n"})))


def _bomb(index: dict[str, Any], content: Content) -> None:
    """It becomes a thousand times as much; and another follows, which would be next."""
    out = io.BytesIO()
    with gzip.GzipFile(fileobj=out, mode="wb", compresslevel=9, mtime=0) as stream:
        stream.write(b"\0" * (32 << 20))
    _layer(index, content, out.getvalue() * 16)


def _no_gzip(index: dict[str, Any], content: Content) -> None:
    _layer(index, content, b"BZh9" * 100)


def _long_names(index: dict[str, Any], _content: Content) -> None:
    index["manifests"][0]["annotations"]["srprov.image.names"] = "\x1b[2J"


def _named(index: dict[str, Any], _content: Content) -> None:
    """All of it follows, but the name."""
    index["manifests"][0]["annotations"]["srprov.image.names"] = "busybox:1"


def _named_besides(index: dict[str, Any], _content: Content) -> None:
    """It has a name that no container of the run had, too."""
    index["manifests"][0]["annotations"]["srprov.image.names"] += " busybox:1"


LAYOUTS: dict[str, tuple[Callable[[dict[str, Any], Content], None], str]] = {
    "a digest that leads out": (_traversal, "is none of"),
    "another size": (_other_size, "its descriptor says"),
    "another size of a layer": (_size_of_layer, "its descriptor says"),
    "a size without end": (_huge_size, "is too large"),
    "one image twice": (_twice, "names one image twice"),
    "images without end": (_many, "200 are the most"),
    "deep JSON": (_deep, "nested more than"),
    "a deep manifest": (_deep_manifest, "nested more than"),
    "a blob that is missing": (_missing, "is missing"),
    "a blob of no image": (_orphan, "belongs to no image"),
    "a file that is no blob": (_stray, "belongs to no image"),
    "a blob with another content": (_other_content, "another content than its name says"),
    "another list for Docker": (_other_list, "is not written as srprov writes it"),
    "another layer": (_other_layer, "becomes another layer"),
    "a bomb": (_bomb, "something follows"),
    "a layer packed otherwise": (_no_gzip, "is not packed by gzip"),
    "a name that draws": (_long_names, "no name that an image can have"),
}


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_hostile_layout_is_refused_and_nothing_is_written(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    change, told = LAYOUTS[kind]
    path = packed(relaid(content, change), tmp_path / "b.zip")
    home = tmp_path / "here"
    home.mkdir()
    monkeypatch.chdir(home)
    report = bounded(lambda: verify(str(path)))
    assert told in " ".join(failed(report)["I2"]), failed(report)
    assert [one.name for one in tmp_path.rglob("*")] in (["here", "b.zip"], ["b.zip", "here"])


def test_a_layer_may_not_become_much_more_than_it_is(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from srprov.oci import packing

    monkeypatch.setattr(packing, "_ANY", 1000)
    monkeypatch.setattr(packing, "_MOST_RATIO", 2)
    path = packed(content, tmp_path / "b.zip")
    assert "it becomes more than 0 MiB" in failed(verify(str(path)))["I2"][0]


def test_two_files_of_one_name_are_no_bundle(content: Content, tmp_path: Path) -> None:
    name = next(one for one in content if one.startswith("images/blobs/"))
    path = packed(content, tmp_path / "b.zip")
    upper = name.replace("blobs", "BLOBS")
    data = path.read_bytes()
    other = next(one for one in content if one.startswith("images/blobs/") and one != name)
    assert len(upper) == len(other)
    path.write_bytes(data.replace(other.encode(), upper.encode()[: len(other)]))
    assert cli(["verify", str(path)]) in (2, 5)


def test_images_that_no_container_had_are_found(content: Content, tmp_path: Path) -> None:
    named = failed(verify(str(packed(relaid(content, _named), tmp_path / "a.zip"))))
    assert any("is named busybox:1" in one for one in named["I3"])
    more = failed(verify(str(packed(relaid(content, _named_besides), tmp_path / "b.zip"))))
    assert any(", busybox:1, and was" in one for one in more["I3"])
    swapped = {name: data.replace(RUNNER.id.encode(), sha(b"?").encode()) if "containers" in name or "journal" in name
               else data for name, data in content.items()}  # fmt: skip
    strange = failed(verify(str(packed(forged(swapped), tmp_path / "b.zip"))))
    assert any("no container of the run had the image" in one for one in strange["I3"])
    assert any("should be in it" in one for one in strange["I3"])
    gone = {name: data for name, data in content.items() if not name.startswith(("images/", "sbom/"))}
    missing = failed(verify(str(packed(forged(gone), tmp_path / "c.zip"))))
    assert any("should be in it" in one for one in missing["I3"])


@pytest.mark.parametrize("change", ["version", "gone", "added", "lonely"])
def test_a_list_of_packages_that_does_not_follow_is_found(content: Content, tmp_path: Path, change: str) -> None:
    name = f"sbom/{RUNNER.id[7:]}.cdx.json"
    found = dict(content)
    if change == "version":
        found[name] = found[name].replace(b"7.88.1-10", b"7.88.1-11")
    elif change == "gone":
        del found[name]
    elif change == "added":
        found[f"sbom/{'0' * 64}.cdx.json"] = found[name]
    else:
        found = {one: data for one, data in found.items() if not one.startswith("images/")}
    assert failed(verify(str(packed(forged(found), tmp_path / "b.zip"))))["I4" if change != "lonely" else "I3"]


def test_lists_of_another_version_are_not_held_to_what_this_one_would_write(content: Content, tmp_path: Path) -> None:
    name = f"sbom/{RUNNER.id[7:]}.cdx.json"
    found = {**content, name: content[name].replace(b'"srprov"', b'"other"')}
    found["bundle.json"] = found["bundle.json"].replace(b'"srprov": "', b'"srprov": "9')
    (one,) = (one for one in verify(str(packed(forged(found), tmp_path / "b.zip"))).findings if one.id == "I4")
    assert one.result == "skipped" and "it was made by srprov 9" in one.details[0]


def test_packages_that_a_lock_recorded_must_be_there(content: Content, tmp_path: Path) -> None:
    tag = "srprov/runner:0123456789abcdef"
    run = run_with(tmp_path)
    journal = run / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"runner: image": "runner:1"', f'"runner: image": "{tag}"'))
    head = f'lock: 1\nsrprov: "0.1.0"\nimages: []\nrepositories: []\nfiles: {{}}\npackages:\n- image: "{tag}"\n'
    lock = head + '  platform: "linux/amd64"\n  apt:\n  - "curl=%s"\n  pip:\n  - "numpy==1.26.4"\n'
    for version, result in (("7.88.1-10", "pass"), ("7.88.1-9", "fail")):
        place = run / "sessions/1/inputs/race.lock"
        place.write_text(lock % version)
        about = json.loads((run / "sessions/1/inputs.json").read_text())
        files = [one for one in about["files"] if one.get("file") != "inputs/race.lock"]
        digest = hashlib.sha256(place.read_bytes()).hexdigest()
        files.append({"file": "inputs/race.lock", "path": "race.lock", "sha256": digest, "executable": False})
        (run / "sessions/1/inputs.json").write_text(json.dumps({**about, "files": files}))
        report = verify(str(bundled_with(run, tmp_path / f"{result}.zip")))
        assert results(report)["I4"] == result, failed(report)
    assert "curl=7.88.1-9" in failed(report)["I4"][0]


def test_the_good_layout_is_read_whatever_tool_wrote_its_layers(tmp_path: Path) -> None:
    long = "opt/" + "x" * 120 + "/lib/python3.11/site-packages/tool-1.0.dist-info/METADATA"
    runner = Image((layer({**DEBIAN, long: "Name: tool\nVersion: 1.0\n"}, format=tarfile.GNU_FORMAT),))
    path = bundled_with(run_with(tmp_path, runner), tmp_path / "b.zip", runner, JUDGE)
    assert failed(verify(str(path))) == {}
    names = [one["name"] for one in json.loads(unpacked(path)[f"sbom/{runner.id[7:]}.cdx.json"])["components"]]
    assert names == ["debian", "curl", "tool"]


def test_a_lock_is_read_once_for_all_images_and_sessions(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hundreds of each, in a bundle of a megabyte, would be days."""
    read: list[str] = []
    monkeypatch.setattr(checks_images, "load", read.append)
    one = {name.removeprefix("sessions/1/"): data for name, data in content.items() if name.startswith("sessions/1/")}
    more = {f"sessions/{number}/{name}": data for number in (2, 3) for name, data in one.items()}
    verify(str(packed(with_manifest({**content, **more}), tmp_path / "b.zip")))
    assert [name.rpartition("/")[2] for name in read] == ["race.lock"]


def test_images_have_no_more_packages_together_than_a_run_needs(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is looked through by itself, and there may be hundreds of one layer."""
    monkeypatch.setattr(checks_images, "_MOST_WORK", 5)
    found = failed(verify(str(packed(content, tmp_path / "b.zip"))))
    assert found == {"I4": ("its images have longer lists of packages than any run needs",)}
