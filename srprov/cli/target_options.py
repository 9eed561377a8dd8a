"""The option of `plan` and `apply` that chooses services."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar, cast

import click
from msgspec.structs import replace

from srprov.controller.request import PlanRequest

_F = TypeVar("_F", bound=Callable[..., object])
_TARGET = click.option(
    "--target", "targets", multiple=True, metavar="SERVICE",
    help="Only this service, and what it needs; may be repeated. Others stay as they are, or the plan is refused.",
)  # fmt: skip


def targeting(function: _F) -> _F:
    """Add `--target`; the verb finds it in `request`."""

    @functools.wraps(function)
    def with_targets(*, request: PlanRequest, targets: tuple[str, ...], **more: object) -> object:
        return function(request=replace(request, targets=targets), **more)

    return cast("_F", _TARGET(with_targets))
