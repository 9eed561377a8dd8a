"""`srprov trials`: which trials an experiment has; no robot is asked."""

from __future__ import annotations

from typing import Any

import click

from srprov.cli import inputs, options
from srprov.cli.output import err, out, out_json
from srprov.cli.status import table


@click.command()
@click.argument("file", metavar="FILE")
@options.JSON
def trials(file: str, as_json: bool) -> int:
    """List the trials that `srprov run` runs: in order, with ids, seeds and parameters. No robot is asked.

    `run --only` takes the ids in the columns TRIAL and POINT.
    """
    from srprov.controller.trial_values import listed

    experiment = inputs.load_experiment(file).experiment
    rows, notes = listed(experiment)
    if as_json:
        out_json({"experiment": experiment.name, "trials": rows})
    else:
        out(table([_shown(row) for row in rows], ("order", "trial", "point", "repetition", "seed", "parameters")))
    err("\n".join(notes))
    return 0


def _shown(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "parameters": " ".join(f"{name}={value}" for name, value in row["parameters"].items())}
