"""The option of `plan` and `apply` that changes the keys of an encrypted overlay."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar, cast

import click
from msgspec.structs import replace

from srprov.controller.request import PlanRequest

_F = TypeVar("_F", bound=Callable[..., object])
_ROTATE = click.option(
    "--rotate-keys", is_flag=True,
    help="New keys for an encrypted overlay, on all of its robots; the old ones go when all use the new ones.",
)  # fmt: skip


def rotating(function: _F) -> _F:
    """Add `--rotate-keys`; the verb finds it in `request`."""

    @functools.wraps(function)
    def with_keys(*, request: PlanRequest, rotate_keys: bool, **more: object) -> object:
        return function(request=replace(request, rotate_keys=rotate_keys), **more)

    return cast("_F", _ROTATE(with_keys))
