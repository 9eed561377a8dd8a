"""Data sets on this machine and on their way: by their hash, once, and on from where it ended."""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path

import pytest

from srprov import datasets
from srprov.modules import MODULES
from srprov.modules.dataset import DataParams
from srprov.modules.module import STATE_ROOT
from srprov.transport.data_copy import take_script
from srprov.wire import DATA_STORE, Reply, Run, SendData

CONTENT = os.urandom(300_000)
SHA = hashlib.sha256(CONTENT).hexdigest()
URL = "https://data.example/x.bag"


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def take(store: Path, sent: bytes, sha256: str = SHA, size: int = len(CONTENT)) -> list[str]:
    """Let a shell take what is sent; give what it says."""
    script = take_script(sha256, size).replace(DATA_STORE, str(store))
    done = subprocess.run(["sh", "-c", script], input=sent, capture_output=True, timeout=30, check=False)
    return done.stdout.decode().splitlines()


def test_a_robot_takes_what_has_the_hash_and_has_it_then(tmp_path: Path) -> None:
    assert take(tmp_path, CONTENT) == ["have 0", "done"]
    data = tmp_path / SHA / "data"
    assert data.read_bytes() == CONTENT and data.stat().st_mode & 0o777 == 0o444
    assert [one.name for one in data.parent.iterdir()] == ["data"]
    assert take(tmp_path, b"") == ["there"]


@pytest.mark.parametrize("cut", [1, 150_000, 299_999])
def test_what_was_cut_off_goes_on_where_it_ended(tmp_path: Path, cut: int) -> None:
    assert take(tmp_path, CONTENT[:cut]) == ["have 0"]
    assert not (tmp_path / SHA / "data").exists()
    assert take(tmp_path, CONTENT[cut:]) == [f"have {cut}", "done"]


def test_one_flipped_byte_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    wrong = bytes([CONTENT[0] ^ 1]) + CONTENT[1:]
    assert take(tmp_path, wrong) == ["have 0", f"wrong {hashlib.sha256(wrong).hexdigest()}"]
    assert list((tmp_path / SHA).iterdir()) == []


def test_what_changed_on_the_robot_is_taken_again(tmp_path: Path) -> None:
    take(tmp_path, CONTENT)
    data = tmp_path / SHA / "data"
    data.chmod(0o644)
    data.write_bytes(b"other")
    assert take(tmp_path, CONTENT) == ["have 0", "done"]
    assert data.read_bytes() == CONTENT


def test_a_disk_without_room_is_refused_before_the_first_byte(tmp_path: Path) -> None:
    (said,) = take(tmp_path, b"", size=1 << 60)
    assert said.startswith("no room: it needs 1099511627840 MiB, and has ")


def test_a_file_is_hashed_again_only_when_it_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "f"
    path.write_bytes(CONTENT)
    assert datasets.digest(str(path)) == (SHA, len(CONTENT))
    assert datasets.find(SHA) == path
    with monkeypatch.context() as without:
        without.setattr(datasets.hashlib, "sha256", None)
        assert datasets.digest(str(path)) == (SHA, len(CONTENT))
    path.write_bytes(b"test")
    assert datasets.digest(str(path))[0] == hashlib.sha256(b"test").hexdigest()
    assert datasets.find(SHA) is None
    assert (datasets.folder() / "known.json").stat().st_mode & 0o777 == 0o600


def test_a_list_of_known_files_that_is_full_begins_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tmp_path / "a", tmp_path / "b"]
    for path in paths:
        path.write_bytes(path.name.encode())
    datasets.digest(str(paths[0]))
    monkeypatch.setattr(datasets, "_MOST_KNOWN", (datasets.folder() / "known.json").stat().st_size + 10)
    datasets.digest(str(paths[1]))
    assert [datasets.find(hashlib.sha256(path.name.encode()).hexdigest()) for path in paths] == [None, paths[1]]


def test_a_link_in_the_place_of_a_checked_file_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("x")
    (tmp_path / "f").symlink_to(tmp_path / "other")
    with pytest.raises(OSError):
        datasets.digest(str(tmp_path / "f"))


def test_a_download_is_kept_when_its_hash_is_right(tmp_path: Path) -> None:
    kept = datasets.keep(SHA, [CONTENT[:1000], CONTENT[1000:]], URL)
    assert datasets.find(SHA, URL) == kept and kept.read_bytes() == CONTENT
    datasets.forget(SHA)
    assert datasets.find(SHA, URL) is None


def test_who_names_an_address_gets_what_it_gives_and_no_file_of_this_machine(tmp_path: Path) -> None:
    """A record or a bundle tells the hash of a data set that nobody else may have."""
    (tmp_path / "private").write_bytes(CONTENT)
    datasets.digest(str(tmp_path / "private"))
    assert datasets.find(SHA) == tmp_path / "private" and datasets.find(SHA, URL) is None
    kept = datasets.keep(SHA, [CONTENT], "https://lab.example/private.bag")
    assert datasets.find(SHA, URL) is None and datasets.find(SHA, "https://lab.example/private.bag") == kept
    assert datasets.keep(SHA, [CONTENT], URL) == datasets.find(SHA, URL)


def test_a_download_with_another_hash_or_too_large_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(datasets.WrongData, match="its sha256 is"):
        datasets.keep(SHA, [b"other"], URL)
    monkeypatch.setattr(datasets, "MOST_BYTES", 10)
    with pytest.raises(datasets.WrongData, match="larger"):
        datasets.keep(SHA, [CONTENT], URL)
    assert list(datasets.folder().iterdir()) == []


@pytest.mark.parametrize("known", ["", "[", '{"/etc/passwd": [1]}', '{"/x": {}}', "[1]", '{"/x": 1}'])
def test_a_list_of_known_files_of_any_shape_is_only_a_list(known: str) -> None:
    datasets.folder().mkdir(parents=True)
    (datasets.folder() / "known.json").write_text(known)
    assert datasets.find(SHA) is None


def test_a_robot_that_has_a_data_set_gives_it_to_nobody_who_has_not_got_it_himself(tmp_path: Path) -> None:
    """An apply that fails since nobody gives the content is tried again: that must not find all as it should be."""
    module, name = MODULES["data"], f"{STATE_ROOT}/hello/data/{SHA}"
    of_url, of_file = DataParams(sha256=SHA, url=URL), DataParams(sha256=SHA)
    change = module.check(name, of_url, None)
    assert change is not None
    begin, send, end = change.commands
    assert isinstance(begin, Run) and isinstance(send, SendData) and isinstance(end, Run)
    (tmp_path / ".data" / SHA).mkdir(parents=True)
    (tmp_path / ".data" / SHA / "data").write_bytes(CONTENT)  # another instance's

    def there() -> list[object]:
        said = shell(module.queries()[0].command)  # type: ignore[union-attr]  # a question to the shell
        return [one.state["there"] for one in module.parse([Reply(status=0, out=said)])]

    def shell(script: str) -> str:
        done = subprocess.run(["sh", "-c", script.replace(STATE_ROOT, str(tmp_path))], capture_output=True, check=True)
        return done.stdout.decode().replace(str(tmp_path), STATE_ROOT)

    def change_for(want: DataParams) -> object:
        said = shell(module.queries()[0].command)  # type: ignore[union-attr]  # as above
        return module.check(name, want, module.parse([Reply(status=0, out=said)])[0].state)

    shell(begin.script)
    assert there() == [False] and change_for(of_file)
    shell(end.script)
    assert there() == [True] and not change_for(of_url) and not change_for(of_file)
    assert change_for(DataParams(sha256=SHA, url="https://evil.example/x"))  # may be another's, under that name
    sent = module.check(name, of_file, None)
    assert sent is not None and isinstance(sent.commands[-1], Run)
    shell(sent.commands[-1].script)
    assert there() == [True] and change_for(of_url) and not change_for(of_file)
