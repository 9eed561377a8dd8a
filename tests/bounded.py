"""Do something that somebody hostile asked for, within the limits that srprov promises for it."""

from __future__ import annotations

import os
import pickle
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")
CPU_S = 2.0
MEMORY_BYTES = 300 * 1024 * 1024


_UNIT_S = 0.015
"""CPU seconds that `_unit` takes on the processors for which limits are meant."""


def _unit() -> None:
    sum(len(str(number)) for number in range(200_000))


def slowness() -> float:
    """Return how many times longer the processor takes just now; a busy neighbour doubles its seconds."""
    begin = time.process_time()
    for _ in range(20):
        _unit()
    return max(1.0, (time.process_time() - begin) / (20 * _UNIT_S))


@contextmanager
def within(cpu_s: float) -> Iterator[None]:
    """Hold what is done inside to so many CPU seconds of this process, on the processors for which limits are meant."""
    begin = time.process_time()
    yield
    took = time.process_time() - begin
    if took >= cpu_s:
        took /= slowness()
    assert took < cpu_s, f"it took {took:.1f} s"


def bounded(work: Callable[[], T], cpu_s: float = CPU_S, memory: int = MEMORY_BYTES) -> T:
    """Return what `work` returns, or raise what it raises; in a child that may take no more memory and time.

    The kernel ends it when it takes five times as long, so that what never ends fails too.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            with open("/proc/self/statm", encoding="ascii") as stream:
                space = int(stream.read().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (space + memory, space + memory))
            resource.setrlimit(resource.RLIMIT_CPU, (int(5 * cpu_s), int(5 * cpu_s) + 1))
            result: T | None = None
            wrong: BaseException | None = None
            begin = time.process_time()
            try:
                result = work()
            except Exception as error:  # any error at all goes to the parent, which judges it
                wrong = error
            took = time.process_time() - begin
            answer = result, wrong, took if took < cpu_s else took / slowness()
            with open(writer, "wb") as out:
                out.write(pickle.dumps(answer))
        finally:
            os._exit(0)
    os.close(writer)
    with open(reader, "rb") as stream_in:
        answered = stream_in.read()
    _, status = os.waitpid(child, 0)
    assert answered, f"it was ended by the kernel: {os.waitstatus_to_exitcode(status)}"
    value, raised, took = pickle.loads(answered)
    assert took < cpu_s, f"it took {took:.1f} s"
    if raised is not None:
        raise raised
    return value  # type: ignore[no-any-return]  # what was pickled is what `work` returned
