"""Real files -> broken ones: pieces out of place, values of another kind, and what is known to hurt parsers."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

PIECES = st.sampled_from(
    [
        *'[]{}:,-&*!|>"#%@`\\\t\n=/~$',
        *("<<: *quiet", "!!binary x", "? ", "\x00", "\x85", "\u2028", "\ud7ff", "\x1b[31m", "\u202e", "\ufeff"),
        *("9" * 30, "9" * 5000, "[" * 80, "../" * 9, "-0", "0x_", "'", "1e999", ".nan", "-1", "²", "10**5000"),
        *("null", "~", "{{ x }}", "{{ 'x' * 10**9 }}", "{% for a in b %}", "!vault x", "!json '[1]'", "&a [*a]"),
        *("9999999h", "1-65535:1-65535", "/dev/zero", "/proc/self/mem", "~root", "a" * 300, "*a" * 30, "**/" * 30),
        *(" " * 20_000, "a" * 20_000, "a," * 9000, "${a-" * 4000, "a/" * 9000),
    ]
)
_LONG = 50
"""How often the entries of a list come again; a snapshot takes 15 ms for each container."""
_PUMPED = 150_000
"""Characters."""
JUNK: st.SearchStrategy[Any] = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([10**30, -1, 0, 1e300, "", "\0", "\ud800", "²", "9" * 400, [], {}, [[]], [None], {"": None}])
    | st.text(max_size=8)
    | st.recursive(st.none() | st.text(max_size=4), lambda inner: st.lists(inner, max_size=3), max_leaves=6)
)


@st.composite
def text(draw: Callable[..., Any], seed: str) -> bytes:
    """Replace, double or cut out some stretches of a text."""
    lines = seed.split("\n")
    for left in reversed(range(draw(st.integers(1, 4)))):
        kind = draw(st.sampled_from(["piece", "piece", "line", "cut", "double", "pump"]))
        if kind == "pump" and not left:
            # what is read in a time that grows with the square of a length shows at this one
            at = draw(st.integers(0, len(lines) - 1))
            start = draw(st.integers(0, len(lines[at])))
            end = start + draw(st.sampled_from([1, 1, 2, 7, 1000]))
            piece = lines[at][start:end] or "\n"
            lines[at] = lines[at][:start] + piece * (_PUMPED // len(piece)) + lines[at][end:]
        elif kind == "piece":
            at = draw(st.integers(0, len(lines) - 1))
            line = lines[at]
            start = draw(st.integers(0, len(line)))
            end = min(len(line), start + draw(st.integers(0, 12)))
            lines[at] = line[:start] + draw(PIECES | st.text(max_size=6)) + line[end:]
        else:
            at = draw(st.integers(0, len(lines) - 1))
            other = draw(st.integers(0, len(lines) - 1))
            lines[at : at + (kind != "double")] = [] if kind == "cut" else [lines[other]] * draw(st.integers(1, 3))
            lines = lines or [""]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def _places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at] + [path for key, one in inside for path in _places(one, (*at, key))]


def _at(value: Any, path: tuple[Any, ...]) -> Any:
    for part in path:
        value = value[part]
    return value


def _replaced(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    copied = dict(value) if isinstance(value, dict) else list(value)
    copied[path[0]] = _replaced(value[path[0]], path[1:], new)
    return copied


@st.composite
def values(draw: Callable[..., Any], seed: str) -> bytes:
    """Replace some values of a JSON document by junk, or by other values of it; or make one of its lists long."""
    document = json.loads(seed)
    lists = [path for path in _places(document) if isinstance(_at(document, path), list)]
    if lists and draw(st.integers(0, 5)) == 0:
        path = draw(st.sampled_from(lists))
        return json.dumps(_replaced(document, path, _at(document, path) * _LONG)).encode("utf-8", "surrogatepass")
    for _ in range(draw(st.integers(1, 3))):
        every = _places(document)
        place = every[draw(st.integers(0, len(every) - 1))]
        source = every[draw(st.integers(0, len(every) - 1))]
        new = draw(JUNK)
        if draw(st.booleans()):
            new = _at(document, source)
        document = _replaced(document, place, new)
        if len(json.dumps(document)) > 500_000:
            break
    return json.dumps(document).encode("utf-8", "surrogatepass")


def _is_json(seed: str) -> bool:
    try:
        return isinstance(json.loads(seed), dict | list)
    except ValueError:
        return False


def of(seed: str) -> st.SearchStrategy[bytes]:
    """Return what may become of a real file's text, and sometimes anything at all."""
    anything = st.binary(max_size=300)
    if _is_json(seed):
        return st.one_of(values(seed), values(seed), text(seed), anything)
    return st.one_of(text(seed), text(seed), text(seed), anything)
