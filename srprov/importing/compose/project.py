"""All files of a Compose project -> one tree in long forms, in Compose's order of rules.

For each file: `!reset` and `!override` are noted, variables put in, services extended, other projects included, the
file is laid over those before it, checked, and brought to its long form. Reads files.
"""

from __future__ import annotations

from collections.abc import Sequence

from srprov.importing.compose import check, defaults, extends, include, notes
from srprov.importing.compose.forms import long
from srprov.importing.compose.loading import File, Loading, first_look
from srprov.importing.compose.merge import merged
from srprov.importing.compose.unique import unique
from srprov.importing.compose.values import Value
from srprov.importing.normal import Note
from srprov.importing.position import Position


def load(files: Sequence[File], loading: Loading) -> Value:
    """Return the tree of a project; its relative paths begin at the loading's folder.

    Raises:
        Refused: Compose or srprov does not take it.
    """
    tree = Value({}, Position(files[0].shown))
    for file in files:
        tree = _laid_over(tree, file, loading)
    tree = defaults.put_in(tree)
    check.sense(tree)
    return defaults.environment(tree, loading.variables)


def _laid_over(tree: Value, file: File, loading: Loading) -> Value:
    own, reset = first_look(file, loading)
    loading.notes += notes.of_file(own)
    own = extends.extended(own, reset, file, loading)
    tree = reset.drop(tree)
    own = include.included(own, file, loading, load)
    tree = unique(merged(tree, own))
    check.shape(tree)
    if (version := tree.get("version")) is not None:
        loading.notes.append(Note(version.place, "`version` means nothing to Compose any more"))
        tree = tree.of({name: item for name, item in tree.data.items() if name != "version"})
    return unique(defaults.without_empty(long(tree)))
