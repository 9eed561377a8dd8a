"""Addresses of this machine's settings, written anew without the name and the password before the host. Pure.

A password may have any character in it, and programs differ in which of them they take: apt goes by one with `'`, `#`,
`?` or a blank. So nothing is cut out of an address: its host, port and path have forms, and all else stays here. Of one
with `/` before the `@` nobody knows where the host begins: it has no form.
"""

from __future__ import annotations

import re

HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9_.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+\])"
_ADDRESS = re.compile(
    rf"(?P<scheme>(?:https?|socks[45][ah]?)://)?(?:[^/]*@)?(?P<host>{HOST}(?::[0-9]{{1,5}})?)"
    r"(?P<path>/[\w.~+%=,:/-]*)?",
    re.ASCII,
)


def plain_address(text: str) -> str:
    """Return an address without its login; nothing for one of another form."""
    match = _ADDRESS.fullmatch(text)
    return f"{match['scheme']}{match['host']}{match['path'] or ''}" if match and match["scheme"] else ""


def plain_proxy(text: str) -> str:
    """Return a proxy without its login; a scheme may be left out."""
    match = _ADDRESS.fullmatch(text)
    return f"{match['scheme'] or ''}{match['host']}{match['path'] or ''}" if match else ""
