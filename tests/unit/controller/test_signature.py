"""Only a plan that a known key signed is taken with --signers; what is in the file is not looked at before."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.controller.signature import signature, verified
from srprov.errors import RefusedError, UsageError

PLAN = b'{"plan": 1}\n'


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with two keys, of which one is a signer's, and a plan that this one signed."""
    for name in ("anna", "mallory"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / name)], check=True)
    (tmp_path / "signers").write_text("anna@lab " + (tmp_path / "anna.pub").read_text())
    (tmp_path / "plan.json").write_bytes(PLAN)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.json.sig").write_bytes(signature(PLAN, "plan.json", "anna"))
    return tmp_path


def test_a_signers_plan_is_read(here: Path) -> None:
    assert verified("plan.json", "signers") == PLAN


@pytest.mark.parametrize("change", ["content", "other key", "no signature", "garbage", "other namespace", "nobody"])
def test_any_other_is_refused(here: Path, change: str) -> None:
    """Changed, signed by somebody else or for something else, or not signed at all: exit 9 names the file."""
    if change == "content":
        (here / "plan.json").write_bytes(PLAN + b" ")
    if change == "other key":
        (here / "plan.json.sig").write_bytes(signature(PLAN, "plan.json", "mallory"))
    if change == "no signature":
        (here / "plan.json.sig").unlink()
    if change == "garbage":
        (here / "plan.json.sig").write_bytes(b"\0" * 100)
    if change == "other namespace":
        done = subprocess.run(
            ["ssh-keygen", "-Y", "sign", "-q", "-f", "anna", "-n", "git"], input=PLAN, capture_output=True, check=True
        )
        (here / "plan.json.sig").write_bytes(done.stdout)
    if change == "nobody":
        (here / "signers").write_text("")
    with pytest.raises(RefusedError, match=r"plan\.json has no signature") as caught:
        verified("plan.json", "signers")
    assert caught.value.exit_code == 9


def test_an_edf_cannot_be_signed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    assert run(["apply", "e.edf", "-i", "inv.yml", "--yes", "--signers", "signers"]) == 5
    assert "--signers is for plans" in capsys.readouterr().err


def test_a_key_that_is_none_is_told(here: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot sign plan\.json"):
        signature(PLAN, "plan.json", "signers")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--sign", "anna"], "--sign signs the file that -o writes"),
        (["-o", "plan.edf"], "a plan's name does not end in .edf"),
        (["-o", "Plan.YML"], "a plan's name does not end in .edf"),
    ],
)
def test_what_could_not_be_applied_is_not_written(
    here: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    assert run(["plan", "e.edf", "-i", "inv.yml", *words]) == 5
    assert said in capsys.readouterr().err


def test_a_plan_is_not_taken_from_a_file_that_is_named_like_an_edf(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "experiment.edf").write_bytes(PLAN)
    assert run(["apply", "experiment.edf", "-i", "inv.yml", "--yes"]) == 5
    assert "experiment.edf is named like an EDF, and is none" in capsys.readouterr().err
