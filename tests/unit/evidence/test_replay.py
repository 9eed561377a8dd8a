"""What of a bundle is taken to run it again, and who does whose part."""

from __future__ import annotations

import hashlib
import json
import stat
from contextlib import suppress
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov import private
from srprov.cli.replay import told
from srprov.codes import Code
from srprov.definitions import load_experiment
from srprov.definitions.model import Host, Inventory
from srprov.errors import RefusedError, UsageError
from srprov.evidence.replay import Replay, check, differences, mapped, read, unpack
from srprov.evidence.replay_images import Kept
from srprov.secret import Secret, forget
from tests.fakes import World
from tests.trial_folders import FILES, planned
from tests.unit.evidence.bundles import Content, as_it_is, packed, with_manifest


def inventory(*names: str) -> Inventory:
    hosts = {name: Host(name=name, address=f"{name}.lab") for name in names}
    return Inventory(hosts=hosts, groups={"all": names, "first": names[:1]})


def test_definitions_come_out_as_they_were_and_nothing_else_does(bundled: Path, tmp_path: Path) -> None:
    verified = check(str(bundled))
    for _ in range(2):  # also into a folder that has them already
        unpack(verified, tmp_path / "again")
    again = read(verified)
    there = {str(one.relative_to(tmp_path / "again")): one for one in (tmp_path / "again").rglob("*") if one.is_file()}
    assert {name: one.read_text() for name, one in there.items()} == FILES
    assert {stat.S_IMODE(one.stat().st_mode) & 0o077 for one in there.values()} == {0}
    assert (again.edf, again.placed, again.robots) == ("race.edf", {"runner": "r1", "referee": "r2"}, ("r1", "r2"))
    assert set(load_experiment(tmp_path / "again" / again.edf).experiment.services) == {"runner", "referee"}


def test_a_bundle_that_is_not_what_it_says_is_not_run(content: Content, tmp_path: Path) -> None:
    changed = {**content, "sessions/1/inputs/runner.cdf": b"cdf: 1\nimage: evil:1\n"}
    with pytest.raises(RefusedError, match=r"F1 .*runner\.cdf") as refused:
        check(str(packed(changed, tmp_path / "b.zip")))
    assert refused.value.exit_code == 9
    with pytest.raises(RefusedError, match="D1"):
        check(str(packed(with_manifest(changed), tmp_path / "c.zip")))


def test_a_folder_with_something_else_is_not_written_to(bundled: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "more").mkdir()
    unpack(as_it_is(bundled), tmp_path / "more")
    (tmp_path / "more" / "mine").write_text("")
    unpack(as_it_is(bundled), tmp_path / "linked")
    (tmp_path / "linked" / "race.edf").rename(tmp_path / "kept")
    (tmp_path / "linked" / "race.edf").symlink_to(tmp_path / "kept")
    for name in ("link", "more", "linked"):
        with pytest.raises(UsageError, match="something else is in"):
            unpack(as_it_is(bundled), tmp_path / name)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("place", ["bare/HEAD", "cvs/Root"])
def test_a_bundle_does_not_say_whose_experiment_it_is(content: Content, tmp_path: Path, place: str) -> None:
    """With the remote of somebody else's repository, a replay would count as that experiment and replace what runs.

    What surely makes one is not read at all.
    """
    more = {**content, f"sessions/1/inputs/{place}": b'[remote "origin"]\nurl = https://lab.example/race.git\n'}
    with pytest.raises(UsageError, match="a repository would say whose experiment it is"):
        unpack(as_it_is(packed(with_manifest(more), tmp_path / "b.zip")), tmp_path / "again")
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize("place", [".git/config", "bare/HEAD"])
def test_no_data_set_of_a_bundle_makes_a_repository(content: Content, tmp_path: Path, place: str) -> None:
    """A data set is put there by hand, so a folder may have it before: an archive that brings the bundle, too."""
    about = json.loads(content["sessions/1/inputs.json"])
    about["files"].append({"path": place, "data": f"inputs/{place}", "sha256": "0" * 64, "size": 60})
    more = {**content, "sessions/1/inputs.json": json.dumps(about).encode()}
    with pytest.raises(UsageError, match="a data set that would make a repository"):
        unpack(as_it_is(packed(with_manifest(more), tmp_path / "b.zip")), tmp_path / "again")
    assert not (tmp_path / "again").exists()


def test_no_data_set_of_a_bundle_has_the_place_of_a_file(content: Content, tmp_path: Path) -> None:
    """Checks read an empty file in its place, and what was run was the file: variables that nobody had looked at."""
    about = json.loads(content["sessions/1/inputs.json"])
    env = b"EVIL=1\n"
    about["files"].append(
        {"file": "inputs/more.env", "data": "inputs/more.env", "sha256": hashlib.sha256(env).hexdigest(), "size": 7}
    )
    more = {**content, "sessions/1/inputs.json": json.dumps(about).encode(), "sessions/1/inputs/more.env": env}
    bundle = packed(with_manifest(more), tmp_path / "b.zip")
    with pytest.raises(RefusedError, match=r"a data set in the place of a file: inputs/more\.env"):
        check(str(bundle))
    with pytest.raises(UsageError, match=r"a data set in the place of a file: inputs/more\.env"):
        unpack(as_it_is(bundle), tmp_path / "again")
    assert not (tmp_path / "again").exists()


def test_an_edf_lies_where_it_is_unpacked_from(content: Content, tmp_path: Path) -> None:
    about = {**json.loads(content["sessions/1/inputs.json"]), "edf": "race.edf"}
    more = {**content, "sessions/1/inputs.json": json.dumps(about).encode(), "sessions/1/race.edf": b"edf: 1\n"}
    with pytest.raises(UsageError, match="names no EDF that is there"):
        unpack(as_it_is(packed(with_manifest(more), tmp_path / "b.zip")), tmp_path / "again")


def test_robots_do_the_parts_of_others_under_their_names() -> None:
    found = mapped(inventory("r1", "kuka", "spare"), ("r1", "r2"), {"r2": "kuka"})
    assert {name: (one.name, one.address) for name, one in found.hosts.items()} == {
        "r1": ("r1", "r1.lab"), "r2": ("r2", "kuka.lab"),
    }  # fmt: skip
    assert found.groups == {"all": ("r1", "r2"), "first": ("r1",)}
    named = replace(inventory("r1", "spare"), groups={"builders": ("spare",)})
    assert mapped(named, ("r1",), {}).groups["builders"], "no other robot builds for others"
    swapped = mapped(inventory("r1", "r2"), ("r1", "r2"), {"r1": "r2", "r2": "r1"})
    assert [one.address for one in swapped.hosts.values()] == ["r2.lab", "r1.lab"]


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({}, "there is no robot r2 in the inventory"),
        ({"r2": "kuk"}, "there is no robot kuk in the inventory"),
        ({"r2": "r1"}, "r1 would do the part of several robots"),
        ({"r3": "kuka"}, "the bundle has no such robot"),
    ],
)
def test_a_part_is_one_robots(asked: dict[str, str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        mapped(inventory("r1", "kuka"), ("r1", "r2"), asked)


def test_what_is_different_of_robots_is_told_before_anything_is_run(bundled: Path, tmp_path: Path) -> None:
    unpack(as_it_is(bundled), tmp_path / "again")
    again = read(as_it_is(bundled))
    snapshot = planned(World().add("r1", "r2"), tmp_path / "again" / again.edf).base.snapshot
    assert snapshot is not None
    snapshot = replace(snapshot, facts={**snapshot.facts, "r2": replace(snapshot.facts["r2"], cpus=2)})
    assert list(differences(again, {"r2": "kuka"}, snapshot)) == [
        "r1 is r1: the same kind of machine", "r2 is kuka: cpus: 4, and 2",
    ]  # fmt: skip
    assert Replay(edf=again.edf, placed={}, facts={}).robots == ()


def test_a_folder_that_cannot_be_written_is_told(bundled: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="Not a directory") as told:
        unpack(as_it_is(bundled), tmp_path / "file" / "again")
    assert told.value.code == Code.CANNOT_WRITE


@pytest.mark.parametrize("below", ["", "experiment", "experiment/tracks"])
def test_what_was_signed_goes_where_nobody_else_can_put_other_definitions(
    bundled: Path, tmp_path: Path, below: str
) -> None:
    """They are read after they were written: whoever owns the folder, or may write to it, is quicker."""
    folder, signed = tmp_path / "open" / "experiment", replace(as_it_is(bundled), signed=True)
    unpack(signed, folder)
    (tmp_path / "open" / below).chmod(0o777)
    with pytest.raises(RefusedError, match="others can write to"):
        unpack(signed, folder)
    unpack(as_it_is(bundled), folder)


@pytest.mark.parametrize("below", ["experiment", "experiment/tracks"])
def test_what_was_signed_goes_where_nobody_else_can_add_files(bundled: Path, tmp_path: Path, below: str) -> None:
    """In a sticky folder others replace nothing, but what they add is shipped, or built into an image."""
    folder, signed = tmp_path / "open" / "experiment", replace(as_it_is(bundled), signed=True)
    unpack(signed, folder)
    (tmp_path / "open" / below).chmod(0o1777)
    with pytest.raises(RefusedError, match="others can write to"):
        unpack(signed, folder)


@pytest.mark.parametrize("signed", [False, True])
def test_nothing_is_unpacked_by_way_of_somebody_else_s_link(
    bundled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, signed: bool
) -> None:
    """Whoever may write to the folder waits for its first file; or to that above it, and takes the folder itself."""
    elsewhere, new, shared = tmp_path / "elsewhere", tmp_path / "new", tmp_path / "shared"
    elsewhere.mkdir()
    written = private.write_output

    def meanwhile(path: str, content: bytes) -> None:
        written(path, content)
        if (new / "race.edf").exists() and not (new / "tracks").exists() and not (tmp_path / "taken").exists():
            new.rename(tmp_path / "taken")
            new.symlink_to(elsewhere)
        if (shared / "race.edf").exists() and not (shared / "tracks").exists():
            (shared / "tracks").symlink_to(elsewhere)

    monkeypatch.setattr(private, "write_output", meanwhile)
    one = replace(as_it_is(bundled), signed=signed)
    with suppress(RefusedError, UsageError):
        unpack(one, new)
    shared.mkdir()
    shared.chmod(0o777)
    with pytest.raises(RefusedError, match="others can write to"):
        unpack(one, shared)
    assert list(elsewhere.iterdir()) == list(shared.iterdir()) == []
    assert {one.name for one in (tmp_path / "taken").iterdir()} == {name.split("/")[0] for name in FILES}


def test_what_a_robot_says_of_itself_shows_no_secret_and_where_images_come_from_is_hidden_by_none(
    bundled: Path, tmp_path: Path
) -> None:
    """A robot knows its own sudo's password; and a bundle's experiment chooses what its secrets are."""
    unpack(as_it_is(bundled), tmp_path / "again")
    again = read(as_it_is(bundled))
    snapshot = planned(World().add("r1", "r2"), tmp_path / "again" / again.edf).base.snapshot
    assert snapshot is not None
    snapshot = replace(snapshot, facts={**snapshot.facts, "r2": replace(snapshot.facts["r2"], kernel="hunter2-sudo")})
    Secret("hunter2-sudo")
    Secret("by its name: it may be another image today")
    found = dict(told(again, Kept(images={}, names={"web": "busybox"}), {}, snapshot))
    parts, images = list(found["Who does whose part"]), list(found["Images"])
    forget()
    assert parts[0] == "r1 is r1: the same kind of machine"
    assert "***" in parts[1] and "hunter2" not in parts[1]
    assert images == ["web: busybox, by its name: it may be another image today"]
