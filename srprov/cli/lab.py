"""`srprov lab`: the verbs of the embedded lab.

Prints what lab/lab.py answers; knows nothing of how a robot is made. Each verb gets the lab's name
from the group's option.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import click
import msgspec

from srprov import regular_file
from srprov.cli.output import err as say
from srprov.cli.output import out, out_json
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.lab import faults, overview, partition
from srprov.lab import lab as labs
from srprov.lab.places import MOST_ROBOTS, check_name
from srprov.lab.sites import find


def _checked(_context: click.Context, _option: click.Parameter, name: str) -> str:
    return check_name(name)


class _Whole(click.Group):
    """A group whose help has the whole first line of each verb: click cuts it after 45 characters."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(200)) for name, one in sorted(self.commands.items())])


@click.group(cls=_Whole)
@click.option(
    "--name",
    envvar="SRPROV_LAB",
    show_envvar=True,
    default="",
    callback=_checked,
    help="Which lab: several can be up side by side (default: the one without a name).",
)
@click.pass_context
def lab(context: click.Context, name: str) -> None:
    """Robots on this machine, for tests and demonstrations (Linux, root)."""
    context.obj = name


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
@click.pass_obj
def up(name: str, count: int | None, spec_path: Path | None, user: str | None) -> None:
    """Make the lab as asked, and write inventory/lab.yml (inventory/lab-NAME.yml for a lab with a name).

    Boots what is missing or dead, removes what is too many, and leaves the rest alone.
    """
    from srprov.definitions import refuse_link_out

    text = None
    if spec_path is not None:
        # of a project's link, a line of what it leads to would be shown where it is wrong
        refuse_link_out(str(spec_path), "--spec ")
        try:
            text = regular_file.read_text(spec_path)
        except OSError as error:
            raise UsageError(
                f"cannot read {spec_path}: {error.strerror}", hint="check --spec", code=Code.NO_FILE
            ) from error
    booted = labs.up(name, labs.Wanted(count, text, str(spec_path or "lab-spec.yml"), user), say)
    seen = overview.robots(name)
    say(f"{len(seen)} robots are ready" + ("" if booted else ", nothing to do"))
    say(f"use them with -i {os.path.relpath(find(name).inventory)}")


@lab.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
@click.pass_obj
def status(name: str, as_json: bool) -> None:
    """Show the robots and whether they are ready."""
    seen = overview.robots(name)
    if as_json:
        out_json({"robots": {each.name: msgspec.to_builtins(each) for each in seen}})
        return
    if not seen:
        out(f"{find(name).title} is down")
    for each in seen:
        memory = "" if each.memory is None else f"{each.memory / 2**20:6.0f} MiB"
        line = f"{each.name:<10} {each.address:<15} {each.state:<8} {memory:10}  {', '.join(each.faults)}"
        out(line.rstrip())


@lab.command("list")
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def list_labs(as_json: bool) -> None:
    """Show the labs that are up on this machine, whoever brought them up."""
    found = overview.labs()
    if as_json:
        out_json({"labs": [msgspec.to_builtins(each) for each in found]})
        return
    if not found:
        out("no lab is up")
    for each in found:
        dead = f", {each.robots - each.alive} dead" if each.alive < each.robots else ""
        robots = f"{each.robots} robot{'s' * (each.robots > 1)}{dead}"
        out(f"{each.name or '(no name)':<20} {robots:<18} {each.subnet:<16} {each.since}  {', '.join(each.folders)}")


@lab.command()
@click.pass_obj
def down(name: str) -> None:
    """Remove the lab: robots, disks, network, state. The images stay cached."""
    say(f"{find(name).title} is gone" if labs.down(name, say) else f"{find(name).title} is down already")


@lab.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
@click.argument("robot")
@click.argument("command", nargs=-1, type=click.UNPROCESSED)
@click.pass_obj
def shell(name: str, robot: str, command: tuple[str, ...]) -> None:
    """Enter a robot past its network and sshd, or run COMMAND there."""
    program = labs.shell(name, robot, command[1:] if command[:1] == ("--",) else command)
    sys.stdout.flush()
    os.execv(program[0], program)  # noqa: S606 - no shell is wanted: its exit code becomes ours


@lab.command()
@click.argument("robot")
@click.option("--docker", is_flag=True, help="Only its Docker engine, as by a crash; it comes back two seconds later.")
@click.pass_obj
def kill(name: str, robot: str, docker: bool) -> None:
    """End a robot at once, as by power loss. Its disk stays."""
    if docker:
        faults.kill_engine(find(name), robot)
        say(f"{robot}: dockerd was killed")
    else:
        labs.kill(name, robot)
        say(f"{robot} is dead")


@lab.command("stop-docker")
@click.argument("robot")
@click.pass_obj
def stop_docker(name: str, robot: str) -> None:
    """Stop a robot's Docker engine. It stays down until `restart`, with or without --docker, or `up`."""
    faults.stop_engine(find(name), robot)
    say(f"{robot}: dockerd is stopped")


@lab.command()
@click.argument("robot")
@click.option("--docker", is_flag=True, help="Only its Docker engine.")
@click.pass_obj
def restart(name: str, robot: str, docker: bool) -> None:
    """Boot a robot again, dead or alive, with its disk kept."""
    if docker:
        faults.restart_engine(find(name), robot)
        say(f"{robot}: dockerd is ready")
    else:
        labs.restart(name, robot)
        say(f"{robot} is ready")


@lab.command()
@click.argument("robot")
@click.option(
    "--offset", type=float, required=True, metavar="SECONDS", help="From the right time, e.g. -1.5; 0 is right."
)
@click.pass_obj
def clock(name: str, robot: str, offset: float) -> None:
    """Set a robot's clock, for whoever asks `date`, until the robot restarts or `up`."""
    faults.set_clock(find(name), robot, offset)
    say(f"{robot}: its clock is {offset:+g} s off")


def _other(what: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    text = f"{what} this robot, or `{partition.CONTROLLER}` (default: everybody)."
    return click.option("--from", "other", metavar="ROBOT", default=partition.ALL, help=text)


@lab.command("partition")
@click.argument("robot")
@_other("Only from")
@click.pass_obj
def partition_robot(name: str, robot: str, other: str) -> None:
    """Cut a robot off without a word: packets vanish, connections hang.

    It stays cut off while it is dead or restarts, until `heal` or `up`.
    """
    faults.cut(find(name), robot, other)
    say(f"{robot} is cut off from {other}")


@lab.command()
@click.argument("robot")
@_other("Only the partition from")
@click.pass_obj
def heal(name: str, robot: str, other: str) -> None:
    """Undo `partition`; without --from, whatever cuts the robot off."""
    say(f"{robot} is healed" if faults.heal(find(name), robot, other) else f"{robot} is not cut off from {other}")
