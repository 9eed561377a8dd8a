"""Between `verify` and what follows, a bundle may become another one: whoever can write to its folder sees to it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from srprov.cli.main import run as cli
from srprov.evidence import checks_files, verify
from srprov.evidence.checks_files import Hashed
from srprov.evidence.files import MANIFEST, Files
from tests.unit.evidence.bundles import Content, archive, packed, with_manifest

EVIL = b"cdf: 1\nimage: evil:1\n"
NOWHERE = "{ansible_host: 127.0.0.1, ansible_port: 1}"
INVENTORY = f"all: {{hosts: {{r1: {NOWHERE}, r2: {NOWHERE}}}}}\n"


def other(content: Content) -> Content:
    """Return a bundle whose runner is another one; all of its hashes are right."""
    return with_manifest({**content, "sessions/1/inputs/runner.cdf": EVIL})


def less(content: Content) -> Content:
    """Return a bundle without one of the files that were signed."""
    return {name: data for name, data in content.items() if not name.endswith("/oval.txt")}


def renamed(path: Path, content: Content) -> None:
    """Put another file in its place."""
    os.replace(packed(content, path.with_name("evil.zip")), path)


def rewritten(path: Path, content: Content) -> None:
    """Write into the file that is there."""
    packed(content, path)


@pytest.mark.parametrize("change", [other, less])
@pytest.mark.parametrize("put", [renamed, rewritten])
def test_what_is_run_is_what_was_verified(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    change: Callable[[Content], Content], put: Callable[[Path, Content], None],
) -> None:  # fmt: skip
    path, asked = packed(content, tmp_path / "race.zip"), []

    def swapping(bundle: str, signers: str = "") -> verify.Report:
        report = verified(bundle, signers)
        put(path, change(content))
        asked.append(report.failed)
        return report

    verified = verify.verify
    monkeypatch.setattr(verify, "verify", swapping)
    (tmp_path / "robots.yml").write_text(INVENTORY)
    code = cli(["replay", str(path), "-i", str(tmp_path / "robots.yml"), "-o", str(tmp_path / "again"), "--yes"])
    assert asked == [False] and code == 5
    assert "when it was verified" in capsys.readouterr().err
    assert not (tmp_path / "again").exists()


class Turning:
    """A bundle that has another manifest, and with it other files, each time that one asks."""

    def __init__(self, *some: Files) -> None:
        self.some, self.reads = some, 0

    @property
    def sizes(self) -> Mapping[str, int]:
        return self.some[0].sizes

    def pieces(self, name: str) -> Iterator[bytes]:
        self.reads += name == MANIFEST
        return self.some[min(self.reads, len(self.some)) - 1].pieces(name)


def test_the_manifest_that_is_compared_is_the_one_that_was_signed(
    content: Content, monkeypatch: pytest.MonkeyPatch
) -> None:
    signed: list[bytes] = []
    monkeypatch.setattr(checks_files, "complaint", lambda text, *_more: signed.append(text) or "")
    whole = {**content, f"{MANIFEST}.sig": b"signature"}
    hashed = Hashed(Turning(archive(whole), archive({**other(whole), f"{MANIFEST}.sig": b"signature"})))
    assert not [*checks_files.hashes(hashed), *checks_files.nothing_else(hashed), *checks_files.signature(hashed, "s")]
    assert signed == [content[MANIFEST]] and hashed.sha256("sessions/1/inputs/runner.cdf") in signed[0].decode()
