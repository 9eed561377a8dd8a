"""`robot[01:12]` and `robot[a:c]`, as Ansible's inventories and patterns write many names in one.

Takes text; gives every name in order. Pure.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence

_RANGE = re.compile(r"\[([0-9]+|[a-zA-Z]):([0-9]+|[a-zA-Z])(?::([0-9]+))?\]", re.ASCII)
_ADDRESS = re.compile(r"(?P<name>[^:\s]+|\[[0-9a-fA-F:.%]+\]):(?P<port>[0-9]{1,5})", re.ASCII)
MOST_NAMES = 10_000
_LONGEST = 512
"""Characters of a name with its ranges: what is longer is no name, whatever it stands for."""


def expand(text: str) -> list[str]:
    """Return every name that a text with ranges stands for; a text without any is its own name.

    Raises:
        ValueError: A range runs backwards, mixes digits and letters, or there are more names than `MOST_NAMES`; or the
            text is too long for a name.
    """
    return list(count_and_names(text)[1])


def count_and_names(text: str) -> tuple[int, Iterator[str]]:
    """Return how many names a text with ranges stands for, and the names, each made when it is asked for.

    Raises:
        ValueError: As `expand`; no name was made before.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"'{text[:60]}…' is longer than {_LONGEST} characters")
    found = list(_RANGE.finditer(text))
    numbers = [_numbers(match) for match in found]
    count = math.prod(map(len, numbers))
    if count > MOST_NAMES:
        raise ValueError(f"'{text[:60]}' stands for more than {MOST_NAMES} names")
    pieces: list[Sequence[str]] = []
    end = 0
    for match, some in zip(found, numbers, strict=True):
        pieces += [(text[end : match.start()],), _words(match[1], some)]
        end = match.end()
    return count, map("".join, itertools.product(*pieces, (text[end:],)))


def _numbers(match: re.Match[str]) -> range:
    """Return the numbers of a range; of letters, those that Unicode gives them."""
    first, last, step = match[1], match[2], int(match[3] or 1)
    if first.isdecimal() != last.isdecimal():
        raise ValueError(f"the range '{match[0]}' mixes digits and letters")
    low, high = (int(first), int(last)) if first.isdecimal() else (ord(first), ord(last))
    if low > high or step < 1:
        raise ValueError(f"the range '{match[0]}' is empty")
    if first.isdecimal() and len(first) > 1 and first.startswith("0") and len(first) != len(last):
        raise ValueError(f"the range '{match[0]}' needs as many digits at its end as at its start")
    if (high - low) // step > MOST_NAMES:
        raise ValueError(f"the range '{match[0]}' stands for more than {MOST_NAMES} names")
    return range(low, high + 1, step)


def _words(first: str, numbers: range) -> list[str]:
    """Return numbers as a range writes them that begins with `first`."""
    width = len(first) if first.startswith("0") else 0
    return [str(number).zfill(width) if first.isdecimal() else chr(number) for number in numbers]


def split_port(text: str) -> tuple[str, int | None]:
    """Split `name:port`; a range or an IPv6 address is no port.

    Raises:
        ValueError: The port is not within 1 to 65535.
    """
    match = _ADDRESS.fullmatch(_RANGE.sub(lambda found: "x" * len(found[0]), text))
    if match is None:
        return text, None
    port = int(match["port"])
    if not 1 <= port <= 65535:
        raise ValueError(f"'{port}' is not within ports 1 to 65535")
    return text[: match.end("name")].strip("[]") if text.count(":") > 2 and "[" in text[:1] else text[
        : match.end("name")
    ], port
