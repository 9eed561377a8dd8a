"""A unit of somebody else's with the name of an instance's: `srprov-worker.service` is also a site's worker."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.modules import unit
from srprov.wire import Run

OURS = "# Written by srprov for the instance worker\n"


@pytest.mark.parametrize(("there", "code"), [("[Unit]\nDescription=a worker\n", 1), ("", 1), (OURS, 0), (None, 0)])
def test_a_unit_that_srprov_did_not_write_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: str | None, code: int
) -> None:
    monkeypatch.setattr(unit, "FOLDER", str(tmp_path))
    name, new = unit.unit_name("worker"), f"{OURS}[Unit]\n"
    if there is not None:
        (tmp_path / name).write_text(there)
    (command,) = unit._write(name, new)
    assert isinstance(command, Run)
    done = subprocess.run(
        ["/bin/sh", "-c", f"systemctl() {{ :; }}\n{command.script}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done
    assert (tmp_path / name).read_text() == (there if code else new)
    assert ("srprov did not write it" in done.stderr) is bool(code)
