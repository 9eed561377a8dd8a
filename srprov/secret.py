"""Values that nothing shows: `Hidden`, `Secret`, and `redact`, the one function that decides what is printable.

A `Secret` is known to `redact` from the moment it is made, so that whoever prints or records cannot forget one. The
command line sends all of its output through `redact`, the record all of its files. A `Vault` holds the values that
the transport puts in the place of a name, in its last step and nowhere else.

Touches nothing but its own list of values. Source: CI runners mask a value in every form that a program may print it
in; three of base64, because what stands before it shifts its bits.
"""

from __future__ import annotations

import base64
import hashlib
import threading
from collections.abc import Iterator, Mapping

SHORTEST = 4
"""Characters of a secret. A shorter one would be found in every other line, and blank out the whole output."""
MASK = "***"
_SHORTEST_PART = 8
"""Characters of a line of a long secret (a key in PEM) that is looked for by itself."""
_SHORTEST_SHIFTED = 6


class Hidden:
    """A value that nothing prints: `str` and `repr` show `***`, and it is no JSON value."""

    __slots__ = ("_value",)

    def __init__(self, value: str) -> None:
        """Wrap a value; bytes that are no UTF-8 arrive as surrogates (`os.fsdecode`'s way) and leave as they were."""
        self._value = value

    def reveal(self) -> str:
        """Return the value; only transport calls this."""
        return self._value

    def digest(self) -> Hidden:
        """Return the sha256 in hex, hidden too: a short value could be guessed from it."""
        return Hidden(hashlib.sha256(_bytes(self._value)).hexdigest())

    def __repr__(self) -> str:
        """Never the value."""
        return MASK

    __str__ = __repr__

    def __reduce__(self) -> str | tuple[object, ...]:
        """Refuse to be pickled: that would be the value in clear."""
        raise TypeError("a hidden value cannot be pickled")

    def __copy__(self) -> Hidden:
        """Be one's own copy, as values that never change are."""
        return self

    def __deepcopy__(self, _memo: object) -> Hidden:
        """Be one's own copy."""
        return self

    def __eq__(self, other: object) -> bool:
        """Equal when the hidden values are."""
        return isinstance(other, Hidden) and other._value == self._value

    def __hash__(self) -> int:
        """Hash as equal secrets demand."""
        return hash(("Hidden", self._value))


class Secret(Hidden):
    """A password, token or key of the user; `redact` knows it from now on."""

    __slots__ = ()

    def __init__(self, value: str) -> None:
        """Wrap a value as soon as it is read.

        Raises:
            ValueError: It is too short to be hidden.
        """
        if len(value.strip()) < SHORTEST:
            raise ValueError(f"a secret has at least {SHORTEST} characters; a shorter one cannot be hidden in output")
        super().__init__(value)
        _known.add(value)


class Vault:
    """The values of an experiment's secrets by name, filled before anything is sent."""

    def __init__(self, values: Mapping[str, Secret] | None = None) -> None:
        """Begin with these values."""
        self._values = dict(values or {})

    def __getitem__(self, name: str) -> Secret:
        """Return a secret; KeyError when nobody resolved it."""
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        """Return whether it was resolved."""
        return name in self._values

    def content(self, name: str) -> bytes:
        """Return the bytes that go to a robot; only transport calls this."""
        return _bytes(self._values[name].reveal())

    def holds(self, text: str) -> str:
        """Return the name of the first secret whose value stands in a text in any of its forms, or nothing."""
        for name, secret in sorted(self._values.items()):
            if any(form in text for form in forms(secret.reveal())):
                return name
        return ""


def _bytes(value: str) -> bytes:
    return value.encode("utf-8", "surrogateescape")


def forms(value: str) -> frozenset[str]:
    """Return every text that a value is looked for as: itself, in base64, quoted for URLs, JSON, Python and a shell."""
    raw = _bytes(value)
    found = {raw.hex(), hashlib.sha256(raw).hexdigest(), *_base64(raw)}
    for text in {value, value.strip(), raw.decode("utf-8", "replace").strip()}:
        found |= set(_escaped(text))
    lines = value.splitlines()
    if len(lines) > 1:
        parts = {line.strip() for line in lines}
        found |= {form for part in parts if len(part) >= _SHORTEST_PART for form in (part, *_base64(_bytes(part)))}
    return frozenset(form for form in found if len(form.strip()) >= SHORTEST)


def _base64(raw: bytes) -> Iterator[str]:
    """Return base64 of the value alone, and what of it is fixed when one or two bytes stand before it."""
    whole = [
        base64.b64encode(raw).decode("ascii").rstrip("="),
        base64.b64encode(raw.strip()).decode("ascii").rstrip("="),
    ]
    for before in range(3):
        text = base64.b64encode(b"\0" * before + raw).decode("ascii").rstrip("=")
        # a character that also holds bits of a neighbour differs with it
        first, last = (0, 2, 3)[before], len(text) - ((before + len(raw)) % 3 != 0)
        if last - first >= _SHORTEST_SHIFTED:
            whole.append(text[first:last])
    for text in whole:
        yield text
        yield text.replace("+", "-").replace("/", "_")


def _escaped(text: str) -> Iterator[str]:
    import html
    import json
    import re
    import shlex
    from urllib.parse import quote

    yield text
    yield json.dumps(text)[1:-1]
    yield json.dumps(text, ensure_ascii=False)[1:-1]
    yield json.dumps(json.dumps(text))[3:-3]
    for safe in ("", "/"):
        quoted = quote(_bytes(text), safe=safe)
        yield from (quoted, quoted.replace("%20", "+"), _lower(quoted))
    yield repr(text)[1:-1]
    yield repr(_bytes(text))[2:-1]
    yield text.encode("unicode_escape").decode("ascii")
    yield from (html.escape(text), html.escape(text, quote=False))
    yield shlex.quote(text).strip("'")
    yield re.sub(r"([\\`*_{}\[\]()<>#+\-!|~@])", r"\\\1", text)  # Markdown


def _lower(quoted: str) -> str:
    """Write `%2F` as `%2f`: RFC 3986 allows both."""
    first, *rest = quoted.split("%")
    return "%".join([first, *(part[:2].lower() + part[2:] for part in rest)])


class _Known:
    """Every form of every secret, by its first characters: a text is gone through once, not once per form."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: frozenset[str] = frozenset()
        self._by_start: dict[str, tuple[str, ...]] = {}

    def add(self, value: str) -> None:
        """Look for a value from now on."""
        with self._lock:
            if value in self._values:
                return
            by_start = dict(self._by_start)  # readers have no lock: they go on with the old one
            for form in sorted(forms(value)):
                start = form[:SHORTEST]
                by_start[start] = (*by_start.get(start, ()), form)
            self._values, self._by_start = self._values | {value}, by_start

    @property
    def some(self) -> bool:
        """Return whether there is anything to look for."""
        return bool(self._values)

    def spans(self, text: str) -> Iterator[tuple[int, int]]:
        """Return every place where a form stands, in order, also where two overlap."""
        by_start = self._by_start
        for at in range(len(text) - SHORTEST + 1):
            start = text[at : at + SHORTEST]
            if start in by_start:
                for form in by_start[start]:
                    if text.startswith(form, at):
                        yield at, at + len(form)

    def clear(self) -> None:
        """Know nothing; for tests."""
        with self._lock:
            self._values, self._by_start = frozenset(), {}


_known = _Known()


def redact(text: str) -> str:
    """Return a text with every known secret, in any of its forms, as `***`."""
    if not _known.some:
        return text
    parts: list[str] = []
    end = 0
    for start, stop in _known.spans(text):
        if not parts or start > end:  # what overlaps or touches the one before is one mask with it
            parts += [text[end:start], MASK]
        end = max(end, stop)
    return "".join([*parts, text[end:]]) if parts else text


def redacted(value: object) -> object:
    """Return a JSON value in which every text and every key went through `redact`; numbers stay, so it stays JSON."""
    if isinstance(value, str):
        return redact(value)
    if isinstance(value, Mapping):
        return {redact(str(key)): redacted(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [redacted(item) for item in value]
    if isinstance(value, Hidden):
        return MASK
    return value


def forget() -> None:
    """Know no secret any more; for tests, which would hide each other's words."""
    _known.clear()
