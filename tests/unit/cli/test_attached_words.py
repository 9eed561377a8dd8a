"""What is told of a command that no shell splits, and of a shell that no keys reach."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from srprov.cli.attached import in_one_word, of_no_use


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (("ls /log",), True),
        (("ls|wc",), True),
        (("ls", "/log"), False),
        (("sh", "-c", "ls /log"), False),
        (("hostname",), False),
    ],
)
def test_a_command_in_one_word_is_told_apart(command: tuple[str, ...], told: bool) -> None:
    assert ("sh -c" in in_one_word(command)) is told


@pytest.mark.parametrize(
    ("command", "terminal", "keys", "told"),
    [
        (("bash",), False, True, True),
        (("/bin/sh",), False, True, True),
        (("bash",), True, True, False),
        (("bash",), False, False, False),
        (("bash", "-c", "ls"), False, True, False),
        (("ls",), False, True, False),
    ],
)
def test_a_shell_without_a_terminal_is_told_where_keys_would_be_expected(
    command: tuple[str, ...], terminal: bool, keys: bool, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: keys))
    assert ("-t" in of_no_use(command, terminal=terminal)) is told
