"""What the answers mean for each pair of endpoints: what works from one to the other, and what does not. Pure."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from srprov.probing.model import SERVICE, UNDERLAY, Endpoint, Measured, Round

LARGEST = 9216
"""bytes; the program tries no larger packets."""
REACH, MTU, TCP, MULTICAST = "reach", "mtu", "tcp", "multicast"
CHECKS = (REACH, MTU, TCP, MULTICAST)


class Pair(msgspec.Struct, frozen=True, kw_only=True):
    """One endpoint asked another."""

    source: Endpoint
    target: Endpoint
    measured: Measured
    """By the one that asked."""
    heard: bool | None
    """Whether the other says that it heard it; None: it says nothing."""
    failed: tuple[str, ...]
    """Of CHECKS, those that did not work. What cannot work without another is not named beside it."""

    @property
    def names(self) -> tuple[str, str]:
        """Return what both are called."""
        return self.source.name, self.target.name


def pairs_of(found: Round) -> tuple[Pair, ...]:
    """Return every pair that was asked, on the overlay and on the underlay, in the order of the endpoints."""
    return tuple(_pairs(found))


def _pairs(found: Round) -> Iterator[Pair]:
    every = found.request.endpoints
    for at, source in enumerate(every):
        said = found.said.get(at)
        if said is None or said.failed:
            continue
        for other, target in enumerate(every):
            if other == at or not asked(source, target) or other not in found.said:
                continue
            measured, back = said.peers.get(other, Measured()), found.said[other]
            seen = back.peers.get(at, Measured())
            mtu = found.request.underlay_mtu if source.kind == UNDERLAY else found.request.mtu
            yield Pair(
                source=source,
                target=target,
                measured=measured,
                heard=None if back.failed else seen.heard,
                failed=tuple(_failed(source, target, measured, None if back.failed else seen, min(mtu, LARGEST))),
            )


def asked(source: Endpoint, target: Endpoint) -> bool:
    """Return whether one asks the other; the program has the same rule."""
    if (source.kind == UNDERLAY) != (target.kind == UNDERLAY):
        return False
    return not (source.sparse and target.sparse)


def _failed(source: Endpoint, target: Endpoint, measured: Measured, seen: Measured | None, mtu: int) -> Iterator[str]:
    if not measured.received:
        yield REACH
        return
    if measured.fits < mtu:
        yield MTU
    if source.kind != SERVICE or target.kind != SERVICE or seen is None:
        return
    if not measured.tcp:
        yield TCP
    if not seen.multicast:
        yield MULTICAST
