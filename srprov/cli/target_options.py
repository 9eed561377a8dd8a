"""Options that choose a part of a plan: services for `plan` and `apply`, robots for `plan`."""

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


def shown_part(function: _F) -> _F:
    """Add --limit and --exclude to a verb that shows what would be changed."""
    only = "Show what would change on these robots alone (Ansible pattern; @failed: those that the last run did not "
    limit = click.option("--limit", default="", metavar="PATTERN", help=f"{only}finish; @FILE: a list).")
    exclude = click.option("--exclude", default="", metavar="PATTERN", help="Leave out what would change on these.")
    return limit(exclude(function))
