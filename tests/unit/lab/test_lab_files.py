"""What `lab up` writes as root into the folder where it runs, which may be a stranger's."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from srprov.cli.inputs import load_inventory
from srprov.errors import LabError, UsageError
from srprov.lab import disk, places, state, written
from srprov.lab.inventory import HEADER
from srprov.lab.lab import _place_of_inventory, _write_if_other, _write_inventory
from srprov.lab.places import Site


def test_a_file_is_written_once_and_can_be_read_by_whoever_called_sudo(tmp_path: Path) -> None:
    path = tmp_path / "inventory" / "lab.yml"
    _write_if_other(path, "one")
    about = path.stat()
    _write_if_other(path, "one")
    assert (path.read_text(), about.st_mode & 0o777, path.stat().st_ino) == ("one", 0o644, about.st_ino)
    _write_if_other(path, "two")
    assert (path.read_text(), os.listdir(path.parent)) == ("two", ["lab.yml"])


@pytest.mark.parametrize("name", [".lab.yml.new", "lab.yml"])
def test_a_link_in_a_strangers_folder_is_not_written_through(tmp_path: Path, name: str) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (tmp_path / "inventory").mkdir()
    (tmp_path / "inventory" / name).symlink_to(precious)
    _write_if_other(tmp_path / "inventory" / "lab.yml", "lab")
    assert precious.read_text() == "mine"
    assert (tmp_path / "inventory" / "lab.yml").read_text() == "lab"


def test_a_folder_that_is_a_link_and_a_pipe_are_refused(tmp_path: Path) -> None:
    (tmp_path / "etc").mkdir()
    (tmp_path / "inventory").symlink_to("etc")
    with pytest.raises(LabError, match="is a link"):
        _write_if_other(tmp_path / "inventory" / "lab.yml", "lab")
    assert os.listdir(tmp_path / "etc") == []
    os.mkfifo(tmp_path / "etc" / "lab.yml")
    with pytest.raises(LabError, match="it is a pipe"):
        _write_if_other(tmp_path / "etc" / "lab.yml", "lab")


@pytest.fixture
def at_labs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    """Return a lab without robots, whose files lie in a folder of the test."""
    monkeypatch.setattr(places, "RUN", tmp_path / "run")
    monkeypatch.setattr(disk, "host_key", lambda site, name: "key")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return Site("", 1)


def test_what_was_a_lab_s_inventory_is_written_only_while_it_is_one(tmp_path: Path, at_labs: Site) -> None:
    """A folder of a project that was, by `git pull`, becomes a link to one of the user's own, or has a file of his."""
    old, mine = tmp_path / "clone" / "sub" / "inventory" / "lab.yml", tmp_path / "mine" / "inventory" / "lab.yml"
    for path in (old, mine):
        path.parent.mkdir(parents=True)
    lab = state.Lab({}, None, "", (str(old), str(at_labs.inventory.absolute())), "")
    old.write_text(f"{HEADER}old")
    _write_inventory(at_labs, lab, [])
    assert old.read_text() == at_labs.inventory.read_text() != f"{HEADER}old"

    old.write_text("all: {hosts: {mine: }}\n")
    _write_inventory(at_labs, lab, [])
    assert old.read_text() == "all: {hosts: {mine: }}\n"

    shutil.rmtree(tmp_path / "clone" / "sub")
    (tmp_path / "clone" / "sub").symlink_to("../mine")
    for text in ("all: {hosts: {mine: }}\n", f"{HEADER}of another lab"):
        mine.write_text(text)
        _write_inventory(at_labs, lab, [])
        assert mine.read_text() == text
    with pytest.raises(LabError, match="or lies below one"):
        _write_if_other(old, "lab")


def test_a_file_of_the_user_s_in_the_inventory_s_place_is_refused_before_anything_is_done(
    tmp_path: Path, at_labs: Site
) -> None:
    at_labs.inventory.parent.mkdir()
    at_labs.inventory.write_text("all: {hosts: {mine: }}\n")
    with pytest.raises(LabError, match=r"inventory/lab\.yml is not what `srprov lab up` wrote"):
        _place_of_inventory(at_labs)
    at_labs.inventory.write_text(f"{HEADER}all: {{}}\n")
    assert _place_of_inventory(at_labs) == str(tmp_path / "here" / "inventory" / "lab.yml")


@pytest.mark.parametrize("name", ["group_vars", "host_vars"])
def test_the_inventory_goes_beside_nobody_s_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A project that was cloned may bring a ProxyCommand there, which `-i inventory/lab.yml` would run."""
    monkeypatch.chdir(tmp_path)
    site = Site("", None)
    assert _place_of_inventory(site) == str(tmp_path / "inventory" / "lab.yml")
    (tmp_path / "inventory" / name).mkdir(parents=True)
    with pytest.raises(LabError, match=f"inventory/{name} would be read with the lab's inventory"):
        _place_of_inventory(site)


def test_an_inventory_that_lab_up_did_not_write_is_not_taken_for_the_labs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A project ignores `inventory/`, and brings one there later: `git pull` replaces the lab's without a word."""
    path, text = tmp_path / "clone" / "inventory" / "lab.yml", "all: {hosts: {robot1: }}\n"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    monkeypatch.setattr(places, "RUN", tmp_path / "run")
    monkeypatch.setattr(written, "NAMED_RUN", tmp_path / "run" / "srprov-labs")
    known = state.Lab({}, None, "", (str(path),), written.digest(text))
    monkeypatch.chdir(tmp_path / "clone")
    for name in ("", "anna"):
        state.write_lab(Site(name, None), known)
        assert written.changed(["inventory/lab.yml", str(path)]) == ""
        path.write_text("all: {hosts: {robot1: }, vars: {ansible_ssh_common_args: -o ProxyCommand=theirs}}\n")
        assert [written.changed([one]) for one in ("inventory/lab.yml", "inventory", "./inventory/../inventory")] == [
            str(path)
        ] * 3
        assert written.changed(["other.yml"]) == ""
        with pytest.raises(UsageError, match="not what `srprov lab up` wrote"):
            load_inventory(("inventory/lab.yml",))
        path.rename(tmp_path / "theirs.yml")
        path.symlink_to(tmp_path / "theirs.yml")
        assert written.changed(["inventory/lab.yml"]) == str(path)
        path.unlink()
        assert written.changed(["inventory/lab.yml"]) == ""
        path.write_text(text)
        (places.RUN / Site(name, None).group / "lab.json").unlink()


def test_a_lab_of_a_later_srprov_is_read_for_what_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "RUN", tmp_path)
    site = Site("other", None)
    state.write(site.run / "lab.json", {"spec": {}, "user": None, "since": "now", "inventories": ["/a"], "more": 1})
    assert state.read_lab(site) == state.Lab({}, None, "now", ("/a",))
