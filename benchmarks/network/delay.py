"""A piece of cable that every frame needs some time for: two tap devices, and this program between them.

    python delay.py TAP TAP MICROSECONDS

Makes both devices, prints a line when they are there, and carries frames both ways until its standard input ends; the
devices go with it. For kernels without the queueing discipline `netem`. It needs some microseconds of CPU time for a
frame, the same for everybody's, and what it adds to the delay is in the figures of all.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import struct
import sys
import time
from collections import deque

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_PR_SET_TIMERSLACK = 29
_FRAME = 2048
_MOST = 64
"""Frames that are read from one device before the other one is looked at."""


def tap(name: str) -> int:
    """Make a tap device; give its file descriptor."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TAP | _IFF_NO_PI))
    return device


def carry(ends: tuple[int, int], delay_s: float, until: int) -> None:
    """Carry frames from each end to the other one, late by so much, until a file descriptor can be read."""
    other = {ends[0]: ends[1], ends[1]: ends[0]}
    waiting: deque[tuple[float, int, bytes]] = deque()
    while True:
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, end, frame = waiting.popleft()
            try:
                os.write(end, frame)
            except OSError:  # the device is down, or its queue is full: a cable does not wait either
                continue
        ready = select.select([*ends, until], [], [], max(0.0, waiting[0][0] - now) if waiting else None)[0]
        if until in ready:
            return
        for end in ready:
            for _ in range(_MOST):
                try:
                    frame = os.read(end, _FRAME)
                except BlockingIOError:
                    break
                waiting.append((time.monotonic() + delay_s, other[end], frame))


def main() -> None:
    """Be the cable."""
    first, second, microseconds = sys.argv[1:]
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1000, 0, 0, 0)  # nanoseconds; otherwise each wait is 50 us too long
    ends = (tap(first), tap(second))
    print("ready", flush=True)
    carry(ends, float(microseconds) / 1e6, sys.stdin.fileno())


if __name__ == "__main__":
    main()
