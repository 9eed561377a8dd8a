"""`verify` finds whatever is changed in a bundle, also by somebody who makes all hashes anew."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run as cli
from srprov.evidence import checks_files, descriptions
from srprov.evidence.checks_files import Hashed
from srprov.evidence.files import CRATE, MANIFEST, NotThere
from srprov.evidence.make import bundle
from srprov.evidence.verify import verify
from tests.unit.evidence.bundles import Content, archive, events, forged, journal, packed, unpacked, with_manifest


def failed(path: Path, signers: str = "") -> set[str]:
    """Return the checks of a bundle that fail."""
    return {one.id for one in verify(str(path), signers).findings if one.result == "fail"}


def test_a_bundle_passes_every_check(bundled: Path) -> None:
    results = {one.id: one.result for one in verify(str(bundled)).findings}
    assert [name for name, result in results.items() if result == "skipped"] == ["F4", "I2", "I3", "I4"]
    assert set(results.values()) == {"pass", "skipped", "info"}


def by_the_manifest(content: Content) -> bool:
    """Return whether hashes and names alone show that something is wrong."""
    hashed = Hashed(archive(content))
    try:
        return any(checks_files.hashes(hashed)) or any(checks_files.nothing_else(hashed))
    except NotThere:
        return True


TABLES = ("trials.csv", "metrics.csv", "clocks.csv", "hosts.csv", "containers.csv", "csv-metadata.json")


def _flipped(data: bytes) -> bytes:
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


def test_a_flipped_bit_in_any_file_is_found(content: Content, tmp_path: Path) -> None:
    """In the middle of each; of an empty file there is nothing to flip."""
    made = caught = 0
    for name, data in content.items():
        if data:
            changed = _flipped(data)
            made += 1
            caught += by_the_manifest({**content, name: changed})
    assert made == caught == len([data for data in content.values() if data]) > 40
    assert failed(packed({**content, "trials.csv": changed}, tmp_path / "b.zip")) >= {"F1", "J2", "S1"}


def test_a_flipped_bit_is_found_with_the_manifest_made_anew(content: Content, tmp_path: Path) -> None:
    """The crate has the hashes too, and follows from the files; so do the papers. The manifest itself is made anew."""
    missed, made = [], 0
    for name in [name for name, data in content.items() if data and name != MANIFEST]:
        changed = packed(with_manifest({**content, name: _flipped(content[name])}), tmp_path / "b.zip")
        missed += [name] * (not failed(changed))
        made += 1
    assert (missed, made) == ([], len([data for data in content.values() if data]) - 1)


def test_a_flipped_bit_that_a_careful_forger_cannot_hide_is_one_of_which_something_else_tells(
    content: Content, tmp_path: Path
) -> None:
    """With crate, papers, tables and manifest made anew: docs/evidence.md says what nothing else tells of."""
    made_anew = {*descriptions.GENERATED, MANIFEST} | {name for name in content if name.startswith(TABLES)}
    missed, made = [], 0
    for name in [name for name, data in content.items() if data and name not in made_anew]:
        changed = packed(forged({**content, name: _flipped(content[name])}), tmp_path / "b.zip")
        missed += [name] * (not failed(changed))
        made += 1
    alone = ("journal.jsonl", "bundle.json", "environment.json", "facts.json", "inventory.yml", "plan.json", "plan.txt")
    assert [one for one in missed if not one.endswith((*alone, ".log")) and "/rendered/" not in one] == []
    assert made - len(missed) >= made // 2


def test_a_file_that_is_missing_is_found(content: Content, tmp_path: Path) -> None:
    for name in content:
        assert by_the_manifest({other: data for other, data in content.items() if other != name}), name
    left = {name: data for name, data in content.items() if name != "trials.csv"}
    assert failed(packed(left, tmp_path / "b.zip")) >= {"F1", "J2", "S1"}


def test_a_file_that_was_taken_out_of_the_manifest_too_is_found(content: Content, tmp_path: Path) -> None:
    """Whichever it is: something refers to it, or follows from it. Of the trials one stands for all."""
    missed, tried = [], 0
    for name in set(content) - {MANIFEST}:
        if not name.startswith("trials/") or name.startswith("trials/4e9ce07a82-r002/"):
            left = {other: data for other, data in content.items() if other != name}
            missed += [name] * (not failed(packed(with_manifest(left), tmp_path / "b.zip")))
            tried += 1
    assert missed == [] and tried > 25


@pytest.mark.parametrize(
    "name", ["more.txt", "trials/4e9ce07a82-r001.2/results/runner/out/x", "sessions/1/inputs/x", "trials/x/logs/x"]
)
def test_a_file_that_was_added_is_found(content: Content, tmp_path: Path, name: str) -> None:
    """With hashes made anew it is found by the crate, which follows from the files."""
    more = {**content, name: b"x"}
    assert failed(packed(more, tmp_path / "b.zip")) >= {"F2"}
    assert failed(packed(with_manifest(more), tmp_path / "b.zip"))


Change = Callable[[Content], Content]


def _row(content: Content, trial: int, attempt: int, **values: Any) -> Content:
    """Change an attempt's row wherever it stands: in the journal and in its folder."""
    found = events(content)
    trials = [one["trial"] for one in found if one["event"] == "begin" and one["attempt"] == 1]
    name = trials[trial]
    for one in found:
        if "row" in one and (one["trial"], one["attempt"]) == (name, attempt):
            one["row"].update(values)
            folder = f"trials/{name}" + ("" if attempt == 1 else f".{attempt}")
            row = one["row"]
    return {**content, "journal.jsonl": journal(found), f"{folder}/trial.json": json.dumps(row, indent=2).encode()}


def _swapped_rows(content: Content) -> Content:
    head, first, second, *rest = content["trials.csv"].splitlines(keepends=True)
    return {**content, "trials.csv": b"".join([head, second, first, *rest])}


def _reordered(content: Content) -> Content:
    """Let two trials change places in the journal, with their times and numbers as if it had been so."""
    found = events(content)
    trials = [one["trial"] for one in found if one["event"] == "begin" and one["attempt"] == 1]
    one, other = trials[1], trials[2]
    head = [each for each in found if each.get("trial") not in (one, other)]
    blocks = {name: [each for each in found if each.get("trial") == name] for name in (one, other)}
    place = next(at for at, each in enumerate(found) if each.get("trial") == one)
    mixed = [*head[:place], *blocks[other], *blocks[one], *head[place:]]
    times = [{key: each[key] for key in ("seq", "utc", "monotonic")} for each in found]
    return {**content, "journal.jsonl": journal([{**each, **time} for each, time in zip(mixed, times, strict=True)])}


def _order_too(content: Content) -> Content:
    found = events(_reordered(content))
    begun = [one for one in found if one["event"] == "begin"]
    for place, one in enumerate(dict.fromkeys(one["trial"] for one in begun), start=1):
        for each in found:
            if each.get("trial") == one and each["event"] == "begin":
                each["order"] = place
    return {**content, "journal.jsonl": journal(found)}


def _without(content: Content, event: str) -> Content:
    """Leave out the last event of a kind, with all that follows renumbered."""
    found = events(content)
    at = max(place for place, one in enumerate(found) if one["event"] == event)
    left = [{**one, "seq": seq} for seq, one in enumerate(found[:at] + found[at + 1 :], start=1)]
    return {**content, "journal.jsonl": journal(left)}


def _result(content: Content) -> Content:
    name = next(name for name in content if name.endswith("result.json"))
    return {**content, name: b'{"steps": 101}'}


def _log(content: Content) -> Content:
    name = next(name for name in content if name.endswith("referee.log"))
    return {**content, name: content[name] + b"2026-11-22T09:00:02.000000000Z tick\n"}


def _image(content: Content) -> Content:
    name = next(name for name in content if name.endswith("containers.json"))
    found = json.loads(content[name])
    found["runner"]["Image"] = f"sha256:{'0' * 64}"
    return {**content, name: json.dumps(found).encode()}


def _exit_code(content: Content) -> Content:
    good = next(name for name in content if name.endswith("result.json") and b"100" in content[name])
    name = f"{good.partition('/results/')[0]}/containers.json"
    found = json.loads(content[name])
    found["runner"]["State"]["ExitCode"] = 1
    return {**content, name: json.dumps(found).encode()}


def _hidden_failure(content: Content) -> Content:
    """Take the attempt that failed out of everything, and give its number to the next one."""
    found = events(content)
    trial = next(one["trial"] for one in found if one["event"] == "begin")
    left = [one for one in found if (one.get("trial"), one.get("attempt")) != (trial, 1)]
    kept = {name: data for name, data in content.items() if not name.startswith(f"trials/{trial}/")}
    return {**kept, "journal.jsonl": journal([{**one, "seq": seq} for seq, one in enumerate(left, start=1)])}


def _placement(content: Content) -> Content:
    name = "sessions/1/assignment.json"
    found = json.loads(content[name])
    found["assignment"]["runner"] = "r2"
    return {**content, name: json.dumps(found).encode()}


def _edf(content: Content) -> Content:
    name = "sessions/1/inputs/race.edf"
    return {**content, name: content[name].replace(b"below: 150", b"below: 250")}


def _seed_of_design(content: Content) -> Content:
    """With the file's hash in the record changed too."""
    import hashlib

    name = "sessions/1/inputs/race.edf"
    data = content[name].replace(b"seed: 7", b"seed: 8")
    old, new = (hashlib.sha256(one).hexdigest().encode() for one in (content[name], data))
    listed = content["sessions/1/inputs.json"].replace(old, new)
    return {**content, name: data, "sessions/1/inputs.json": listed}


def _crate(content: Content) -> Content:
    found = json.loads(content[CRATE])
    digest = next(one for one in found["@graph"] if one["@id"] == "trials.csv")
    digest["sha256"] = "0" * 64
    return {**content, CRATE: json.dumps(found).encode()}


@pytest.mark.parametrize(
    ("change", "finds"),
    [
        (_swapped_rows, "J2"),
        (lambda content: {**content, "metrics.csv": content["metrics.csv"].replace(b"100.0", b"99.0")}, "J2"),
        (_crate, "S1"),
        (lambda content: {**content, "README.md": content["README.md"] + b"It is all true.\n"}, "S2"),
    ],
)
def test_what_was_changed_alone_with_a_new_manifest_is_found(
    content: Content, tmp_path: Path, change: Change, finds: str
) -> None:
    assert finds in failed(packed(with_manifest(change(content)), tmp_path / "b.zip"))


@pytest.mark.parametrize(
    ("change", "finds"),
    [
        (lambda content: _row(content, 1, 1, seed=1), "D2"),
        (lambda content: _row(content, 1, 1, p_SPEED="2"), "D2"),
        (lambda content: _row(content, 1, 1, verdict="unknown"), "M1"),
        (lambda content: _row(content, 2, 1, m_steps=90.0), "M1"),
        (lambda content: _row(content, 2, 1, m_ticks=None), "M1"),
        (_reordered, "D3"),
        (_order_too, "D3"),
        (lambda content: _without(content, "end"), "J1"),
        (lambda content: _without(content, "begin"), "J1"),
        (_hidden_failure, "J1"),
        (_result, "F3"),
        (_log, "M1"),
        (_image, "I1"),
        (_exit_code, "M1"),
        (_placement, "D4"),
        (_edf, "D1"),
        (_seed_of_design, "D2"),
    ],
)
def test_what_a_careful_forger_changed_is_found_by_what_follows(
    content: Content, tmp_path: Path, change: Change, finds: str
) -> None:
    """Tables, papers, crate and manifest are made anew to fit."""
    assert failed(packed(forged(content), tmp_path / "same.zip")) == set(), "a forger who changes nothing is not found"
    assert finds in failed(packed(forged(change(content)), tmp_path / "b.zip"))


def test_whoever_signed_it_is_looked_up_among_the_signers(run: Path, tmp_path: Path) -> None:
    """Somebody else's signature, a signature for something else, and none at all do not count."""
    from srprov.controller.bundling import signer
    from srprov.controller.signature import signature

    for name in ("ada", "eve"):
        key = str(tmp_path / name)
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    public = (tmp_path / "ada.pub").read_text().rsplit(" ", 1)[0]
    signers = tmp_path / "signers"
    signers.write_text(f"ada@lab {public}\n")
    signed = tmp_path / "signed.zip"
    bundle(run, signed, sign=signer(str(tmp_path / "ada"), "x"))
    assert failed(signed, str(signers)) == set()
    found = unpacked(signed)
    (tmp_path / "m").write_bytes(found[MANIFEST])
    (tmp_path / "m.sig").write_bytes(found[f"{MANIFEST}.sig"])
    words = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", "ada@lab", "-n", "srprov-bundle", "-s"]
    with (tmp_path / "m").open() as manifest:
        subprocess.run([*words, str(tmp_path / "m.sig")], stdin=manifest, check=True, capture_output=True)
    for sign in (
        signer(str(tmp_path / "eve"), "x"),
        lambda manifest: signature(manifest, "x", str(tmp_path / "ada")),  # of a plan
        None,
    ):
        bundle(run, tmp_path / "b.zip", sign=sign)
        assert failed(tmp_path / "b.zip", str(signers)) == {"F4"}
    changed = forged(_row(found, 1, 1, seed=1))
    assert "F4" in failed(packed({**changed, f"{MANIFEST}.sig": found[f"{MANIFEST}.sig"]}, signed), str(signers))


def test_the_exit_code_says_what_came_of_it(
    bundled: Path, content: Content, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli(["verify", str(bundled)]) == 0
    told = capsys.readouterr()
    assert "FAIL" not in told.out and "not from a careful forger" in told.err
    changed = packed(with_manifest(_swapped_rows(content)), tmp_path / "b.zip")
    assert cli(["verify", str(changed)]) == 2
    assert capsys.readouterr().out.splitlines()[:2] == [
        "FAIL J2  tables follow from the journal",
        "         trials.csv is not what follows from the journal",
    ]
