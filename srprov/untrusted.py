"""What robots, engines and files from elsewhere say, made harmless: bounded JSON, text, numbers and lists.

Takes any text or JSON value; returns a value of the type that was asked for. A robot may be broken or hostile: its
words end on terminals, in file names and in sums that decide who runs what. Only `parse_json` raises, for files that a
user names; everything else turns what is wrong into an empty value. Touches nothing.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

TEXT_LENGTH = 200
"""Characters of a text that is shown."""
STRING_LENGTH = 65_536
"""Characters of a text that is only compared."""
LONGEST_PATH = 4096
"""Bytes that Linux takes as a path. One of 65,000 lies in 30,000 folders, whose names are a gigabyte together."""
LIST_LENGTH = 1024
"""Entries that a list of facts may have: links, routes, devices."""
MAX_JSON_CHARACTERS = 8 * 1024 * 1024
"""Parsing is linear in the text, so that this also limits its time: about 0.2 s."""
MAX_JSON_DEPTH = 60
_MOST_LEVELS_OF_ROBOTS = 50
"""What a robot said is kept below a few levels of srprov's own, in files that are read again."""
_MOST_CONTAINERS = 400_000
"""Lists and maps in a robot's JSON; an empty one takes two characters, and thirty times that in memory."""
MAX_JSON_VALUES = 2_000_000
"""Brackets, commas and colons outside of strings: each value of JSON has one, and takes about 100 bytes of memory."""
MOST_OF_ONE = 512 << 10
"""Characters of what an engine says of one container or image; they are some ten thousand."""
_MOST_NESTED = 20_000
"""Lists and maps in that: an empty one takes thirty times its text in memory."""
LARGEST_NUMBER = 2**64
"""No JSON number is larger; counters of kernel and engine have 64 bits."""

_INTEGER = re.compile(r"-?[0-9]{1,18}")
_LONG_NUMBER = re.compile("[0-9]{20}")
"""Each number that is too large has so many digits; so have some that are none, as in a hash."""
_DECIMAL = re.compile(r"-?[0-9]{1,18}(\.[0-9]{1,18})?")
_NO_MARKS = bytes(set(range(256)) - set(b'"[{,:'))
_PIECE = 1 << 16
_CONTAINERS: frozenset[type] = frozenset({dict, list})
_TOO_DEEP = f"it is nested more than {MAX_JSON_DEPTH} levels deep"


def parse_json(
    source: str, *, max_characters: int = MAX_JSON_CHARACTERS, max_values: int = MAX_JSON_VALUES, wide: bool = False
) -> Any:  # noqa: ANN401 - JSON is any
    """Return a file's JSON, with numbers that can be calculated with; with `wide`, fractions as large as floats are.

    Raises:
        ValueError: It is no JSON, is too long or nested too deeply, or has a number that is not finite or too large.
    """
    return _parse(source, _WIDE_DECODER if wide else _FILE_DECODER, max_characters, max_values)


def json_or_none(source: str) -> Any:  # noqa: ANN401 - JSON is any; each caller checks the shape that it needs
    """Return the JSON that a robot sent; None for what is broken, or beyond the limits of `parse_json`.

    `ip -j` writes control characters of a link's name or alias as they are: one odd link must not hide all others.
    What is kept of it in a file can be read again: no number in it is larger than files may have, and it is less deep.
    """
    try:
        return json_of_robot(source)
    except ValueError:
        return None


def json_of_robot(source: str) -> Any:  # noqa: ANN401 - JSON is any
    """Return what `json_or_none` returns, where None is JSON's `null`.

    Raises:
        ValueError: It is broken, or beyond the limits.
    """
    decoder = _FILE_DECODER if _LONG_NUMBER.search(source) else _ROBOT_DECODER
    return _parse(source, decoder, MAX_JSON_CHARACTERS, max_containers=_MOST_CONTAINERS, levels=_MOST_LEVELS_OF_ROBOTS)


def is_of_one(source: str) -> bool:
    """Tell whether what an engine says of one container or image is no longer than any needs: many are kept at once."""
    return len(source) <= MOST_OF_ONE and not _holds_more(source, _MOST_NESTED, MOST_OF_ONE)


def _parse(
    source: str, decoder: json.JSONDecoder, max_characters: int, max_values: int = MAX_JSON_VALUES,
    max_containers: int = MAX_JSON_VALUES, levels: int = MAX_JSON_DEPTH,
) -> Any:  # fmt: skip  # noqa: ANN401 - JSON is any
    if len(source) > max_characters:
        raise ValueError(f"it is longer than {max_characters} characters")
    if more := _holds_more(source, max_containers, max_values):
        raise ValueError(f"it holds more than {more}")
    try:
        value = decoder.decode(source)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_depth(value, levels)
    return value


def _holds_more(source: str, max_containers: int, max_values: int) -> str:
    """Return which limit a text is beyond, or "". Strings do not count: a label of brackets is one value."""
    count: Callable[[str], int] = source.count
    for is_bare in (False, True):
        containers = count("[") + count("{")
        values = containers + count(",") + count(":")
        if containers <= max_containers and values <= max_values:
            return ""
        if not is_bare:
            count = _marks_outside_strings(source).count
    return f"{max_containers} lists and maps" if containers > max_containers else f"{max_values} values"


def _marks_outside_strings(source: str) -> str:
    """Return the brackets, commas and colons that are in no string, in a time that is linear whatever the text is."""
    escaped = source.encode("ascii", "ignore").replace(rb"\\", b"").replace(rb"\"", b"")
    # two quotes side by side, with nothing that counts in between, change nothing
    marks = escaped.translate(None, _NO_MARKS).replace(b'""', b"")
    found: list[bytes] = []
    is_inside = 0
    for start in range(0, len(marks), _PIECE):  # in pieces, as each string takes fifty bytes here
        parts = marks[start : start + _PIECE].split(b'"')
        found.append(b"".join(parts[is_inside::2]))
        is_inside = (is_inside + len(parts) - 1) % 2
    return b"".join(found).decode()


def _check_depth(value: object, levels: int) -> None:
    """Refuse (ValueError) what is nested deeper than whoever walks it later can follow."""
    level: list[Any] = [value] if type(value) in _CONTAINERS else []
    for _ in range(levels):
        if not level:
            return
        inside = (outer.values() if isinstance(outer, dict) else outer for outer in level)
        level = [inner for values in inside for inner in values if type(inner) in _CONTAINERS]
    if level:
        raise ValueError(_TOO_DEEP)


def _whole(digits: str) -> int:
    # Python itself refuses thousands of digits, with words that nobody understands
    return int(digits) if len(digits) < 25 and abs(int(digits)) <= LARGEST_NUMBER else _refuse(digits)


def _fraction(digits: str) -> float:
    value = float(digits)
    return value if abs(value) <= LARGEST_NUMBER else _refuse(digits)


def _finite(digits: str) -> float:
    value = float(digits)
    return value if math.isfinite(value) else _refuse(digits)


def _refuse(digits: str) -> NoReturn:
    raise ValueError(f"the number {digits if len(digits) < 25 else digits[:20] + '...'} is too large or not a number")


_FILE_DECODER = json.JSONDecoder(strict=False, parse_int=_whole, parse_float=_fraction, parse_constant=_refuse)
_WIDE_DECODER = json.JSONDecoder(strict=False, parse_int=_whole, parse_float=_finite, parse_constant=_refuse)
_ROBOT_DECODER = json.JSONDecoder(strict=False, parse_float=_fraction, parse_constant=_refuse)
"""Leaves whole numbers to Python: a check of each takes longer than the rest. For texts without a long one."""


def text(value: object, *, length: int = TEXT_LENGTH) -> str:
    """Return one printable line of at most `length` characters, no control or bidi ones; what is not text is ""."""
    if not isinstance(value, str):
        return ""
    # cut first: a robot may send megabytes, and only a few characters of them can matter
    return "".join(c for c in value[: 4 * length] if c.isprintable())[:length].strip()


def string(value: object) -> str:
    """Return a text as it came, cut, to be compared with; what is not text is ""."""
    cut = value[:STRING_LENGTH] if isinstance(value, str) else ""
    # half of a surrogate pair, which JSON can hold, cannot be written to any file or terminal
    return cut if cut.isascii() else cut.encode("utf-8", "replace").decode("utf-8")


def folder(value: object) -> str:
    """Return an absolute path as `text` does; what is none is ""."""
    said = text(value)
    return said if said.startswith("/") else ""


def absolute(value: object) -> str:
    """Return an absolute path as `string` does, for a word of a shell, which holds no NUL; what is none is "".

    What is longer than any path of Linux is none.
    """
    said = string(value)
    return said if said.startswith("/") and "\0" not in said and not is_too_long(said) else ""


def is_too_long(path: str) -> bool:
    """Tell whether a path is longer than Linux takes."""
    return len(path) > LONGEST_PATH or len(path.encode("utf-8", "replace")) > LONGEST_PATH


def lines_of(out: str, most: int) -> list[str]:
    """Return at most `most` lines. Only a line feed ends one; str.splitlines would also take a form feed."""
    return out.split("\n", most)[:most]


def integer(value: object, *, low: int = 0, high: int = 10**18, default: int = 0) -> int:
    """Return an int clamped to `low..high`; `default` when it is no number at all."""
    if isinstance(value, str) and _INTEGER.fullmatch(value.strip()):
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        return default
    return max(low, min(high, value))


def decimal(value: object, *, low: float, high: float, default: float) -> float:
    """Return a finite float clamped to `low..high`; `default` when it is no number, NaN or infinite."""
    if isinstance(value, str) and _DECIMAL.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return default
    try:
        number = float(value)
    except OverflowError:
        return default
    return float(max(low, min(high, number))) if math.isfinite(number) else default


def mapping(value: object) -> Mapping[str, Any]:
    """Return the mapping, or an empty one for anything else."""
    return value if isinstance(value, Mapping) else {}


def mappings(value: object, *, most: int = 65_536) -> list[Mapping[str, Any]]:
    """Return the mappings in a list, at most `most` of them; anything else is left out."""
    return [item for item in value if isinstance(item, Mapping)][:most] if isinstance(value, list) else []


def strings(value: object) -> list[str]:
    """Return the texts in a list, each as `string` does; anything else is left out."""
    return [string(one) for one in value if isinstance(one, str)] if isinstance(value, list) else []


def string_map(value: object) -> dict[str, str]:
    """Return a map of texts, such as the labels of a Docker object; anything else is empty."""
    return {string(name): string(one) for name, one in mapping(value).items()}
