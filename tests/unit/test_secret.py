"""The type that nothing prints, and the one function that decides what is printable."""

from __future__ import annotations

import base64
import copy
import dataclasses
import json
import pickle
import shlex
import subprocess
import traceback
import urllib.parse
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.cli.output import clean, line_of, out_json
from srprov.planning.fingerprint import lasting
from srprov.secret import MASK, Hidden, Secret, Vault, forget, redact, redact_lines, redacted

VALUE = "p/a ss\"w'ör+d&%1"


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


@pytest.mark.parametrize(
    "show", [str, repr, "{}".format, "{!r:>5}".format, lambda s: f"{[s]}", lambda s: f"{ {1: s} }"]
)
def test_no_way_of_printing_shows_a_hidden_value(show: Callable[[object], str]) -> None:
    """Neither by itself nor inside a collection, formatted or not."""
    shown = show(Hidden(VALUE))
    assert MASK in shown and VALUE not in shown


def test_a_dataclass_with_a_secret_prints_none() -> None:
    """The generated repr, and a copy of it as a mapping, keep the wrapping."""

    @dataclasses.dataclass
    class Host:
        password: Secret

    host = Host(Secret(VALUE))
    assert repr(host).endswith("Host(password=***)")
    assert dataclasses.asdict(host) == {"password": Secret(VALUE)}
    assert copy.deepcopy(host) == host
    assert not hasattr(host.password, "__dict__")


@pytest.mark.parametrize("write", [json.dumps, pickle.dumps])
def test_a_hidden_value_cannot_be_serialised(write: Callable[[object], object]) -> None:
    """Whoever forgets about it gets an error instead of a leak."""
    with pytest.raises(TypeError) as caught:
        write([Hidden(VALUE)])
    assert VALUE not in str(caught.value)


@pytest.mark.parametrize("value", ["", "abc", "ab \n", " a  \t "])
def test_a_short_secret_is_refused_without_being_named(value: str) -> None:
    """What could not be hidden in output is no secret; blanks around it do not make it longer."""
    with pytest.raises(ValueError, match="at least 4 characters") as caught:
        Secret(value)
    assert not value.strip() or value not in str(caught.value).split()


def test_equal_values_are_equal_secrets() -> None:
    """Hashes of secrets can be compared without being looked at."""
    assert Secret(VALUE) == Secret(VALUE) != Secret(VALUE + "x")
    assert Secret(VALUE).digest() == Hidden(VALUE).digest() != Hidden("other").digest()
    assert len({Secret(VALUE), Secret(VALUE)}) == 1


FORMS: dict[str, Callable[[str], str]] = {
    "itself": str,
    "base64": lambda v: base64.b64encode(v.encode()).decode(),
    "base64 for URLs": lambda v: base64.urlsafe_b64encode(v.encode()).decode(),
    "base64 behind a user's name": lambda v: base64.b64encode(f"user:{v}".encode()).decode(),
    "base64 behind one byte": lambda v: base64.b64encode(f"u{v}:x".encode()).decode(),
    "base64 behind two bytes": lambda v: base64.b64encode(f"u:{v}\n".encode()).decode(),
    "URL": urllib.parse.quote,
    "URL, everything quoted": lambda v: urllib.parse.quote(v, safe=""),
    "form": urllib.parse.quote_plus,
    "JSON": json.dumps,
    "JSON in UTF-8": lambda v: json.dumps(v, ensure_ascii=False),
    "JSON in JSON": lambda v: json.dumps(json.dumps({"a": v})),
    "Python": repr,
    "Python bytes": lambda v: repr(v.encode()),
    "hex": lambda v: v.encode().hex(),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_found(form: str) -> None:
    """As itself or encoded, in the middle of a line or twice in it."""
    Secret(VALUE)
    shown = FORMS[form](VALUE)
    line = f"before {shown} between {shown}! after"
    assert redact(line) != line
    fixed = shown[8:-6] if form.startswith("base64 behind") else shown.strip("'\"b")
    assert fixed not in redact(line)
    assert redact(line).startswith("before ") and redact(line).endswith("! after")


@pytest.mark.parametrize("value", ["/git/aaaa'", 'two "words', "back\\slash", "a'b'c d"])
@pytest.mark.parametrize("path", ["{}$(touch ran)", "a {}' $(touch ran)", "{}';touch ran;'", "`x`{}\"'$(touch ran)"])
def test_no_secret_takes_the_quotes_of_a_command_with_it(tmp_path: Path, value: str, path: str) -> None:
    """A stranger chooses what his secrets are, and what his folders are called: a message has a command with both."""
    Secret(value)
    words = f"{shlex.quote(path.format(value))} {shlex.quote('/srv' + path.format(value))}"
    shown = clean(f"see: true {words}\nnext").splitlines()
    assert shown[1] == "next" and value not in shown[0]
    subprocess.run(["sh", "-c", shown[0].removeprefix("see: ")], cwd=tmp_path, capture_output=True, check=False)
    assert list(tmp_path.iterdir()) == []


def test_lines_of_a_long_secret_are_found_one_by_one() -> None:
    """A key in PEM is printed line by line, indented perhaps."""
    lines = ["-----BEGIN KEY-----", "MIIEvgIBADANBgkqhkiG9w0BAQEFAASC", "Zm9v", "-----END KEY-----"]
    Secret("\n".join(lines) + "\n")
    assert redact(f"    {lines[1]}") == "    ***"
    assert redact("Zm9v") == "Zm9v", "too short to be looked for alone"


def test_a_secret_that_ends_with_a_line_leaves_the_next_line_one() -> None:
    """Patterns of metrics look for the beginning of a line."""
    Secret("hunter2-hunter2\n")
    assert redact("a hunter2-hunter2\nGOAL 3\n") == "a ***\nGOAL 3\n"
    assert list(redact_lines(["1Z hunter2-hunter2", "2Z GOAL 3"])) == ["1Z ***", "2Z GOAL 3"]


def test_overlapping_secrets_leave_no_end_behind() -> None:
    """Where two overlap, or one contains another, nothing of either is left."""
    Secret("abcdef"), Secret("defghi"), Secret("cde1")
    assert redact("xabcdefghiy") == "x***y"
    assert redact("abcde1") == "ab***"
    assert redact("abcdefabcdef|") == "***|"
    Secret("aXaXa")
    assert redact("aXaXaXa.") == "***."


def test_control_characters_do_not_hide_a_secret_from_the_terminal() -> None:
    """Neither those in the output nor those in the value."""
    Secret("canary-one")
    assert "canary-one" not in clean("can\x1b[0mary\x07-one")
    Secret("two\x07canary")
    assert clean("<two\x07canary>") == "<***>"


def test_json_stays_json(capsys: pytest.CaptureFixture[str]) -> None:
    """A secret that looks like a number or a word of JSON is replaced in texts only."""
    Secret("1234"), Secret("true"), Secret('say "x"')
    value = {"size": 91234, "ok": True, "text": 'it is 1234, say "x"', "true": [None, "x"], "h": Hidden("hidden")}
    out_json(value)
    expected = {"size": 91234, "ok": True, "text": "it is ***, ***", "***": [None, "x"], "h": "***"}
    assert json.loads(capsys.readouterr().out) == expected
    assert json.loads(line_of(value)) == expected == redacted(value)


def test_an_exception_with_the_value_is_printed_without_it() -> None:
    """The text of a traceback goes through the same function as everything else."""
    secret = Secret("canary-in-error")
    try:
        raise RuntimeError(f"cannot use {secret.reveal()!r}")
    except RuntimeError:
        shown = clean(traceback.format_exc())
    assert "RuntimeError: cannot use '***'" in shown and "canary-in-error" not in shown


def test_bytes_that_are_no_text_leave_as_they_came() -> None:
    """A vault gives the very bytes that were read."""
    raw = bytes(range(256))
    vault = Vault({"key": Secret(raw.decode("utf-8", "surrogateescape"))})
    assert vault.content("key") == raw
    assert "key" in vault and "other" not in vault
    assert vault.holds("nothing") == "" and vault.holds(f"x{base64.b64encode(raw).decode()}") == "key"
    assert MASK in redact(base64.b64encode(raw).decode())


def test_a_state_that_is_written_down_has_no_hash_of_a_secret() -> None:
    """Fingerprints and plan files keep the rest of it."""
    assert lasting({"digest": Secret(VALUE).digest(), "mode": "0400"}) == {"mode": "0400"}
