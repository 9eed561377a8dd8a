"""A link of the user's to which an archive gave a second name in a project: where it leads is a word of his own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.controller.copied import Copied
from srprov.controller.copied_in import Owner, tar_of
from srprov.controller.own_files import asked_for
from srprov.definitions import load_experiment
from srprov.definitions.model import Inventory
from srprov.definitions.version_control import ELSEWHERE

WORD = "14470817221966341234"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project with `data/c`, a second name of a link in the user's profile of a browser."""
    (tmp_path / "browser").mkdir()
    (tmp_path / "exp/data").mkdir(parents=True)
    (tmp_path / "browser/SingletonCookie").symlink_to(WORD)
    os.link(tmp_path / "browser/SingletonCookie", tmp_path / "exp/data/c", follow_symlinks=False)
    (tmp_path / "exp/data/own").symlink_to("file")
    (tmp_path / "exp/data/file").write_text("x")
    (tmp_path / "exp/Dockerfile").write_text("FROM busybox\nCOPY . /x\n")
    (tmp_path / "exp/inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path / "exp")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path


SHIPPED = {
    "volume": "{image: x, volumes: ['./data:/d:ro']}",
    "all": "{image: x, volumes: ['.:/d:ro']}",
    "seed": "{image: x, volumes: ['v:/d']}\nvolumes: {v: {seed: data}}",
    "data": "{image: x, data: [{path: data, target: /d}]}",
    "context": "{cdf: Dockerfile}",
    "file of a CDF": "{cdf: c.cdf}",
}


@pytest.mark.parametrize("by", SHIPPED)
def test_it_is_asked_for_and_its_words_are_told_nowhere(
    here: Path, by: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("c.cdf").write_text("cdf: 1\nbase: x\nfiles: [{src: data, dest: /d}]\n")
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices:\n  a: {SHIPPED[by]}\n")
    found = asked_for(load_experiment("e.edf"), Inventory(hosts={}, groups={})).experiment.outside
    assert found == (("a", f"{here}/exp/data/c: {ELSEWHERE}"),)
    for words in (["plan", "e.edf", "-i", "inv.yml"], ["export", "compose", "e.edf", "-i", "inv.yml", "-o", "out"]):
        assert run(words) in (4, 9)
        said = "".join(capsys.readouterr())
        assert WORD not in said and (words[0] == "export" or "data/c: it has another name" in said)
    assert not Path("out").exists()


def test_where_it_leads_decides_nothing(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Out of the folder, or not: a check of a stranger's change is read by everybody."""
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices:\n  a: {SHIPPED['volume']}\n")
    told = []
    for leads in (WORD, "/etc/passwd"):
        for name in ("browser/SingletonCookie", "exp/data/c"):
            (here / name).unlink()
        (here / "browser/SingletonCookie").symlink_to(leads)
        os.link(here / "browser/SingletonCookie", here / "exp/data/c", follow_symlinks=False)
        told.append((run(["validate", "e.edf"]), "".join(capsys.readouterr())))
    assert told[0] == told[1] and told[0][0] == 0


@pytest.mark.parametrize("by", ["data/c", "by"])
@pytest.mark.parametrize("words", ["cdf: NAME", "cdf: t.cdf"])
def test_a_definition_by_it_is_asked_for(here: Path, words: str, by: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("by").symlink_to("data/c")
    Path("t.cdf").write_text(f"cdf: 1\nextends: {by}\n")
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices: {{a: {{{words.replace('NAME', by)}}}}}\n")
    assert run(["validate", "e.edf"]) == 0
    assert run(["plan", "e.edf", "-i", "inv.yml"]) == 9
    said = "".join(capsys.readouterr())
    assert WORD not in said and f"outside ({here}/exp/data/c: {ELSEWHERE})" in said


@pytest.mark.parametrize("by", ["data/c", "by"])
@pytest.mark.parametrize("words", ["cdf: d.cdf", "image: x, env_file: NAME/x", "image: x, volumes: ['./NAME:/x:ro']"])
def test_no_path_leads_by_it(here: Path, words: str, by: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("by").symlink_to("data/c")
    Path("d.cdf").write_text(f"cdf: 1\ndockerfile: {by}\n")
    words = words.replace("NAME", by)
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices: {{a: {{{words}}}}}\n")
    for verb in (["validate"], ["plan", "-i", "inv.yml"]):
        assert run([*verb, "e.edf"]) == 5
        said = "".join(capsys.readouterr())
        assert WORD not in said and "leads by a link that has another name" in said


def test_an_import_does_not_copy_it(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("compose.yml").write_text("services: {a: {image: busybox, volumes: ['./data:/d:ro']}}\n")
    run(["import", "compose", "compose.yml", "-o", "out"])
    assert WORD not in "".join(capsys.readouterr())
    made = [os.readlink(path) for path in Path("out").rglob("*") if path.is_symlink()] if Path("out").exists() else []
    assert WORD not in made


def test_a_copy_into_a_container_leaves_it_out(here: Path) -> None:
    copied = Copied()
    content = b"".join(tar_of("data", "d", Owner(0, 0), copied))
    assert WORD.encode() not in content and b"own" in content and "data/c" in repr(copied)


def test_a_link_whose_names_are_all_in_the_folder_is_the_projects_own(here: Path) -> None:
    """As `cp -al` makes them."""
    Path("data/c").unlink()
    os.link("data/own", "data/also", follow_symlinks=False)
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices:\n  a: {SHIPPED['volume']}\n")
    assert not asked_for(load_experiment("e.edf"), Inventory(hosts={}, groups={})).experiment.outside
