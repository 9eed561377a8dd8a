"""Secrets as resources: found by hash and permissions, told without either value or hash, written by a placeholder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator

import pytest

from srprov.modules import MODULES
from srprov.modules.module import MEMORY_ROOT
from srprov.modules.secret import secret_path, with_value
from srprov.resource import Action, Change, Resource
from srprov.secret import Hidden, Secret, Vault, forget
from srprov.wire import Put, Reply, Run
from tests.resources import resource

VALUE = "hunter2-module"
SHA = hashlib.sha256(VALUE.encode()).hexdigest()
PATH = f"{MEMORY_ROOT}/hello/secrets/token"
MODULE = MODULES["secret"]


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


def want(mode: str = "0400") -> Resource:
    """Return the wanted secret."""
    return with_value(resource("secret", PATH, {"name": "token", "mode": mode}), Vault({"token": Secret(VALUE)}))


def check(listing: str, mode: str = "0400") -> Change | None:
    """Compare with what a robot listed."""
    found = [one for one in MODULE.parse([Reply(status=0, out=listing)]) if one.name == PATH]
    return MODULE.check(PATH, want(mode).params, found[0].state if found else None)


@pytest.mark.parametrize(
    ("listing", "mode", "cause"),
    [
        ("", "0400", "create: not there"),
        (f"400 ./hello/secrets/token\n{SHA}  ./hello/secrets/token\n", "0400", None),
        (f"400 ./hello/secrets/token\n{'0' * 64}  ./hello/secrets/token\n", "0400", "update: secret differs"),
        (f"644 ./hello/secrets/token\n{SHA}  ./hello/secrets/token\n", "0400", "update: mode is 0644, not 0400"),
        (f"{SHA}  ./hello/secrets/token\n", "0400", "update: mode is unknown, not 0400"),
        (f"400 ./other/secrets/token\n{SHA}  ./other/secrets/token\n", "0400", "create: not there"),
    ],
)
def test_what_differs_is_told_in_words_without_value_or_hash(listing: str, mode: str, cause: str | None) -> None:
    """Not there, other content, other permissions; nothing of either content."""
    change = check(listing, mode)
    assert (f"{change.action.name.lower()}: {change.cause}" if change else None) == cause


def test_the_command_is_a_placeholder() -> None:
    """A new file is renamed into place, an old one is rewritten in place; neither command holds the value."""
    other = f"400 ./hello/secrets/token\n{'0' * 64}  ./hello/secrets/token\n"
    for listing, action, in_place in (("", Action.CREATE, False), (other, Action.UPDATE, True)):
        change = check(listing)
        assert change is not None and change.action is action
        (command,) = change.commands
        assert command == Put(path=PATH, secret="token", mode=0o400, in_place=in_place)
        assert VALUE not in repr(command) and SHA[:8] not in repr(command) + command.text()
        assert "<secret token>" in command.text()


def test_a_half_written_one_is_cleaned_up() -> None:
    """It is the instance's too, and nobody wants it."""
    found = MODULE.parse([Reply(status=0, out=f"400 ./hello/secrets/token.part\n{SHA}  ./hello/secrets/token.part\n")])
    assert [(one.name, one.instance) for one in found] == [(PATH + ".part", "hello")]


def test_removal_stays_below_the_root() -> None:
    """The file goes, and the folders that are empty then; nothing outside."""
    (found,) = MODULE.parse([Reply(status=0, out=f"{SHA}  ./hello/secrets/token\n")])
    (command,) = MODULE.removal(found)
    assert isinstance(command, Run)
    assert command.script.startswith(f"rm -rf {PATH} || exit 1; rmdir {MEMORY_ROOT}/hello/secrets 2>/dev/null; ")
    assert command.script.endswith(f"test ! -e {PATH}")
    (evil,) = MODULE.parse([Reply(status=0, out=f"{SHA}  ./../secrets/x\n")])
    with pytest.raises(ValueError, match="not inside"):
        MODULE.removal(evil)


@pytest.mark.parametrize(
    "junk", ["\x00", "x" * 64, f"{SHA}", f"{SHA}  a", f"{SHA}  ./a/b/c\n", "400 ", "/ / /\n ./a/secrets/b"]
)
def test_junk_is_read_as_nothing(junk: str) -> None:
    """What is no line of ours gives no resource, and no state holds a bare hash."""
    assert [one for one in MODULE.parse([Reply(status=0, out=junk)]) if not one.name] == []
    for one in MODULE.parse([Reply(status=0, out=junk + f"\n{SHA}  ./hello/secrets/token\n")]):
        assert isinstance(one.state["digest"], Hidden)
        assert SHA not in json.dumps({key: str(value) for key, value in one.state.items()})


def test_other_permissions_are_another_file() -> None:
    """Two services may see one secret differently; a name cannot pretend to be such a file."""
    assert secret_path("i", "token", "0400") != secret_path("i", "token", "0444")
    assert "@" in secret_path("i", "token", "0444")
