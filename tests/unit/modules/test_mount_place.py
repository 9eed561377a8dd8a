"""Where mounted paths lead, as a plan saw it and when a container is made, in a real shell of this machine."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from srprov.led import LED
from srprov.modules.mount_place import LEADS_TO, NOT_TOLD, guarded
from srprov.wire import EngineCall, Run, quote

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


def test_a_script_of_a_container_is_not_run_where_a_path_leads_elsewhere(
    tmp_path: Path, shell: tuple[str, ...]
) -> None:  # fmt: skip
    maps, home = tmp_path / "maps", tmp_path / "home"
    mounts = [{"Type": "bind", "Source": str(maps)}, {"Type": "volume", "Source": "logs"}]
    home.mkdir()
    maps.mkdir()
    command = guarded(Run(script="echo made"), mounts, {str(maps): str(maps), "/other": "/other"})
    assert isinstance(command, Run)
    assert tried(shell, command.script) == (0, "made\n")
    maps.rmdir()
    assert tried(shell, command.script) == (0, "made\n")  # who needs it says so
    maps.symlink_to(home)
    said = f"{maps} leads to {home}, and to {maps} when it was planned: plan again\n"
    assert tried(shell, command.script) == (1, said)
    unknown = guarded(Run(script="echo made"), mounts, {str(maps): NOT_TOLD})
    assert isinstance(unknown, Run)
    said = f"{maps} leads to {home}, and to what was not told when it was planned: plan again\n"
    assert tried(shell, unknown.script) == (1, said)
    other = guarded(Run(script="echo made"), mounts, {str(maps): str(home)})
    assert isinstance(other, Run)
    assert tried(shell, other.script) == (0, "made\n")


def test_what_was_not_looked_at_and_what_is_no_script_stays(shell: tuple[str, ...]) -> None:
    call, run = EngineCall(method="POST", path="/containers/x/start"), Run(script="true")
    mounts = [{"Type": "bind", "Source": "/srv/maps"}]
    assert guarded(call, mounts, {"/srv/maps": "/srv/maps"}) is call
    assert guarded(run, mounts, {"/srv": "/srv"}) is run
    assert shell


def test_a_container_has_where_its_paths_led_as_a_label(shell: tuple[str, ...]) -> None:
    call = EngineCall(method="POST", path="/containers/create", body='{"Image":"x","Labels":{"a":"b"}}')
    mounts = [{"Type": "bind", "Source": "/srv/maps"}, {"Type": "volume", "Source": "/srv/v"}]
    made = guarded(call, mounts, {"/srv/maps": "/mnt/maps", "/srv/v": "/srv/v"})
    assert isinstance(made, EngineCall) and shell
    assert json.loads(made.body) == {"Image": "x", "Labels": {"a": "b", LED: '{"/srv/maps":"/mnt/maps"}'}}
    assert guarded(call, mounts, {}) is call
