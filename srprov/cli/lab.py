"""`srprov lab`: the verbs of the embedded lab.

Prints what lab/lab.py answers; knows nothing of how a robot is made.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

import click

from srprov.cli.output import err as say
from srprov.cli.output import out
from srprov.errors import UsageError
from srprov.lab import lab as labs
from srprov.lab.places import MOST_ROBOTS


@click.group()
def lab() -> None:
    """Robots on this machine, for tests and demonstrations (Linux, root)."""


@lab.command()
@click.option(
    "-n",
    "--robots",
    "count",
    type=click.IntRange(1, MOST_ROBOTS),
    help="How many robots (default 4).",
)
@click.option(
    "--spec",
    "spec_path",
    type=click.Path(path_type=Path),
    help="lab-spec.yml with the robots' options.",
)
@click.option("--user", type=click.Choice(["root", "robot"]), help="Who logs in, in the inventory.")
def up(count: int | None, spec_path: Path | None, user: str | None) -> None:
    """Make the lab as asked, and write inventory/lab.yml.

    Boots what is missing or dead, removes what is too many, and leaves the rest alone.
    """
    text = None
    if spec_path is not None:
        try:
            text = spec_path.read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"cannot read {spec_path}: {error}", hint="check --spec") from error
    booted = labs.up(labs.Wanted(count, text, str(spec_path or "lab-spec.yml"), user), say)
    seen = labs.status()
    say(f"{len(seen)} robots are ready" + ("" if booted else ", nothing to do"))


@lab.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def status(as_json: bool) -> None:
    """Show the robots and whether they are ready."""
    seen = labs.status()
    if as_json:
        out(json.dumps({"robots": {each.name: asdict(each) for each in seen}}, indent=2))
        return
    if not seen:
        out("the lab is down")
    for each in seen:
        memory = "" if each.memory is None else f"{each.memory / 2**20:6.0f} MiB"
        out(f"{each.name:<10} {each.address:<15} {each.state:<8} {memory}")


@lab.command()
def down() -> None:
    """Remove the lab: robots, disks, network, state. The images stay cached."""
    say("the lab is gone" if labs.down(say) else "the lab is down already")


@lab.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
@click.argument("robot")
@click.argument("command", nargs=-1, type=click.UNPROCESSED)
def shell(robot: str, command: tuple[str, ...]) -> None:
    """Enter a robot past its network and sshd, or run COMMAND there."""
    program = labs.shell(robot, command)
    sys.stdout.flush()
    os.execv(program[0], program)  # noqa: S606 - no shell is wanted: its exit code becomes ours


@lab.command()
@click.argument("robot")
def kill(robot: str) -> None:
    """End a robot at once, as by power loss. Its disk stays."""
    labs.kill(robot)
    say(f"{robot} is dead")


@lab.command()
@click.argument("robot")
def restart(robot: str) -> None:
    """Boot a robot again, dead or alive, with its disk kept."""
    labs.restart(robot)
    say(f"{robot} is ready")
