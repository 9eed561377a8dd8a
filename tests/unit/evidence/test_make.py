"""Bundles: equal for equal runs, whole, and without what is nobody else's business."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import zipfile
from pathlib import Path
from urllib.parse import quote

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run as cli
from srprov.definitions import load_experiment
from srprov.errors import DefinitionError, RefusedError, UsageError
from srprov.evidence.files import NotThere
from srprov.evidence.make import bundle
from srprov.evidence.replay import unpack
from srprov.evidence.session import data_sets
from srprov.evidence.verify import verify
from srprov.record.journal import Journal, read
from srprov.record.memory import note_ran, note_secret_files
from srprov.secret import Secret, forget
from tests.bounded import bounded
from tests.trial_folders import EDF, FILES, MACHINE, run_folder, write_experiment
from tests.unit.evidence.bundles import archive, as_it_is, unpacked

CANARY = "c4n4ry/of a coal+mine"


def test_two_bundles_of_one_run_are_equal_wherever_whoever_and_whenever_they_are_made(
    run: Path, bundled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made of a copy, by a user of another name with another home, another umask and later; one is signed."""
    copy = tmp_path / "elsewhere" / "deep"
    shutil.copytree(run, copy)
    monkeypatch.chdir(tmp_path)
    for name, value in {
        "USER": "eve",
        "LOGNAME": "eve",
        "HOME": str(tmp_path),
        "TZ": "Asia/Tokyo",
        "LANG": "C",
    }.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("time.time", lambda: 2_000_000_000.0)
    before = os.umask(0o077)
    try:
        bundle(Path("elsewhere/deep"), Path("b.zip"))
    finally:
        os.umask(before)
    assert Path("b.zip").read_bytes() == bundled.read_bytes()
    bundle(copy, tmp_path / "signed.zip", sign=lambda _manifest: b"signature")
    signed = unpacked(tmp_path / "signed.zip")
    assert signed.pop("manifest-sha256.txt.sig") == b"signature"
    assert signed == unpacked(bundled)


def test_a_bundle_is_a_zip_that_plain_tools_check(bundled: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(bundled) as archive:
        assert archive.testzip() is None
        archive.extractall(tmp_path)
        modes = {one.external_attr >> 16 for one in archive.infolist()}
    assert modes == {0o100644}
    subprocess.run(["sha256sum", "-c", "--strict", "--quiet", "manifest-sha256.txt"], cwd=tmp_path, check=True)
    told = subprocess.run(
        ["awk", "-F,", "$7 == \"ok\" && $8 == \"success\"", "trials.csv"], cwd=tmp_path, check=True, capture_output=True
    )  # fmt: skip
    assert len(told.stdout.splitlines()) == 2


def test_all_of_the_run_is_in_it(run: Path, bundled: Path) -> None:
    """Files as they came byte for byte; what srprov wrote, but for addresses, hosts and users."""
    found = unpacked(bundled)
    there = {str(path.relative_to(run)) for path in run.rglob("*") if path.is_file()} - {"sessions/1/hardware.json"}
    more = {"README.md", "CITATION.cff", "bundle.json", "ro-crate-metadata.json", "manifest-sha256.txt", "LICENSE",
            "CHECKLIST.md", ".zenodo.json", "datacite.json"}  # fmt: skip
    assert set(found) == there | more
    for name in there:
        same = found[name] == (run / name).read_bytes()
        assert same or name.startswith("sessions/1/"), name
    for name, text in FILES.items():
        assert found[f"sessions/1/inputs/{name}"] == text.encode()


def test_a_record_holds_values_and_nothing_of_this_process(run: Path) -> None:
    """An address in memory would make each record another one, and tell nobody anything."""
    decided = json.loads((run / "sessions/1/assignment.json").read_text())["decision"]
    assert decided["placed"] == {"referee": "r2", "runner": "r1"} and decided["optimal"] is True
    for path in (run / "sessions").rglob("*"):
        assert path.is_dir() or b" at 0x" not in path.read_bytes(), path


def test_files_above_the_experiments_folder_come_too_and_are_found_there(tmp_path: Path) -> None:
    shared = FILES["runner.cdf"].replace("common.cdf", "../shared/common.cdf")
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "common.cdf").write_text(FILES["common.cdf"])
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "race", {**FILES, "runner.cdf": shared}))
    bundle(run, tmp_path / "b.zip")
    found = unpacked(tmp_path / "b.zip")
    assert found["sessions/1/inputs/shared/common.cdf"] == FILES["common.cdf"].encode()
    assert "sessions/1/inputs/edf/race.edf" in found
    assert [name for name, content in found.items() if f"{tmp_path}".encode() in content] == []
    (tmp_path / "shared" / "common.cdf").unlink()
    assert not verify(str(tmp_path / "b.zip")).failed


def test_a_file_by_a_path_that_only_this_machine_has_makes_no_bundle(tmp_path: Path) -> None:
    """It would pass here and nowhere else."""
    text = EDF.replace("cdf: runner.cdf", f"cdf: {tmp_path}/elsewhere.cdf")
    (tmp_path / "elsewhere.cdf").write_text(FILES["common.cdf"] + "command: [run]\n")
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "race", {**FILES, "race.edf": text}))
    with pytest.raises(UsageError, match="a path that only one machine has"):
        bundle(run, tmp_path / "b.zip")


def test_a_run_that_shipped_a_repository_is_told_so_before_anything_is_written(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of an EDF that mounts `./.git`; to run it again as it was helps nobody."""
    copy = shutil.copytree(run, tmp_path / "copy")
    for name in ("logs/HEAD", "HEAD"):
        (copy / "sessions/1/inputs/.git" / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / "sessions/1/inputs/.git" / name).write_text("x")
    assert cli(["bundle", str(copy), "-o", str(tmp_path / "b.zip")]) == 5
    said = capsys.readouterr().err
    assert "it has sessions/1/inputs/.git/HEAD: a repository here could name programs" in said
    assert "run it without that among what the EDF ships" in said


def test_what_a_record_has_elsewhere_is_told_as_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The record of such a run is no repository, but what a replay ships would be one."""
    more = {"HEAD": "ref: refs/heads/main\n", "objects/x": "", "refs/x": "", "config": "[core]"}
    files = {**FILES, **{f"tracks/{name}": text for name, text in more.items()}}
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "race", files))
    kept = run / "sessions/1/inputs/tracks"
    assert (kept / "config").exists() and not (kept / "HEAD").exists()
    assert cli(["bundle", str(run), "-o", str(tmp_path / "b.zip")]) == 5
    assert "it has sessions/1/inputs/tracks/HEAD: a repository here could name programs" in capsys.readouterr().err
    assert cli(["compare", str(run), str(run)]) == 0


def test_a_run_of_a_robot_with_a_hash_in_a_tag_is_read(run: Path, tmp_path: Path) -> None:
    """A record has all robots in a line; in another inventory no key stands behind what looks like a comment."""
    copy = shutil.copytree(run, tmp_path / "copy")
    place = copy / "sessions/1/inputs/inventory.yml"
    inventory = json.loads(place.read_text())
    hosts = inventory["all"]["hosts"]
    for host in hosts.values():
        host["srprov_tags"] = [*host.get("srprov_tags", ()), "arm #2"]
    place.write_text(json.dumps(inventory))
    assert cli(["bundle", str(copy), "-o", str(tmp_path / "b.zip")]) == 0


def test_nothing_tells_how_robots_are_reached(run: Path, bundled: Path) -> None:
    facts = json.loads((run / "sessions/1/facts.json").read_text())
    inventory = json.loads((run / "sessions/1/inputs/inventory.yml").read_text())
    environment = json.loads((run / "sessions/1/environment.json").read_text())
    words = {host["ansible_host"] for host in inventory["all"]["hosts"].values()} | {environment["owner"]}
    words |= {environment["source"]["file"].rpartition("/")[0]}
    tokens = json.loads((run / "sessions/1/hardware.json").read_text())["tokens"]
    assert set(tokens) == {"B1DA5A20", MACHINE}
    words |= {*tokens}
    words |= {link["mac"] for one in facts["robots"].values() for link in one["links"]}
    assert len(words) > 6
    for name, content in unpacked(bundled).items():
        assert [word for word in words if word.encode() in content] == [], name
    robot = json.loads(unpacked(bundled)["sessions/1/facts.json"])["robots"]["r1"]
    assert (robot["hosts"], robot["homes"]) == ([], [])
    assert (robot["machine_id"], robot["serials"]) == (tokens[MACHINE], [f"046d:0825 {tokens['B1DA5A20']}"])
    hosts = json.loads(unpacked(bundled)["sessions/1/inputs/inventory.yml"])["all"]["hosts"]
    assert {key for host in hosts.values() for key in host} == {"ansible_host", "srprov_tags", "srprov_devices"}


FORMS = [CANARY, base64.b64encode(CANARY.encode()).decode(), quote(CANARY, safe=""), CANARY.encode().hex()]


def test_a_log_that_is_one_line_costs_no_more_than_others(run: Path, tmp_path: Path) -> None:
    """Its words are replaced as anywhere, also where the line is cut, and its metrics are those of its beginning."""
    copy, name = tmp_path / "run", "trials/4e9ce07a82-r002/logs/r1.runner.log"
    shutil.copytree(run, copy)
    with (copy / name).open("a") as log:
        log.write("2026-11-22T09:00:01.0Z ")
        for _ in range(8):
            log.write("from 10.0.0.1 to somewhere else on this long line, which is one word after the other " * 30_000)
    bounded(lambda: bundle(copy, tmp_path / "b.zip"), cpu_s=30.0, memory=40 << 20)
    kept = unpacked(tmp_path / "b.zip")[name]
    assert kept.count(b"from 192.0.2.1 to ") == 8 * 30_000 and b"10.0.0." not in kept
    report = bounded(lambda: verify(str(tmp_path / "b.zip")), cpu_s=10.0, memory=40 << 20)
    assert not report.failed


@pytest.mark.soak
def test_a_thousand_trials_are_bundled_and_verified_in_seconds(tmp_path: Path) -> None:
    text = EDF.replace("repetitions: 2", "repetitions: 500")
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "race", {**FILES, "race.edf": text}))
    made = bounded(lambda: bundle(run, tmp_path / "b.zip"), cpu_s=30.0)
    assert made.files > 6000
    assert not bounded(lambda: verify(str(tmp_path / "b.zip")), cpu_s=30.0).failed


PLACES = {
    "trials/4e9ce07a82-r002/logs/r2.referee.log": "",
    "trials/4e9ce07a82-r002/results/runner/out/result.json": "",
    "sessions/1/inputs/race.edf": "",
    "sessions/1/facts.json": "amd64",
    "sessions/1/environment.json": "not a git repository",
    "sessions/1/inputs/inventory.yml": "gpu",
    "journal.jsonl": "abcdef01",
}
"""File -> a word of it in whose place a secret leaves it JSON; nothing: at its end."""


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", PLACES)
def test_a_secret_in_whatever_form_stops_it(run: Path, tmp_path: Path, form: str, name: str) -> None:
    """Nothing is left of what was written so far."""
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    text, word = (copy / name).read_text(), PLACES[name]
    assert word in text
    (copy / name).write_text(text.replace(word, form, 1) if word else f"{text}# {form}\n")
    Secret(CANARY)
    with pytest.raises(RefusedError, match="the value of a secret") as refused:
        bundle(copy, tmp_path / "b.zip")
    assert name in refused.value.message and CANARY not in refused.value.message
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
    assert refused.value.exit_code == 9


@pytest.mark.parametrize("kind", ["env", "file", "bare"])
def test_secrets_of_the_experiment_are_looked_for_where_they_come_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """In a variable of the controller, in a file beside the EDF, and in a variable that a service takes over."""
    source = {"env": "{env: TOKEN}", "file": "{file: token.txt}", "bare": "{command: [false]}"}[kind]
    text = EDF.replace("services:", f"secrets: {{token: {source}}}\nservices:")
    if kind == "bare":
        text = text.replace("env_file: referee.env", "environment: [TOKEN]")
    monkeypatch.setenv("TOKEN", "something else" if kind == "file" else CANARY)
    edf = write_experiment(tmp_path / "experiment", {**FILES, "race.edf": text, "token.txt": CANARY})
    run = run_folder(tmp_path / "run", edf, log=["tick", f"I have {CANARY}"])
    if kind == "file":  # of a stranger's run: nobody allowed it here
        assert cli(["bundle", str(run), "-o", str(tmp_path / "b.zip")]) == 0
        assert "note: token cannot be read here" in capsys.readouterr().err
        (tmp_path / "b.zip").unlink()
        note_secret_files([os.path.realpath(edf.parent / "token.txt")])
    else:
        _given(run, "TOKEN")
    assert cli(["bundle", str(run), "-o", str(tmp_path / "b.zip")]) == 9
    told = capsys.readouterr().err
    assert "r2.referee.log: the value of a secret" in told and CANARY not in told
    assert ("note: token cannot be read here" in told) is (kind == "bare")
    assert not (tmp_path / "b.zip").exists()


def _given(run: Path, *variables: str) -> None:
    """Let this machine remember which variables it gave to a run."""
    (run / "token").write_text(32 * "a")
    assert note_ran({f"{32 * 'a'} variables": variables}) == ""


@pytest.mark.parametrize("kind", ["secret", "bare", "unlisted", "env_file"])
def test_a_run_of_a_stranger_has_no_variable_of_this_machine_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """Whether there is a bundle told whether a guess in it was right, or whether there is such a variable."""
    text, files = EDF, FILES
    if kind == "secret":
        text = text.replace("services:", "secrets: {token: {env: TOKEN}}\nservices:")
    elif kind == "env_file":
        files = {**FILES, "referee.env": f"{FILES['referee.env']}TOKEN\n"}
    else:
        text = text.replace("env_file: referee.env", "environment: [TOKEN]")
    monkeypatch.setenv("TOKEN", CANARY)
    edf = write_experiment(tmp_path / "experiment", {**files, "race.edf": text})
    run = run_folder(tmp_path / "run", edf, log=["tick", f"I guess {CANARY}"])
    if kind == "unlisted":
        given = run / "sessions" / "1" / "inputs.json"
        given.write_text(json.dumps({**json.loads(given.read_text()), "variables": []}))
    forget()
    _given(tmp_path, "TOKEN")  # as to a run of the user's own
    (run / "token").write_text(32 * "b")
    told = []
    for value in (CANARY, "another value", None):
        monkeypatch.delenv("TOKEN") if value is None else monkeypatch.setenv("TOKEN", value)
        told.append((cli(["bundle", str(run), "-o", str(tmp_path / "b.zip")]), capsys.readouterr()))
    assert told == 3 * [told[0]]
    assert told[0][0] == (5 if kind == "unlisted" else 0)
    note = "note: nobody looks for values of variables that this machine did not give to this run: TOKEN\n"
    assert (note in told[0][1].err) is (kind != "unlisted")


@pytest.mark.parametrize("way", ["../", "/", "link"])
def test_a_run_of_a_stranger_names_no_definition_elsewhere(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], way: str
) -> None:
    """What is wrong with a definition is told in its own words: they were those of any file of the user's."""
    copy, home = tmp_path / "run", tmp_path / "home"
    shutil.copytree(run, copy)
    home.mkdir()
    (home / "race.edf").write_text("edf: 1\nname: x\nservices: {a: {image: i, restart: nobodys-business}}\n")
    session = copy / "sessions" / "1"
    given = json.loads((session / "inputs.json").read_text())
    if way == "link":
        shutil.rmtree(session / "inputs")
        (session / "inputs").symlink_to(home)
    else:
        given["edf"] = str(home / "race.edf") if way == "/" else "inputs/../../../../home/race.edf"
    (session / "inputs.json").write_text(json.dumps(given))
    assert cli(["bundle", str(copy), "-o", str(tmp_path / "b.zip")]) == 5
    told = capsys.readouterr().err
    assert "nobodys-business" not in told
    assert ("is a link" if way == "link" else "names no EDF that is there") in told


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("-----BEGIN OPENSSH PRIVATE KEY-----", "a private key"),
        ("aws AKIAIOSFODNN7EXAMPLE", "an access key of AWS"),
        (f"push with ghp_{'a1' * 18}", "a token of GitHub"),
        ("wpa: password=correct-horse", "a password"),
        ("GET https://ada:correct-horse@host/", "a password in an address"),
        ("GET https://ada:it's-mine@host/", "a password in an address"),
    ],
)
def test_what_looks_like_a_secret_stops_it_until_a_person_looked(
    run: Path, tmp_path: Path, line: str, what: str
) -> None:
    copy, name = tmp_path / "run", "trials/4e9ce07a82-r002/logs/r2.referee.log"
    shutil.copytree(run, copy)
    (copy / name).write_text(f"2026-11-22T09:00:01.0Z tick\n2026-11-22T09:00:01.0Z tick {line}\n")
    with pytest.raises(RefusedError, match=what):
        bundle(copy, tmp_path / "b.zip")
    bundle(copy, tmp_path / "b.zip", no_secret=[name])
    assert name in unpacked(tmp_path / "b.zip")


def test_a_run_that_has_not_ended_or_cannot_be_told_is_refused(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    with pytest.raises(UsageError, match="it would hold itself"):
        bundle(copy, copy / "trials" / "b.zip")
    (copy / "trials" / "link").symlink_to("/etc/passwd")
    with pytest.raises(UsageError, match="is a link"):
        bundle(copy, tmp_path / "b.zip")
    (copy / "trials" / "link").unlink()
    (tmp_path / "credentials").write_text("aws_secret_access_key = decoy")
    (copy / "trials" / "link").hardlink_to(tmp_path / "credentials")
    with pytest.raises(UsageError, match="has another name"):
        bundle(copy, tmp_path / "b.zip")
    for place in (tmp_path / "credentials", copy / "trials" / "link"):
        place.unlink()
    events, _ = read(copy)
    with Journal(copy, len(events) + 1) as journal:
        journal.add("resume", run="x", same={})
    with pytest.raises(UsageError, match="under way, or was killed"):
        bundle(copy, tmp_path / "b.zip")
    shutil.rmtree(copy / "sessions")
    with Journal(copy, len(events) + 2) as journal:
        journal.add("ended", reason="")
    with pytest.raises(UsageError, match="it does not say what was run"):
        bundle(copy, tmp_path / "b.zip")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]


def test_the_verb_says_what_it_wrote(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli(["bundle", str(run), "-o", str(tmp_path / "b.zip"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["bytes"] == (tmp_path / "b.zip").stat().st_size and document["signed"] is False
    assert list(Draft202012Validator(data.schema("bundle")).iter_errors(document)) == []
    assert cli(["verify", str(tmp_path / "b.zip"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("verify")).iter_errors(document)) == []
    assert document["run"] == "20261122T090000Z-race-abcdef01" and document["failed"] is False


def test_the_placement_follows_from_the_record_alone(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also when the inventory that was used is not there any more."""
    home = run / "sessions" / "1"
    words = ["assign", str(home / "inputs/race.edf"), "-i", str(home / "inputs/inventory.yml")]
    assert cli([*words, "--facts", str(home / "facts.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    stated = json.loads((home / "assignment.json").read_text())
    assert found["assignment"] == stated["assignment"] and found["cost"] == pytest.approx(stated["cost"], abs=1e-6)


def test_seeds_come_too_and_of_data_sets_the_hash(tmp_path: Path) -> None:
    """A data set may be large: who runs it again puts the file where the definitions name it."""
    old = 'volumes: ["./tracks:/tracks"]'
    new = 'volumes: ["./tracks:/tracks", "state:/state"], data: [{path: ./sets/map.bin, target: /map}]'
    edf = EDF.replace(old, new) + "volumes: {state: {seed: ./first}}\n"
    files = {**FILES, "race.edf": edf, "first/known.txt": "first\n", "sets/map.bin": "1" * 9000}
    assert old in EDF
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "experiment", files))
    listed = {one["path"]: one for one in json.loads((run / "sessions/1/inputs.json").read_text())["files"]}
    digest = hashlib.sha256(b"1" * 9000).hexdigest()
    assert listed["sets/map.bin"] == {
        "path": "sets/map.bin", "data": "inputs/sets/map.bin", "sha256": digest, "size": 9000,
    }  # fmt: skip
    bundle(run, tmp_path / "b.zip")
    content = unpacked(tmp_path / "b.zip")
    assert content["sessions/1/inputs/first/known.txt"] == b"first\n"
    assert "sessions/1/inputs/sets/map.bin" not in content
    assert not verify(str(tmp_path / "b.zip")).failed
    again = tmp_path / "again"
    unpack(as_it_is(tmp_path / "b.zip"), again)
    with pytest.raises(DefinitionError) as missing:
        load_experiment(again / "race.edf")
    assert "sets/map.bin" in missing.value.problems[0].message
    (again / "sets").mkdir()
    (again / "sets" / "map.bin").write_text("1" * 9000)
    unpack(as_it_is(tmp_path / "b.zip"), again)
    assert load_experiment(again / "race.edf").experiment.name == "race"


@pytest.mark.parametrize("place", ["inputs/../../x", "/etc/x", "inputs//x", "sessions/x", "inputs/a/../../../x"])
def test_a_data_set_of_a_stranger_is_written_nowhere_else(place: str) -> None:
    files = {"home/inputs.json": json.dumps({"files": [{"path": "x", "data": place}]}).encode()}
    with pytest.raises(NotThere, match="a data set of no place"):
        data_sets(archive(files), "home")


def test_robots_that_do_the_parts_of_each_other_keep_their_names(run: Path, tmp_path: Path) -> None:
    """As after a replay with `--map r1=r2 --map r2=r1`: the system of each calls itself as the bundle calls another."""
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    for path in folder.glob("sessions/*/facts.json"):
        facts = json.loads(path.read_text())
        facts["robots"]["r1"]["hostname"], facts["robots"]["r2"]["hostname"] = "referee", "runner"
        facts["robots"] |= {"runner": facts["robots"]["r1"], "referee": facts["robots"]["r2"]}
        path.write_text(json.dumps(facts))
    bundle(folder, tmp_path / "b.zip")
    content = unpacked(tmp_path / "b.zip")
    before = json.loads((folder / "sessions/1/assignment.json").read_text())["assignment"]
    assert json.loads(content["sessions/1/assignment.json"])["assignment"] == before


@pytest.mark.parametrize("host", ["assignment", "status", "runner", "referee", "r2", 'r2"', '"r2": "r1"', "crashed"])
def test_no_robots_name_for_itself_changes_what_a_bundle_says(run: Path, tmp_path: Path, host: str) -> None:
    """It may be a word of srprov's documents, a service's or another robot's name, or no name at all."""
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    for path in folder.glob("sessions/*/facts.json"):
        facts = json.loads(path.read_text())
        facts["robots"]["r1"]["hostname"] = host
        path.write_text(json.dumps(facts))
    bundle(folder, tmp_path / "b.zip")
    content = unpacked(tmp_path / "b.zip")
    before = json.loads((folder / "sessions/1/assignment.json").read_text())["assignment"]
    assert json.loads(content["sessions/1/assignment.json"])["assignment"] == before
    assert content["trials.csv"] == (folder / "trials.csv").read_bytes()
    assert not [one.id for one in verify(str(tmp_path / "b.zip")).findings if one.result == "fail"]
