"""Archives of strangers: nothing is written, run or waited for, whatever they are."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run as cli
from srprov.errors import UsageError
from srprov.evidence import stored_zip
from srprov.evidence.citation import _author
from srprov.evidence.verify import verify
from tests.bounded import bounded
from tests.unit.evidence.bundles import Content, events, journal, packed, with_manifest

EDF = "sessions/1/inputs/race.edf"


def zipped(
    name: str = "bundle.json", mode: int = 0o100644, kind: int = zipfile.ZIP_STORED, data: bytes = b"{}"
) -> bytes:
    """Return an archive with one file, as `zipfile` writes it."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        one = zipfile.ZipInfo("bundle.json")
        one.external_attr = mode << 16
        archive.writestr(one, data, kind)
    return out.getvalue()


def ours(*names: str, data: bytes = b"{}", places: tuple[int, ...] = ()) -> bytes:
    """Return an archive with these files, written as srprov writes one but without any of its checks."""
    out, entries = io.BytesIO(), []
    for number, name in enumerate(names):
        at = places[number] if number < len(places) else out.tell()
        one = stored_zip.Entry(name, len(data), zlib.crc32(data), at)
        entries.append(one)
        if number >= len(places):
            out.write(one.header + data)
    directory = b"".join(one.record for one in entries)
    return out.getvalue() + directory + stored_zip._tail(len(entries), len(directory), out.tell())


GOOD = ours("bundle.json")

ARCHIVES = {
    "a bomb": zipped(kind=zipfile.ZIP_DEFLATED, data=b"\0" * (64 << 20)),
    "a name that leads out": ours("../bundle.json"),
    "a name that leads out later": ours("a/../../b"),
    "a name from the root": ours("/etc/cron.d/x"),
    "a name of Windows": ours("C:\\x"),
    "a drive": ours("c:x"),
    "a name that draws": ours("a\x1b[2J"),
    "a name that hides": ours("a\u202eb"),
    "an empty part": ours("a//b"),
    "a long name": ours("a" * 2000),
    "a link": zipped(mode=0o120777),
    "a device": zipped(mode=0o020666),
    "two of one name": ours("bundle.json", "bundle.json"),
    "two but for case": ours("bundle.json", "BUNDLE.json"),
    "a file that is a folder": ours("a", "a/b"),
    "one content twice": ours("bundle.json", "b", places=(0, 0)),
    "entries that overlap": ours("bundle.json", "b", "c", places=(0, 10, 20)),
    "something before": b"MZ" + GOOD,
    "something behind": GOOD + b"x",
    "a comment": GOOD[:-2] + b"\1\0x",
    "half of one": GOOD[: len(GOOD) // 2],
    "no end": GOOD[:-1],
    "nothing": b"",
    "no zip": b"PK" * 1000,
    "a count that lies": GOOD[:-12] + struct.pack("<2H", 60_000, 60_000) + GOOD[-8:],
    "a directory that is not there": GOOD[:-10] + struct.pack("<2L", 1 << 31, 1 << 31) + b"\0\0",
    "a wide end that lies": stored_zip._tail(1 << 62, 1 << 62, 1 << 62),
}


@pytest.mark.parametrize("kind", ARCHIVES)
def test_what_is_no_bundle_is_refused_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    home = tmp_path / "here"
    home.mkdir()
    (tmp_path / "b.zip").write_bytes(ARCHIVES[kind])
    monkeypatch.chdir(home)
    monkeypatch.setenv("TMPDIR", str(home))
    assert bounded(lambda: cli(["verify", "../b.zip"])) == 5
    assert [path.name for path in tmp_path.rglob("*")] in (["here", "b.zip"], ["b.zip", "here"])
    del capsys


def test_names_of_many_folders_are_looked_at_in_little_memory(tmp_path: Path) -> None:
    """Each folder above each file, as a text of its own, would be a gigabyte for these three megabytes."""
    names = [f"{number:04x}/{'a/' * 490}b" for number in range(1500)]
    (tmp_path / "b.zip").write_bytes(ours("bundle.json", *names, data=b""))
    assert bounded(lambda: cli(["verify", str(tmp_path / "b.zip")])) == 5


def test_a_manifest_that_names_what_is_not_there_is_not_read_into_memory(tmp_path: Path) -> None:
    lines = b"".join(b"%064x  %d\n" % (number, number) for number in range(700_000))
    path = packed({"bundle.json": b"{}", "manifest-sha256.txt": lines}, tmp_path / "b.zip")
    report = bounded(lambda: verify(str(path)))
    assert {one.id: one.details for one in report.findings}["F1"] == ("manifest-sha256.txt is larger than 1 MiB",)


@pytest.mark.parametrize("names", [("a/b", "A"), ("a", "b", "a/b/c"), ("a/b/c", "a-b", "a/B"), ("a!", "a", "a/b")])
def test_no_file_stands_where_another_one_has_a_folder(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="two files cannot both be there"):
        stored_zip.read(io.BytesIO(ours(*names)))


@pytest.mark.parametrize(
    "names",
    [(".git/config",), ("HEAD", "config", "objects/x", "refs/x"), ("a/HEAD", "a/commondir"), ("a/.hg/hgrc",),
     ("CVS/Root",), ("a/_FOSSIL_",)],
)  # fmt: skip
def test_no_bundle_is_a_repository_where_it_is_unpacked(names: tuple[str, ...]) -> None:
    """Whoever unpacked it to look at it, as the manual shows, had git run what its settings name."""
    with pytest.raises(ValueError, match="a repository here could name programs"):
        stored_zip.read(io.BytesIO(ours("bundle.json", *names)))
    writer = stored_zip.Writer(io.BytesIO())
    for name in names:
        writer.add(name, 1, [b"x"])
    with pytest.raises(ValueError, match="a repository here could name programs"):
        writer.finish()


def test_a_file_that_is_called_head_makes_no_repository() -> None:
    names = ["bundle.json", "a/HEAD", "objects/x", "a/refs/x"]
    assert [one.name for one in stored_zip.read(io.BytesIO(ours(*names)))] == names


def test_the_good_archive_that_these_are_made_of_can_be_read() -> None:
    assert [one.name for one in stored_zip.read(io.BytesIO(GOOD))] == ["bundle.json"]
    assert [one.name for one in stored_zip.read(io.BytesIO(ours("a/b", "c")))] == ["a/b", "c"]


def test_sizes_and_places_of_more_than_32_bits_are_written_and_read() -> None:
    """As headers alone: nobody needs four gigabytes to see it."""
    one = stored_zip.Entry("a", 5 << 30, 1, 6 << 30)
    assert list(stored_zip._entries(one.record, 1)) == [one]
    assert len(one.header) == 30 + 1 + 20
    tail = stored_zip._tail(70_000, 1 << 20, 5 << 30)
    assert stored_zip._directory(io.BytesIO(b"x" * 100 + tail), 100 + len(tail)) == (70_000, 1 << 20, 5 << 30)


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "b.zip"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    with pytest.raises(UsageError, match="is no bundle"):
        verify("/dev/zero" if kind == "device" else str(path))


LOG = "trials/4e9ce07a82-r002/logs/r2.referee.log"
ALIASES = b"a: &a [x, x]\n" + b"".join(b"%c: &%c [*%c, *%c]\n" % (n + 1, n + 1, n, n) for n in range(97, 120))
NO_EVENTS = b'{"seq": 1, "event": "run", "utc": [], "same": []}\n{"seq": 2, "event": "end", "row": [1]}\n'
ELSEWHERE = b'{"edf": "../../../../etc/passwd", "files": [{"file": "../../x"}]}'
DEEP = b"[" * 100_000 + b"]" * 100_000
CONTENTS: dict[str, dict[str, bytes]] = {
    "deep JSON": {"bundle.json": DEEP, "ro-crate-metadata.json": DEEP, "sessions/1/facts.json": DEEP},
    "deep JSON in the journal": {"journal.jsonl": b'{"seq": 1, "event": "run", "same": ' + DEEP + b"}\n"},
    "a long journal": {"journal.jsonl": b'{"seq":1,"event":"run","a":[' + b"1," * 6_000_000 + b"1]}\n"},
    "a plan that wants root": {"sessions/1/plan.json": b'{"steps": [{"commands": [{"run": "touch /tmp/owned"}]}]}'},
    "an alias bomb": {EDF: ALIASES},
    "a long line": {LOG: b"2026-11-22T09:00:01Z " + b"a" * (8 << 20) + b"\n"},
    "a manifest that names much": {"manifest-sha256.txt": b"0" * 64 + b"  /etc/passwd\n"},
    "numbers that are none": {"sessions/1/assignment.json": b'{"assignment": {"runner": 1}, "cost": 1e999}'},
    "rows that are none": {"journal.jsonl": NO_EVENTS},
    "an EDF elsewhere": {"sessions/1/inputs.json": ELSEWHERE},
}


@pytest.mark.parametrize("kind", CONTENTS)
def test_what_a_bundle_holds_costs_little_and_is_found(content: Content, tmp_path: Path, kind: str) -> None:
    path = packed({**with_manifest({**content, **CONTENTS[kind]}), **CONTENTS[kind]}, tmp_path / "b.zip")
    report = bounded(lambda: verify(str(path)))
    assert report.failed
    assert not Path("/tmp/owned").exists()


ODD: list[Any] = [None, True, -1, 0.5, 1e308, 10**400, "", "x" * 5000, "../../etc", [], {}, [1], [[]], {"a": 1}]


def _places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Return where in a JSON value something stands."""
    yield place
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _places(item, (*place, key))


def _with(value: Any, place: tuple[Any, ...], odd: Any) -> Any:
    if not place:
        return odd
    value[place[0]] = _with(value[place[0]], place[1:], odd)
    return value


def _one_odd(content: Content, chance: random.Random) -> Content:
    """Put an odd value somewhere into a JSON file, or into an event of the journal."""
    names = [name for name in content if name.endswith((".json", ".yml"))]
    name = chance.choice([*names, *["journal.jsonl"] * len(names)])
    if name != "journal.jsonl":
        try:
            value = json.loads(content[name])
        except ValueError:  # YAML
            return content
        return {
            **content,
            name: json.dumps(_with(value, chance.choice([*_places(value)]), chance.choice(ODD))).encode(),
        }
    found = events(content)
    at = chance.randrange(len(found))
    found[at] = _with(found[at], chance.choice([*_places(found[at])]), chance.choice(ODD))
    return {**content, name: journal(found)}


@pytest.mark.parametrize("seed", range(5))
def test_odd_values_anywhere_end_in_findings(content: Content, tmp_path: Path, seed: int) -> None:
    """Verified with a manifest that fits; whatever is thrown is a bug."""
    chance = random.Random(seed)
    for _ in range(15):
        verify(str(packed(with_manifest(_one_odd(content, chance)), tmp_path / "b.zip")))


def test_a_row_whose_lists_are_numbers_is_a_finding(content: Content, tmp_path: Path) -> None:
    found = events(content)
    for one in found:
        if "row" in one:
            one["row"].update(clocks=0.5, hosts=0.5, containers={"a": 1})
    report = verify(str(packed(with_manifest({**content, "journal.jsonl": journal(found)}), tmp_path / "b.zip")))
    assert {one.id for one in report.findings if one.result == "fail"} >= {"J2", "J3", "S2"}


def test_nothing_of_an_experiment_is_run_and_no_file_of_this_machine_is_told(
    content: Content, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An inventory that is a program, a secret that a program prints, a file of the controller's, a playbook."""
    mark, secret = tmp_path / "owned", tmp_path / "private.env"
    secret.write_text("KEY=not-for-strangers\nnonsense line\n")
    text = content[EDF].decode()
    changes = {
        "command": text.replace("services:", f"secrets: {{key: {{command: [touch, {mark}]}}}}\nservices:"),
        "env_file": text.replace("referee.env", str(secret)),
        "playbook": text.replace("services:", f"playbooks: [{secret}]\nservices:"),
    }
    script = f"#!/bin/sh\ntouch {mark}\n".encode()
    bundles = [{**content, EDF: one.encode()} for one in changes.values()]
    for files in (*bundles, {**content, "sessions/1/inputs/inventory.yml": script}):
        assert cli(["verify", str(packed(with_manifest(files), tmp_path / "b.zip"))]) == 2
    told = capsys.readouterr()
    assert "strangers" not in told.out + told.err and "nonsense" not in told.out + told.err
    assert not mark.exists()


def test_an_author_of_blanks_is_read_in_time() -> None:
    """Where an ORCID might begin is looked for at each of them."""
    assert bounded(lambda: _author("Ada" + " " * 300_000 + "(https://orcid.org/0000-0002-1825-0097)x")) == (
        "Ada" + " " * 300_000 + "x", "0000-0002-1825-0097",
    )  # fmt: skip
    assert bounded(lambda: _author("a" + " " * 300_000 + "b"))[1] == ""
