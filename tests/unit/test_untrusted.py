"""One parser for what others say: within limits, and never the end of a run."""

from __future__ import annotations

import json
import tracemalloc
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov import untrusted
from srprov.controller.status import status_of
from srprov.errors import UsageError
from srprov.execution.locks import Holder, parse_holder
from srprov.facts.gather import _without_mute
from srprov.facts.model import Snapshot
from srprov.facts.placements import read_placements
from srprov.failure import why
from srprov.network.foreign import foreign_uses
from srprov.network.record import read_record
from srprov.planning.planread import is_plan, load
from srprov.transport.engine.answers import message_of
from srprov.untrusted import json_or_none, mappings, parse_json, string, string_map, strings
from srprov.wire import Reply
from tests.bounded import within

DEEP = "[" * 5000
HOSTILE = [DEEP, '{"a":' * 5000, "9" * 5000, "1e999", "NaN", "-Infinity", '{"a": ' + "9" * 5000 + "}", "", "{", "\0"]


@pytest.mark.parametrize("source", HOSTILE)
def test_hostile_json_is_none_for_every_reader(source: str) -> None:
    """Depth, digits and numbers that are none end no run."""
    now = "2026-11-21T02:00:00Z"
    assert json_or_none(source) is None
    assert Reply(status=200, out=source).json() is None
    assert parse_holder(f"{now} {source}") == Holder()
    assert read_placements([source]) == {}
    assert message_of(source) == " ".join(source.split())[:500]


@pytest.mark.parametrize("source", [DEEP, '{"format":' * 5000, '{"format": ' + "9" * 5000 + "}", '{"format": NaN}'])
def test_a_hostile_plan_file_is_refused_as_one_that_cannot_be_applied(source: str) -> None:
    assert isinstance(is_plan(source), bool)
    with pytest.raises(UsageError, match="no plan that can be applied"):
        load(source, "plan.json")


def test_a_record_beside_a_hostile_one_is_read() -> None:
    good = '{"instance": "i", "serial": 3}'
    assert read_placements([DEEP, good, '{"instance": 7}']) == {"i": {"instance": "i", "serial": 3}}


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


def test_the_limit_of_depth_counts_levels_not_brackets() -> None:
    parse_json(nested(untrusted.MAX_JSON_DEPTH))
    parse_json(json.dumps([[]] * 500))
    parse_json(json.dumps(["[" * 5000, '\\"{' * 500]))
    with pytest.raises(ValueError, match="nested more than 60 levels"):
        parse_json(nested(untrusted.MAX_JSON_DEPTH + 1))


def test_brackets_in_strings_hide_no_depth() -> None:
    with pytest.raises(ValueError, match="nested more than"):
        parse_json('["]]]]",' * 100 + "1" + "]" * 100)


def test_text_that_is_too_long_is_refused_unread() -> None:
    with pytest.raises(ValueError, match="longer than 10 characters"):
        parse_json('"' + "x" * 10 + '"', max_characters=10)


@pytest.mark.parametrize("piece", ['"\\', '"', "[", '\\"', '["', "\\", '"\\"', "]["])
def test_no_text_takes_long(piece: str) -> None:
    source = "[" * 61 + piece * (1_000_000 // len(piece))
    with within(4):
        json_or_none(source)


def test_a_number_that_is_too_large_is_named() -> None:
    assert parse_json(str(2**64)) == 2**64
    with pytest.raises(ValueError, match=r"the number 9{20}\.\.\. is too large or not a number"):
        parse_json("9" * 5000)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(-1e15, 1e15) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(JSON)
def test_everything_else_is_read_as_it_is(value: Any) -> None:
    assert parse_json(json.dumps(value)) == value
    assert parse_json(json.dumps([value] * 70, ensure_ascii=False)) == [value] * 70


@given(st.text(alphabet='[]{}",:\\1ae \n'))
def test_broken_json_is_none_and_never_an_error(source: str) -> None:
    found = json_or_none("[[" * 20 + source)
    assert found is None or isinstance(found, list)


def test_values_of_the_wrong_kind_are_empty() -> None:
    assert [string(value) for value in (None, 7, True, {}, ["x"])] == [""] * 5
    assert string_map({"a": "1", "b": None, "c": {}}) == {"a": "1", "b": "", "c": ""}
    assert string_map(["a"]) == {}
    assert strings(["a", 7, None, "b\ud800"]) == ["a", "b?"]
    assert strings("ab") == strings({"a": "b"}) == []
    assert mappings([1, {"a": 1}, None]) == [{"a": 1}]
    assert mappings("x") == []


@pytest.mark.parametrize(("path", "is_one"), [
    ("/" + "a" * 4095, True), ("/" + "a" * 4096, False), ("/" + "ä" * 2047, True), ("/" + "ä" * 2048, False),
    ("/\ud800", True), ("relative", False), ("/a\0b", False),
])  # fmt: skip
def test_what_is_longer_than_linux_takes_is_no_path(path: str, is_one: bool) -> None:
    assert untrusted.absolute(path) == (string(path) if is_one else "")


def test_half_a_surrogate_pair_can_be_written_to_a_file() -> None:
    name = parse_json('"a\\ud800b"')
    assert string(name).encode() == b"a?b"


def test_json_of_very_many_lists_is_none() -> None:
    """Two characters each, and thirty times that in memory."""
    assert json_or_none("[" + "[]," * 500_000 + "[]]") is None
    assert json_or_none("[" + "[]," * 1000 + "[]]") == [[]] * 1001


@pytest.mark.parametrize("piece", ["[", "{", ",", ":", '\\"[', "\\\\[", "é["])
def test_what_stands_in_strings_is_no_list_and_no_value(piece: str) -> None:
    """An image of a stranger has labels as long as its author likes; they stand in every answer of its robot."""
    label = piece * (2_100_000 // len(piece) + 1)
    source = f'[{{"Labels": {{"note": "{label}"}}, "Id": "a"}}]'
    (box,) = json_or_none(source)
    assert box["Id"] == "a" and len(box["Labels"]["note"]) > 1_000_000
    assert parse_json(source) == [box]
    of_one = json.dumps({"Labels": {"note": "[" * 400_000 + '\\"'}})
    assert untrusted.is_of_one(of_one)


@pytest.mark.parametrize("said", ['""', '"\\\\"', '"\\""', '"a","é"', '"\\\\\\"a"'])
def test_strings_hide_no_list_and_no_value(said: str) -> None:
    """Counted as the parser would: a quote that is escaped ends no string, one behind two backslashes does."""
    lists, values = (f"[{said},{piece * times}1]" for piece, times in (("[],", 400_001), ("1,", 2_000_001)))
    for source, told in ((lists, "more than 400000 lists and maps"), (values, "more than 2000000 values")):
        with pytest.raises(ValueError, match=told):
            untrusted.json_of_robot(source)
    assert not untrusted.is_of_one(f"[{said},{'[],' * 20_000}1]")


@given(st.recursive(st.text('"\\[{,:é\n'), lambda inner: st.lists(inner) | st.dictionaries(st.text('"[\\'), inner)))
def test_as_many_marks_are_outside_strings_as_values_have(value: object) -> None:
    def marks(one: object) -> int:
        if not isinstance(one, (dict, list)):
            return 0
        inner = one.values() if isinstance(one, dict) else one
        return 1 + max(0, len(one) - 1) + isinstance(one, dict) * len(one) + sum(map(marks, inner))

    for source in (json.dumps(value), json.dumps(value, ensure_ascii=False)):
        assert len(untrusted._marks_outside_strings(source)) == marks(value)


_LONG = ['"', "\\", '"\\', '\\"', '["', '"",', '"a"a', '"[["[[', '"\\\\a"[[', 'é"', "["]


@pytest.mark.parametrize("piece", _LONG)
@pytest.mark.parametrize("before", ["[", '["', '["' + "[" * 400_001])
def test_no_strings_take_long_to_be_left_out(before: str, piece: str) -> None:
    source = (before + piece * ((8 << 20) // len(piece)))[: 8 << 20]
    with within(0.6):
        untrusted._marks_outside_strings(source)


@pytest.mark.parametrize(
    "said", ["[" * 60 + "]" * 60, '{"a": 18446744073709551617}', '{"a": -100000000000000000000}'],
    ids=("deep", "large", "small"),
)  # fmt: skip
def test_what_a_robot_says_is_none_where_no_file_that_keeps_it_could_be_read_again(said: str) -> None:
    """It is kept below levels of srprov's own; a file holds no number that nothing counts up to."""
    assert json_or_none(said) is None


@given(st.recursive(st.integers() | st.text("0123456789ab", max_size=30), lambda one: st.lists(one) | st.dictionaries(
    st.text("0123456789", max_size=25), one)))  # fmt: skip
def test_what_a_robot_says_can_be_kept_and_read_again(said: object) -> None:
    found = json_or_none(json.dumps(said))
    if found is not None:
        assert parse_json(json.dumps({"robot": {"service": found}}, indent=2)) == {"robot": {"service": said}}


ODD = ([], {}, [[]], {"a": []}, None, 7, True, -1, 10**40, "x", ["x"], "\ud800")


@pytest.mark.parametrize("odd", ODD, ids=str)
def test_a_record_of_any_shape_ends_nobody_s_verb(odd: object) -> None:
    """Whatever stands in its fields, all who read records find texts, numbers and maps of them."""
    good = {"ip": "10.0.0.1", "mac": "", "network": "overlay", "robot": "away"}
    bad = [
        {"services": odd}, {"robots": odd}, {"services": {"a": odd}}, {"services": {"a": {**good, "robot": odd}}},
        {"subnet": odd, "vni": odd, "mtu": odd, "port": odd, "source": odd}, {"robots": {"r1": {"vtep": odd}}},
    ]  # fmt: skip
    for fields in bad:
        line = json.dumps({"instance": "hello", "serial": 3, "services": {"b": good}, **fields})
        found = read_placements([line])
        snapshot = Snapshot(facts={}, observed={}, placements=found, records={"r1": found}, unreachable={"away": "x"})
        status_of(snapshot)
        read_record(found.get("hello"))  # none is read that has a number beyond those that files have
        list(foreign_uses("other", ("b", "l"), snapshot, None))
        _without_mute(snapshot)


def test_what_a_robot_says_of_a_failure_is_one_line_however_much_it_says() -> None:
    """Sixteen megabytes of single letters are eight million words, which take half a gigabyte."""
    assert why(Reply(status=500, ok=False, err="no\n  space \n")) == "no space"
    assert why(Reply(status=503, ok=False)) == "status 503"
    said = "a " * (8 << 20)
    tracemalloc.start()
    try:
        assert len(why(Reply(status=500, ok=False, out=said))) <= 500
        assert tracemalloc.get_traced_memory()[1] < 2 << 20
    finally:
        tracemalloc.stop()
