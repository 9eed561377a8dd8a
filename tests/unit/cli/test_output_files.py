"""Files that a user names for output, in folders that others can write to: no link or pipe of theirs gets anything."""

from __future__ import annotations

import os
import stat
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from srprov import regular_file
from srprov.cli import output_options
from srprov.cli.main import cli, run
from srprov.cli.output_options import EVENTS
from srprov.cli.plan import write_plan
from srprov.controller import signature
from srprov.controller.saved import plan_file
from srprov.definitions.model import Definitions
from srprov.errors import SrprovError
from srprov.planning.planfile import PlanFile, dump
from srprov.secret import Vault
from tests.fakes import World
from tests.worlds import experiment, made, service

_THEIRS = 65534


@pytest.fixture(name="saved")
def a_plan_for_a_file() -> PlanFile:
    what = Definitions(experiment=experiment(service("one", robot="r1")), containers={})
    return plan_file(replace(made(World().add("r1"), what), definitions=None))


def events_to(path: str) -> None:
    """Do what a verb does with its `--events`."""

    @click.command()
    @EVENTS
    def verb(events: object) -> None:
        events.write("{}\n")  # type: ignore[attr-defined]

    result = CliRunner().invoke(verb, ["--events", path], catch_exceptions=False)
    assert result.exit_code == 0, result.output


@pytest.fixture(name="write", params=["plan", "signature", "events"])
def every_way_to_write(
    request: pytest.FixtureRequest, saved: PlanFile, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Path], None]:
    if request.param == "events":
        return lambda path: events_to(str(path))
    signed = subprocess.CompletedProcess((), 0, b"SIGNATURE", b"")
    monkeypatch.setattr(signature, "_ssh_keygen", lambda *_, **__: signed)
    if request.param == "plan":
        return lambda path: write_plan(str(path), saved, Vault())
    return lambda path: write_plan(str(path.with_name("p")), saved, Vault(), None, "key")


@pytest.fixture(name="shared")
def a_folder_that_all_can_write_to(tmp_path: Path) -> Path:
    folder = tmp_path / "shared"
    folder.mkdir()
    folder.chmod(0o777)
    return folder


@pytest.mark.parametrize("there", ["link", "dangling", "hard link", "file of another", "pipe of another", "device"])
def test_what_others_put_there_gets_nothing_and_is_replaced(
    shared: Path, write: Callable[[Path], None], there: str
) -> None:
    victim, target = shared.parent / "victim", shared / "p.sig"
    if there != "dangling":
        victim.write_text("precious")
    if there in ("link", "dangling"):
        target.symlink_to(victim)
    elif there == "hard link":
        target.hardlink_to(victim)
    elif os.geteuid():
        pytest.skip("only root can make devices, and files of others")
    elif there == "device":  # as root's tar makes one of what a stranger's archive says: a disk
        os.mknod(target, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    else:
        os.mkfifo(target) if "pipe" in there else target.touch()
        os.chown(target, _THEIRS, _THEIRS)
    write(target)
    about = target.lstat()
    assert (about.st_uid, about.st_mode & 0o177777, about.st_nlink) == (os.geteuid(), 0o100600, 1)
    assert target.stat().st_size and sorted(one.name for one in shared.iterdir() if one.name != "p") == ["p.sig"]
    assert not victim.exists() if there == "dangling" else victim.read_text() == "precious"


def test_a_pipe_or_device_of_the_users_own_is_written_to(shared: Path, write: Callable[[Path], None]) -> None:
    pipe = shared / "p.sig"
    os.mkfifo(pipe)
    with open(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK), "rb") as reader:
        write(pipe)
        assert reader.read() and pipe.is_fifo()


def test_a_pipe_that_no_program_reads_holds_nobody(shared: Path, write: Callable[[Path], None]) -> None:
    """An archive may bring one, which is the user's then."""
    os.mkfifo(shared / "p.sig")
    with pytest.raises((OSError, SrprovError, AssertionError), match="a pipe that no program reads"):
        write(shared / "p.sig")


def test_the_kernels_link_to_what_is_open_is_followed(tmp_path: Path, saved: PlanFile) -> None:
    """As /dev/stdout is one, and /dev/fd/63 of a shell's `>(…)`."""
    with (tmp_path / "out").open("wb") as stream:
        write_plan(f"/proc/self/fd/{stream.fileno()}", saved, Vault())
        written = (tmp_path / "out").read_bytes()
        assert written == dump(saved).encode()
        events_to(f"/dev/fd/{stream.fileno()}")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["out"]


def test_a_link_where_everybody_may_make_one_is_replaced(tmp_path: Path, write: Callable[[Path], None]) -> None:
    """Below /dev, too: a project may lie in /dev/shm."""
    (tmp_path / ".bashrc").write_text("precious")
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        target = Path(folder) / "p.sig"
        target.symlink_to(tmp_path / ".bashrc")
        write(target)
        assert target.stat().st_size and not target.is_symlink()
    assert (tmp_path / ".bashrc").read_text() == "precious"


@pytest.mark.parametrize("aim", ["file", "device", "nothing"])
def test_a_link_in_the_users_own_folder_is_replaced(tmp_path: Path, write: Callable[[Path], None], aim: str) -> None:
    """It may have come with a project that was cloned."""
    aims = {"file": tmp_path / ".bashrc", "device": Path("/dev/null"), "nothing": tmp_path / "new"}
    (tmp_path / ".bashrc").write_text("precious")
    target = tmp_path / "project" / "p.sig"
    target.parent.mkdir()
    target.symlink_to(aims[aim])
    write(target)
    assert target.is_file() and not target.is_symlink() and target.stat().st_size
    assert (tmp_path / ".bashrc").read_text() == "precious" and not (tmp_path / "new").exists()


def test_what_was_made_is_signed_whatever_lies_in_the_file_by_then(
    tmp_path: Path, saved: PlanFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    signed: list[bytes] = []

    def sign(*_words: str, given: bytes = b"", **_limit: float) -> subprocess.CompletedProcess[bytes]:
        signed.append(given)
        return subprocess.CompletedProcess((), 0, b"SIGNATURE", b"")

    monkeypatch.setattr(signature, "_ssh_keygen", sign)
    monkeypatch.setattr(regular_file, "read", lambda *_, **__: b"somebody else's")
    write_plan(str(tmp_path / "plan.json"), saved, Vault(), None, "key")
    assert signed == [dump(saved).encode()] == [(tmp_path / "plan.json").read_bytes()]


def test_every_option_that_names_what_is_written_looks_where_links_lead() -> None:
    """A clone has `data -> ../../.config/srprov`, and `-o data/srprov.toml` made a page the settings of its user."""
    looking = {output_options.written, output_options.no_link, output_options.no_way_out, output_options.no_way_above}
    context, seen, followed = click.Context(cli), 0, {"run", "collect"}  # `results` may be a link to a large disk
    for verb in cli.list_commands(context):
        command = cli.get_command(context, verb)
        assert command is not None
        for one in command.params:
            if {"-o", "--out", "--svg", "--png", "--events", "--runs"} & set(one.opts):
                if verb in followed and "-o" in one.opts:
                    continue
                seen += 1
                assert one.callback in looking or isinstance(one.type, output_options._Output), (verb, one.opts)
    assert seen > 20


@pytest.mark.parametrize(
    "words",
    [
        ("report", "page.html", "--extract", "-o", "data/srprov.toml"),
        ("report", "run", "-o", "data/page.html"),
        ("bundle", "run", "-o", "data/b.zip"),
        ("plan", "e.edf", "-i", "r1,", "-o", "data/p.json"),
        ("lock", "data/e.edf", "-i", "r1,"),
    ],
    ids=lambda words: words[0],
)
def test_no_link_of_a_project_leads_out_what_a_verb_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "p.json").write_text("mine")
    (tmp_path / "clone").mkdir()
    (tmp_path / "clone" / "data").symlink_to("../mine")
    edf = "edf: 1\nname: e\nservices:\n  a: {image: busybox}\n"
    for one in ("clone", "mine"):
        (tmp_path / one / "e.edf").write_text(edf)
    monkeypatch.chdir(tmp_path / "clone")
    assert run(list(words)) == 5
    assert "data" in capsys.readouterr().err
    left = {one.name: one.read_text() for one in (tmp_path / "mine").iterdir()}
    assert left == {"p.json": "mine", "e.edf": edf}
