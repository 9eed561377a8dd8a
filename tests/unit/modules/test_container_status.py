"""When a container counts as healthy, and why it never will."""

from __future__ import annotations

import json

import pytest

from srprov.modules.container_status import reached
from srprov.wire import Reply

NONE = "a has no healthcheck: neither the definitions nor its image say one"


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ({"Status": "running", "Health": {"Status": "starting"}}, (False, "")),
        ({"Status": "running", "Health": {"Status": "healthy"}}, (True, "")),
        ({"Status": "running"}, (False, NONE)),
        ({"Status": "running", "Health": {"Status": "none"}}, (False, NONE)),
        ({"Status": "created"}, (False, "")),
        ({"Status": "running", "Health": []}, (False, "")),
    ],
)
def test_a_container_without_a_healthcheck_never_gets_healthy(
    state: dict[str, object], expected: tuple[bool, str]
) -> None:
    reply = Reply(status=200, out=json.dumps({"State": state}))
    assert reached("a", "healthy", reply) == expected


@pytest.mark.parametrize("condition", ["started", "healthy", "completed"])
@pytest.mark.parametrize("code", ["1\ndone: all is well", ["x"] * 1000, {"a": 1}, None])
def test_an_exit_code_is_a_number_whatever_an_engine_says(condition: str, code: object) -> None:
    state = {"Status": "exited", "ExitCode": code}
    holds, never = reached("a", condition, Reply(status=200, out=json.dumps({"State": state})))
    assert not holds and never.startswith("a exited with code -1")
