"""`!reset` and `!override`: what a later file takes away from an earlier one before it is laid over it. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from msgspec.structs import replace

from srprov.importing.compose.values import Value
from srprov.importing.position import Path


@dataclass
class Resets:
    """Paths that what came before loses."""

    below: dict[str, Resets] = field(default_factory=dict)
    here: bool = False

    def add(self, path: Path) -> None:
        """Add one path."""
        node = self
        for part in path:
            node = node.below.setdefault(str(part), Resets())
        node.here = True

    def drop(self, base: Value) -> Value:
        """Return a tree without what is reset; entries of lists stay, as in Compose."""
        if not self.below or not isinstance(base.data, dict):
            return base
        kept = {}
        for name, item in base.data.items():
            below = self.below.get(name)
            if below is None:
                kept[name] = item
            elif not below.here:
                kept[name] = below.drop(item)
        return replace(base, data=kept)

    def of_service(self, name: str) -> Resets:
        """Return what is reset of one service."""
        return self.below.get("services", Resets()).below.get(name, Resets())


def taken(tree: Value) -> tuple[Value, Resets]:
    """Return a file's tree without its `!reset` entries, and what it resets."""
    resets = Resets()
    return _taken(tree, (), resets) or tree.of({}), resets


def _taken(value: Value, path: Path, resets: Resets) -> Value | None:
    if value.tag:
        resets.add(path)
        return None if value.tag == "!reset" else value
    if isinstance(value.data, dict):
        entries = {name: _taken(item, (*path, name), resets) for name, item in value.data.items()}
        return replace(value, data={name: item for name, item in entries.items() if item is not None})
    if isinstance(value.data, list):
        items = [_taken(item, (*path, number), resets) for number, item in enumerate(value.data)]
        return replace(value, data=[item for item in items if item is not None])
    return value
