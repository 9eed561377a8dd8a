"""`srprov`: the verbs, each loaded only when it is called, and the one place that turns errors into exit codes."""

from __future__ import annotations

import atexit
import errno
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

import click

from srprov import __version__
from srprov.cli import output
from srprov.cli.codes import BUG, INTERRUPTED, USAGE
from srprov.cli.config import default_map
from srprov.cli.interrupt import as_interrupt
from srprov.cli.output import Answer, below, err, err_whole, print_uncaught
from srprov.cli.streams import lost, protect_standard_streams
from srprov.cli.surroundings import keep_to_whole_paths
from srprov.cli.variables import name_variables
from srprov.codes import Code
from srprov.errors import DefinitionError, NoAssignment, SrprovError, TransportError, UsageError, visible

_VERBS = {
    "init": "Write the files of a new experiment.",
    "validate": "Check definition files; no robot is asked.",
    "fmt": "Bring EDFs and CDFs into one form; no robot is asked.",
    "facts": "Show the robots as they are.",
    "doctor": "Check that each robot has what srprov needs, and say how to get it.",
    "assign": "Show which robot would run which service, and why.",
    "lock": "Write down what tags and branches are now, for plan and apply.",
    "build": "Bring images to the robots ahead of apply, or show their Dockerfiles.",
    "plan": "Show what would change; changes nothing.",
    "diff": "Show what a change of an EDF would change; no robot is asked.",
    "apply": "Change the robots so that the experiment runs on them.",
    "trials": "List the experiment's trials; no robot is asked.",
    "run": "Run the experiment's trials, and bring home what they give.",
    "runs": "List the runs that were recorded, or show what one did; no robot is asked.",
    "report": "Write a run, a plan or a bundle as one HTML page; no robot is asked.",
    "bundle": "Pack a run of trials into one file that others can check.",
    "verify": "Check such a file: its hashes, and all that can be worked out again; no robot is asked.",
    "compare": "Say what is the same in two runs of trials, and what is not; no robot is asked.",
    "replay": "Run the trials of such a file again, on other robots, and compare.",
    "status": "Show the running experiment.",
    "snapshot": "Write an experiment from robots that were set up by hand.",
    "probe": "Try the overlay: whether all robots and services reach each other, and why not.",
    "images": "Show the images that srprov built on robots; prune: remove what nobody uses.",
    "wait": "Wait until jobs have completed, services are healthy, or something was printed.",
    "exec": "Run a command in a service's container.",
    "cp": "Copy files from a service's container, or into one.",
    "ssh": "Log in on a robot, as srprov does.",
    "logs": "Show the output of services.",
    "collect": "Bring home the results, logs and facts of the running experiment.",
    "restart": "Stop services and start them again.",
    "stop": "Stop services; their containers stay.",
    "start": "Start services that were stopped.",
    "locks": "Show who is changing which robot.",
    "destroy": "Remove everything that an instance owns.",
    "import": "Make an experiment of Docker Compose or SwarmRob files; no robot is asked.",
    "export": "Write an experiment for Docker Compose, Docker Swarm or Kubernetes.",
    "worker": "Serve the robots of a site to those who run experiments elsewhere.",
    "lab": "The embedded lab: robots on this machine.",
    "schema": "Print a JSON Schema.",
    "explain": "Say what the code of an error means, with examples and what to do.",
    "config": "Show every setting with its value, and where that comes from.",
    "completion": "Print a script that completes command lines in bash, zsh or fish.",
    "man": "Print the manual page: every verb and option.",
}

_MODULES = {"import": "importing", "config": "configured"}
"""Verbs whose names no module or no function can have -> the name of both."""


class _LazyGroup(click.Group):
    """The group of verbs. It knows each by its name and one line, and imports its file when it is used."""

    lines = _VERBS

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _VERBS:
            return None
        name = _MODULES.get(cmd_name, cmd_name)
        command = getattr(importlib.import_module(f"srprov.cli.{name}"), name)
        assert isinstance(command, click.Command)
        name_variables(command, f"SRPROV_{cmd_name.upper()}")
        defaults = (ctx.default_map or {}).get(cmd_name, {})
        for one in command.params:
            if isinstance(one, click.Option) and one.is_flag and type(defaults.get(one.name)) in (int, float):
                defaults[one.name] = str(defaults[one.name])  # click takes no number for yes or no
        return command

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:  # click would take it for standard output's, and exit without a word
            raise ConnectionError("a connection broke") from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl(list(_VERBS.items()))
        with formatter.section("Example"):
            formatter.write_text("srprov apply experiment.edf -i inventory.yml")


@click.group(cls=_LazyGroup, context_settings={"auto_envvar_prefix": "SRPROV", "help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="srprov")
def cli() -> None:
    """Provision multi-robot experiments over SSH, without agents."""


def run(arguments: list[str] | None = None) -> int:
    """Run one command line and return its exit code; whatever goes wrong becomes a message and a documented code."""
    keep_to_whole_paths(os.environ)
    try:
        completes = (sys.argv[1:] if arguments is None else arguments)[:1] == ["completion"]
        # a line is completed where a configuration file has a mistake, too
        defaults = {} if completes else default_map(_VERBS, _here(), os.environ)
        result = cli.main(args=arguments, prog_name="srprov", standalone_mode=False, default_map=defaults)
    except click.exceptions.Exit as stop:
        return int(stop.exit_code)
    except (click.Abort, KeyboardInterrupt):
        err("interrupted")
        return INTERRUPTED
    except click.ClickException as error:
        _show_misuse(error, sys.argv[1:] if arguments is None else arguments)
        return USAGE
    except SrprovError as error:
        show_error(error)
        _point_to_page(error.code)
        return error.exit_code
    except Exception:
        err(traceback.format_exc())
        err(f"error[{Code.BUG}]: this is a bug in srprov; please report it with the lines above")
        return BUG
    return result if isinstance(result, int) else 0


def _here() -> Path:
    try:
        return Path.cwd()
    except OSError as error:
        why = f"the folder in which you are cannot be named: {error.strerror}"
        raise UsageError(why, hint="somebody removed it: cd to another one", code=Code.NO_FILE) from error


def _show_misuse(error: click.ClickException, words: Sequence[str]) -> None:
    """Print what is wrong with a command line: first a file that is not there, at last what the verb takes."""
    from srprov.cli.misuse import as_error, missing_files

    told = as_error(error)
    of_file = told.code in (Code.NO_FILE, Code.CANNOT_WRITE)
    for one in () if of_file else missing_files(words):
        show_error(one)
    show_error(told)
    if isinstance(error, click.UsageError) and error.ctx and not of_file:
        err(f"  {' '.join(error.ctx.get_usage().split())}")


def _point_to_page(code: Code) -> None:
    """Say where more is said, to a person: a log has the code."""
    if sys.stderr.isatty():
        err(f"srprov explain {code}  says more")


def show_error(error: SrprovError) -> None:
    """Print an error with all that it carries and what to do next."""
    tell = err_whole if error.code is Code.NOT_ALLOWED else err
    if isinstance(error, DefinitionError):
        from srprov.cli.problems import render_problems

        err(render_problems(error.problems))
        err(f"error: {error.message}")
    else:
        robot = error.host if isinstance(error, TransportError) else ""
        who = f"{robot}: " if robot and robot not in error.message else ""
        tell(f"error[{error.code}]: {who}{below(error.message)}")
    if isinstance(error, NoAssignment):
        for service, reasons in sorted(error.misses.items()):
            for robot, reason in sorted(reasons.items()):
                err(f"  {service} cannot run on {robot}: {visible(reason)}")
    if error.hint:
        tell(f"  {visible(error.hint)}")


def code_of_output(code: int) -> int:
    """Return the exit code of a run, or 5 instead of 0 when its answer could not be written."""
    error = lost(sys.stdout)
    if error is None:
        return code
    reader_left = error.errno == errno.EPIPE
    needed = output.expected is Answer.WHOLE or (output.expected is Answer.TEXT and not reader_left)
    if not reader_left:
        word = f"error[{Code.CANNOT_WRITE}]" if needed else "warning"
        err(f"{word}: standard output cannot be written: {error.strerror}")
    return code or (USAGE if needed else 0)


def keep_to_ourselves() -> None:
    """Let nothing that this process writes, or leaves when it crashes, be read by others on this machine."""
    import resource

    os.umask(0o077)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # secrets are in memory


def _end(codes: list[int]) -> None:
    """End the process without taking the interpreter apart.

    That would end threads which still read, and aborts the process when one is in C++ (google-re2) just then.
    """
    if codes:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(codes[0])


def entry() -> None:
    """Run the `srprov` command and exit with its code."""
    codes: list[int] = []
    atexit.register(_end, codes)  # the first of all, so it is called last
    if sys.argv[1:2] != ["lab"]:  # its robots are made of files that all of their users read
        keep_to_ourselves()
    # a run is short and keeps nearly all of its objects: looking for cycles every 700 of them costs 5 % of a small run
    gc.set_threshold(100_000, 50, 100)
    protect_standard_streams()
    as_interrupt()
    print_uncaught()
    code = code_of_output(run())
    gc.freeze()  # or the interpreter looks through everything for cycles before it ends: 7 % of a small run
    codes.append(code)
    sys.exit(code)


if __name__ == "__main__":
    entry()
