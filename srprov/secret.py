"""Values that nothing shows: `Hidden`, `Secret`, and `redact`, the one function that decides what is printable.

A `Secret` is known to `redact` from the moment it is made, so that whoever prints or records cannot forget one. The
command line sends all of its output through `redact`, the record all of its files. A `Vault` holds the values that
the transport puts in the place of a name, in its last step and nowhere else.

Touches nothing but its own list of values. `redaction.py` knows what a value may look like.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping

from srprov.redaction import MASK, SHORTEST, Known, forms, in_bytes
from srprov.redaction_lines import as_they_come, lines_without, together

__all__ = ["MASK", "SHORTEST", "Hidden", "Secret", "Vault", "forget", "holds", "redact", "redact_lines", "redacted"]


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
        return Hidden(hashlib.sha256(in_bytes(self._value)).hexdigest())

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
        _all.add(value)


class Vault:
    """The values of an experiment's secrets by name, filled before one of them is sent."""

    def __init__(self, values: Mapping[str, Secret] | None = None) -> None:
        """Begin with these values."""
        self._values = dict(values or {})

    def __getitem__(self, name: str) -> Secret:
        """Return a secret; KeyError when nobody resolved it."""
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        """Return whether it was resolved."""
        return name in self._values

    def fill(self, other: Vault) -> None:
        """Take the values of another one, for who holds this one already."""
        self._values.update(other._values)

    def content(self, name: str) -> bytes:
        """Return the bytes that go to a robot; only transport calls this."""
        return in_bytes(self._values[name].reveal())

    def holds(self, text: str) -> str:
        """Return the name of the first secret whose value stands in a text in any of its forms, or nothing."""
        for name, secret in sorted(self._values.items()):
            if any(form in text for form in forms(secret.reveal())):
                return name
        return ""


class _All:
    """The secrets of this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made = Known()
        self._new: dict[str, frozenset[str]] = {}

    @property
    def known(self) -> Known:
        """What is looked for. Made anew when somebody asks after values were added: an inventory has thousands."""
        if self._new:
            with self._lock:
                self._made, self._new = self._made.plus(self._new), {}
        return self._made

    def add(self, value: str) -> None:
        """Look for a value from now on."""
        found = forms(value)
        with self._lock:
            self._new[value] = found

    def clear(self) -> None:
        """Know nothing; for tests."""
        with self._lock:
            self._made, self._new = Known(), {}


_all = _All()


def redact(text: str, *, for_people: bool = False) -> str:
    """Return a text with every known secret, in any of its forms, as `***`."""
    return _all.known.without(text, for_people=for_people) if _all.known else text


def holds(data: bytes) -> bool:
    """Return whether bytes hold a known secret, in any of its forms but those with wraps and separators in them.

    For gigabytes: it is a hundred times faster than `redact`.
    """
    return _all.known.stands_in(data)


def redact_lines(lines: Iterable[str], *, live: bool = False) -> Iterator[str]:
    """Return the lines of a stream, as many as came, with every known secret as `***`, also one that lines break.

    With `live` none waits longer than two moments for those that come next; a thread takes them then.
    """
    if not _all.known:
        return iter(lines)
    return lines_without(_all.known, as_they_come(lines) if live else together(lines))


def redacted(value: object) -> object:
    """Return a JSON value in which every text and every key went through `redact`; numbers stay, so it stays JSON."""
    known = _all.known
    return _clean(value, known.without if known else None)


def _clean(value: object, without: Callable[[str], str] | None) -> object:
    if isinstance(value, str):
        return without(value) if without else value
    if value is None or isinstance(value, int | float):
        return value
    if isinstance(value, dict | Mapping):  # a dict is told from others before Mapping's own check, which takes longer
        keys = map(str, value) if without is None else (without(str(key)) for key in value)
        return {key: _clean(item, without) for key, item in zip(keys, value.values(), strict=True)}
    if isinstance(value, list | tuple):
        return [_clean(item, without) for item in value]
    return MASK if isinstance(value, Hidden) else value


def forget() -> None:
    """Know no secret any more; for tests, which would hide each other's words."""
    _all.clear()
