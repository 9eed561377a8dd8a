"""What makes a file the user's own by what is in it, wherever it lies: a private key, or a password of robots. Pure.

ssh has keys by its own settings, others sign, and no list of who uses one is whole: a key is known by how it begins. A
password of robots is known by Ansible's word for it: a user has several inventories, and an editor keeps what one was.
Programs put keys into texts of their own by base64 (kubectl, services of builds), and editors write UTF-16: a file is
read in these ways, too.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator

LARGEST = 8 << 20
"""Bytes of a file that is known by its content: as many as an inventory may have."""
_KEY = re.compile(
    rb"-----BEGIN (?:(?:[A-Z0-9]+ ){0,3}PRIVATE KEY(?: BLOCK)?|OpenVPN Static key V[0-9])-----"
    rb"|---- BEGIN SSH2 ENCRYPTED PRIVATE KEY ----|PuTTY-User-Key-File-[0-9]|AGE-SECRET-KEY-"
    rb"|\bPrivateKey[ \t]*=[ \t]*[A-Za-z0-9+/]{43}="  # WireGuard's and NetworkManager's
    rb"|\bprivate-key=[A-Za-z0-9+/]{43}="
    rb"|^untrusted comment: [^\n]{0,200}\bsecret key"  # minisign's and signify's
    rb"|\((?:[0-9]{1,2}:)?(?:protected-)?private-key\b"  # GnuPG's
    rb"|^SSH PRIVATE KEY FILE FORMAT|^Private-key-format: v|^== ed25519v1-secret:"  # ssh's first one, BIND's, Tor's
)
"""In texts; RFC 7468, RFC 4716 and what these programs write."""
_KEY_WORDS = (
    b"PRIVATE KEY", b"OpenVPN Static key", b"PuTTY-User-Key-File-", b"AGE-SECRET-KEY-", b"PrivateKey", b"private-key",
    b"secret key", b"Private-key-format", b"ed25519v1-secret",
)  # fmt: skip
"""One of these stands in each of them: words alone are found twenty times as fast."""
_JSON_KEY = re.compile(rb"[\"']d\\*[\"']\s*:\s*\\*[\"'][A-Za-z0-9_-]{42}")
"""The private part of a key in JSON (RFC 7517), which is one beside a `kty`."""
_SEQUENCE = rb"\x30(?:[\x00-\x7f]|\x81.|\x82..|\x83...)"
_BINARY_KEY = re.compile(
    rb"%(s)s(?:\x02\x01[\x00\x01]%(s)s\x06"  # PKCS #8 (RFC 5958)
    rb"|%(s)s\x06\x09\x2a\x86\x48\x86\xf7\x0d\x01\x05"  # PKCS #8 under a password (PKCS #5)
    rb"|\x02\x01[\x00\x01]\x02[\x10-\x7f\x81\x82]"  # PKCS #1, and DSA's
    rb"|\x02\x01\x01\x04[\x10-\x7f]"  # an elliptic curve's (RFC 5915)
    rb"|\x02\x01\x03%(s)s)"  # PKCS #12
    rb"|\xfe\xed\xfe\xed|\xce\xce\xce\xce|\x03\xd9\xa2\x9a|\x05\x02\x00\x00" % {b"s": _SEQUENCE},
    re.DOTALL,
)
"""How such a file begins: DER, and the stores of Java, KeePass and Kerberos."""
_PROGRAMS_KEY = re.compile(
    rb"(?:[\x94\x9c].|[\x95\x9d]..|[\x96\x9e]....|[\xc5\xc7](?:[\x00-\xbf]|[\xc0-\xdf].|\xff....))"
    rb"(?:\x03.{6}|[\x04-\x06].{4})[\x01-\x1c]"  # OpenPGP's secret keys (RFC 9580), as gpg exports them
    rb"|\x00\x00\x00.(?:ssh-|ecdsa-sha2-)|openssh-key-v1\x00|\x00GITCRYPTKEY",  # Dropbear's begins with its kind
    re.DOTALL,
)
"""How files of single programs begin: too little of it to be looked for in every piece of base64."""
_PASSWORD = re.compile(rb"\bansible_[a-z_]*pass(?:word|phrase)?\\*[\"']?\]?[ \t]*[:=]")
"""In YAML, INI and JSON, also where no verb was told that it is an inventory; and in a program that prints one."""
_PIECE = re.compile(rb"M[A-Za-z0-9+/]{47}")
"""Where a key without any words around it may begin in base64: DER's sequences do with an M."""
_BLANKS = b" \t\r\n\\"
_MARKS = (b"\xff\xfe", b"\xfe\xff")


def _in_base64(word: bytes) -> Iterator[bytes]:
    """Yield what of a word stands in base64, whichever of three places it has in what is written so."""
    for before in range(3):
        encoded = base64.b64encode(bytes(before) + word).rstrip(b"=")
        known = (before + len(word)) * 8 // 6
        yield encoded[-(-before * 8 // 6) : known]


_WORDS = (b"PRIVATE KEY-----", b"PRIVATE KEY BLOCK", b"openssh-key-v1\0", b"AGE-SECRET-KEY-", b"PuTTY-User-Key-File-")
_ENCODED = tuple(part for word in _WORDS for part in _in_base64(word))


def is_own(content: bytes) -> bool:
    """Return whether a file's content makes it the user's own."""
    if len(content) > LARGEST:
        return False
    narrow = content.replace(b"\0", b"") if _is_wide(content) else content
    return (
        any(pattern.match(content) for pattern in (_BINARY_KEY, _PROGRAMS_KEY))
        or (any(word in narrow for word in _KEY_WORDS) and _KEY.search(narrow) is not None)
        or (b"ansible_" in narrow and _PASSWORD.search(narrow) is not None)
        or (b"kty" in narrow and _JSON_KEY.search(narrow) is not None)
        or _has_encoded(narrow)
    )


def _is_wide(content: bytes) -> bool:
    """Return whether a text has more than a byte for each letter: UTF-16, as some editors and shells write it."""
    start = content[:64]
    return start[:2] in _MARKS or (len(start) > 3 and any(not any(start[at::2]) for at in (0, 1)))


def _has_encoded(text: bytes) -> bool:
    """Return whether a key stands in base64 in a text, in whatever lines."""
    joined = text.replace(b"\\n", b"").translate(None, _BLANKS)
    if any(part in joined for part in _ENCODED):
        return True
    return any(_BINARY_KEY.match(base64.b64decode(match[0])) for match in _PIECE.finditer(text))
