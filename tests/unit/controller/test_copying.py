"""Copies between this machine and a container that is a folder here; an engine is played by `tarfile`."""

from __future__ import annotations

import io
import itertools
import os
import shutil
import socket
import stat
import tarfile
import time
from collections.abc import Collection, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from srprov.codes import Code
from srprov.container_files import InContainer
from srprov.controller import copied_out
from srprov.controller.copied import Copied
from srprov.controller.copied_in import Owner, tar_of
from srprov.controller.copied_links import Links, stays_inside
from srprov.controller.copied_out import Target, unpack
from srprov.controller.copying import InService, copy_into, copy_out, place, raw_into, raw_out
from srprov.controller.made_from import files_of
from srprov.errors import UsageError
from srprov.record.memory import note_secret_files
from srprov.transport import tar_stream

TIME = 1_600_000_000


class Engine:
    """A container whose files lie in a folder; tars are made and unpacked as Docker's engine does."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.got: list[tarfile.TarInfo] = []

    def _at(self, path: str) -> Path:
        return self.root / path.lstrip("/")

    def path_in(self, _container: str, path: str) -> InContainer | None:
        try:
            about = self._at(path).lstat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        link = ""
        if stat.S_ISLNK(about.st_mode):
            link = "/" + os.path.relpath(self._at(path).resolve(), self.root)
        return InContainer(
            is_folder=stat.S_ISDIR(about.st_mode), is_file=stat.S_ISREG(about.st_mode), size=about.st_size, link=link
        )

    def copy_out(self, _container: str, path: str) -> Iterator[bytes]:
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w") as tar:
            tar.add(self._at(path), arcname=os.path.basename(path) or "/")
        yield buffer.getvalue()

    def copy_into(self, _container: str, folder: str, tar: Iterator[bytes]) -> None:
        with tarfile.open(fileobj=io.BytesIO(b"".join(tar))) as read:
            self.got = read.getmembers()
            read.extractall(self._at(folder), filter="tar")


@pytest.fixture
def engine(tmp_path: Path) -> Engine:
    root = tmp_path / "container"
    (root / "out/deep").mkdir(parents=True)
    (root / "out/a.txt").write_text("a")
    (root / "out/deep/run.sh").write_text("#!/bin/sh\n")
    (root / "out/deep/run.sh").chmod(0o755)
    (root / "out/a.txt").chmod(0o644)
    (root / "latest").symlink_to("out")
    os.utime(root / "out/a.txt", (TIME, TIME))
    return Engine(root)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def out(engine: Engine, word: str, target: str, *, preserve: bool = False, believed: Collection[str] = ()) -> Copied:
    source = place(word)
    assert isinstance(source, InService)
    copied = Copied()
    copy_out(engine, "c", source, target, copied, preserve=preserve, believed=believed)
    return copied


def into(engine: Engine, source: str, word: str, owner: Owner = Owner()) -> Copied:  # noqa: B008 - a value
    target = place(word)
    assert isinstance(target, InService)
    copied = Copied()
    copy_into(engine, "c", source, target, owner, copied)
    return copied


def tree(folder: Path) -> dict[str, str]:
    """Give every file below a folder with its content."""
    return {str(one.relative_to(folder)): one.read_text() for one in sorted(folder.rglob("*")) if one.is_file()}


@pytest.mark.parametrize("folder", [".git", "sub/.Git", ".hg"])
def test_a_container_makes_no_repository_here(engine: Engine, here: Path, folder: str) -> None:
    """Settings of one name programs, and a prompt that asks git for its status runs them."""
    (here / "clone" / folder).mkdir(parents=True)
    (here / "clone" / folder / "config").write_text("mine")
    (engine.root / "out" / folder / "hooks").mkdir(parents=True)
    for name in ("config", "hooks/pre-commit"):
        (engine.root / "out" / folder / name).write_text("its own")
    copied = out(engine, "s:/out/.", "clone")
    assert tree(here / "clone") == {"a.txt": "a", "deep/run.sh": "#!/bin/sh\n", f"{folder}/config": "mine"}
    assert [one.partition(":")[0] for one in copied.left_out] == [folder]


def test_a_folder_that_is_a_repository_by_itself_comes_as_none(engine: Engine, here: Path) -> None:
    (engine.root / "out/bare/refs").mkdir(parents=True)
    (engine.root / "out/bare/config").write_text("[core]\nworktree = .\n")
    (engine.root / "out/bare/HEAD").symlink_to("config")
    (engine.root / "out/bare/head").mkdir()
    copied = out(engine, "s:/out", "new")
    assert not (here / "new/bare/HEAD").is_symlink() and (here / "new/bare/config").exists()
    assert (here / "new/bare/head").is_dir(), "a folder of a robot's head"
    assert [one.partition(":")[0] for one in copied.left_out] == ["new/bare/HEAD"]
    out(engine, "s:/out/bare/config", "HEAD")
    assert (here / "HEAD").exists()  # the user's own word


@pytest.mark.parametrize(
    ("word", "target", "found"),
    [
        ("s:/out/a.txt", ".", {"a.txt": "a"}),
        ("s:/out/a.txt", "b.txt", {"b.txt": "a"}),
        ("s:/out", "new", {"new/a.txt": "a", "new/deep/run.sh": "#!/bin/sh\n"}),
        ("s:/out/", ".", {"out/a.txt": "a", "out/deep/run.sh": "#!/bin/sh\n"}),
        ("s:/out/.", "new", {"new/a.txt": "a", "new/deep/run.sh": "#!/bin/sh\n"}),
        ("s:/latest", "new", {"new/a.txt": "a", "new/deep/run.sh": "#!/bin/sh\n"}),
        ("s:/out/../out//deep/run.sh", ".", {"run.sh": "#!/bin/sh\n"}),
        ("s:/", "all", {"all/out/a.txt": "a", "all/out/deep/run.sh": "#!/bin/sh\n"}),
    ],
)
def test_what_comes_out_lies_where_cp_would_put_it(
    engine: Engine, here: Path, word: str, target: str, found: dict[str, str]
) -> None:
    if word == "s:/":
        (engine.root / "latest").unlink()
    copied = out(engine, word, target)
    assert tree(here) == found
    assert (copied.files, copied.bytes, copied.left_out) == (len(found), sum(map(len, found.values())), [])


def test_no_name_that_a_container_chooses_lies_where_the_user_s_programs_look(
    engine: Engine, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Variables beside the inventory name programs that run here, and so do settings where somebody works."""
    mine = here.parent / "mine"
    for folder in ("home", "lab/host_vars", "lab/robots", "lab/work", "lab/new"):
        (mine / folder).mkdir(parents=True)
    (mine / "lab/robots/all.yml").write_text("all: {}")
    (mine / "robots.yml").symlink_to("lab/robots/all.yml")
    monkeypatch.setenv("HOME", str(mine / "home"))
    monkeypatch.chdir(mine / "lab/work")
    shutil.copytree(engine.root / "out", engine.root / "robots/group_vars")
    inventory, linked = str(mine / "lab/robots/all.yml"), str(mine / "robots.yml")
    for word, target, believed in (
        ("s:/out/.", ".", ()),
        ("s:/out/.", "..", ()),
        ("s:/", str(mine / "lab"), ()),
        ("s:/out/.", str(mine / "home"), ()),
        ("s:/robots/.", "../robots", (inventory,)),
        ("s:/robots/.", "../robots", (linked,)),
        ("s:/robots", "..", ("../robots/all.yml",)),
        ("s:/robots", "..", ("../robots",)),
        ("s:/out/.", str(mine), ("nothing.edf", linked)),
        ("s:/robots/group_vars", "../robots", (inventory,)),
        ("s:/out/a.txt", "../host_vars/robot1.yml", ("../all.yml",)),
        ("s:/out/a.txt", "../robots/more.yml", ("../robots",)),
        ("s:/out", "host_vars", ("robots.yml",)),
    ):
        with pytest.raises(UsageError, match="could name programs") as refused:
            out(engine, word, target, believed=believed)
        assert refused.value.code is Code.IN_THE_WAY
    assert [*tree(mine)] == ["lab/robots/all.yml", "robots.yml"]
    for target in ("new", "../new", "../robots"):
        out(engine, "s:/out/.", target, believed=(linked,) if target != "../robots" else ())
    assert {"lab/work/new/a.txt", "lab/new/a.txt", "lab/robots/a.txt"} <= tree(mine).keys()


def test_no_name_that_a_container_chooses_lies_where_the_experiment_is_defined(engine: Engine, here: Path) -> None:
    """A CDF says what runs on other robots, too; a secret's file what only these should know."""
    for name in ("nav", "base", "image", "keys", "set", "maps"):
        (here / name).mkdir()
    (here / "maps/hall.yaml").write_text("hall")
    (here / "keys/token").write_text("a-decoy-token")
    (here / "set/nav.env").write_text("A=1\n")
    (here / "image/Dockerfile").write_text("FROM busybox\n")
    (here / "base/ros.cdf").write_text("cdf: 1\nname: ros\nbase: busybox\n")
    (here / "nav/nav.cdf").write_text("cdf: 1\nname: nav\nextends: ../base/ros.cdf\ncommand: nav\n")
    (here / "image/made.cdf").write_text("cdf: 1\nname: made\ndockerfile: Dockerfile\n")
    (here / "e.edf").write_text(
        "edf: 1\nname: e\nsecrets: {token: {file: keys/token}}\nservices:\n  nav: {cdf: nav/nav.cdf, secrets: [token], "
        "env_file: set/nav.env, volumes: ['./maps:/maps:ro'], environment: [SET_FOR_APPLY_ALONE]}\n"
        "  made: {cdf: image/made.cdf}\n"
    )
    believed = files_of("e.edf")
    for target in ("nav", "base", "image", "keys", "set"):
        with pytest.raises(UsageError, match="what a container has could name programs there"):
            out(engine, "s:/out/.", target, believed=believed)
    for target in ("maps", "nav/config"):
        out(engine, "s:/out/.", target, believed=believed)
    out(engine, "s:/out", "nav", believed=believed)
    assert {"maps/a.txt", "nav/config/a.txt", "nav/out/a.txt"} <= tree(here).keys()


def test_of_an_edf_that_is_not_valid_nobody_knows_what_it_is_made_from(here: Path) -> None:
    (here / "e.edf").write_text("edf: 1\nname: e\nservices: {nav: {cdf: not-there.cdf}}\n")
    assert files_of("e.edf") == []


@pytest.mark.parametrize(("word", "target"), [("s:/x/.git", "."), ("s:/x/.git/config", ".git"), ("s:/x", "link/new")])
def test_nothing_of_a_container_s_goes_into_a_repository_that_is_here(
    engine: Engine, here: Path, monkeypatch: pytest.MonkeyPatch, word: str, target: str
) -> None:
    """Its settings name programs, which the next look at its status runs; also where the user names it himself."""
    work = here / "CVS" / "work"
    (work / ".git").mkdir(parents=True)
    (work / ".git" / "config").write_text("mine")
    (work / "link").symlink_to(".git")
    (engine.root / "x/.git").mkdir(parents=True)
    (engine.root / "x/.git/config").write_text("[core]\nfsmonitor = id\n")
    monkeypatch.chdir(work)
    with pytest.raises(UsageError, match=r"lies in \.git: what a container has could name programs"):
        out(engine, word, target)
    assert (work / ".git" / "config").read_text() == "mine"
    out(engine, "s:/out", "new")


def test_files_are_their_owners_alone_unless_they_are_to_be_as_they_were(engine: Engine, here: Path) -> None:
    out(engine, "s:/out", "plain")
    assert stat.S_IMODE((here / "plain/a.txt").stat().st_mode) == 0o600
    assert stat.S_IMODE((here / "plain/deep/run.sh").stat().st_mode) == 0o700
    (engine.root / "out/deep/run.sh").chmod(0o6755)
    (engine.root / "out/deep").chmod(0o750)
    out(engine, "s:/out", "same", preserve=True)
    assert stat.S_IMODE((here / "same/a.txt").stat().st_mode) == 0o644
    assert (here / "same/a.txt").stat().st_mtime == TIME
    assert stat.S_IMODE((here / "same/deep/run.sh").stat().st_mode) == 0o755, "nothing acts as somebody else"
    assert stat.S_IMODE((here / "same/deep").stat().st_mode) == 0o750


def test_what_is_there_is_replaced_and_links_are_not_followed(engine: Engine, here: Path) -> None:
    (here / "secret").write_text("mine")
    (here / "a.txt").symlink_to("secret")
    out(engine, "s:/out/a.txt", ".")
    assert (here / "secret").read_text() == "mine" and not (here / "a.txt").is_symlink()
    assert (here / "a.txt").read_text() == "a"
    (here / "elsewhere").mkdir()
    (here / "out").symlink_to("elsewhere")
    with pytest.raises(UsageError, match="a file or link is there, where a folder is to be"):
        out(engine, "s:/out", ".")
    assert list((here / "elsewhere").iterdir()) == []


@pytest.mark.parametrize(
    ("word", "target", "words"),
    [
        ("s:/nothing", ".", "there is no /nothing in s"),
        ("s:/out/a.txt/", ".", "is no folder"),
        ("s:/out/a.txt/.", ".", "is no folder"),
        ("s:/out/a.txt", "new/", "new/: there is no such folder"),
        ("s:/out/a.txt", "no/where", "no: there is no such folder"),
        ("s:/out", "file", "file: a file is there"),
        ("s:/out/a.txt", "holds", "a folder is there, where a file is to be"),
    ],
)
def test_what_cannot_come_out_is_refused(engine: Engine, here: Path, word: str, target: str, words: str) -> None:
    (here / "file").write_text("x")
    (here / "holds/a.txt").mkdir(parents=True)
    with pytest.raises(UsageError, match=words):
        out(engine, word, target)
    assert sorted(str(one.relative_to(here)) for one in here.rglob("*")) == ["file", "holds", "holds/a.txt"]


@pytest.mark.parametrize(
    ("source", "word", "found"),
    [
        ("f.txt", "s:/out", "out/f.txt"),
        ("f.txt", "s:/out/", "out/f.txt"),
        ("f.txt", "s:/latest", "out/f.txt"),
        ("f.txt", "s:/out/a.txt", "out/a.txt"),
        ("f.txt", "s:/new.txt", "new.txt"),
        ("folder", "s:/out", "out/folder/g.txt"),
        ("folder", "s:/new", "new/g.txt"),
        ("folder/.", "s:/out", "out/g.txt"),
        ("folder/.", "s:/new/", "new/g.txt"),
    ],
)
def test_what_goes_in_lies_where_cp_would_put_it(
    engine: Engine, here: Path, source: str, word: str, found: str
) -> None:
    (here / "folder").mkdir()
    (here / "f.txt").write_text("f")
    (here / "folder/g.txt").write_text("g")
    before = tree(engine.root)
    copied = into(engine, source, word)
    assert tree(engine.root) == before | {found: source[:1].replace("o", "g") if source == "f.txt" else "g"}
    assert (copied.files, copied.bytes) == (1, 1)


@pytest.mark.parametrize(
    ("source", "word", "words"),
    [
        ("nothing", "s:/out", "nothing: there is no such file or folder"),
        ("folder", "s:/out/a.txt", "is a file, and folder is a folder"),
        ("f.txt", "s:/new/", "there is no folder s:/new"),
        ("f.txt", "s:/out/a.txt/", "there is no folder"),
        ("f.txt", "s:/no/where.txt", "there is no folder s:/no"),
    ],
)
def test_what_cannot_go_in_is_refused(engine: Engine, here: Path, source: str, word: str, words: str) -> None:
    (here / "folder").mkdir()
    (here / "f.txt").write_text("f")
    before = tree(engine.root)
    with pytest.raises(UsageError, match=words):
        into(engine, source, word)
    assert tree(engine.root) == before


def test_what_goes_in_keeps_its_mode_and_links_and_belongs_to_whom_is_named(engine: Engine, here: Path) -> None:
    (here / "folder").mkdir()
    (here / "folder/run").write_text("x" * 3_000_000)
    (here / "folder/run").chmod(0o750)
    (here / "folder/link").symlink_to("/etc/passwd")
    os.mkfifo(here / "folder/pipe")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind("folder/socket")
        copied = into(engine, "folder", "s:/new", Owner(1000, 1001))
    by_name = {one.name: one for one in engine.got}
    assert sorted(by_name) == ["new", "new/link", "new/run"]
    assert {(one.uid, one.gid) for one in engine.got} == {(1000, 1001)}
    assert by_name["new/run"].mode == 0o750 and by_name["new/link"].linkname == "/etc/passwd"
    assert [os.path.basename(line) for line in copied.left_out] == [
        "pipe: a device, pipe or socket",
        "socket: a device, pipe or socket",
    ]


def test_odd_names_come_back_as_they_were(engine: Engine, here: Path) -> None:
    """Also those that no text can hold, and those that are longer than a tar's header."""
    names = ["a b", "ä", "new\nline", "\udcff", "-x", ".hidden", "x" * 240, "back\\slash", "*", "\x1b[31m"]
    (here / "odd" / ("d" * 200)).mkdir(parents=True)
    for name in names:
        (here / "odd" / name).write_text("1")
        (here / "odd" / ("d" * 200) / name).write_text("2")
    made = tar_of("odd", "odd", Owner(), Copied())
    copied = Copied()
    unpack(made, Target(folder=".", name="back"), copied, preserve=False)
    assert sorted(os.listdir("back")) == sorted([*names, "d" * 200])
    assert sorted(os.listdir(f"back/{'d' * 200}")) == sorted(names)
    assert (copied.files, copied.left_out) == (2 * len(names), [])


def test_a_file_that_gets_shorter_while_it_is_sent_is_told(here: Path) -> None:
    (here / "f").write_bytes(bytes(3 << 20))
    pieces = tar_of("f", "f", Owner(), Copied())
    next(pieces)
    os.truncate(here / "f", 10)
    with pytest.raises(UsageError, match="it changed while it was read"):
        list(pieces)


def test_a_tar_goes_through_as_it_is(engine: Engine, here: Path) -> None:
    source, target = place("s:/out"), place("s:/latest")
    assert isinstance(source, InService) and isinstance(target, InService)
    raw = b"".join(raw_out(engine, "c", source, Copied()))
    with tarfile.open(fileobj=io.BytesIO(raw)) as tar:
        assert "out/deep/run.sh" in tar.getnames()
    raw_into(engine, "c", iter([raw]), target)
    assert (engine.root / "out/out/a.txt").read_text() == "a"
    file = place("s:/out/a.txt")
    assert isinstance(file, InService)
    with pytest.raises(UsageError, match="is no folder"):
        raw_into(engine, "c", iter([raw]), file)


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("a:/x", InService(service="a", path="/x")),
        ("a@r1:/x/", InService(service="a@r1", path="/x", folder=True)),
        ("a:/x/.", InService(service="a", path="/x", content=True, folder=True)),
        ("a:/../..//x", InService(service="a", path="/x")),
        ("a:/", InService(service="a", path="/", folder=True)),
        ("./a:b", "./a:b"),
        ("dir/a:b", "dir/a:b"),
        ("/a:b", "/a:b"),
        ("-", "-"),
        ("plain", "plain"),
    ],
)
def test_words_are_read_as_docker_cp_reads_them(word: str, found: object) -> None:
    assert place(word) == found


@pytest.mark.parametrize(
    "word", ["key", "ssh", "ssh/", "ssh/.", "ssh/known", "./ssh/new", "folder/key", "way/key", "../here/key"]
)
def test_a_link_of_a_project_that_leads_out_of_its_folder_is_not_followed(
    here: Path, monkeypatch: pytest.MonkeyPatch, word: str
) -> None:
    """A copy took a key of the user's into a container, or a container's files into a folder of the user's."""
    away = here.parent / "away"
    (away / "known").mkdir(parents=True)
    (away / "id").write_text("secret")
    (here / "folder").mkdir()
    for name, leads_to in {"key": "../away/id", "ssh": str(away), "folder/key": "../key", "way": "folder"}.items():
        (here / name).symlink_to(leads_to)
    monkeypatch.chdir(here)
    with pytest.raises(UsageError, match="is a link that leads out of its folder"):
        place(word)
    assert place(str(here / "ssh")) == str(here / "ssh")


@pytest.fixture
def clone(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project that was cloned with a token, with an inventory and the file of a secret of the user's in it."""
    for name in (".git/config", "conf/inventory.yml", "keys/token", "map.pgm"):
        (here / name).parent.mkdir(exist_ok=True)
        (here / name).write_text("ansible_password: mine" if "inventory" in name else f"url of {name}")
    note_secret_files([str(here / "keys/token")])
    monkeypatch.chdir(here)
    return here


def sent(path: str) -> tuple[list[str], int]:
    """Return the files that a copy has, and how many were left out."""
    copied = Copied()
    with tarfile.open(fileobj=io.BytesIO(b"".join(tar_of(path, "x", Owner(), copied)))) as read:
        return sorted(one.name for one in read if one.isreg()), len(copied.left_out)


def test_a_link_of_a_project_leads_to_nothing_that_is_the_users_own(clone: Path) -> None:
    """By `params.yaml` a container had the token in the clone's address, or robots' password."""
    (clone / "params.yaml").symlink_to(".git/config")
    with pytest.raises(UsageError, match="is a link that leads into a repository"):
        place("params.yaml")
    for name, leads_to in {"a": "conf/inventory.yml", "b": "keys/token", "c": "map.pgm", "d": "conf", "e": "."}.items():
        (clone / name).symlink_to(leads_to)
    for name in "abcde":
        with pytest.raises(UsageError, match=f"{name} is a link, which a project may have brought"):
            place(name)
    # by its own name it is the user's word
    assert [sent(name) for name in (".git/config", "conf/inventory.yml", "keys")] == [
        (["x"], 0), (["x"], 0), (["x/token"], 0),
    ]  # fmt: skip


def test_a_second_name_that_an_archive_gave_a_file_of_the_users_own_is_left_out(clone: Path) -> None:
    for name, other in {"a": ".git/config", "b": "conf/inventory.yml", "c": "keys/token", "d": "map.pgm"}.items():
        os.link(clone / other, clone / name)
    assert [sent(name) for name in "abc"] == [([], 1), ([], 1), ([], 1)]
    (clone.parent / "credentials").write_text("a key")
    (clone / "more").mkdir()
    os.link(clone.parent / "credentials", clone / "more/e")
    assert [sent(name) for name in ("more/e", "more")] == [([], 1), ([], 1)]
    assert sent(".git") == ([], 1)


def test_one_file_of_a_relative_path_has_no_second_name(clone: Path) -> None:
    """An archive may be unpacked in a folder of the user's own, where both names of the file are, then."""
    os.link(clone / "map.pgm", clone / "d")
    assert [sent(name) for name in ("d", "map.pgm", str(clone / "map.pgm"))] == [([], 1), ([], 1), (["x"], 0)]


@pytest.mark.parametrize("folder", [".git", ".git/objects/aa", "CVS", "cvs", ".dvc", "sub"])
def test_no_folder_s_name_makes_a_second_name_the_user_s_word(clone: Path, folder: str) -> None:
    """A stranger's archive has such folders as it likes; that it is a repository nobody says."""
    (clone.parent / "credentials").write_text("a key")
    (clone / "maps" / folder).mkdir(parents=True)
    (clone / "maps/hall.yaml").write_text("hall")
    os.link(clone.parent / "credentials", clone / "maps" / folder / "Entries")
    assert sent("maps") == (["x/hall.yaml"], 1)


def test_a_link_that_stays_in_its_folder_is_followed_by_a_whole_path_alone(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An archive that is unpacked in a folder of the user's own had a link there, `results -> .ssh`."""
    (here / "2026").mkdir()
    (here / "latest").symlink_to("2026")
    monkeypatch.chdir(here)
    for word in ("latest/.", "./latest", "latest/new"):
        with pytest.raises(UsageError, match="latest is a link, which a project may have brought") as refused:
            place(word)
        assert str(here / "2026") in refused.value.hint
        whole = str(here / word)
        assert place(whole) == whole


@pytest.mark.parametrize("word", ["a:", "a:x", ":/x"])
def test_a_service_without_a_whole_path_is_refused(word: str) -> None:
    with pytest.raises(UsageError, match="is no SERVICE:/path"):
        place(word)


def tar(*entries: tuple[str, bytes, str]) -> bytes:
    """Return a tar of names, kinds, and content or link."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as made:
        for name, kind, word in entries:
            one = tarfile.TarInfo(name)
            one.type, one.mode = kind, 0o777
            if kind == tarfile.REGTYPE:
                one.size = len(word)
                made.addfile(one, io.BytesIO(word.encode()))
            else:
                one.linkname = word
                made.addfile(one)
    return buffer.getvalue()


FILE, DIR, SYM, HARD, FIFO, DEVICE = (
    tarfile.REGTYPE, tarfile.DIRTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE,
)  # fmt: skip


@pytest.mark.parametrize(
    "entries",
    [
        [("d", DIR, ""), ("d/../../evil", FILE, "x")],
        [("d", DIR, ""), ("../evil", FILE, "x")],
        [("d", DIR, ""), ("/etc/evil", FILE, "x")],
        [("d", DIR, ""), ("other/evil", FILE, "x")],
        [("d", DIR, ""), ("d/l", SYM, "sub"), ("d/l/evil", FILE, "x")],
        [("d", DIR, ""), ("d/f", FILE, "x"), ("d/f/evil", FILE, "x")],
        [("d", DIR, ""), ("d/h", HARD, "d/../../outside")],
        [("d", DIR, ""), ("d/h", HARD, "/etc/passwd")],
        [("d", DIR, ""), ("d/h", HARD, "d/was-here")],
    ],
)
def test_no_tar_of_a_hostile_container_writes_elsewhere(here: Path, entries: list[tuple[str, bytes, str]]) -> None:
    """Nor takes a second name for a file of the user's."""
    (here / "outside").write_text("mine")
    (here / "place").mkdir()
    (here / "place/copy").mkdir()
    (here / "place/copy/was-here").write_text("mine too")
    with pytest.raises((UsageError, OSError)):
        unpack(iter([tar(*entries)]), Target(folder="place", name="copy"), Copied(), preserve=True)
    there = {str(one.relative_to(here)) for one in here.rglob("*")}
    assert there - {"place/copy/l", "place/copy/f"} == {"outside", "place", "place/copy", "place/copy/was-here"}
    assert (here / "place/copy").is_dir() and not (here / "place/copy").is_symlink()
    assert ((here / "outside").read_text(), (here / "place/copy/was-here").stat().st_nlink) == ("mine", 1)


def test_a_link_in_the_place_of_what_is_copied_leads_nowhere(here: Path) -> None:
    (here / "elsewhere").mkdir()
    for entries in ([("d", DIR, "")], []):
        made = tar(*entries, ("d", SYM, str(here / "elsewhere")), ("d/f", FILE, "x"))
        copied = Copied()
        unpack(iter([made]), Target(folder=".", name="copy"), copied, preserve=False)
        assert "a link that leads out of it" in copied.left_out[0]
        assert os.listdir("copy") == ["f"] and os.listdir("elsewhere") == []


def test_a_second_name_of_a_file_whose_place_a_link_took_leads_nowhere(here: Path) -> None:
    """The link stays inside where it lies; its second name, further up, would not."""
    (here / "outside").write_text("mine")
    made = tar(
        ("d", DIR, ""), ("d/s", DIR, ""), ("d/s/f", FILE, "x"), ("d/s/f", SYM, "../outside"), ("d/h", HARD, "d/s/f"),
    )  # fmt: skip
    with pytest.raises(UsageError, match="another name of what is no file"):
        unpack(iter([made]), Target(folder=".", name="copy"), Copied(), preserve=False)
    assert not os.path.islink("copy/s/f") and not os.path.lexists("copy/h")


def test_a_link_leads_to_what_came_with_it_and_to_no_file_of_the_user_s(here: Path) -> None:
    """By a name of the container's, the user would send it a file that lies beside."""
    (here / "maps/sites").mkdir(parents=True)
    for name in ("mine.yaml", "sites/mine.yaml"):
        (here / "maps" / name).write_text("mine")
    (here / "maps/old").symlink_to("mine.yaml")
    (here / "maps/good").symlink_to("sites/new.yaml")
    made = tar(
        ("m", DIR, ""), ("m/hall.yaml", SYM, "mine.yaml"), ("m/later", SYM, "not-there-yet"), ("m/all", SYM, "."),
        ("m/by-folder", SYM, "sites"), ("m/by-link", SYM, "hall.yaml"), ("m/by-two", SYM, "by-folder/new.yaml"),
        ("m/a", SYM, "b"), ("m/b", SYM, "a"), ("m/old", SYM, "mine.yaml"), ("m/sites", DIR, ""),
        ("m/sites/up", SYM, "../mine.yaml"), ("m/sites/new.yaml", FILE, "new"), ("m/good", SYM, "latest.yaml"),
        ("m/latest.yaml", SYM, "sites/new.yaml"), ("m/runs", SYM, "run7"), ("m/run7", DIR, ""),
    )  # fmt: skip
    for again in (False, True):
        copied = Copied()
        unpack(iter([made]), Target(folder="maps", name=""), copied, preserve=True)
        links = {str(one.relative_to(here / "maps")) for one in (here / "maps").rglob("*") if one.is_symlink()}
        assert links == {"old"}, again
        assert Path("maps/good").read_text() == Path("maps/latest.yaml").read_text() == "new"
        assert (here / "maps/mine.yaml").read_text() == "mine"
        away = [line.partition(": a link to what did not come with it") for line in copied.left_out]
        assert [name for name, found, _ in away if found] == [
            "a",
            "b",
            "by-link",
            "by-two",
            "hall.yaml",
            "later",
            "old",
            "sites/up",
        ]
        words = "a link to a folder, {}; a tar has it, with `-`".format
        folders = [name for name, found, _ in away if not found]
        assert folders == [f"all: {words('.')}", f"by-folder: {words('sites')}", f"runs: {words('run7')}"]


def test_no_name_of_a_copy_becomes_that_of_what_comes_later(here: Path) -> None:
    """Of another robot's file, under a name that the first one chose; or of the user's, written in its place."""
    (here / "maps").mkdir()
    first = tar(
        ("m", DIR, ""), ("m/site.yaml", FILE, "a decoy"), ("m/hall.yaml", SYM, "site.yaml"), ("m/run7", DIR, ""),
        ("m/again.yaml", HARD, "m/site.yaml"), ("m/latest", SYM, "run7"), ("m/by-two", SYM, "hall.yaml"),
    )  # fmt: skip
    later = tar(("m", DIR, ""), ("m/site.yaml", FILE, "robot3's token"))
    copied = Copied()
    unpack(iter([first]), Target(folder="maps", name=""), copied, preserve=False)
    unpack(iter([later]), Target(folder="maps", name=""), Copied(), preserve=False)
    (here / "maps/run7/mine.yaml").write_text("mine")
    names = ("again.yaml", "by-two", "hall.yaml")
    assert {(here / "maps" / one).read_text() for one in names} == {"a decoy"}
    with (here / "maps/site.yaml").open("r+") as file:  # as editors do that keep the file
        file.write("mine")
    assert {(here / "maps" / one).read_text() for one in names} == {"a decoy"}
    assert not (here / "maps/latest").exists() and copied.left_out[0].startswith("latest: a link to a folder, run7")
    assert not copied.lost, "all that the folder holds is here"


def test_what_links_lead_to_counts_as_what_comes(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container has as many links to one large file as it likes."""
    monkeypatch.setattr(copied_out, "_MOST_BYTES", 10_000)
    many = [(f"d/{at}", kind, word) for at, (kind, word) in enumerate([(SYM, "f"), (HARD, "d/f")] * 5)]
    copied = Copied()
    with pytest.raises(UsageError, match="with what links lead to, it has more than"):
        unpack(iter([tar(("d", DIR, ""), ("d/f", FILE, "x" * 4000), *many)]), Target(folder=".", name="copy"), copied,
               preserve=False)  # fmt: skip
    assert copied.bytes <= 10_000


def test_another_name_of_what_nobody_may_read_is_left_out(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With `-p` a file may come that its owner cannot open; root can."""

    def refuse(*_words: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(copied_out, "open_file", refuse)
    copied = Copied()
    made = tar(("d", DIR, ""), ("d/f", FILE, "x"), ("d/h", HARD, "d/f"), ("d/s", SYM, "f"), ("d/g", FILE, "y"))
    unpack(iter([made]), Target(folder=".", name="copy"), copied, preserve=True)
    assert sorted(os.listdir("copy")) == ["f", "g"]
    assert copied.left_out == [f"copy/{one}: another name of a file that nobody may read" for one in ("h", "s")]


def test_a_file_that_is_there_stays_where_a_link_to_another_one_would_take_its_place(here: Path) -> None:
    for name in ("hall.yaml", "site.yaml"):
        (here / name).write_text(name)
    unpack(iter([tar(("m", DIR, ""), ("m/hall.yaml", SYM, "site.yaml"))]), Target(folder=".", name=""), Copied(),
           preserve=False)  # fmt: skip
    assert (here / "hall.yaml").read_text() == "hall.yaml" and not (here / "hall.yaml").is_symlink()


def test_links_of_a_long_chain_are_looked_at_in_time() -> None:
    links = Links()
    for at in range(100_000):
        links.add(f"d/{at}", str(at + 1))
    began = time.monotonic()
    assert [place for place, _, end in links.all() if end == "d/100000"][:1] == ["d/99960"]
    assert time.monotonic() - began < 20


def test_links_out_devices_and_pipes_are_left_out_and_told(here: Path) -> None:
    made = tar(
        ("d", DIR, ""), ("d/f", FILE, "x"), ("d/in", SYM, "f"), ("d/abs", SYM, "/etc/passwd"), ("d/up", SYM, "../x"),
        ("d/pipe", FIFO, ""), ("d/null", DEVICE, ""), ("d/again", HARD, "d/f"),
    )  # fmt: skip
    copied = Copied()
    unpack(iter([made]), Target(folder=".", name="copy"), copied, preserve=False)
    assert sorted(os.listdir("copy")) == ["again", "f", "in"]
    assert not os.path.samefile("copy/again", "copy/f") and not os.path.islink("copy/in")
    assert {Path("copy", name).read_text() for name in ("again", "f", "in")} == {"x"} and copied.files == 3
    assert copied.left_out == [
        "copy/abs: a link that leads out of it, to /etc/passwd",
        "copy/up: a link that leads out of it, to ../x",
        "copy/pipe: a device, pipe or socket",
        "copy/null: a device, pipe or socket",
    ]
    unpack(iter([made]), Target(folder=".", name="copy"), Copied(), preserve=False)
    assert sorted(os.listdir("copy")) == ["again", "f", "in"], "nothing is left beside it the second time"


@pytest.mark.parametrize(
    ("depth", "link", "inside"),
    [
        (0, "f", True), (0, "a/b/../c", False), (0, "..", False), (1, "..", True), (1, "../f", True),
        (2, "../../f", True), (1, "../../f", False), (0, "/f", False), (0, "", False), (0, "./f", True),
        (2, "./.././f", True), (3, "a/..", False), (-1, "f", False),
    ],
)  # fmt: skip
def test_a_link_stays_inside_whatever_other_links_there_are(depth: int, link: str, inside: bool) -> None:
    assert stays_inside(depth, link) is inside


def test_a_copy_that_is_cut_leaves_no_half_file(here: Path) -> None:
    """Neither in the place of what is there, nor beside it; also after Ctrl-C."""
    (here / "f").write_text("before")
    whole = tar(("f", FILE, "x" * 2_000_000))

    def cut(error: BaseException) -> Iterator[bytes]:
        yield whole[:1_500_000]
        raise error

    for error in (KeyboardInterrupt(), UsageError("gone", code=Code.NO_FILE)):
        with pytest.raises(type(error)):
            unpack(cut(error), Target(folder=".", name="f"), Copied(), preserve=False)
    with pytest.raises(UsageError, match="it ends too early"):
        unpack(iter([whole[:1_500_000]]), Target(folder=".", name="f"), Copied(), preserve=False)
    assert os.listdir(".") == ["f"] and (here / "f").read_text() == "before"
    shutil.rmtree(here)


def test_a_container_without_end_does_not_fill_the_disk(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What came before stays, and the file that is cut is gone."""
    monkeypatch.setattr(copied_out, "_LOOK", 1 << 20)
    monkeypatch.setattr(copied_out.os, "fstatvfs", lambda _file: SimpleNamespace(f_bavail=100, f_frsize=1 << 20))
    info = tarfile.TarInfo("a")
    info.size = 60 << 30
    sent = itertools.chain([info.tobuf()], itertools.repeat(bytes(1 << 20)))
    copied = Copied()
    with pytest.raises(OSError, match="512 MiB would be free"):
        unpack(sent, Target(folder=str(here), name="a"), copied, preserve=False)
    assert copied.bytes < 4 << 20 and not (here / "a").exists() and not list(here.glob(".srprov-*"))


def test_names_and_what_is_left_out_take_a_bounded_memory(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container has as many pipes as it likes, and names of 4096 characters that each are shown as six."""
    many = tar(("d", DIR, ""), *((f"d/{at}" + "\u202e" * 1000, FIFO, "") for at in range(1100)))
    copied = Copied()
    unpack(iter([many]), Target(folder=".", name="copy"), copied, preserve=False)
    assert (len(copied.left_out), copied.more_left_out) == (1000, 100)
    assert max(map(len, copied.left_out)) < 3000
    monkeypatch.setattr(tar_stream, "_MOST_NAMES", 1 << 20)
    with pytest.raises(UsageError, match="its names have more than 1 Mi characters"):
        unpack(iter([many]), Target(folder=".", name="copy"), Copied(), preserve=False)


def test_a_folder_of_any_depth_goes_in(here: Path) -> None:
    """A project that was cloned has as many folders in each other as its author likes."""
    place = os.open(here, os.O_RDONLY)
    for _ in range(600):
        os.mkdir("a", dir_fd=place)
        below = os.open("a", os.O_RDONLY, dir_fd=place)
        os.close(place)
        place = below
    os.close(place)
    made = b"".join(tar_of("a", "b", Owner(), Copied()))
    with tarfile.open(fileobj=io.BytesIO(made)) as found:
        assert len(found.getnames()) == 600
