"""Secrets as files in a robot's memory: below MEMORY_ROOT, mounted read-only into the containers that list them.

The resource's name is the absolute path. `with_value` adds the value after rendering: neither a playbook nor a plan
file ever holds it. What differs is found by comparing hashes in memory; no text says more than that it does. A new
value goes into the same inode, so that containers see it and none is restarted.

After a reboot the memory is empty, and the files are `not there`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import msgspec
from msgspec.structs import replace

from srprov.modules.container_form import WORD
from srprov.modules.differences import HIDDEN
from srprov.modules.file import remove_path
from srprov.modules.module import MEMORY_ROOT, Module, Names
from srprov.modules.params import NOT_WRITTEN, Mode
from srprov.resource import Action, Change, Difference, Observed, Resource, State
from srprov.robot_answers import all_lines
from srprov.secret import Hidden, Secret, Vault
from srprov.wire import AnyQuery, Command, Put, Query, Reply

_FIND = "find . -mindepth 3 -maxdepth 3 -path './*/secrets/*' -type f -exec"
_ANY = 'set -- */secrets; [ -e "$1" ]'
# where there are none, no program is started; and it cannot fail: what a failed command printed is shown
_SHOW = f"{_FIND} stat -c '%a %n' {{}} +; {_FIND} sha256sum {{}} +"
_LIST = f"cd {MEMORY_ROOT} 2>/dev/null && {_ANY} || exit 0; {_SHOW}; exit 0"
_PARTS = 3
_PERMISSIONS = 0o777
"""No setuid bit."""
_SHA_DIGITS = hashlib.sha256().digest_size * 2


def secret_path(instance: str, name: str, mode: str) -> str:
    """Return the place of a secret on a robot; services that want it with different permissions get a file each."""
    return f"{MEMORY_ROOT}/{instance}/secrets/{name}" + ("" if mode == "0400" else f"@{mode}")


def with_value(want: Resource, vault: Vault) -> Resource:
    """Return a wanted secret with its value; any other resource as it is."""
    if not isinstance(want.params, SecretParams):
        return want
    return replace(want, params=replace(want.params, value=vault[want.params.name]))


def names_of(wants: Iterable[Resource]) -> set[str]:
    """Return the names of the secrets among wanted resources."""
    return {want.params.name for want in wants if isinstance(want.params, SecretParams)}


class SecretParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a secret."""

    name: str
    mode: Mode
    value: Annotated[Secret | None, NOT_WRITTEN] = None
    """Added by `with_value`."""


class SecretModule(Module[SecretParams]):
    """The module of kind `secret`."""

    kind = "secret"
    params = SecretParams
    root = MEMORY_ROOT

    def queries(self) -> tuple[AnyQuery, ...]:
        """Return permissions and hash of every secret, of all instances."""
        return (Query(command=_LIST),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read `400 ./instance/secrets/name` and `sha256  ./instance/secrets/name` lines; a half-written one counts."""
        modes: dict[str, str] = {}
        found = []
        for line in all_lines(replies[0].out):
            word, _, path = line.partition(" ")
            path = path.removeprefix(" ")
            parts = path.removeprefix("./").split("/")
            if len(parts) != _PARTS or parts[1] != "secrets":
                continue
            if len(word) != _SHA_DIGITS:
                modes[path] = word.zfill(4)[:8]
                continue
            state = {"digest": Hidden(word), "mode": modes.get(path, "")}
            name = f"{MEMORY_ROOT}/{'/'.join(parts)}"
            found.append(Observed(module="secret", name=name, instance=parts[0], state=state))
        return tuple(found)

    def check(self, name: str, want: SecretParams, found: State | None) -> Change | None:
        """Compare hashes, and say no more than that they differ; the command holds a placeholder for the value."""
        write = (Put(path=name, secret=want.name, mode=want.mode, in_place=found is not None),)
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=write)
        if want.value is None or found["digest"] != want.value.digest():
            return Change(action=Action.UPDATE, cause="secret differs", before=found, commands=write)
        if found["mode"] != (mode := f"{want.mode:04o}"):
            cause = f"mode is {found['mode'] or 'unknown'}, not {mode}"
            return Change(action=Action.UPDATE, cause=cause, before=found, commands=write)
        return None

    def differences(self, want: SecretParams, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
        """Say of the value no more than that it differs."""
        if found["mode"] != (mode := f"{want.mode:04o}"):
            return (Difference(field="mode", old=found["mode"] or None, new=mode),)
        if want.value is None or found["digest"] != want.value.digest():
            return (Difference(field="value", note=HIDDEN),)
        return ()

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it, and the folders above it that are empty then."""
        return (remove_path(found.name, MEMORY_ROOT, with_root=True),)

    def is_own(self, name: str, want: SecretParams, names: Names) -> bool:
        """Compare its place with its name and mode."""
        place = secret_path(names.instance, want.name, f"{want.mode:04o}")
        return name == place and want.mode <= _PERMISSIONS and WORD.fullmatch(want.name) is not None

    def misplaced(self, name: str, want: SecretParams, context: Mapping[str, Any]) -> tuple[str, str] | None:
        """Say so of one that no service on the robot uses: nobody reads its value."""
        if wrong := super().misplaced(name, want, context):
            return wrong
        if want.name not in {one["name"] for one in context["secrets"]}:
            return f"no service on this robot uses a secret '{want.name}'", "list it under a service's 'secrets'"
        return None
