"""Programs that the user or an experiment names: what they print, up to a size and a time, and their end.

Takes processes that were started in a session of their own, with pipes; gives bytes.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time


def read_both(process: subprocess.Popen[bytes], end: float, most: int) -> tuple[bytes, bytes]:
    """Read both streams to their ends, or until the first has `most` bytes; of the second, further ones are left out.

    Raises:
        TimeoutError: It does not come to an end before `end`, on the monotonic clock.
    """
    assert process.stdout and process.stderr
    got = {process.stdout: bytearray(), process.stderr: bytearray()}
    with selectors.DefaultSelector() as waiting:
        for stream in got:
            waiting.register(stream, selectors.EVENT_READ)
        while waiting.get_map():
            for key, _ in waiting.select(max(end - time.monotonic(), 0.0)):
                piece = os.read(key.fd, 1 << 16)
                buffer = got[key.fileobj]  # type: ignore[index]  # the very streams that were registered
                buffer += piece[: max(0, most - len(buffer))]
                if len(got[process.stdout]) >= most:
                    return bytes(got[process.stdout]), bytes(got[process.stderr])
                if not piece:
                    waiting.unregister(key.fileobj)
            if time.monotonic() >= end:
                raise TimeoutError
    return bytes(got[process.stdout]), bytes(got[process.stderr])


def stop(process: subprocess.Popen[bytes]) -> None:
    """End the command with all its children, and close its pipes."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # what it left in the background too
    process.wait()
    for pipe in (process.stdout, process.stderr):
        if pipe:
            pipe.close()
