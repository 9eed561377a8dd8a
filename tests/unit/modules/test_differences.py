"""Values of files and containers that differ: bounded, and indifferent to what a robot says."""

from __future__ import annotations

import io
import json
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.containermodel import Runtime
from srprov.modules.container_body import differing, parts_of
from srprov.modules.container_commands import hashes
from srprov.modules.container_params import ContainerParams, NetworkPlace
from srprov.modules.container_values import differing_values, wanted_values
from srprov.modules.differences import MOST_READ, compared, read_start, text_difference
from srprov.modules.module import digest
from srprov.modules.tree import content_difference, content_queries, mounted_tree
from srprov.resource import Difference
from srprov.wire import Reply
from tests.bounded import within
from tests.readonly import shell_violations

WANT = ContainerParams(
    instance="i", source="s", service="web", image="busybox", hostname="web", job=False,
    run=Runtime(environment={"RATE": "4"}), mounts=(), network=NetworkPlace(mode="none"), api="1.41",
)  # fmt: skip
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
KEYS = ("Id", "Config", "HostConfig", "NetworkSettings")
INNER = ("Env", "Cmd", "Mounts", "PortBindings", "Healthcheck", "LogConfig", "Ulimits", "Labels", "Devices", "Tmpfs",
         "RestartPolicy", "Networks", "DeviceRequests", "StopTimeout", "Memory", "ExposedPorts")  # fmt: skip


@settings(max_examples=150)
@given(about=st.dictionaries(st.sampled_from(KEYS), st.dictionaries(st.sampled_from(INNER), JSON) | JSON), image=JSON)
def test_whatever_an_engine_says_gives_texts(about: Any, image: Any) -> None:
    """Never an error; every value a text."""
    replies = [Reply(status=200, out=json.dumps(one)) for one in (about, image)]
    for found in differing_values(WANT, {"parts": {}}, replies):
        assert isinstance(found.field, str)
        assert all(isinstance(side, str | None) for side in (found.old, found.new))


def test_without_the_image_nothing_that_it_may_have_brought_is_told() -> None:
    """A variable that is there and not wanted may be the image's; one that is wanted is known."""
    about = {"Id": "a" * 64, "Config": {"Image": "busybox", "Env": ["RATE=2", "PATH=/bin"], "Cmd": ["sh"]}}
    replies = [Reply(status=200, out=json.dumps(about)), Reply(status=404, ok=False)]

    found = differing_values(WANT, {"parts": {"environment": "x", "command": "x"}}, replies)

    assert Difference(field="environment.RATE", old="2", new="4") in found
    assert not [one for one in found if one.field in ("environment.PATH", "command")]


def test_peers_that_a_container_gets_when_it_is_made_anew_are_told() -> None:
    """It was told that they go, and what a plan file had put in their place was not."""
    want = replace(WANT, made_with={"ROS_STATIC_PEERS": "10.0.0.1;10.0.0.2"})
    about = {"Config": {"Env": ["RATE=4", "ROS_STATIC_PEERS=10.0.0.1"]}}
    replies = [Reply(status=200, out=json.dumps(about)), Reply(status=200, out='{"Config": {}}')]
    found = differing_values(want, {"parts": {"environment": "x"}}, replies)
    assert [one for one in found if one.field.startswith("environment")] == [
        Difference(field="environment.ROS_STATIC_PEERS", old="10.0.0.1", new="10.0.0.1;10.0.0.2")
    ]


def test_values_without_end_are_counted() -> None:
    """Each was a line of the plan; what is wanted is told, however many there are."""
    image = Reply(status=200, out='{"Config": {}}')
    about = {"Id": "a" * 64, "Config": {"Image": "busybox", "Env": [f"A{n}=x" for n in range(20_000)]}}
    said = Reply(status=200, out=json.dumps(about))

    found = differing_values(WANT, {"parts": {"environment": "x"}}, [said, image])

    assert len(found) < 120 and Difference(field="environment.RATE", new="4") in found
    assert found[-1] == Difference(field="container", note="and 19900 more values that are there, and go")


@pytest.mark.parametrize("at", [0, 1])
def test_what_is_longer_than_any_container_or_image_needs_is_not_read(at: int) -> None:
    """A robot says up to 8 MiB of each, of many containers."""
    said = [Reply(status=200, out='{"Id": "a", "Config": {}}'), Reply(status=200, out='{"Config": {}}')]
    said[at] = Reply(status=200, out=said[at].out + " " * (512 << 10))
    (found,) = differing_values(WANT, {"parts": {"environment": "x"}}, said)
    assert found == Difference(field="container", note="its old values were not read")


def test_values_whose_hashes_begin_alike_are_told() -> None:
    """Whoever writes both has such a pair within a second: of 8 digits, another command was in no plan."""
    was, now = (replace(WANT, run=Runtime(command=("echo", one))) for one in ("fine # 193600", "evil # 4206"))
    parts = [{key: digest(value) for key, value in parts_of(one).items()} for one in (was, now)]
    assert parts[0]["command"][:8] == parts[1]["command"][:8]
    about = Reply(status=200, out=json.dumps({"Config": {"Cmd": ["echo", "fine # 193600"]}}))
    image = Reply(status=200, out=json.dumps({"Config": {}}))
    for there in (hashes(was)[1], {key: value[:8] for key, value in parts[0].items()}):  # also of an older srprov's
        found = {one.field: (one.old, one.new) for one in differing_values(now, {"parts": there}, [about, image])}
        assert found["command"] == ("echo 'fine # 193600'", "echo 'evil # 4206'")
    assert differing(hashes(was)[1], now) == "command differs"


def test_wanted_values_have_no_empty_part() -> None:
    """The parts are those of the hashes, so that one leads to the other."""
    assert set(parts_of(WANT)) <= set(wanted_values(WANT))


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        (Reply(status=1, ok=False), "a", "the old content was not read; new: 1 bytes"),
        (Reply(status=0, out="a\ufffd"), "b", "no text; new: 1 bytes, sha256 3e23e816"),
        (Reply(status=0, out="a" * (MOST_READ + 1)), "b", "longer than 64 KiB, not compared; new: 1 bytes"),
        (Reply(status=0, out="a\n" * 1501), "b", "more than 1500 lines, not compared; new: 1 bytes"),
    ],
)
def test_what_is_no_short_text_is_not_compared(old: Reply, new: str, note: str) -> None:
    """It is said, with what is known of the new content."""
    assert text_difference("content", old, new).note.startswith(note)


def test_a_diff_is_short_and_quick() -> None:
    """The worst that fits: other lines on both sides, and the same one again and again."""
    with within(5):
        for line in ("x{}", "y"):
            old = "".join(f"{line.format(n)}\n" for n in range(1500))
            new = "".join(f"z{line.format(n)}\n" for n in range(1500))
            found = text_difference("content", Reply(status=0, out=old), new)
            assert len(found.diff) == 61
            assert found.diff[-1].endswith(" more lines")
    (added,) = [line for line in text_difference("c", Reply(status=0, out="a"), "b").diff if line.startswith("\\")][:1]
    assert added == "\\ no newline at the end"


def test_only_other_values_are_told() -> None:
    """An empty one is none; a long one is cut."""
    assert compared({"a": "1", "b": "", "c": "x"}, {"a": "1", "c": "y" * 3000, "d": "2"}) == (
        Difference(field="c", old="x", new="y" * 1999 + "… (3000 characters)"),
        Difference(field="d", old=None, new="2"),
    )


def test_a_tar_that_is_none_is_said_to_be() -> None:
    """A plan file may hold any bytes."""
    found = content_difference("volumes./f", "/p", (Reply(status=0), Reply(status=0)), b"x" * 600)
    assert found.note.startswith("the new content is ")
    assert mounted_tree("bind /var/lib/srprov/e/trees/" + "a" * 24 + "/.. (read-only)") == ("", "")
    assert mounted_tree("bind /etc (read-only)") == mounted_tree(None) == ("", "")


@pytest.mark.parametrize("line", ["x" * 70, "x" * 70 + "  ", "x" * 70 + "  a", "x" * 64 + "  /p"])
def test_a_line_that_is_no_hash_of_a_file_says_nothing(line: str) -> None:
    """Of a robot that lies: it ended the plan of all robots; and a name without a folder was one of this machine's."""
    whole = io.BytesIO()
    with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name in ("p/a", "p/b"):
            entry = tarfile.TarInfo(name)
            entry.mode = 0o644
            archive.addfile(entry, io.BytesIO())
    found = content_difference(
        "volumes./f", "/p", (Reply(status=0, out=line + "\n"), Reply(status=0)), whole.getvalue()
    )
    assert found.note in ("2 new: a, b", "2 new: a, b; 1 gone: .")


def test_what_is_asked_only_reads() -> None:
    """Whatever the path is; and the shell does what is meant, on a file, a folder and nothing."""
    for path in ("/var/lib/srprov/e/a", "/x/it's $(reboot); rm -rf /"):
        for query in (read_start(path), *content_queries(path)):
            assert shell_violations(query.command) == []


def test_the_shell_gives_what_is_read_here(tmp_path: Path) -> None:
    """A mounted file as a diff, a folder by its names: the questions' own answers, from a real shell."""

    def ask(path: Path) -> list[Reply]:
        runs = [subprocess.run(["sh", "-c", one.command], capture_output=True, text=True, check=True)
                for one in content_queries(str(path))]  # fmt: skip
        return [Reply(status=0, out=one.stdout) for one in runs]

    (tmp_path / "it's").mkdir()
    file, folder = tmp_path / "it's" / "app.yml", tmp_path / "it's"
    file.write_text("a\n")

    def tar(*files: tuple[str, bytes]) -> bytes:
        whole = io.BytesIO()
        with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as archive:
            for name, content in files:
                entry = tarfile.TarInfo(name)
                entry.size, entry.mode = len(content), 0o644
                archive.addfile(entry, io.BytesIO(content))
        return whole.getvalue()

    assert content_difference("f", str(file), ask(file), tar(("app.yml", b"b\n"))).diff == ("@@ -1 +1 @@", "-a", "+b")
    found = content_difference("f", str(folder), ask(folder), tar(("x/app.yml", b"a\n"), ("x/new", b"n")))
    assert found.note == "1 new: new"
    assert content_difference("f", "/none", ask(Path("/none")), tar(("x", b"n"))).diff == (
        "@@ -0,0 +1 @@",
        "+n",
        "\\ no newline at the end",
    )
