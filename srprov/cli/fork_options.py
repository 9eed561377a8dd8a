"""Options that say how many robots are talked to at the same time, by how many processes, and how fast it begins.

Verbs get `--forks`. The rest only matters to whoever connects, and is left where `inputs.connect` finds it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from srprov.controller.fleet import Sharing

_F = TypeVar("_F", bound=Callable[..., Any])
_WORKERS, _RATE, _SCHEDULER = "srprov.workers", "srprov.connect-rate", "srprov.engine"
_MOST = 256


def _keep_workers(context: click.Context, _option: click.Parameter, text: str) -> None:
    """Take `auto` or a number of processes."""
    if text != "auto" and not (text.isascii() and text.isdecimal() and 1 <= int(text[:9]) <= _MOST):
        raise click.BadParameter(f"'{text}' is neither auto nor a number from 1 to {_MOST}")
    context.meta[_WORKERS] = text


def _keep_rate(context: click.Context, _option: click.Parameter, rate: float) -> None:
    context.meta[_RATE] = rate


def _keep_scheduler(context: click.Context, _option: click.Parameter, address: str) -> None:
    if address:
        from srprov.controller.fleet import checked_scheduler

        context.meta[_SCHEDULER] = checked_scheduler(address)


_forks = click.option(
    "-f", "--forks", type=click.IntRange(min=1), default=64, show_default=True, help="Robots at the same time."
)
_workers = click.option(
    "--workers", default="1", show_default=True, metavar="N|auto", expose_value=False, callback=_keep_workers,
    help="Processes that have the connections; auto: one for each processor, from 200 robots on. See docs/scale.md.",
)  # fmt: skip
_rate = click.option(
    "--connect-rate", type=click.FloatRange(min=0.1, max=10_000), default=40.0, show_default=True, metavar="N",
    expose_value=False, callback=_keep_rate,
    help="Connections begun per second, by all processes together, after the first --forks of them.",
)  # fmt: skip


_engine = click.option(
    "--engine", default="", metavar="tls://HOST:PORT", expose_value=False, callback=_keep_scheduler,
    help="Scheduler of a Dask cluster whose workers reach robots with srprov_site. See docs/sites.md.",
)  # fmt: skip


def FORKS(function: _F) -> _F:
    """Add --forks, and those of `SHARING`."""
    return _forks(SHARING(function))


def SHARING(function: _F) -> _F:
    """Add --workers, --connect-rate and --engine."""
    return _workers(_rate(_engine(function)))


def sharing() -> Sharing:
    """Return how the user wants connections to be shared."""
    from srprov.controller.fleet import ALONE, Sharing

    context = click.get_current_context(silent=True)
    if context is None:
        return ALONE
    return Sharing(
        workers=context.meta.get(_WORKERS, ALONE.workers),
        rate_per_s=context.meta.get(_RATE, ALONE.rate_per_s),
        scheduler=context.meta.get(_SCHEDULER, ALONE.scheduler),
    )
