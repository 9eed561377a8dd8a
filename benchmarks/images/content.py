"""The images that are sent around: layers of this machine's own files, as tar files, the same on every run here.

Four fifths of a layer are files of /usr/lib in the order of their names, the rest is random: together they compress to
about half, as a ROS image does. What a layer has depends on its size and its seed alone.
"""

from __future__ import annotations

import functools
import io
import random
import tarfile
import zlib
from collections.abc import Sequence
from pathlib import Path

MIB = 1 << 20
BASE_LAYERS = 6
TOP_SHARE = 24
"""Each of the two layers above the base is this part of the image: 20 of 480 MiB."""
_LONGEST_FILE = 4 * MIB
_PIECE = 256 * 1024


def write_layer(path: Path, size: int, seed: int) -> int:
    """Write a layer of so many bytes of content; give its size when compressed as by `gzip -1`."""
    source = random.Random(seed)
    files = _files()
    at, left = source.randrange(len(files)), size * 4 // 5
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as archive:
        while left > 0:
            content = files[at % len(files)].read_bytes()[:left]
            _add(archive, f"opt/{seed}/{at % 97}/{at}", content)
            at, left = at + 1, left - len(content)
        for start in range(0, size - size * 4 // 5, _PIECE):
            _add(archive, f"opt/{seed}/random/{start}", source.randbytes(min(_PIECE, size - size * 4 // 5 - start)))
    return packed(path)


def packed(path: Path) -> int:
    """Return the size of a file when compressed as by `gzip -1`."""
    press, count = zlib.compressobj(1), 0
    with path.open("rb") as file:
        while piece := file.read(MIB):
            count += len(press.compress(piece))
    return count + len(press.flush())


def context(out: Path, dockerfile: Sequence[str], layers: Sequence[Path]) -> None:
    """Write a build's context, whose Dockerfile adds the layers by their files' names."""
    with tarfile.open(out, "w") as archive:
        _add(archive, "Dockerfile", "\n".join([*dockerfile, ""]).encode())
        for layer in layers:
            archive.add(layer, layer.name)


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size = len(content)
    archive.addfile(member, io.BytesIO(content))


@functools.cache
def _files() -> Sequence[Path]:
    """Return plain files of this machine that are neither empty nor large, by name."""
    plain = (path for path in Path("/usr/lib").rglob("*") if not path.is_symlink() and path.is_file())
    return sorted(path for path in plain if 0 < path.stat().st_size <= _LONGEST_FILE)
