"""YAML text -> the same document in one form, or nothing where that would not be the same.

Takes text and the order of keys; gives text. Pure. What was made is read again: values and comments are those of the
text before, or it is refused.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import form, layout, loader
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq


def canonical(text: str, file: str, orders: form.Orders) -> str:
    """Return a document in its form; one without values comes back as it is.

    Args:
        text: The document.
        file: Its name in messages.
        orders: The order of keys in each map.

    Raises:
        DefinitionError: It is no YAML, breaks a limit, or cannot be written anew without a change of its meaning.
    """
    before = loader.parse(text, file)
    if before is None:
        return text
    made = form.text_of(layout.read(text, file), orders)
    try:
        after = loader.parse(made, file)
    except DefinitionError:
        after = None
    if after is None or not _same(before, after) or layout.comments(text) != layout.comments(made):
        hint = "it is left as it is; the last line needs an end, and odd spellings a plainer one"
        raise DefinitionError([Diagnostic(Location(file), "cannot be brought into form", hint=hint, code=Code.YAML)])
    return made


def _same(one: Node, other: Node) -> bool:
    """Return whether two values are read as the same; the order of keys means nothing."""
    if one.tag != other.tag:
        return False
    if isinstance(one, Map) and isinstance(other, Map):
        return one.entries.keys() == other.entries.keys() and all(
            _same(value, other.entries[key]) for key, value in one.entries.items()
        )
    if isinstance(one, Seq) and isinstance(other, Seq):
        return len(one.items) == len(other.items) and all(map(_same, one.items, other.items))
    return isinstance(one, Scalar) and isinstance(other, Scalar) and (one.text, one.plain) == (other.text, other.plain)
