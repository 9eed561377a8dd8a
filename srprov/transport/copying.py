"""How far the copy of an image has come."""

from __future__ import annotations

from collections.abc import Iterator

from srprov.wire import Progress

_COPY_STEP = 16 << 20


def counted(chunks: Iterator[bytes], image: str, progress: Progress) -> Iterator[bytes]:
    """Pass chunks on and tell how much went by."""
    total = step = 0
    for chunk in chunks:
        yield chunk
        total += len(chunk)
        if total >= step:
            progress(f"{image}: {total / (1 << 20):.0f} MiB copied")
            step = total + _COPY_STEP
    progress(f"{image}: {total / (1 << 20):.1f} MiB copied, loading")
