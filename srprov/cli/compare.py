"""`srprov compare`: what is the same in two runs, and what is not."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import click
import msgspec

from srprov.cli import options
from srprov.cli.codes import DIFFERENCES
from srprov.cli.output import err, out, out_json
from srprov.codes import Code
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.definitions.trialsmodel import Margin
    from srprov.evidence.grades import Section
    from srprov.evidence.verified import Bundle

_EXISTING = click.Path(exists=True)


MARGINS = click.option(
    "--margin", "margins", multiple=True, metavar="METRIC=VALUE",
    help="How much METRIC may differ and still count as equal: 0.5 in its unit, or 10% of A's. May be repeated. "
    "The metric `success` is the share of trials with that verdict.",
)  # fmt: skip
STRICT = click.option("--strict", is_flag=True, help="Exit with 2 also when it is inconclusive.")


@click.command()
@click.argument("runs", metavar="A... [B]", nargs=-1, required=True, type=_EXISTING)
@click.option(
    "--with", "others", multiple=True, type=_EXISTING, metavar="B",
    help="A run of the other side; may be repeated. Without it, there are two runs, A and B.",
)  # fmt: skip
@MARGINS
@STRICT
@options.JSON
def compare(
    runs: tuple[str, ...], others: tuple[str, ...], margins: tuple[str, ...], *, strict: bool, as_json: bool
) -> int:
    """Compare runs of trials: what was run, where, and what came of it.

    A and B are folders of runs, or bundles. Exits with 0 when they are identical or equivalent, and when nobody can
    tell; with 2 when they differ.
    """
    if not others and len(runs) != 2:
        hint = "name two runs, or those of the other side by --with"
        raise UsageError(f"{len(runs)} runs make no two sides", hint=hint, code=Code.OPTIONS)
    a, b = (runs, others) if others else (runs[:1], runs[1:])
    return show_comparison(a, b, margins_of(margins), strict=strict, as_json=as_json)


def show_comparison(
    a: Sequence[str], b: Sequence[str], margins: Mapping[str, Margin], *, strict: bool, as_json: bool,
    only: Collection[str] = (), verified: Collection[Bundle] = (),
) -> int:  # fmt: skip
    """Compare two sides, say what came of it, and return the exit code.

    Raises:
        UsageError: A run cannot be read, or no run has a metric that a margin names.
    """
    from srprov.evidence.compare import compare as of
    from srprov.evidence.grades import DIFFERENT, INCONCLUSIVE

    found = of(a, b, margins, only, verified)
    failed = found.answer == DIFFERENT or (strict and found.answer == INCONCLUSIVE)
    if as_json:
        sections = [{"grade": one.grade, **msgspec.to_builtins(one)} for one in found.sections]
        out_json({"a": list(a), "b": list(b), "answer": found.answer, "sections": sections, "notes": list(found.notes)})
        return DIFFERENCES if failed else 0
    for decides in (True, False):
        out("what decides:" if decides else "\nwhat informs:")
        out("\n".join(line for one in found.sections if one.decides is decides for line in _lines(one)))
    why = [one.id for one in found.sections if one.decides and one.grade in (found.answer, "unknown")]
    out(f"\n{found.answer}" + (f": {', '.join(why)}" if found.answer in (DIFFERENT, INCONCLUSIVE) else ""))
    err("\n".join(found.notes))
    return DIFFERENCES if failed else 0


def margins_of(texts: Iterable[str]) -> dict[str, Margin]:
    """Return metric -> margin.

    Raises:
        UsageError: One is none.
    """
    return dict(map(_margin, texts))


def _lines(one: Section) -> list[str]:
    """Return a section in lines; what is identical is counted, not listed."""
    same = [line for line in one.lines if line.grade == "identical"]
    head = f"  {one.id:<12} {one.grade:<13} {one.what}"
    if len(same) == len(one.lines):
        return [head]
    rest = [f"    {line.grade:<13} {line.subject}: {line.text}" for line in one.lines if line.grade != "identical"]
    return [head, *rest, *([f"    {'identical':<13} {len(same)} more"] if same else [])]


def _margin(text: str) -> tuple[str, Margin]:
    """Read METRIC=VALUE."""
    from srprov.definitions.trialsmodel import Margin

    name, _, value = text.partition("=")
    relative = value.endswith("%")
    try:
        number = float(value.removesuffix("%")) / (100 if relative else 1)
    except ValueError:
        number = math.nan
    if not name or not 0 < number < (1 if relative else math.inf):
        raise UsageError(
            f"--margin {text} is none",
            hint="for example --margin time=0.5, or --margin time=10%",
            code=Code.OPTION_VALUE,
        )
    return name, Margin(number, relative)
