"""The lab's link made slow: all traffic between the controller and its robots shares one bucket, both ways.

As in one Wi-Fi cell: what the controller sends and what it gets pass the same token bucket (`tc tbf`) of an
intermediate device, at the controller's end of the lab's bridge.
"""

from __future__ import annotations

import contextlib
import re
import subprocess
from collections.abc import Iterator

DEVICE = "srbench-ifb"
FULL = "full"
_QUEUE_MS = 50


def rate(word: str) -> str:
    """Return a link's rate as `tc` wants it, or nothing for the lab's full speed.

    Raises:
        ValueError: It is neither `full` nor a rate such as `50mbit`.
    """
    if word != FULL and not re.fullmatch(r"[1-9][0-9]*[km]bit", word):
        raise ValueError(f"{word}: neither {FULL} nor a rate such as 50mbit")
    return "" if word == FULL else word


@contextlib.contextmanager
def shaped(bridge: str, word: str) -> Iterator[None]:
    """Let the bridge carry no more than that for a while."""
    if not rate(word):
        yield
        return
    _undo(bridge)
    try:
        _run("ip", "link", "add", DEVICE, "type", "ifb")
        _run("ip", "link", "set", DEVICE, "up")
        bucket = f"tbf rate {rate(word)} burst 64kb latency {_QUEUE_MS}ms"
        _run("tc", "qdisc", "add", "dev", DEVICE, "root", *bucket.split())
        _run("tc", "qdisc", "add", "dev", bridge, "clsact")
        through = f"protocol all u32 match u32 0 0 action mirred egress redirect dev {DEVICE}"
        for way in ("ingress", "egress"):
            _run("tc", "filter", "add", "dev", bridge, way, *through.split())
        yield
    finally:
        _undo(bridge)


def _undo(bridge: str) -> None:
    for words in (["tc", "qdisc", "del", "dev", bridge, "clsact"], ["ip", "link", "del", DEVICE]):
        subprocess.run(words, capture_output=True, timeout=30, check=False)  # it may not be there


def _run(*words: str) -> None:
    subprocess.run(words, check=True, timeout=30)
