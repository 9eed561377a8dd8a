"""A link whose words iproute2's batch could misread: the shell quotes them, one process per call."""

from __future__ import annotations

import shlex

import pytest

from srprov.modules.vxlan import VxlanModule
from srprov.wire import Run
from tests.resources import resource

PARAMS = {"vni": 7, "local": "192.0.2.1", "port": 4789, "bridge": "srpb1", "mtu": 1450, "fdb": []}


def script(instance: str) -> str:
    want = resource("vxlan", "srpv1", {**PARAMS, "instance": instance})
    change = VxlanModule().check(want.name, want.params, None)
    assert change is not None
    (command,) = change.commands
    assert isinstance(command, Run)
    guard, _, rest = command.script.partition("\n")
    assert guard.startswith("case $({ nft list table bridge srpv1 ||") and guard.endswith("exit 1 ;; esac")
    return rest


@pytest.mark.parametrize("instance", ["a b", "it's", 'say "x"', "a#b", "back\\slash", "two\nlines", "$(reboot)", "é"])
def test_odd_words_are_quoted(instance: str) -> None:
    text = script(instance)
    assert "-batch" not in text
    calls = [call.removesuffix(" || exit") for call in text.split(" || exit\n")]
    assert [shlex.split(call)[:3] for call in calls] == [["ip", "link", "add"], *[["ip", "link", "set"]] * 4]
    assert shlex.split(calls[1])[3:] == ["dev", "srpv1", "alias", f"srprov:{instance}"]


@pytest.mark.parametrize("instance", ["hello", "a-b.c_d", "x" * 60])
def test_plain_words_are_one_batch(instance: str) -> None:
    lines = script(instance).splitlines()
    assert lines[0].startswith("printf %s 'link add ") and lines[-1] == "' | ip -batch - || exit"
    assert f"link set dev srpv1 alias srprov:{instance}" in lines
