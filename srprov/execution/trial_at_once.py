"""Work on several robots at once, in threads. Takes names and what is done with each; gives what each gave."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_T = TypeVar("_T")


def at_once(
    hosts: Sequence[str], work: Callable[[str], _T], over: threading.Event, *, leave: bool = False
) -> dict[str, _T]:
    """Do something with all robots at once, and return what each gave.

    Args:
        hosts: The robots' names.
        work: Takes one of them.
        over: Set as soon as one has failed: whoever waits for another to come back need not any more.
        leave: The work changes no robot, and ends with its connection: whoever interrupts it does not wait for it.

    Raises:
        Exception: What the first robot in order raised that failed; no other one is at work any more.
        KeyboardInterrupt: Somebody interrupted it.
    """
    if len(hosts) == 1:
        return {hosts[0]: work(hosts[0])}
    pool, wait = ThreadPoolExecutor(max(1, len(hosts))), True
    running = {host: pool.submit(work, host) for host in hosts}
    try:
        return {host: one.result() for host, one in running.items()}
    except BaseException as error:
        over.set()
        wait = not (leave and isinstance(error, KeyboardInterrupt))
        raise
    finally:
        pool.shutdown(wait)
