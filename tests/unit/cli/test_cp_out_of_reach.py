"""`cp` of a service whose robot does not answer says that, and not that there is nothing."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import NoReturn

import pytest

from srprov.cli import cp, inputs
from srprov.controller import located, sent_to
from srprov.errors import ConnectError

AWAY = located.Located(service="s2", host="robot2", container="srprov.closed.s2")


def test_a_robot_out_of_reach_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """`srprov apply` would not help."""

    def get(host: str) -> NoReturn:
        raise ConnectError(host, "no answer")

    fleet = SimpleNamespace(gather=lambda _: None, sessions=SimpleNamespace(get=get))
    for name, given in (("load_inventory", None), ("named_instance", ("closed", "closed.edf"))):
        monkeypatch.setattr(inputs, name, lambda *_, given=given: given)
    monkeypatch.setattr(inputs, "connect", lambda *_: nullcontext(fleet))
    monkeypatch.setattr(located, "locate", lambda *_: None)
    monkeypatch.setattr(sent_to, "trusted", lambda *_: AWAY)
    with pytest.raises(ConnectError, match="no answer"), cp._located("a.edf", "s2", (), 1, 1.0, "", None):
        pass
