"""`srprov exec`: a command in a service's container, with its streams and its exit code."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from srprov.cli import inputs, options
from srprov.cli.attached import NOT_RUN, check_inventories, check_terminal, in_one_word, of_no_use, passed_on
from srprov.cli.main import show_error
from srprov.cli.output import err
from srprov.codes import Code
from srprov.errors import SrprovError
from srprov.session import Exec

if TYPE_CHECKING:
    from srprov.controller.located import Located
    from srprov.session import Session


def _settings(_context: click.Context, _option: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
    for one in given:
        if not one.partition("=")[1] or one.startswith("="):
            raise click.BadParameter(f"'{one}' is not NAME=VALUE")
    return given


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("service", metavar="SERVICE[@ROBOT]")
@click.argument("command", metavar="-- COMMAND...", nargs=-1, required=True)
@options.robots_without_json
@options.INSTANCE
@click.option("-e", "--env", multiple=True, metavar="NAME=VALUE", callback=_settings,
              help="A variable of the command; may be repeated.")  # fmt: skip
@click.option("-u", "--user", default="", help="User, or UID, with a group after a colon (default: the container's).")
@click.option("-w", "--workdir", default="", metavar="DIR", help="Folder in the container.")
@click.option("-t", "--tty", is_flag=True, help="Give the command your terminal, with Ctrl-C and its size.")
def exec(
    file: str, service: str, command: tuple[str, ...], inventories: tuple[str, ...], forks: int, timeout: float,
    instance: str, env: tuple[str, ...], user: str, workdir: str, tty: bool,
) -> int:  # fmt: skip
    """Run a command in the container of a service, and end with its exit code; with 255 when it could not be run.

    A command line that srprov does not understand ends with 5.

    SERVICE is a name of the EDF that runs once, a replica, or SERVICE@ROBOT. The command's words are passed on as they
    are, without a shell. Standard input is passed on unless it is a terminal; with -t, a terminal is.
    """
    what = Exec(
        command=command, environment=env, user=user, folder=workdir, stdin=tty or not sys.stdin.isatty(),
        terminal=tty,
    )  # fmt: skip
    check_inventories(inventories)
    try:
        check_terminal(tty)
        return _run(file, service, inventories, forks, timeout, instance, what)
    except SrprovError as error:
        show_error(error)
        return NOT_RUN


def _run(
    file: str, service: str, inventories: tuple[str, ...], forks: int, timeout: float, instance: str, what: Exec
) -> int:
    from srprov.controller.located import locate
    from srprov.controller.sent_to import trusted
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    experiment = inputs.experiment_if_valid(file)
    with inputs.connect(inventory, timeout, forks) as fleet:
        where = trusted(locate(fleet.gather(Detail.BASIC), name, experiment), service, source)
        return _attached(fleet.sessions.get(where.host), where, what)


def _attached(session: Session, where: Located, what: Exec) -> int:
    """Run it, and pass its streams on."""
    if useless := of_no_use(what.command, terminal=what.terminal):
        err(f"note: {useless}")
    running = session.run_in(where.container, what)
    code = passed_on(running, stdin=what.stdin, terminal=what.terminal)
    if code is None:
        err(f"error[{Code.COMMAND}]: {where.where}: the command could not be run")
        if hint := in_one_word(what.command):
            err(f"  {hint}")
    return NOT_RUN if code is None else code
