"""`srprov ssh`: a shell on a robot, reached as srprov reaches it."""

from __future__ import annotations

import os
import sys

import click

from srprov.cli import inputs, options
from srprov.cli.attached import NOT_RUN, check_inventories, check_terminal, in_one_word, passed_on
from srprov.cli.main import show_error
from srprov.cli.output import catch_logs, err
from srprov.codes import Code
from srprov.errors import SrprovError

_NOT_FOUND = 127
"""What a shell ends with when there is no such command."""


@click.command()
@click.argument("robot", metavar="ROBOT")
@click.argument("command", metavar="[-- COMMAND...]", nargs=-1)
@options.INVENTORY
@options.TIMEOUT
@click.option("-t", "--tty", is_flag=True, help="Give a command your terminal too; a shell has it anyway.")
def ssh(robot: str, command: tuple[str, ...], inventories: tuple[str, ...], timeout: float, tty: bool) -> int:
    """Log in on a robot: a shell, or COMMAND; end with its exit code, with 255 when there was none.

    Address, port, user, keys, password, jump hosts and host keys are those of the inventory and of your ssh
    configuration, as for every verb. The command's words reach the robot as they are; for pipes and wildcards:
    -- sh -c 'ls /bags | wc -l'. A command line that srprov does not understand ends with 5.
    """
    check_inventories(inventories)
    try:
        check_terminal(tty)
        return _logged_in(robot, command, inventories, timeout, tty=tty)
    except SrprovError as error:
        show_error(error)
        return NOT_RUN


def _logged_in(robot: str, command: tuple[str, ...], inventories: tuple[str, ...], timeout: float, *, tty: bool) -> int:
    from srprov.controller.login import log_in, robot_of

    catch_logs()
    host = robot_of(inputs.load_inventory(inventories), robot)
    here = sys.stdin.isatty() and sys.stdout.isatty()
    terminal = tty or (here and not command)
    kind = os.environ.get("TERM", "")[:64] or "dumb"
    running = log_in(host, command, terminal=kind if terminal else "", timeout_s=timeout)
    code = passed_on(running, stdin=terminal or not sys.stdin.isatty() or not command, terminal=terminal)
    if code is None:
        err(f"error[{Code.COMMAND}]: {robot}: a signal ended it")
    if code == _NOT_FOUND and (hint := in_one_word(command)):
        err(f"note: {hint}")
    return NOT_RUN if code is None else code
