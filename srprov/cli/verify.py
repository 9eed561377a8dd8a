"""`srprov verify`: whether a bundle is what it says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import msgspec

from srprov.cli import options
from srprov.cli.codes import DIFFERENCES
from srprov.cli.output import err, out, out_json
from srprov.cli.standing import signers_option

if TYPE_CHECKING:
    from srprov.evidence.verify import Finding

_MARKS = {"pass": "ok  ", "fail": "FAIL", "skipped": "-   ", "info": "    "}


@click.command()
@click.argument("bundle", metavar="BUNDLE", type=click.Path(exists=True, dir_okay=False))
@signers_option("Whose signature counts: an allowed_signers file, see ssh-keygen(1). Without one of theirs it fails.")
@options.JSON
def verify(bundle: str, signers: str | None, as_json: bool) -> int:
    """Check a bundle: its hashes, and all that can be worked out again from its files.

    No robot is asked, no network is used, and nothing that the bundle holds is run. Exits with 2 when something is
    not as it should be, with 5 when the file is no bundle.
    """
    from srprov.evidence.verify import verify as check

    report = check(bundle, signers or "")
    if as_json:
        findings = [msgspec.to_builtins(one) for one in report.findings]
        out_json({"bundle": bundle, "run": report.run, "failed": report.failed, "findings": findings,
                  "unproven": list(report.unproven)})  # fmt: skip
        return DIFFERENCES if report.failed else 0
    for one in sorted(report.findings, key=lambda one: one.result != "fail"):
        out("\n".join(_lines(one)))
    err("it does not show " + ";\nnor ".join(report.unproven))
    return DIFFERENCES if report.failed else 0


def _lines(one: Finding) -> list[str]:
    """Return a check in lines: the first says what came of it."""
    head = f"{_MARKS[one.result]} {one.id:<3} {one.what}"
    if one.result in ("skipped", "info"):
        return [f"{head}: {'; '.join(one.details)}"]
    return [head, *(f"         {detail}" for detail in one.details)]
