"""What srprov keeps and goes by later counts only where nobody else can have put it: git's settings run programs."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from srprov import believed, datasets
from srprov.controller import owners
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


STRANGERS = [where_everybody_may_write, of_somebody_elses, by_a_link_of_somebody_elses]
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


def test_a_folder_that_is_the_users_alone_is_believed(top: Path) -> None:
    believed.write(top / "srprov" / "a" / "b.json", json.dumps(1))
    assert believed.read(top / "srprov" / "a" / "b.json", 10) == b"1"
    assert (top / "srprov").stat().st_mode & 0o777 == 0o700
