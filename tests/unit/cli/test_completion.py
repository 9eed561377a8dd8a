"""Completion: what is offered, what never is, that nothing is run or opened for it, and that shells take it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from srprov.cli.completion_line import Answer, answer
from srprov.cli.completion_scripts import SCRIPTS
from srprov.cli.main import cli
from srprov.cli.shell_words import split
from tests.unit.cli.terminal import Terminal

EDF = """\
edf: 1
name: demo
services:
  talker: {image: "busybox", profiles: [debug, long]}
  drone: {image: "busybox", replicas: 3}
  "$(touch HERE)": {image: "busybox"}
  "a b;c": {image: "busybox"}
"""
INVENTORY = "all: {children: {flyers: {hosts: {'uav[1:2]': {}}}, '`id`': {hosts: {'x;y': {}}}}, hosts: {base: {}}}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text(INVENTORY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    return tmp_path


def offered(line: str, inventories: tuple[str, ...] = ()) -> list[str]:
    """Return the words that are offered at the end of a line; one that says so where it is files."""
    found = ask(line, inventories)
    return [f"({found.kind})"] if found.kind != "words" else [word for word, _ in found.words]


def ask(line: str, inventories: tuple[str, ...] = ()) -> Answer:
    before, incomplete = split(line)
    group = cli
    assert isinstance(group, click.Group)
    return answer(group, before, incomplete, inventories)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("srprov pl", ["plan"]),
        ("srprov ", list(cli.list_commands(click.Context(cli)))),
        ("NO_COLOR=1 srprov val", ["validate"]),
        ("srprov plan --unr", ["--unreachable"]),
        ("srprov plan --unreachable ", ["fail", "skip", "reassign"]),
        ("srprov plan --unreachable=s", ["--unreachable=skip"]),
        ("srprov plan --format text --form", []),
        ("srprov plan ", ["(files)"]),
        ("srprov plan --history ", ["(folders)"]),
        ("srprov plan e.edf -i ", ["(files)"]),
        ("srprov plan --events=x", []),
        ("srprov apply --events=x", ["(files)"]),
        ("srprov collect e.edf -o ", ["(folders)"]),
        ("srprov export comp", ["compose"]),
        ("srprov export compose --ou", ["--out"]),
        ("srprov schema sta", ["status"]),
        ("srprov images ", ["(files)"]),
        ("srprov runs sh", ["show"]),
        ("srprov nothing ", list(cli.list_commands(click.Context(cli)))),
        ("srprov plan --nothing ", ["(files)"]),
        ("srprov apply --forks ", []),
        ("srprov restart e.edf ", ["drone", "drone-1", "drone-2", "drone-3", "talker"]),
        ("srprov restart e.edf dr", ["drone", "drone-1", "drone-2", "drone-3"]),
        ("srprov restart -y e.edf -i inv.yml talker dr", ["drone", "drone-1", "drone-2", "drone-3"]),
        ("srprov restart 'e.edf' t", ["talker"]),
        ('srprov restart "e.edf" "t', ["talker"]),
        ("srprov exec e.edf -i inv.yml talker@", ["talker@base", "talker@uav1", "talker@uav2"]),
        ("srprov exec e.edf -i inv.yml talker -- ", ["(files)"]),
        ("srprov exec e.edf -i inv.yml -t ta", ["talker"]),
        ("srprov plan e.edf --profile ", ["debug", "long"]),
        ("srprov wait e.edf --until completed:t", ["completed:talker"]),
        ("srprov plan e.edf --allow al", ["all"]),
        ("srprov facts -i inv.yml --limit f", ["flyers"]),
        ("srprov facts -i inv.yml --limit flyers,u", ["flyers,uav1", "flyers,uav2"]),
        ("srprov facts --inventory=inv.yml --exclude b", ["base"]),
        ("srprov snapshot -i inv.yml u", ["uav1", "uav2"]),
        ("srprov ssh -i inv.yml u", ["uav1", "uav2"]),
        ("srprov cp e.edf talker:/x ", ["(files)"]),
        ("srprov fmt ", ["(files)"]),
        ("srprov init ", ["(folders)"]),
        ("srprov restart missing.edf ", []),
        ("srprov config pl", ["plan"]),
        ("srprov ssh -i inv.yml b", ["base"]),
        ("srprov explain SRP-51", ["SRP-510", "SRP-511", "SRP-512", "SRP-513", "SRP-514", "SRP-515"]),
        ("srprov diff a.edf ", ["(files)"]),
        ("srprov report ", ["(files)"]),
        ("srprov completion ", ["bash", "fish", "zsh"]),
    ],
)
def test_what_may_come_next_is_offered(folder: Path, line: str, words: list[str]) -> None:
    assert sorted(offered(line)) == sorted(words)


def test_no_argument_of_a_verb_is_forgotten(folder: Path) -> None:
    """Each is offered something: names, words or files."""
    context = click.Context(cli)
    for verb in cli.list_commands(context):
        command = cli.get_command(context, verb)
        assert command is not None
        first = next((one for one in command.params if isinstance(one, click.Argument)), None)
        if first is not None:
            assert offered(f"srprov {verb} ", ("inv.yml",)), f"{verb}: {first.name}"


def test_robots_come_from_configuration_too(folder: Path) -> None:
    assert offered("srprov facts --limit uav", ("inv.yml",)) == ["uav1", "uav2"]
    (folder / "srprov.toml").write_text('inventory = ["inv.yml"]\n')
    told = subprocess.run(
        [sys.executable, "-m", "srprov", "completion", "zsh", "--", "srprov", "facts", "--limit", "uav"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert told.stdout.splitlines() == ["words", "uav1", "uav2"]


def test_names_that_a_shell_would_not_take_as_they_are_are_not_offered(folder: Path) -> None:
    every = offered("srprov restart e.edf ") + offered("srprov facts -i inv.yml --limit ")
    assert {"talker", "uav1", "all"} <= set(every)
    assert not [word for word in every if set(word) & set(" \t\n;&|<>$`'\"\\(){}[]*?!#~")]


@pytest.mark.parametrize("mode", [0o755, 0o644])
def test_no_inventory_is_run(folder: Path, mode: int) -> None:
    """Neither a program, nor what is named like one."""
    (folder / "inv.sh").write_text("#!/bin/sh\ntouch ran\necho '{}'\n")
    (folder / "inv.sh").chmod(mode)
    assert "ran" not in offered("srprov facts -i ./inv.sh --limit ") and not (folder / "ran").exists()


def test_nothing_is_opened_for_writing(folder: Path) -> None:
    """click's own way would convert the words before: --events begins its file anew."""
    (folder / "kept.json").write_text("kept")
    assert offered("srprov apply e.edf --events kept.json -o kept.json --unr") == ["--unreachable"]
    assert (folder / "kept.json").read_text() == "kept"


def test_huge_and_hostile_files_give_nothing(folder: Path) -> None:
    os.mkfifo(folder / "pipe.edf")
    (folder / "deep.edf").write_text("[" * 10_000)
    (folder / "large.edf").write_text("services: {a: {}}\n" + "# x\n" * 100_000)
    (folder / "bomb.edf").write_text("a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"{chr(98 + at)}: &{chr(98 + at)} [{','.join(['*' + chr(97 + at)] * 9)}]\n" for at in range(9)
    ))  # fmt: skip
    for name in ("pipe", "deep", "large", "bomb"):
        assert offered(f"srprov restart {name}.edf ") == [], name


def test_completing_imports_nothing_heavy(folder: Path) -> None:
    """Tab is answered in a quarter of a second only without them; tools/completion_time.sh measures it."""
    code = (
        "import sys\nfrom srprov.cli.main import run\n"
        "run(['completion', 'bash', '--', sys.argv[1], ''])\n"
        "heavy = 'paramiko docker jsonschema jinja2 rich numpy scipy ortools requests re2 asyncio'.split()\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    for line in ("srprov restart e.edf ", "srprov apply e.edf -i inv.yml --limit ", "srprov plan --", "srprov "):
        told = subprocess.run([sys.executable, "-c", code, line], capture_output=True, text=True, check=True)
        assert told.stdout.splitlines()[-1] == "[]", line


def test_a_mistake_in_a_configuration_file_does_not_end_completion(folder: Path) -> None:
    (folder / "srprov.toml").write_text("forks = = 3\n")
    told = subprocess.run(
        [sys.executable, "-m", "srprov", "completion", "bash", "--", "srprov pl", "pl"], capture_output=True, text=True
    )
    assert (told.returncode, told.stdout) == (0, "words\nplan\n")


def test_every_script_is_printed_and_none_asks_another_program() -> None:
    for shell, script in SCRIPTS.items():
        told = subprocess.run(
            [sys.executable, "-m", "srprov", "completion", shell], capture_output=True, text=True, check=True
        )
        assert told.stdout == script and f"command srprov completion {shell} --" in script


@pytest.fixture
def on_path(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let shells find this very srprov."""
    (folder / "bin").mkdir()
    program = folder / "bin" / "srprov"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m srprov "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder / 'bin'}:{os.environ['PATH']}")
    return folder


TYPED = [
    ("srprov validat\t", "srprov validate "),
    ("srprov plan --unreachable=re\t", "srprov plan --unreachable=reassign"),
    ("srprov restart e.edf ta\t", "srprov restart e.edf talker"),
    ("srprov exec e.edf -i inv.yml talker@b\t", "srprov exec e.edf -i inv.yml talker@base"),
    ("srprov wait e.edf -i inv.yml --until completed:t\t", "--until completed:talker"),
    ("srprov status inv\t", "srprov status inv.yml"),
    ("srprov apply e.edf --events=inv\t", "srprov apply e.edf --events=inv.yml"),
]


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_completes_what_is_typed(on_path: Path, shell: str) -> None:
    """On a real terminal, at the Tab key."""
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} on this machine")
    words = {"bash": ("bash", "--norc", "--noprofile", "-i"), "zsh": ("zsh", "-f", "-i")}[shell]
    begin = {"bash": "PS1='> '", "zsh": "PS1='> '; autoload -Uz compinit; compinit -u -D"}[shell]
    terminal = Terminal(*words, columns=120)
    try:
        terminal.type(f'{begin}; eval "$(srprov completion {shell})"; echo re""ady\n')
        terminal.read_until("ready")
        for typed, completed in TYPED:
            terminal.type(f"\x15{typed}")
            terminal.read_until(completed)
    finally:
        terminal.process.kill()
        terminal.close()


def test_fish_completes_what_is_typed(on_path: Path) -> None:
    if shutil.which("fish") is None:
        pytest.skip("there is no fish on this machine")
    for typed, completed in TYPED[:5]:
        script = f"srprov completion fish | source; complete -C {typed.strip()!r}"
        told = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, check=True)
        assert any(completed.strip().endswith(line.split("\t")[0]) for line in told.stdout.splitlines()), typed
