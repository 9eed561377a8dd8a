"""Inventories with which nothing else is read: names with a comma (`-i robot1,robot2,`), files that say so, records.

Who gives names alone has named no file. So none is read for them: neither variables that lie in the folder at hand, nor
a file that is called so. That folder may be a project of a stranger's, whose variables would run a program here. So it
is with an inventory that srprov wrote in such a folder: what lies beside it may have come later, as by `git pull`. And
so it is with that of a record, beside which lies what the experiment shipped; all of it may be a stranger's folder.
Looks at the file system.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Iterable
from shlex import quote
from types import MappingProxyType

from msgspec.structs import replace

from srprov import own_records
from srprov.codes import Code
from srprov.definitions.model import BUILDERS, Host, Inventory
from srprov.definitions.script import is_program
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.regular_file import WHOLE, variables_beside
from srprov.secret import MASK

_RECORDED = ("inputs", "inventory.yml")
"""Where a record has what srprov read of the inventory: what the user names then is a name that srprov gave."""


def are_names(path: str) -> bool:
    """Return whether what stands in an inventory's place are names: with a comma, and no path that is there."""
    return "," in path and ("/" not in path or not os.path.exists(path))


def split(path: str) -> list[str]:
    """Return the names.

    Raises:
        DefinitionError: A file is called so.
    """
    if os.path.lexists(path):
        message = "are names of robots and the name of a file, too, which may be a stranger's"
        hint = f"if you mean the file: -i ./{quote(path)}"
        raise _refused(path, message, hint)
    return [name.strip() for name in path.split(",") if name.strip()]


def check_nothing_beside(paths: Collection[str], folders: Collection[str]) -> None:
    """Refuse names where Ansible would read variables for them, from the folder at hand; and what no record has.

    Args:
        paths: All that stands in an inventory's place.
        folders: Those of which variables are read anyway, since an inventory that lies there was named.

    Raises:
        DefinitionError: There are variables, also beside the inventory of a record; or that is a program, or a folder;
            or the folder that it lies in was named.
    """
    for path in paths:
        _check_recorded(path)
    here = os.path.realpath(os.curdir)
    given = next(filter(are_names, paths), "")
    if given and here not in map(os.path.realpath, folders) and (beside := variables_beside(os.curdir)):
        message = f"are names alone, for which {os.path.normpath(beside)} is not read: it may be a stranger's"
        hint = "write the names into a file beside it and name that; or work in another folder"
        raise _refused(given, message, hint)


def _check_recorded(path: str) -> None:
    """Refuse the inventory of a record that is to be run, or with which variables would be read."""
    if not (file := _recorded(path)):
        return
    what = "a folder" if os.path.isdir(file) else "a program" if is_program(file) else ""
    if what:
        message = f"is the inventory of a record, and {what}: srprov writes none, so somebody else did"
        raise _refused(path, message, "if it is yours, and no record's, give it another name")
    if beside := variables_beside(os.path.dirname(file)):
        message = "is the inventory of a record, with which nothing is read,"
        message = f"{message} and {os.path.relpath(beside)} would be: it may be a stranger's"
        raise _refused(path, message, "copy it to another folder, and name the copy")
    if os.path.isdir(path):
        message = "is the folder of a record, of which all files would be read: an experiment shipped them"
        hint = f"name the inventory in it: -i {quote(os.path.join(path, _RECORDED[1]))}"
        raise _refused(path, message, hint)


def check_no_command(paths: Collection[str], hosts: Iterable[Host]) -> None:
    """Refuse a ProxyCommand with the inventory of a record: srprov writes `***` there, which nobody runs.

    Raises:
        DefinitionError: A host has one.
    """
    recorded = next(filter(_recorded, paths), "")
    for host in hosts if recorded else ():
        if any(name == "proxycommand" and value != MASK for name, value in host.ssh_options):
            message = f"is the inventory of a record, and '{host.name}' has a ProxyCommand: srprov writes none"
            raise _refused(
                recorded, message, "name your own inventory; or copy this one to another folder, if you trust it"
            )


def of_records(paths: Collection[str], found: Inventory) -> Inventory:
    """Return an inventory in which the record of another machine says only where robots are, and who logs in there.

    Options of ssh name files that are written to, as with new host keys, `local` means this machine, and who names such
    a record means robots of his own: so their keys and host keys are those of his own settings of ssh.
    """
    strange = next((path for path in paths if (file := _recorded(path)) and not own_records.is_known(file)), "")
    if not strange:
        return found
    hosts = {name: _place_of(host) for name, host in found.hosts.items()}
    groups = {name: robots for name, robots in found.groups.items() if name != BUILDERS}  # who builds is trusted by all
    return replace(
        found, hosts=MappingProxyType(hosts), groups=MappingProxyType(groups), named=False, strange_record=strange
    )


def _place_of(host: Host) -> Host:
    hidden = tuple(one for one in host.ssh_options if one == ("proxycommand", MASK))  # by which no robot is reached
    return replace(
        host, identity_file=None, password=None, become_password=None, connection="ssh", ssh_options=hidden
    )  # fmt: skip


def is_of_record(path: str) -> bool:
    """Return whether a path is that of the inventory of a record: it has many robots in a line, and runs nothing."""
    return bool(_recorded(path))


def _recorded(path: str) -> str:
    """Return the file that is meant if it is the inventory of a record, or nothing."""
    names = [os.path.normpath(os.path.join(here, path)) for here in _here()]
    return next((one for name in names for one in (name, f"{name}/{_RECORDED[1]}") if _is_recorded(one)), "")


def _is_recorded(file: str) -> bool:
    return tuple(file.split(os.sep)[-2:]) == _RECORDED and os.path.lexists(file)


def _here() -> list[str]:
    """Return this folder, also as the shell has it: who went there by a link named that."""
    here, shell = os.getcwd(), os.environ.get("PWD", "")
    with contextlib.suppress(OSError, ValueError):
        if os.path.isabs(shell) and os.path.samefile(shell, here):
            return [here, shell]
    return [here]


def check_whole(path: str, text: str) -> None:
    """Refuse an inventory that says to be read alone, where variables would be read with it.

    Raises:
        DefinitionError: There are variables.
    """
    lines = text.splitlines()
    if WHOLE in lines and (beside := variables_beside(os.path.dirname(path) or os.curdir)):
        message = f"says that nothing is read with it, and {os.path.relpath(beside)} would be: it may be a stranger's"
        raise _refused(path, message, "if it is yours, take this line away", line=lines.index(WHOLE) + 1)


def _refused(path: str, message: str, hint: str, line: int = 1) -> DefinitionError:
    return DefinitionError([Diagnostic(Location(path, line), message, hint=hint, code=Code.UNNAMED_INVENTORY)])
