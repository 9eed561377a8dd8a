"""Which containers of others a plan names, by where the folders of new ones lead, and whether these are written to."""

from __future__ import annotations

import json

import pytest

from srprov.controller.robots_notes import told
from srprov.definitions.containermodel import Mount
from srprov.wire import Reply
from tests.unit.assignment.worlds import found, robot
from tests.worlds import service


@pytest.mark.parametrize(
    ("read_only", "writes", "words"),
    [
        (False, False, "is had by the container own"),
        (True, True, "may be written to by the container own"),
        (True, False, ""),
    ],
)
@pytest.mark.parametrize("has", ["/srv/ws", "/mnt/ws"])
def test_who_has_a_folder_is_told_by_both_its_names(read_only: bool, writes: bool, words: str, has: str) -> None:
    """The new container's `/srv/ws` is a link to `/mnt/ws`."""
    mount = Mount(kind="bind", source="/srv/ws", target="/ws", read_only=read_only)
    other = {"Names": ["/own"], "Mounts": [{"Type": "bind", "Source": has, "RW": writes}], "Labels": {}}
    said = [Reply(status=200, out=out) for out in ("0 /mnt/ws\n", "", "", "", json.dumps([other]))]
    notes = told({"r1": [service("a", mounts=(mount,))]}, {"r1": said}, found(robot("r1")), "hello")
    (note,) = [one for one in notes if "own" in one] or [""]
    assert words in note and bool(note) == bool(words)
