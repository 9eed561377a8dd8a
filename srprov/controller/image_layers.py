"""How an image that one robot has gets to another: the way, and how much it is, as far as robots and this machine know.

Asks only when something is to be copied from a robot that has it already, in two round trips. What is built first has
no layers yet, so nothing is known of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from msgspec.structs import replace

from srprov.controller.render_inputs import RenderInputs
from srprov.controller.robot_images import robot_images
from srprov.facts.gather import Gathering
from srprov.layers import Image, has_classic_store, has_containerd_store, history_sizes, read_image
from srprov.transport.blobs import Blobs
from srprov.transport.image_there import FIRST, INFO, Target, read_target, second_look
from srprov.wire import AnyQuery, EngineQuery, Reply

_Copy = tuple[str, str, str]
"""Target, source, image."""


def with_layers(inputs: RenderInputs, look: Gathering) -> RenderInputs:
    """Return the inputs with what is missing for every copy."""
    copies = _copies(inputs) if inputs.images and inputs.copy_way != "whole" else []
    if not copies:
        return inputs
    asked: dict[str, list[AnyQuery]] = {target: list(FIRST) for target, _, _ in copies}
    for _, source, image in copies:
        asked.setdefault(source, []).extend(_of_source(image))
    first = look.ask_each(asked)
    targets = sorted({target for target, _, _ in copies} & first.keys())
    second = look.ask_each({target: second_look(first[target][: len(FIRST)]) for target in targets})
    seen = {target: read_target(first[target][: len(FIRST)], second[target]) for target in targets if target in second}
    blobs, found = Blobs(), dict[tuple[str, str], dict[str, Any]]()
    for target, source, image in copies:
        if target in seen and source in first:
            at = asked[source].index(_of_source(image)[1]) - 1
            found[target, image] = _copied(inputs.copy_way, seen[target], first[source][at : at + 3], blobs.size)
    return replace(inputs, copied=found)


def _copies(inputs: RenderInputs) -> list[_Copy]:
    """Return the copies whose source has the image already."""
    present = {(h, e.name) for h, items in inputs.snapshot.observed.items() for e in items if e.module == "image"}
    return [
        (host, one["from"], one["name"])
        for host, images in sorted(robot_images(inputs, {}).items())
        for one in images
        if one["source"] == "copy" and one["from"] != host and (one["from"], one["name"]) in present
    ]


def _of_source(image: str) -> tuple[AnyQuery, ...]:
    return INFO, EngineQuery(path=f"/images/{image}/json"), EngineQuery(path=f"/images/{image}/history")


def _copied(way: str, target: Target, source: Sequence[Reply], size: Callable[[str], int | None]) -> dict[str, Any]:
    """Return the parameters of one copy: its way, and what is missing where that is known."""
    info, inspected, history = (reply.json() for reply in source)
    image = read_image(inspected)
    if image is None:
        return {}
    registry = way == "registry" or (target.containerd and not way)
    if not (target.classic or registry) or not (has_classic_store(info) or has_containerd_store(info)):
        return {} if way else {"way": "whole"}
    again = registry and target.classic  # an engine that may take once more what it did not pull
    missing = tuple(dict.fromkeys(image.diff_ids)) if again else target.missing(image)
    kept = [size(one) for one in missing]
    known = sum(one for one in kept if one is not None)
    exact = None not in kept and not again
    return {
        "way": "registry" if registry else way,
        "missing": {
            "layers": len(missing),
            "of": len(image.diff_ids),
            "bytes": known if None not in kept else _unpacked(image, missing, history),
            "exact": exact,
        },
    }


def _unpacked(image: Image, missing: Sequence[str], history: object) -> int:
    """Return the bytes of layers before they are compressed; 0 where the engine does not say."""
    sizes = history_sizes(history, len(image.diff_ids))
    return sum(s for s, one in zip(sizes, image.diff_ids, strict=True) if one in missing) if sizes else 0
