"""Resources for tests, made as a playbook makes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov.modules import MODULES
from srprov.modules.params import read_params
from srprov.resource import Need, Resource


def resource(
    module: str,
    name: str,
    written: Mapping[str, Any],
    *,
    host: str = "r1",
    blobs: Mapping[str, bytes] | None = None,
    needs: tuple[Need, ...] = (),
    source: str = "",
) -> Resource:
    """Return the resource of an item of a playbook."""
    params = read_params(MODULES[module].params, written, blobs or {})
    return Resource(host=host, module=module, name=name, params=params, written=written, needs=needs, source=source)
