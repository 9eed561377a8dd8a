"""Whatever a robot answers: parsing and checking never raise, and nothing foreign is taken for ours."""

from __future__ import annotations

import contextlib
import copy
import json
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.modules import MODULES
from srprov.resource import Change, Observed
from srprov.robot_answers import TooManyError
from srprov.wire import Reply
from tests.conftest import examples
from tests.resources import resource
from tests.unit.modules.test_cases import CASES, KINDS, blobs_of

DIGITS = "9" * 5000
SHA = "0" * 64
JUNK = st.sampled_from(
    [
        None,
        True,
        0,
        -1,
        10**30,
        1.5,
        "",
        "x",
        "²",
        DIGITS,
        "\0",
        "\ud800",
        f"Exited ({DIGITS}) now",
        [],
        {},
        [[]],
        [None],
    ]
)
LINES = st.sampled_from(
    ["", "a", "/" * 50, "\x85\u2028", f"{SHA}  /var/lib/srprov/a/b", f"{SHA}  /var/lib/srprov/../b", "[", "{}", "null"]
)


def real(kind: str) -> tuple[dict[str, Any], list[Any]]:
    """Return a wanted resource and real replies of a robot that has it."""
    defaults = yaml.safe_load((CASES / kind / "defaults.yaml").read_text())
    return defaults["want"], list(defaults["replies"].values())[: len(MODULES[kind].queries())]


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every value inside a JSON value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at] + [path for key, one in inside for path in places(one, (*at, key))]


def replaced(value: Any, path: tuple[Any, ...], junk: Any) -> Any:
    """Return the value with something else at a path."""
    if not path:
        return junk
    value = copy.deepcopy(value)
    inner = value
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = junk
    return value


def survives(kind: str, replies: list[Reply]) -> None:
    """Parse, check every found thing against the wanted one, and take it away; nothing may raise.

    But for what is that robot's failure alone, as what is there would pass for gone.
    """
    want, _ = real(kind)
    params = resource(kind, "x", want["params"], blobs=blobs_of(want["params"])).params
    module = MODULES[kind]
    observed: tuple[Observed, ...] = ()
    with contextlib.suppress(TooManyError):
        observed = module.parse(replies)
    for found in observed:
        assert isinstance(found.name, str) and isinstance(found.instance, str)
        change = module.check(found.name, params, found.state)
        assert change is None or isinstance(change, Change)
        json.dumps(found.state)
        with contextlib.suppress(ValueError):  # no command can be about that name: this robot fails, and no other one
            module.removal(found)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(150), derandomize=True, deadline=None)
@given(data=st.data())
def test_junk_in_a_real_answer_never_raises(kind: str, data: st.DataObject) -> None:
    """A real answer in which any one value is something else is read without an error."""
    _, raw = real(kind)
    which = data.draw(st.integers(0, len(raw) - 1))
    if isinstance(raw[which], str):
        raw[which] += data.draw(LINES)
    else:
        raw[which] = replaced(raw[which], data.draw(st.sampled_from(places(raw[which]))), data.draw(JUNK))
    survives(kind, [Reply(status=200, out=one if isinstance(one, str) else json.dumps(one)) for one in raw])


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(60), derandomize=True, deadline=None)
@given(data=st.data())
def test_any_text_never_raises(kind: str, data: st.DataObject) -> None:
    """Text that is no answer at all, with any status, is read as nothing of ours or as little."""
    count = len(MODULES[kind].queries())
    reply = st.builds(
        lambda out, status: Reply(status=status, out=out, ok=status == 0), st.text() | LINES, st.integers(0, 3)
    )
    survives(kind, data.draw(st.lists(reply, min_size=count, max_size=count)))


@pytest.mark.parametrize("kind", ["container", "image", "network", "volume"])
@pytest.mark.parametrize("status", [0, 404, 500])
def test_an_error_of_the_engine_is_no_list(kind: str, status: int) -> None:
    """The JSON of an error, or no answer, gives nothing."""
    reply = Reply(status=status, out='{"message": "something is wrong"}', ok=False)
    assert MODULES[kind].parse([reply]) == ()
