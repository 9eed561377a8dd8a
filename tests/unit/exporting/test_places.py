"""Where an export has what several services mount: no link of one is in the place of what another one mounts."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from srprov.errors import UsageError
from srprov.exporting import folder
from srprov.exporting.convert import _unique
from srprov.exporting.model import File
from tests.unit.exporting.clusters import on_cluster, pod
from tests.unit.exporting.exports import contents, document, experiment, twin

DEPTH = 40


def _project(tmp_path: Path) -> Path:
    """Return an EDF in whose folder `sub` leads to its `run`; with another folder in the place of `a`, to `/run`."""
    text = (
        "services:\n"
        "  a: {image: x, volumes: ['./proj/a:/n']}\n"
        "  b: {image: x, volumes: ['.:/m']}\n"
        "  c: {image: x, volumes: ['./proj/sub:/n']}\n"
    )
    edf = experiment(tmp_path / "proj", text, proj__a__f="a", proj__sub="its own", run__f="r")
    deep = "/".join(["a0", *(f"d{number}" for number in range(1, DEPTH))])
    (edf.parent / deep).mkdir(parents=True)
    (edf.parent / "a").symlink_to(deep)
    (edf.parent / "sub").symlink_to("a/" + "../" * DEPTH + "run")
    return edf


def test_no_link_of_one_mount_lies_in_the_place_of_another(tmp_path: Path) -> None:
    made = twin(_project(tmp_path))
    out = tmp_path / "out"
    folder.write(str(out), made.files)
    for service in document(made)["services"].values():
        source = os.path.join(out, service["volumes"][0]["source"])
        assert os.path.realpath(source) == os.path.normpath(source), "an engine follows a link on its machine"
    assert (out / document(made)["services"]["c"]["volumes"][0]["source"]).read_text() == "its own"


def test_the_folder_itself_and_what_lies_in_it_are_one_tree(tmp_path: Path) -> None:
    text = "services: {a: {image: x, volumes: ['.:/m']}, b: {image: x, volumes: ['./sub:/n']}}\n"
    made = twin(experiment(tmp_path, text, sub__f="1"))
    assert document(made)["services"]["a"]["volumes"][0]["source"] == "./files"
    assert document(made)["services"]["b"]["volumes"][0]["source"] == "./files/sub"
    assert contents(made)["files/sub/f"] == b"1"


def test_what_lies_elsewhere_is_beside_the_folder_s_own_files(tmp_path: Path) -> None:
    (tmp_path / "lab" / "maps").mkdir(parents=True)
    (tmp_path / "lab" / "maps" / "f").write_text("elsewhere")
    (tmp_path / "lab" / "b.cdf").write_text("cdf: 1\nimage: x\nvolumes: ['./maps:/n']\n")
    text = "services: {a: {image: x, volumes: ['./outside:/m']}, b: {cdf: ../lab/b.cdf}}\n"
    made = twin(experiment(tmp_path / "proj", text, outside__maps__f="own"), "outside")
    assert document(made)["services"]["b"]["volumes"][0]["source"] == "./outside/maps"
    assert contents(made)["outside/maps/f"] == b"elsewhere"
    assert contents(made)["files/outside/maps/f"] == b"own"


def test_what_one_service_may_have_of_version_control_is_in_no_folder_of_another(tmp_path: Path) -> None:
    text = "services: {a: {image: x, volumes: ['.:/m']}, b: {image: x, volumes: ['./.git/config:/n']}}\n"
    made = twin(experiment(tmp_path, text, _dot_git__config="token"), "outside")
    assert document(made)["services"]["b"]["volumes"][0]["source"] == "./outside/config"
    assert [path for path in contents(made) if path.startswith("files/") and ".git" in path] == []


def test_two_files_that_differ_have_no_one_place() -> None:
    with pytest.raises(UsageError, match="files/a cannot be copied: it changed"):
        _unique([File(path="files/a", link="b"), File(path="files/a", content=b"a")])


def test_a_path_has_a_name_that_no_other_one_can_be_found_for(tmp_path: Path) -> None:
    """Of volumes with one name a pod has the last: a folder that the README calls read-only would be written to."""
    (tmp_path / "f").write_text("1")
    text = (
        "secrets: {My_Key: {env: K}}\n"
        "services: {a: {cdf: a.cdf, volumes: ['/usr/lib/a:/a:ro', '/srv/data/b:/b', './f:/f'], "
        "secrets: [My_Key], tmpfs: [/t]}}\n"
    )
    (tmp_path / "a.cdf").write_text("cdf: 1\nbase: x\n")
    made = pod(on_cluster("kubernetes", experiment(tmp_path, text)), "a")
    said = [one["name"] for one in made["volumes"]] + [made["containers"][0]["image"]]
    said += [one["secret"]["secretName"] for one in made["volumes"] if "secret" in one]
    assert {one.partition("-")[0] for one in said} >= {"node", "files", "secret", "memory"}
    assert all(re.search(r"[-:][0-9a-f]{32}\Z", one) for one in said), said
    assert all(len(one) <= 63 for one in said)


def test_a_config_has_a_name_that_no_other_content_can_be_found_for(tmp_path: Path) -> None:
    """Of two contents with one name one alone is left, and a service runs what another one ships; a store has 64."""
    text = "services: {a: {image: x, volumes: ['./f:/f_']}}\n"
    made = on_cluster("swarm", experiment(tmp_path, text, f="1"))
    names = [path.partition("/")[2] for path in contents(made) if path.startswith("configs/")]
    assert names and all(re.fullmatch("[0-9a-f]{31}", one) for one in names), names
    assert len(f"{'n' * 32}_{names[0]}") <= 64
