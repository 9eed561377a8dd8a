"""Runs of strangers in bundles: what they say of attempts and sessions costs no more than what the bundle holds."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.errors import UsageError
from srprov.evidence import checks_values, crate_runs, deposits, descriptions, replay, session, story
from srprov.evidence.verify import verify
from tests.bounded import bounded
from tests.unit.evidence.bundles import Content, archive, as_it_is, events, forged, journal, packed, with_manifest


@pytest.mark.parametrize("odd", [{"trial": []}, {"status": [1]}, {"segment": [1]}, {"attempt": True}, {"attempt": "1"}])
def test_an_end_without_a_row_of_an_attempt_is_none(content: Content, tmp_path: Path, odd: dict[str, object]) -> None:
    found = events(content)
    end = [one for one in found if one["event"] == "end"][-1]
    end["row"] |= odd
    report = verify(str(packed(with_manifest({**content, "journal.jsonl": journal(found)}), tmp_path / "a.zip")))
    (said,) = (one.details[0] for one in report.findings if one.id == "D1")
    assert said == f"journal.jsonl:{end['seq']} ends an attempt without a row of it"


def test_files_are_read_for_one_attempt_alone(content: Content, tmp_path: Path) -> None:
    """Else a small bundle has a log read thousands of times: once for each time that its attempt ended."""
    found = events(content)
    end = [one for one in found if one["event"] == "end"][-1]
    found += [{**end, "seq": len(found) + number} for number in range(1, 3)]
    report = verify(str(packed(with_manifest({**content, "journal.jsonl": journal(found)}), tmp_path / "a.zip")))
    (said,) = (one.details[0] for one in report.findings if one.id == "D1")
    assert said.endswith("which ended before") and not any(one.id == "M1" for one in report.findings)


def test_sessions_that_differ_have_so_many_trials_together(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = {name.removeprefix("sessions/1/"): data for name, data in content.items() if name.startswith("sessions/1/")}
    more = {f"sessions/{number}/{name}": data for number in (2, 3) for name, data in one.items()}
    monkeypatch.setattr("srprov.evidence.story._MOST_TRIALS", 9)
    packed(with_manifest({**content, **more}), tmp_path / "alike.zip")
    assert not _said("trials that differ", tmp_path / "alike.zip")
    more |= {f"sessions/{number}/assignment.json": one["assignment.json"] + b" " * number for number in (2, 3)}
    packed(with_manifest({**content, **more}), tmp_path / "a.zip")
    assert _said("trials that differ", tmp_path / "a.zip")


def differing(content: Content, count: int, *, edf: bool) -> Content:
    """Return a bundle whose further sessions each have another EDF, or other facts alone."""
    one = {name.removeprefix("sessions/1/"): data for name, data in content.items() if name.startswith("sessions/1/")}
    more = {}
    for number in range(2, count + 1):
        own = dict(one)
        own["inputs/race.edf" if edf else "facts.json"] += b"\n" * number
        if edf:
            sha256 = hashlib.sha256(own["inputs/race.edf"]).hexdigest().encode()
            own["inputs.json"] = own["inputs.json"].replace(
                hashlib.sha256(one["inputs/race.edf"]).hexdigest().encode(), sha256
            )
        more |= {f"sessions/{number}/{name}": data for name, data in own.items()}
    return with_manifest({**content, **more})


def test_sessions_are_of_few_experiments_and_each_is_read_once(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A definition of 150 KB takes a second: two hundred of them would be minutes."""
    assert _said("of more than 4 experiments that differ", packed(differing(content, 5, edf=True), tmp_path / "a.zip"))
    read: list[str] = []
    load = session.load_experiment
    monkeypatch.setattr(
        session, "load_experiment", lambda path, *more, **by: read.append(path) or load(path, *more, **by)
    )
    path = packed(differing(content, 9, edf=False), tmp_path / "b.zip")
    assert not _said("experiments that differ", path) and len(read) == 1
    monkeypatch.setattr(session, "_MOST_PAIRS", 8)
    assert _said("pairs of services and robots together", path)


@pytest.mark.parametrize("odd", [10**15, -1, 1e300, "x", None, [], {"a": 1}, True])
def test_odd_numbers_are_none_to_what_describes_a_bundle(content: Content, tmp_path: Path, odd: object) -> None:
    found = events(content)
    for one in found:
        if one["event"] == "end":
            one["row"] |= {"duration_s": odd, "containers": [{"cpu_s": odd}, {"cpu_s": 1.5}, odd]}
    report = verify(str(packed(forged({**content, "journal.jsonl": journal(found)}), tmp_path / "a.zip")))
    assert {one.id for one in report.findings if one.id in ("S1", "S2") and one.result != "pass"} == set()


def test_a_journal_of_short_texts_is_not_read_into_memory(content: Content, tmp_path: Path) -> None:
    """Each of seven bytes takes 88."""
    first = len(events(content)) + 1
    many = '"éł",' * 990_000
    lines = (f'{{"seq":{first + at},"event":"run","a":[{many}1]}}\n' for at in range(4))
    made = with_manifest({**content, "journal.jsonl": content["journal.jsonl"] + "".join(lines).encode()})
    assert bounded(lambda: _said("more than 2000000 texts", packed(made, tmp_path / "a.zip")))


def test_a_small_journal_makes_no_large_tables(content: Content, tmp_path: Path) -> None:
    """An attempt is a hundred bytes in it, and in tables and crate has a word for each column and robot."""
    found = events(content)
    lines = [
        f'{{"seq":{number},"event":"end","trial":"t{number}","row":{{"trial":"t{number}","attempt":1,"status":"x"}}}}\n'
        for number in range(len(found) + 1, 70_000)
    ]
    made = with_manifest({**content, "journal.jsonl": content["journal.jsonl"] + "".join(lines).encode()})
    assert bounded(lambda: _said("cells and services together", packed(made, tmp_path / "a.zip")))


def test_patterns_that_take_long_are_not_waited_for(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line of a log takes seconds with one of them: hours with two hundred, of a bundle of a megabyte."""
    monkeypatch.setattr(checks_values, "_SEARCH_S", 0.2)
    line = b"2026-11-22T09:00:01Z " + b"a" * 65_000 + b"\n"
    slow = content["sessions/1/inputs/race.edf"].replace(b"'^tick'", b"'(a?){500}a{500}z'")
    logs = {name: line * 20 for name in content if name.endswith("r2.referee.log")}
    made = with_manifest({**content, **logs, "sessions/1/inputs/race.edf": slow})
    report = bounded(lambda: verify(str(packed(made, tmp_path / "a.zip"))), cpu_s=4)
    (found,) = (one for one in report.findings if one.id == "M1")
    assert found.result == "skipped" and "its patterns take longer than" in found.details[0]


DATA = ["inputs/race.edf/x", "inputs/tracks", f"inputs/{'x' * 300}", f"inputs/{'x/' * 3000}x", f"inputs/{'x/' * 101}x"]


@pytest.mark.parametrize("place", [None, *DATA])
def test_names_that_no_folder_can_have_are_a_finding(content: Content, tmp_path: Path, place: str | None) -> None:
    """A file of 300 letters, and data sets below a file, in the place of a folder, and of long names."""
    changed = {**content, f"sessions/1/inputs/{'x' * 300}": b"x"}
    if place is not None:
        about = json.loads(content["sessions/1/inputs.json"])
        about["files"].append({"path": "x", "data": place, "sha256": "0" * 64})
        changed = {**content, "sessions/1/inputs.json": json.dumps(about).encode()}
    assert _said("names that no folder can have", packed(with_manifest(changed), tmp_path / "a.zip"))


PLACED = [{"runner": "../../../../tmp/x"}, {"runner": "/etc/x"}, {"runner": "r1\nr2"}, {"runner": ""}, {"a/b": "r1"}]


@pytest.mark.parametrize("placed", PLACED)
def test_who_runs_what_has_names_that_services_and_robots_can_have(
    content: Content, tmp_path: Path, placed: dict[str, str]
) -> None:
    """On a lab, robots have the bundle's names: the log of one that is called /etc/x would be written there."""
    about = json.loads(content["sessions/1/assignment.json"])
    about["assignment"] |= placed
    path = packed(
        with_manifest({**content, "sessions/1/assignment.json": json.dumps(about).encode()}), tmp_path / "a.zip"
    )
    assert _said("cannot be the name of a", path)
    with pytest.raises(UsageError, match="cannot be the name of a"):
        replay.read(as_it_is(path))


@pytest.mark.parametrize("hosts", [None, [], "r1", {"r1": None}, {"r1": {"srprov_pid": ["x"]}}])
def test_an_odd_inventory_has_no_instruments(content: Content, hosts: object) -> None:
    with story.read(archive(content)) as told:
        about = descriptions.told_of(archive(content), told, {})
    assert list(deposits.instruments(replace(about, inventory={"all": {"hosts": hosts}}))) == []
    assert list(deposits.instruments(replace(about, inventory={"all": hosts}))) == []


def test_variables_are_left_out_where_attempts_would_refer_to_very_many(
    content: Content, monkeypatch: pytest.MonkeyPatch
) -> None:
    with story.read(archive(content)) as told:
        about = descriptions.told_of(archive(content), told, {})
        assert [one["name"] for one in crate_runs.environment(about)] == ["FAVOURS"]
        monkeypatch.setattr(crate_runs, "_MOST_REFERENCES", 4)
        assert crate_runs.environment(about) == []


def test_a_file_of_this_machine_that_a_cdf_extends_says_nothing_of_itself(content: Content, tmp_path: Path) -> None:
    """What it requires would show in the placement that follows: a robot of the bundle may have any memory."""
    (tmp_path / "private.cdf").write_text("cdf: 1\nname: private\nimage: busybox\nrequires: {memory: 12345g}\n")
    name = "sessions/1/inputs/runner.cdf"
    text = content[name].decode().replace("common.cdf", f"{tmp_path}/private.cdf")
    assert "private.cdf" in text
    path = packed(with_manifest({**content, name: text.encode()}), tmp_path / "a.zip")
    (said,) = (one.details[0] for one in verify(str(path)).findings if one.id == "D1")
    assert "a path that only one machine has" in said
    assert not any(one.id == "D4" for one in verify(str(path)).findings)


def _said(words: str, path: Path) -> bool:
    return any(words in text for one in verify(str(path)).findings for text in one.details)


def test_a_placement_follows_from_no_variables_that_an_experiment_ships(content: Content, tmp_path: Path) -> None:
    """Ansible would read them with an inventory beside them; the record of one has all that counted then."""
    text = b"ansible_ssh_extra_args: -o ProxyCommand=id\nsrprov_tags: [odd]\nsrprov_slots: 0\n"
    about = json.loads(content["sessions/1/inputs.json"])
    place = "inputs/group_vars/all.yml"
    about["files"].append({"path": "group_vars/all.yml", "file": place, "sha256": hashlib.sha256(text).hexdigest()})
    changed = {**content, f"sessions/1/{place}": text, "sessions/1/inputs.json": json.dumps(about).encode()}
    report = verify(str(packed(with_manifest(changed), tmp_path / "a.zip")))
    assert {one.id: one.result for one in report.findings if one.id in ("D1", "D4")} == {"D1": "pass", "D4": "pass"}
