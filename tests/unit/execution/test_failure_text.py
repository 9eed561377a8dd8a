"""What is said of a command that failed: what went wrong first, the command last."""

from __future__ import annotations

import pytest

from srprov.execution.failure_text import failure_text
from srprov.wire import Reply, Run


@pytest.mark.parametrize(
    ("err", "says"),
    [
        ("no such network\n", "no such network\n  status 7 of make it"),
        ("one\n\ntwo\n", "it failed\n  its last lines:\n    one\n    two\n  status 7 of make it"),
        ("", "it failed, and said nothing\n  status 7 of make it"),
    ],
)
def test_what_went_wrong_comes_first_and_the_command_last(err: str, says: str) -> None:
    assert failure_text(Run(script="make it\nand more"), Reply(status=7, err=err, ok=False)) == says
