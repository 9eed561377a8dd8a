"""What srprov keeps and goes by later counts only where nobody else can have put it: git's settings run programs."""

from __future__ import annotations

import hashlib
import json
import os
import pwd
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from srprov import believed, datasets, whose
from srprov.controller import owners, trial_folder
from srprov.definitions import schema_cache
from srprov.errors import UsageError
from srprov.git import cache
from srprov.git_address import Address, parse_address
from srprov.record import default_root, memory
from srprov.record.folder import RunFolder

SHA256 = hashlib.sha256(b"private").hexdigest()
URL = "https://example.org/x"


def where_everybody_may_write(top: Path) -> None:
    top.chmod(0o777)


def of_somebody_elses(top: Path) -> None:
    os.chown(top / "srprov", 65534, 65534)


def by_a_link_of_somebody_elses(top: Path) -> None:
    (top / "srprov").symlink_to((top / "srprov").rename(top.parent / "cloned"))
    os.lchown(top / "srprov", 65534, 65534)


def by_way_of_a_link_in_the_place_of_which_others_may_put_one(top: Path) -> None:
    """Where the name begins, and where it ends, nobody else may write."""
    shared = top.parent / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    (shared / "link").symlink_to(top.rename(top.parent / "real"))
    top.symlink_to(shared / "link")


def where_an_access_list_lets_somebody_else_write(top: Path) -> None:
    grant(top, user=65534)


def where_an_access_list_lets_another_group_write(top: Path) -> None:
    grant(top, group=65534)


def grant(path: Path, *, user: int = 0, group: int = 0, rights: int = 7) -> None:
    """Give a folder an access list, as `setfacl` does; its owner's group has no more than it had."""
    named = [(0x02, rights, user)] * bool(user), [(0x08, rights, group)] * bool(group)
    nobody = (1 << 32) - 1
    entries = [(0x01, 7, nobody), *named[0], (0x04, 5, nobody), *named[1], (0x10, 7, nobody), (0x20, 0, nobody)]
    packed = struct.pack("<I", 2) + b"".join(struct.pack("<HHI", *one) for one in entries)
    try:
        os.setxattr(path, "system.posix_acl_access", packed)
    except OSError as error:
        pytest.skip(f"no access lists here: {error.strerror}")


STRANGERS = [
    where_everybody_may_write, of_somebody_elses, by_a_link_of_somebody_elses,
    by_way_of_a_link_in_the_place_of_which_others_may_put_one,
    where_an_access_list_lets_somebody_else_write, where_an_access_list_lets_another_group_write,
]  # fmt: skip
Stranger = Callable[[Path], None]


@pytest.fixture
def top(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return what the user named as the folder for caches and for state."""
    folder = tmp_path / "named"
    folder.mkdir(mode=0o700)
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(folder))
    return folder


def git(*words: str) -> str:
    told = ["git", "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(told, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> tuple[Address, str]:
    folder = tmp_path / "repository"
    git("init", "-q", str(folder))
    (folder / "a").write_text("1\n")
    git("-C", str(folder), "add", ".")
    git("-C", str(folder), "commit", "-qm", "x")
    return parse_address(f"file://{folder}"), git("-C", str(folder), "rev-parse", "HEAD")


@pytest.mark.parametrize("stranger", STRANGERS)
def test_a_repository_in_the_cache_whose_settings_others_wrote_runs_nothing(
    top: Path, tmp_path: Path, repository: tuple[Address, str], stranger: Stranger
) -> None:
    address, commit = repository
    place = top / "srprov" / "git" / f"{hashlib.sha256(address.url.encode()).hexdigest()[:32]}.git"
    place.parent.mkdir(mode=0o700, parents=True)
    git("init", "-q", "--bare", str(place))
    git("init", "-q", "--bare", str(tmp_path / "other"))
    (place / "objects/info").mkdir(exist_ok=True)
    (place / "objects/info/alternates").write_text(f"{tmp_path}/other/objects\n")
    git(f"--git-dir={place}", "config", "core.alternateRefsCommand", f"touch {tmp_path}/ran; cat")
    stranger(top)
    with pytest.raises(PermissionError, match="others may write"):
        cache.files(address, commit, 1 << 20)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("stranger", STRANGERS)
def test_a_tree_in_the_cache_that_others_wrote_is_not_taken_for_a_commit(
    top: Path, repository: tuple[Address, str], stranger: Stranger
) -> None:
    address, commit = repository
    made = cache.folder(address, commit, 1 << 20)
    assert made.joinpath("a").read_text() == "1\n" and cache.folder(address, commit, 1 << 20) == made
    stranger(top)
    with pytest.raises(PermissionError):
        cache.folder(address, commit, 1 << 20)


@pytest.mark.parametrize("stranger", STRANGERS)
def test_what_others_say_of_data_sets_gives_no_file(top: Path, tmp_path: Path, stranger: Stranger) -> None:
    kept = datasets.keep(SHA256, [b"private"], URL)
    own = tmp_path / "own"
    own.write_bytes(b"private")
    datasets.digest(str(own))
    assert (datasets.find(SHA256, URL), datasets.find(SHA256)) == (kept, own)
    stranger(top)
    assert (datasets.find(SHA256, URL), datasets.find(SHA256)) == (None, None)
    with pytest.raises(PermissionError):
        datasets.keep(SHA256, [b"private"], URL)


@pytest.mark.parametrize("stranger", STRANGERS)
def test_a_token_that_others_wrote_proves_nothing(top: Path, stranger: Stranger) -> None:
    """With it they could make the proof that a plan file was written here."""
    owner = owners.read_owner("x", "/x.edf")
    owners.keep(owner)
    memory.note_images({"srprov/x:1": ["sha256:1"]})
    memory.remember("x", memory.Memory(robots=frozenset({"robot1"}), records=("1",)))
    assert owners.read_owner("x", "/x.edf") == owner and memory.known_images() and memory.recall("x").robots
    stranger(top)
    assert owners.read_owner("x", "/x.edf").token != owner.token
    assert not memory.known_images() and not memory.recall("x").robots
    with pytest.raises(UsageError, match="others may write"):
        owners.keep(owner)
    assert "others may write" in memory.note_images({"srprov/y:1": ["sha256:1"]})


@pytest.mark.parametrize("stranger", STRANGERS)
def test_no_run_is_recorded_where_others_could_put_links(top: Path, stranger: Stranger) -> None:
    with RunFolder(default_root(), "first") as first:
        pass
    assert not first.problem and first.path.is_dir()
    stranger(top)
    with RunFolder(default_root(), "second") as second:
        second.put("plan.txt", lambda: "x")
    assert "others may write" in second.problem and not second.path.exists()


@pytest.mark.parametrize("stranger", STRANGERS)
def test_no_trials_are_kept_where_others_could_put_links(top: Path, tmp_path: Path, stranger: Stranger) -> None:
    trial_folder.make_folder(default_root().parent / "trials" / "first")
    trial_folder.make_folder(tmp_path / "named by the user")
    stranger(top)
    with pytest.raises(UsageError, match="others may write"):
        trial_folder.make_folder(default_root().parent / "trials" / "second")


@pytest.mark.parametrize("stranger", STRANGERS)
def test_nothing_is_forgotten_by_way_of_what_others_put_there(top: Path, tmp_path: Path, stranger: Stranger) -> None:
    """`destroy` removed a file of that name wherever a link of theirs led."""
    own = tmp_path / "own"
    own.mkdir()
    (own / "x.json").write_text("{}")
    (top / "srprov").mkdir(mode=0o700)
    (top / "srprov/placements").symlink_to(own)
    stranger(top)
    assert "others may write" in memory.remember("x", memory.Memory()) and (own / "x.json").exists()


def test_a_folder_that_is_the_users_alone_is_believed(top: Path) -> None:
    believed.write(top / "srprov" / "a" / "b.json", json.dumps(1), 1 << 10)
    assert believed.read(top / "srprov" / "a" / "b.json", 10) == b"1"
    assert (top / "srprov").stat().st_mode & 0o777 == 0o700


def test_an_access_list_that_lets_nobody_else_write_is_no_harm(top: Path) -> None:
    believed.write(top / "srprov" / "a.json", "1", 1 << 10)
    grant(top, user=65534, rights=5)
    assert believed.read(top / "srprov" / "a.json", 10) == b"1"


def test_links_are_followed_as_the_kernel_does(tmp_path: Path) -> None:
    """A link back to where it stands, one above, and one that never ends."""
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "link").symlink_to("a/b/../../a")
    assert believed.is_out_of_reach(tmp_path / "link/b") and believed.is_out_of_reach(tmp_path / "link" / ".." / "a")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="Too many levels"):
        believed.is_out_of_reach(tmp_path / "loop")
    (tmp_path / "a").chmod(0o777)
    assert not believed.is_out_of_reach(tmp_path / "link/b")


def test_who_has_the_user_s_group_as_his_first_is_somebody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """The list of a group's members does not name him."""
    own = pwd.getpwuid(os.geteuid())
    whose.is_nobody_elses_group.cache_clear()
    assert whose.is_nobody_elses_group(own.pw_gid)
    other = pwd.struct_passwd(("guest", "x", 4242, own.pw_gid, "", "/", "/bin/sh"))
    monkeypatch.setattr(pwd, "getpwall", lambda: [own, other])
    whose.is_nobody_elses_group.cache_clear()
    assert not whose.is_nobody_elses_group(own.pw_gid)
    whose.is_nobody_elses_group.cache_clear()


def test_nothing_is_made_or_changed_by_way_of_somebody_else_s_link(top: Path, tmp_path: Path) -> None:
    """It leads to a folder of the user's, which lost its permissions."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    elsewhere.chmod(0o755)
    (top / "srprov").symlink_to(elsewhere)
    os.lchown(top / "srprov", 65534, 65534)
    with pytest.raises(UsageError, match="others may write"):
        owners.keep(owners.read_owner("x", "/x.edf"))
    schema_cache.add("0" * 64)
    (tmp_path / "own").write_bytes(b"private")
    assert datasets.digest(str(tmp_path / "own"))[0] == SHA256
    assert elsewhere.stat().st_mode & 0o777 == 0o755 and not list(elsewhere.iterdir())


def test_nothing_is_written_that_is_longer_than_what_is_read_again(top: Path) -> None:
    """Words of robots are kept, too: all that a file had told before would be forgotten with them."""
    place = top / "srprov" / "a.json"
    believed.write(place, "old", 3)
    with pytest.raises(OSError, match="that are read of it"):
        believed.write(place, "newer", 3)
    assert believed.read(place, 3) == b"old"
