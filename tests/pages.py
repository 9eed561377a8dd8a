"""Pages of the manual as tests: files that a page says to write, commands that it says to type, and what they print.

A comment in the page's source, right before a block of code, says what the block is; readers do not see it:

    <!-- file: talker.cdf -->   the block is that file's content
    <!-- run -->                its lines are commands, each of which ends with 0
    <!-- run: exit 3 -->        the last of them ends with 3
    <!-- lab -->                commands about the lab itself; only a test that makes one runs them

In a block of the kind `console` a command begins with `$ `, and the lines below it are what it prints: each must be
there, in that order. A number stands for any number, as times and addresses are others each time, hex digits for any,
blanks for any, and `…` for anything.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_MARKED = re.compile(
    r"^<!-- (?P<kind>file|run|lab)(?:: (?P<more>[^\n]+?))? -->\n+```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_MARK = re.compile(r"^<!-- (?:file|run|lab)\b", re.MULTILINE)
_SAME = re.compile(r"\b(?=[0-9a-f]*[0-9])[0-9a-f]{8,}\b|\d+(?:[.:]\d+)*|\s+|…")
_LIMIT_S = 300


@dataclass(frozen=True)
class Block:
    """A block of code that a page marks."""

    kind: str
    more: str
    text: str
    line: int
    commands: list[tuple[str, list[str]]] = field(default_factory=list)
    """What is typed, and the lines that it must print."""

    @property
    def exit_code(self) -> int:
        """The code of the last command."""
        return int(self.more.removeprefix("exit ")) if self.more else 0


def blocks(page: Path) -> list[Block]:
    """Return the marked blocks of a page.

    Raises:
        ValueError: A mark that no block follows, or of no known form.
    """
    text = page.read_text(encoding="utf-8")
    found = [_block(match, text.count("\n", 0, match.start()) + 1) for match in _MARKED.finditer(text)]
    if len(found) != len(_MARK.findall(text)):
        raise ValueError(f"{page.name}: a mark without a block after it")
    return found


def _block(match: re.Match[str], line: int) -> Block:
    kind, more, text = match["kind"], match["more"] or "", match["text"]
    if kind == "run" and more and not re.fullmatch(r"exit \d+", more):
        raise ValueError(f"line {line}: run: {more}")
    commands = [] if kind == "file" else list(_commands(text, match["language"] == "console"))
    return Block(kind, more, text, line, commands)


def _commands(text: str, console: bool) -> Iterator[tuple[str, list[str]]]:
    command, printed = "", list[str]()
    for line in text.replace("\\\n", " ").splitlines():
        if console and not line.startswith("$ "):
            printed.append(line)
        elif line.strip() and not line.startswith("#"):
            if command:
                yield command, printed
            command, printed = line.removeprefix("$ "), []
    if command:
        yield command, printed


def missing(printed: list[str], output: str) -> str:
    """Return the first line of a page that an output does not have after those before it; empty when all are there."""
    lines = iter(output.splitlines())
    for line in printed:
        wanted = re.compile(_pattern(line.strip()))
        if line.strip() not in ("", "…") and not any(wanted.fullmatch(one.strip()) for one in lines):
            return line
    return ""


def _pattern(line: str) -> str:
    parts, at = [], 0
    for same in _SAME.finditer(line):
        what = same[0]
        anything = r"\s+" if what.isspace() else ".*" if what == "…" else "[0-9a-f.:]+"
        parts += [re.escape(line[at : same.start()]), anything]
        at = same.end()
    return "".join([*parts, re.escape(line[at:])])


def play(page: Path, folder: Path, environment: Mapping[str, str], lab: bool = False) -> None:
    """Do what a page says, in a folder; assert that it goes as the page says.

    Args:
        lab: Also make the lab, and remove it.
    """
    env = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", **environment}
    env["PATH"] = f"{Path(sys.executable).parent}:{env['PATH']}"
    for block in blocks(page):
        if block.kind == "file":
            path = folder / block.more
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.kind == "run" or lab:
            _run(page.name, block, folder, env)


def _run(page: str, block: Block, folder: Path, env: Mapping[str, str]) -> None:
    for number, (command, printed) in enumerate(block.commands, 1):
        done = subprocess.run(
            ["bash", "-c", command], cwd=folder, env=env, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=_LIMIT_S,
        )  # fmt: skip
        place = f"{page}, block at line {block.line}: {command}"
        code = block.exit_code if number == len(block.commands) else 0
        assert done.returncode == code, f"{place}: exit {done.returncode}, not {code}\n{done.stdout}"
        gone = missing(printed, done.stdout)
        assert not gone, f"{place}: did not print '{gone}'; it printed\n{done.stdout}"
