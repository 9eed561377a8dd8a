"""Recordings whose recorder was killed are named, and what can be read of an MCAP is beside it, with an end."""

from __future__ import annotations

import hashlib
import io
import random
import struct
from collections.abc import Iterable
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, Writer

from srprov.record.recordings import checked
from srprov.record.results import Kept
from tests.bounded import bounded, within

MESSAGES = 400


def recording(compression: CompressionType = CompressionType.ZSTD) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4096, compression=compression)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema(name="S", encoding="jsonschema", data=b"{}")
    channel = writer.register_channel(topic="/odom", message_encoding="json", schema_id=schema)
    filler = random.Random(1)
    for number in range(MESSAGES):
        data = b"%06d" % number + filler.randbytes(100)
        writer.add_message(channel_id=channel, log_time=number, publish_time=number, data=data)
    writer.finish()
    return stream.getvalue()


def looked_at(folder: Path, names: Iterable[str]) -> dict[str, Kept]:
    kept = [Kept(path=name, name=name, size=(folder / name).stat().st_size) for name in names]
    return {one.path: one for one in checked(folder, kept, folder.with_name(f"{folder.name}.parts"))}


def numbers(path: Path) -> list[int]:
    """Return the numbers of the messages, by two readers of the format's own library."""
    with path.open("rb") as stream:
        found = [int(message.data[:6]) for _, _, message in make_reader(stream).iter_messages()]
        stream.seek(0)
        assert found == [int(one.data[:6]) for _, _, one in NonSeekingReader(stream).iter_messages()]
    return found


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("share", [0.999, 0.9, 0.5, 0.1])
def test_a_cut_mcap_is_named_and_recovered_beside(tmp_path: Path, share: float, compression: CompressionType) -> None:
    whole = recording(compression)
    (tmp_path / "a.mcap").write_bytes(whole[: int(len(whole) * share)])
    before = hashlib.sha256((tmp_path / "a.mcap").read_bytes()).digest()
    one = looked_at(tmp_path, ["a.mcap"])["a.mcap"]
    assert one.unclosed and one.recovered == "a.recovered.mcap"
    found = numbers(tmp_path / "a.recovered.mcap")
    assert found == list(range(len(found)))
    assert len(found) >= MESSAGES * share * 0.8 - 40, "all whole chunks"
    assert hashlib.sha256((tmp_path / "a.mcap").read_bytes()).digest() == before
    assert not looked_at(tmp_path, ["a.recovered.mcap"])["a.recovered.mcap"].unclosed


def test_a_closed_mcap_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(recording())
    one = looked_at(tmp_path, ["a.mcap"])["a.mcap"]
    assert (one.unclosed, one.recovered) == ("", "") and [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_file_of_the_recovered_ones_name_stays(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(recording()[:-9])
    (tmp_path / "a.recovered.mcap").write_bytes(whole := recording())
    one = looked_at(tmp_path, ["a.mcap", "a.recovered.mcap"])["a.mcap"]
    assert one.unclosed and not one.recovered and (tmp_path / "a.recovered.mcap").read_bytes() == whole


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x89MCAP0\r\n",
        b"no recording at all",
        b"\x89MCAP0\r\n" + b"\0" * 10_000,
        b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 1 << 63),
        b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 40) + b"\xff" * 40,
        b"\x89MCAP0\r\n" + struct.pack("<BQ", 5, 0) * 1000,
    ],
)
def test_what_is_none_or_garbage_is_named_and_nothing_is_made(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    one = bounded(lambda: looked_at(tmp_path, ["a.mcap"]))["a.mcap"]
    assert one.unclosed and not one.recovered and [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_zeros_where_the_disk_lost_power_are_left_out(tmp_path: Path) -> None:
    whole = recording()
    (tmp_path / "a.mcap").write_bytes(whole[: len(whole) // 2] + b"\0" * (len(whole) // 2))
    assert looked_at(tmp_path, ["a.mcap"])["a.mcap"].recovered
    assert len(numbers(tmp_path / "a.recovered.mcap")) > MESSAGES // 3


def test_an_mcap_of_records_that_hold_nothing_is_not_recovered(tmp_path: Path) -> None:
    """Each takes a turn of a loop: a gigabyte of them took 200 s."""
    begin = b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 0)
    (tmp_path / "a.mcap").write_bytes(begin + struct.pack("<BQ", 5, 0) * 4_000_000)
    (tmp_path / "b.mcap").write_bytes(begin + (struct.pack("<BQ", 5, 22) + b"\0" * 22) * 50_000)
    with within(4):
        found = looked_at(tmp_path, ["a.mcap", "b.mcap"])
    assert not found["a.mcap"].recovered and "too many records that hold nothing" in found["a.mcap"].unclosed
    assert found["b.mcap"].recovered == "b.recovered.mcap"
    assert not (tmp_path / "a.recovered.mcap").exists() and not list(
        tmp_path.with_name(f"{tmp_path.name}.parts").iterdir()
    )


def test_other_recordings_that_were_not_closed_are_named(tmp_path: Path) -> None:
    def header(index: int) -> bytes:
        field = b"index_pos=" + struct.pack("<Q", index)
        return (
            b"#ROSBAG V2.0\n" + struct.pack("<I", 4 + len(field)) + struct.pack("<I", len(field)) + field + b" " * 4000
        )

    files = {
        "run.bag": header(4117), "torn.bag": header(0), "empty.bag": b"", "run.bag.active": header(0),
        "older.bag": b"#ROSBAG V1.2\n", "older.bag.active": b"#ROSBAG V1.2\n", "full.bag.active": header(4117),
        "led/led_0.db3-journal": b"x" * 100 + bytes.fromhex("d9d505f920a163d7"), "left/left_0.db3-journal": b"x" * 100,
        "whole/metadata.yaml": b"x", "whole/whole_0.db3": b"x", "whole/whole_0.db3-wal": b"", "cut/cut_0.db3": b"x",
        "cut/cut_0.db3-wal": b"x", "two/two_0.mcap": recording(), "alone/run.mcap": recording(), "run.bagx": b"",
    }  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    found = looked_at(tmp_path, files)
    assert {name for name, one in found.items() if one.unclosed} == {
        "torn.bag", "empty.bag", "run.bag.active", "older.bag", "older.bag.active", "full.bag.active",
        "led/led_0.db3-journal", "left/left_0.db3-journal", "cut/cut_0.db3", "cut/cut_0.db3-wal", "two/two_0.mcap",
    }  # fmt: skip
    assert "metadata.yaml" in found["two/two_0.mcap"].unclosed
    # with an older bag it runs what message definitions say; SQLite removes the file that such a journal names
    assert {name for name, one in found.items() if "rosbag reindex" in one.unclosed} == {"torn.bag", "run.bag.active"}
    assert {name for name, one in found.items() if "keep it" in one.unclosed} == {
        "cut/cut_0.db3-wal", "left/left_0.db3-journal",
    }  # fmt: skip


@pytest.mark.parametrize("other", ["x.recovered.mcap/y", "X.Recovered.mcap", "x.recovered.mcap.part/y"])
def test_what_came_home_is_never_replaced_by_what_is_recovered(tmp_path: Path, other: str) -> None:
    (tmp_path / "x.mcap").write_bytes(recording()[:-100])
    (tmp_path / other).parent.mkdir(exist_ok=True)
    (tmp_path / other).write_bytes(b"RESULT")
    one = looked_at(tmp_path, ["x.mcap", other])["x.mcap"]
    free = ".part" in other
    assert bool(one.recovered) == free
    assert ("it was not recovered" in one.unclosed) != free
    assert (tmp_path / other).read_bytes() == b"RESULT"


def test_a_result_with_the_name_of_a_part_stays(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(recording()[:-100])
    (tmp_path / "x.recovered.mcap.part").write_bytes(b"RESULT")
    assert looked_at(tmp_path, ["x.mcap", "x.recovered.mcap.part"])["x.mcap"].recovered == "x.recovered.mcap"
    assert (tmp_path / "x.recovered.mcap.part").read_bytes() == b"RESULT"


def test_a_folder_of_an_earlier_call_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(recording()[:-100])
    (tmp_path / "x.recovered.mcap").mkdir()
    one = looked_at(tmp_path, ["x.mcap"])["x.mcap"]
    assert not one.recovered and "it was not recovered" in one.unclosed


def test_many_files_in_deep_folders_are_looked_at_in_time(tmp_path: Path) -> None:
    """Each folder once, and not for each file in it."""
    deep = "a/" * 98
    kept = [Kept(path=f"{deep}{number}", name=f"{deep}{number}") for number in range(50_000)]
    assert len(bounded(lambda: checked(tmp_path, kept, tmp_path))) == 50_000
