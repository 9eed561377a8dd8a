"""What pip left in users' folders, and keys of archives, read by a real shell of root's where users set traps."""

from __future__ import annotations

import base64
import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov import sandbox
from srprov.sandbox import NO_SANDBOX
from srprov.snapshot import questions, sources
from srprov.snapshot.notes import Notes
from srprov.snapshot.python import parse_installed
from srprov.wire import quote

ROOT = os.geteuid() == 0
PLACE = ".local/lib/python3.11/site-packages"
UNSEEN = '[ ! -L "$i/METADATA" ]', '[ ! -L "$i/direct_url.json" ]', '[ ! -L "$i/INSTALLER" ]'
"""Looks at names that may be other files' a moment later."""
pytestmark = pytest.mark.skipif(not ROOT, reason="only root reads what others may not")


@pytest.fixture
def homes() -> Iterator[Path]:
    """Give what takes the place of /home: Ada has a package from a private address, and Eve has one of her own."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        place = Path(folder)
        place.chmod(0o755)
        package(place / "ada" / PLACE, "private", '{"url": "https://private.example", "dir_info": {}}')
        package(place / "eve" / PLACE, "mine")
        given(place)
        yield place


def package(folder: Path, name: str, direct: str = "") -> Path:
    """Write what pip leaves beside a package."""
    place = folder / f"{name}-1.dist-info"
    place.mkdir(parents=True)
    (place / "INSTALLER").write_text("pip\n", encoding="utf-8")
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n", encoding="utf-8")
    if direct:
        (place / "direct_url.json").write_text(direct, encoding="utf-8")
    return place


def given(homes: Path) -> None:
    """Give each home to its user, who alone may read it."""
    for uid, name in enumerate(("ada", "eve"), 4001):
        subprocess.run(["chown", "-hR", f"{uid}:{uid}", str(homes / name)], check=True)
        (homes / name).chmod(0o700)


def ask(homes: Path, question: str = "", login: str = "") -> str:
    """Return what is said of homes, without what lies elsewhere on this machine."""
    asked = question or questions._METADATA
    words = f"mount --bind {quote(str(homes))} /home && cd / && exec {login} sh -c {quote(asked)}"
    ran = subprocess.run(["unshare", "-m", "sh", "-c", words], capture_output=True, check=True)
    said = base64.b64decode(ran.stdout).decode("utf-8", "replace")
    assert said.endswith(questions.END)
    parts = said.removesuffix(questions.END).split("\0")
    return "".join(
        "\0".join([*parts[at : at + 3], ""]) for at in range(0, len(parts) - 2, 3) if parts[at].startswith("dist /home")
    )


def hasty() -> str:
    """Return the question as if each name were another file's since it was looked at."""
    question = questions._METADATA
    for look in UNSEEN:
        assert look in question
        question = question.replace(look, "true")
    return question


def test_every_home_is_told_of(homes: Path) -> None:
    said = ask(homes)
    assert said == (
        f'dist /home/ada/{PLACE}/private-1.dist-info\0Name: private\nVersion: 1\n\0{{"url": "https://private.example", '
        f'"dir_info": {{}}}}\0dist /home/eve/{PLACE}/mine-1.dist-info\0Name: mine\nVersion: 1\n\0\0'
    )


def test_a_home_that_root_put_elsewhere_is_read(homes: Path) -> None:
    """What lies in /home is root's to choose."""
    (homes / "eve").rename(homes / ".elsewhere")
    (homes / "eve").symlink_to(".elsewhere")
    assert f"dist /home/eve/{PLACE}/mine-1.dist-info\0Name: mine\n" in ask(homes)


@pytest.mark.parametrize("above", [".local", ".local/lib", ".local/lib/python3.11"])
def test_no_folder_above_leads_into_the_home_of_another(homes: Path, above: str) -> None:
    """Each name of Eve's but the last was followed: root told what Ada's folder has as if it were Eve's."""
    (homes / "eve" / above).rename(homes / "eve" / "aside")
    (homes / "eve" / above).symlink_to(f"/home/ada/{above}")
    given(homes)
    said = ask(homes)
    assert "dist /home/ada" in said and "/home/eve" in said
    assert "private" not in said[said.index("dist /home/eve") :]
    notes = Notes()
    parse_installed(said, notes)
    assert ("pip packages in /home/eve/" + PLACE, "are not read: a link is in the folder's path") in [
        (note.subject, note.words) for note in notes.all()
    ]


@pytest.mark.parametrize("way", ["link", "hard link"])
@pytest.mark.parametrize("name", ["METADATA", "direct_url.json"])
def test_no_name_is_another_users_file(homes: Path, name: str, way: str) -> None:
    """One that took the place of Eve's file after a look at it, or is the same file by a second name."""
    record, secret = homes / "eve" / PLACE / "mine-1.dist-info" / name, homes / "ada" / PLACE / "private-1.dist-info"
    record.unlink(missing_ok=True)
    if way == "link":
        record.symlink_to(f"/home/ada/{PLACE}/private-1.dist-info/{name}")
    else:
        record.hardlink_to(secret / name)
    said = ask(homes, hasty())
    assert "private" not in said[said.index("dist /home/eve") :]


def test_a_device_is_not_opened(homes: Path) -> None:
    """One that never ends, as a container may make it in a folder of a user's that is mounted there."""
    record = homes / "eve" / PLACE / "mine-1.dist-info" / "direct_url.json"
    os.mknod(record, 0o20666, os.makedev(1, 9))
    question = hasty().replace('[ -f "$i/direct_url.json" ]', "true")
    assert ask(homes, question).endswith("Name: mine\nVersion: 1\n\0\0")


def test_what_cannot_be_closed_off_is_not_read_and_named(homes: Path) -> None:
    notes = Notes()
    said = ask(homes, questions._METADATA.replace("unshare -m true", "false"))
    assert parse_installed(said, notes) == ()
    assert [(note.subject, note.words) for note in notes.all()] == [
        (f"pip packages in /home/{name}/{PLACE}", f"are not read: {sandbox.NOT_CLOSED}") for name in ("ada", "eve")
    ]
    assert said.count(str(NO_SANDBOX)) == 2


def test_a_shell_that_is_not_roots_is_closed_off_too(homes: Path) -> None:
    """Eve's names lead to what Ada's shell may read, whose snapshot would tell it."""
    (homes / "eve").chmod(0o755)
    record = homes / "eve" / PLACE / "mine-1.dist-info" / "direct_url.json"
    record.symlink_to(f"/home/ada/{PLACE}/private-1.dist-info/direct_url.json")
    said = ask(homes, hasty(), "setpriv --reuid=4001 --regid=4001 --clear-groups")
    assert "dist /home/ada" in said and "private" in said and "/home/eve" in said
    assert "private" not in said[said.index("dist /home/eve") :]


def test_keys_are_what_everybody_may_read(homes: Path) -> None:
    """A key's path leads, by a link of root's, into a folder whose owner leads it on to a file of root's."""
    (homes / "secret").write_text("of root alone", encoding="utf-8")
    (homes / "secret").chmod(0o600)
    (homes / "good").write_text("public", encoding="utf-8")
    (homes / "links").mkdir()
    (homes / "links" / "a.gpg").symlink_to(homes / "secret")
    (homes / "links" / "b.gpg").symlink_to(homes / "good")
    found = [sources.Source("http://a/b", "c", key=str(homes / "links" / name)) for name in ("a.gpg", "b.gpg")]
    ran = subprocess.run(
        ["sh", "-c", sources.keys_query(found, root=True).command], capture_output=True, text=True, check=True
    )
    said = dict(line.split(" ", 1) for line in ran.stdout.splitlines())
    assert [base64.b64decode(coded) for coded in said.values()] == [b"", b"public"]
