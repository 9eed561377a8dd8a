"""`srprov lab`: the verbs of the embedded lab.

Prints what lab/lab.py answers; knows nothing of how a robot is made.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import click

from srprov.cli.output import err as say
from srprov.cli.output import out, out_json
from srprov.errors import UsageError
from srprov.lab import faults, partition
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
        out_json({"robots": {each.name: asdict(each) for each in seen}})
        return
    if not seen:
        out("the lab is down")
    for each in seen:
        memory = "" if each.memory is None else f"{each.memory / 2**20:6.0f} MiB"
        line = f"{each.name:<10} {each.address:<15} {each.state:<8} {memory:10}  {', '.join(each.faults)}"
        out(line.rstrip())


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
@click.option("--docker", is_flag=True, help="Only its Docker engine, as by a crash; it comes back two seconds later.")
def kill(robot: str, docker: bool) -> None:
    """End a robot at once, as by power loss. Its disk stays."""
    if docker:
        faults.kill_engine(robot)
        say(f"{robot}: dockerd was killed")
    else:
        labs.kill(robot)
        say(f"{robot} is dead")


@lab.command("stop-docker")
@click.argument("robot")
def stop_docker(robot: str) -> None:
    """Stop a robot's Docker engine. It stays down until `restart`, with or without --docker, or `up`."""
    faults.stop_engine(robot)
    say(f"{robot}: dockerd is stopped")


@lab.command()
@click.argument("robot")
@click.option("--docker", is_flag=True, help="Only its Docker engine.")
def restart(robot: str, docker: bool) -> None:
    """Boot a robot again, dead or alive, with its disk kept."""
    if docker:
        faults.restart_engine(robot)
        say(f"{robot}: dockerd is ready")
    else:
        labs.restart(robot)
        say(f"{robot} is ready")


def _other(what: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    text = f"{what} this robot, or `{partition.CONTROLLER}` (default: everybody)."
    return click.option("--from", "other", metavar="ROBOT", default=partition.ALL, help=text)


@lab.command("partition")
@click.argument("robot")
@_other("Only from")
def partition_robot(robot: str, other: str) -> None:
    """Cut a robot off without a word: packets vanish, connections hang.

    It stays cut off while it is dead or restarts, until `heal` or `up`.
    """
    faults.cut(robot, other)
    say(f"{robot} is cut off from {other}")


@lab.command()
@click.argument("robot")
@_other("Only the partition from")
def heal(robot: str, other: str) -> None:
    """Undo `partition`; without --from, whatever cuts the robot off."""
    say(f"{robot} is healed" if faults.heal(robot, other) else f"{robot} is not cut off from {other}")
