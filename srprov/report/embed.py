"""The data that a page is about, inside the page: a link that gives it back, and its way out. Pure.

A `data:` address, and no element of script: nothing in a page can be run, whatever it is about. What is large is
packed.

Source: RFC 2397 (data:), RFC 1952 (gzip).
"""

from __future__ import annotations

import base64
import binascii
import gzip
import re
import zlib

import msgspec

from srprov.report.html import Html, el

_PLAIN, _PACKED = "data:application/json;base64,", "data:application/gzip;base64,"
_LARGE = 64 * 1024
"""Bytes; what is larger is packed."""
MOST = 128 << 20
"""Bytes of unpacked data that are taken out of a page."""
_LINK = re.compile(
    rb'<a id="data" download="[^"<>]{1,300}" href="data:application/(json|gzip);base64,([A-Za-z0-9+/=]*)"'
)


def link(name: str, data: bytes) -> Html:
    """Return a link that saves the data, under a name that ends in `.json`, or `.json.gz` where it is packed."""
    if len(data) <= _LARGE:
        return _link(name, _PLAIN, data)
    # no time and no name in it: equal data is equal bytes
    return _link(f"{name}.gz", _PACKED, gzip.compress(data, compresslevel=9, mtime=0))


def _link(name: str, kind: str, data: bytes) -> Html:
    return el("a", name, id="data", download=name, href=kind + base64.b64encode(data).decode("ascii"))


def extracted(page: bytes) -> bytes:
    """Return the data that `link` put into a page.

    Raises:
        ValueError: There is none, or it is broken, or no JSON: whoever wrote the page may have put anything there.
    """
    data = _data(page)
    try:
        msgspec.json.decode(data, type=msgspec.Raw)  # all is looked at, and nothing kept
    except msgspec.DecodeError as error:
        raise ValueError(f"its data is no JSON: {error}") from None
    return data


def _data(page: bytes) -> bytes:
    found = _LINK.search(page)
    if found is None:
        raise ValueError("it holds no data of srprov")
    try:
        data = base64.b64decode(found[2], validate=True)
        if found[1] == b"json":
            return data
        unpacked = zlib.decompressobj(wbits=31)
        whole = unpacked.decompress(data, MOST)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"its data is broken: {error}") from None
    if not unpacked.eof:
        raise ValueError(f"its data is broken, or larger than {MOST >> 20} MiB")
    return whole
