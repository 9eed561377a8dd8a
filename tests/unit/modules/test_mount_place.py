"""Where mounted paths lead, as a plan saw it and when a container is made, in a real shell of this machine."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.modules.mount_place import LEADS_TO
from srprov.wire import quote

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))
pytestmark = pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])


def tried(shell: tuple[str, ...], script: str) -> tuple[int, str]:
    try:
        done = subprocess.run([*shell, script], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"there is no {shell[0]} here")
    return done.returncode, done.stdout + done.stderr


def test_what_is_not_there_leads_where_what_is_there_of_it_does(tmp_path: Path, shell: tuple[str, ...]) -> None:
    (tmp_path / "it's").mkdir()
    (tmp_path / "to").symlink_to("it's")
    (tmp_path / "gone").symlink_to("nowhere")
    led = {"to": "it's", "to/a": "it's/a", "to/a/b/c": "it's/a/b/c", "x/y": "x/y", "gone": "nowhere"}
    for path, real in led.items():
        script = f"{LEADS_TO}leads_to {quote(str(tmp_path / path))}"
        assert tried(shell, script) == (0, f"{tmp_path}/{real}\n")
    assert tried(shell, f"{LEADS_TO}leads_to /") == (0, "/\n")
    (tmp_path / "loop").symlink_to("loop")
    assert tried(shell, f"{LEADS_TO}leads_to {quote(str(tmp_path / 'loop'))}")[0] == 1
