"""Where an engine keeps its files, read of its configuration by the shells of robots."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.facts.answers import parse_disk
from srprov.facts.probes import PROBES
from srprov.modules import container_limits
from srprov.wire import Reply

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))
TOLD = ('{{\n "data-root": "{}"\n}}\n', '{{"log-level": "warn", "data-root":"{}"}}', '{{\n "data-root": "{}" }}')
"""Editors and programs that write one line leave the last newline out."""


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("told", TOLD, ids=("lines", "one line", "no last newline"))
def test_an_engine_s_folder_is_read_of_any_last_line(tmp_path: Path, shell: tuple[str, ...], told: str) -> None:
    ident, engine, config = "a" * 64, tmp_path / "ssd/docker", tmp_path / "daemon.json"
    (engine / "containers" / ident).mkdir(parents=True)
    (engine / "containers" / ident / "hostconfig.json").write_text('{"Memory":268435456,"NanoCpus":0}')
    config.write_text(told.format(engine))

    def said(command: str) -> str:
        command = command.replace("/etc/docker/daemon.json", str(config))
        return subprocess.run([*shell, command], capture_output=True, text=True, check=True).stdout

    (disk,) = (one for one in PROBES if one.name == "disk")
    assert parse_disk(said(disk.command)).root == str(engine)
    limits = container_limits.limits_of(Reply(status=0, out=said(container_limits.QUERY.command)))
    assert limits == {ident: {"Memory": "268435456", "NanoCpus": "0"}}
