"""Which images the last run of each instance named, by its record on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.record.last import newest, record_json, records
from srprov.untrusted import mapping, mappings, string


def named_images(root: Path) -> dict[str, frozenset[str]]:
    """Return image -> the instances whose last recorded run had it wanted: by `apply`, `build` or `run`.

    After a `destroy`, an instance names none. A run that was killed before its plan was written does not count.

    Raises:
        UsageError: A record cannot be read, so nobody knows what it names.
    """
    named: dict[str, set[str]] = {}
    for instance, folders in records(root).items():
        last = next((path for path in newest(folders) if (path / "plan.json").exists()), None)
        for image in _images(last) if last else ():
            named.setdefault(image, set()).add(instance)
    return {image: frozenset(instances) for image, instances in named.items()}


def _images(record: Path) -> Iterator[str]:
    try:
        plan = mapping(record_json(record / "plan.json"))
    except (OSError, ValueError) as error:
        hint = "remove that folder, if nothing that it names is needed any more"
        raise UsageError(f"{record} is no record that can be read: {error}", hint=hint, code=Code.RECORD) from error
    yield from mapping(plan.get("contexts"))
    wanted = [*(one for one in mappings(plan.get("steps")) if one.get("want")), *mappings(plan.get("also_wanted"))]
    yield from (string(one.get("name")) for one in wanted if one.get("module") == "image")
