"""Users' playbooks and contexts -> the texts that they render to, in a child process with limits.

A playbook that may state anything on a robot may still not use up the controller: no rule inside of Jinja2's sandbox
holds for all of `'x' * 10**9`, nested loops and filters, but the kernel's limits do. One child renders all playbooks
for all robots; it is forked, since starting a Python takes longer than most applies. It writes one line for each text,
so that it is known what it was at when a limit ended it.
"""

from __future__ import annotations

import functools
import json
import math
import os
import resource
import selectors
import signal
import time
import traceback
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import msgspec
from jinja2 import Template, TemplateError

from srprov.definitions.playbookmodel import Playbook
from srprov.rendering.environment import environment
from srprov.untrusted import parse_json

CPU_S = 1.0
CPU_EACH_S = 0.01
"""More for each text; compiling and rendering one takes some milliseconds."""
MEMORY_BYTES = 200 * 1024 * 1024
"""More than what the controller has already."""
LONGEST_TEXT = 1_000_000
LONGEST_FAULT = 500
_LONGEST_ANSWER = 64 * 1024 * 1024
_WALL_S = 30.0
_FAILURES = (
    TemplateError, TypeError, ValueError, ArithmeticError, LookupError, AttributeError, RecursionError, SyntaxError,
)  # fmt: skip
"""What expressions raise, and what compiling does with too many nested blocks."""


class Rendered(msgspec.Struct, frozen=True):
    """What one playbook came to for one robot: a text, or a fault and the line of the template where it is."""

    text: str = ""
    fault: str = ""
    line: int = 1


Job = tuple[Playbook, Mapping[str, Any]]


def render_texts(jobs: Sequence[Job]) -> list[Rendered]:
    """Render each playbook with its context. What comes after one that broke a limit is left out."""
    if not jobs:
        return []
    cpu_s = math.ceil(CPU_S + CPU_EACH_S * len(jobs))
    lines, ended = _lines_of_child(jobs, cpu_s)
    found = [Rendered(**parse_json(line)) for line in lines]
    if len(found) < len(jobs):
        limits = f"{cpu_s} s of computing, {MEMORY_BYTES >> 20} MiB of memory"
        found.append(Rendered(fault=f"it takes too much to be rendered ({ended}; the limits are {limits})"))
    return found


def _lines_of_child(jobs: Sequence[Job], cpu_s: int) -> tuple[list[str], str]:
    """Return the whole lines that the child wrote, and what ended it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _be_the_child(jobs, writer, cpu_s)
    os.close(writer)
    try:
        answer, ended = _read(reader, time.monotonic() + cpu_s + _WALL_S)
        if ended:
            os.kill(child, signal.SIGKILL)
    finally:
        os.close(reader)  # a child that still writes ends with that
        _, status = os.waitpid(child, 0)
    killed = os.WIFSIGNALED(status) and os.WTERMSIG(status)
    why = "it computes for too long" if killed == signal.SIGXCPU else "it needs too much memory"
    return answer.decode("ascii").split("\n")[:-1], ended or why


def _read(reader: int, end: float) -> tuple[bytes, str]:
    """Read until the child is at its end; return why not, if not."""
    pieces: list[bytes] = []
    size = 0
    with selectors.DefaultSelector() as waiting:
        waiting.register(reader, selectors.EVENT_READ)
        while True:
            if not waiting.select(max(end - time.monotonic(), 0.0)):
                return b"".join(pieces), "it does not come to an end"
            piece = os.read(reader, 1 << 20)
            pieces.append(piece)
            size += len(piece)
            if not piece or size > _LONGEST_ANSWER:
                return b"".join(pieces), "it renders to too much text" if piece else ""


def _be_the_child(jobs: Sequence[Job], writer: int, cpu_s: int) -> NoReturn:
    """Write a line for each job, then end; whatever happens, nothing of the parent's is cleaned up here."""
    code = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
        if space := _address_space():
            resource.setrlimit(resource.RLIMIT_AS, (space + MEMORY_BYTES, space + MEMORY_BYTES))
        with open(writer, "w", encoding="ascii") as stream:
            for playbook, context in jobs:
                stream.write(json.dumps(msgspec.structs.asdict(_rendered(playbook, context))) + "\n")
                stream.flush()
        code = 0
    finally:
        os._exit(code)


def _address_space() -> int:
    """Return the bytes of address space that this process has; 0 where the kernel does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            return int(stream.read().split()[0]) * resource.getpagesize()
    except (OSError, ValueError, IndexError):
        return 0


@functools.lru_cache(maxsize=256)
def _template(text: str) -> Template:
    """Compile a playbook, once for all robots, and in the child too: the compiler computes constants."""
    return environment().from_string(text)


def _rendered(playbook: Playbook, context: Mapping[str, Any]) -> Rendered:
    try:
        text = _template(playbook.marked).render(**context)
    except _FAILURES as error:
        return Rendered(fault=str(error)[:LONGEST_FAULT] or type(error).__name__, line=_line(error))
    if len(text) > LONGEST_TEXT:
        return Rendered(fault=f"it renders to more than {LONGEST_TEXT} characters")
    return Rendered(text=text)


def _line(error: BaseException) -> int:
    """Return the line of the template in which an expression failed; Jinja2 writes it into the traceback."""
    if isinstance(line := getattr(error, "lineno", None), int):
        return line
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == "<template>"]
    return lines[-1] or 1 if lines else 1
