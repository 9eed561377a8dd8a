"""What looks like a secret: by its name, by a form that only keys and tokens have, or by chance that no word has.

Takes names and texts; gives reasons, and texts in which `***` stands for what looks like one. Pure; linear in the
text. It errs on the side of hiding: what is taken for a secret is asked of the user, what is not is written to a file.

Source: RFC 3986 (userinfo), RFC 7468 (PEM), the forms of tokens that their issuers document.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence

from srprov.redaction import MASK
from srprov.snapshot.short_options import REFERENCE, masked_short

LONGEST = 1 << 20
"""Characters of a text that are looked at; of a longer one all is taken for a secret."""
_PARTS = [
    "password", "passwd", "passphrase", "passcode", "secret", "token", "apikey", "accesskey", "privatekey",
    "credential", "authkey", "encryptionkey", "signingkey", "sessionkey", "sshkey", "cookie", "connectionstring",
    "webhook", "keytab", "htpasswd", "requirepass", "masterauth"
]  # fmt: skip
"""Anywhere in a name without its separators."""
_WORDS = frozenset([
    "pass", "pwd", "pw", "psk", "pin", "auth", "key", "keys", "dsn", "salt", "otp", "jwt", "bearer", "cred",
    "creds", "authorization"
])  # fmt: skip
"""As a word of a name: `DB_PASS`, `wifiPsk`."""
_OFTEN_NONE = frozenset({"key", "keys", "pin", "auth", "salt"})
_NO_SECRET = frozenset({"PWD", "OLDPWD"})
_PLACES = ("file", "path", "dir", "directory", "sock", "socket", "folder", "home")
"""Last word of a name whose value is a path."""
_PLAIN = frozenset(["yes", "no", "true", "false", "on", "off", "0", "1", "none", "null"])
_SPLIT = re.compile(r"[^A-Za-z0-9]+|(?<=[a-z0-9])(?=[A-Z])")
_PATH = re.compile(r"[~/][\w@.+:/-]*")
_FORMS = re.compile(
    r"-----BEGIN [A-Z0-9 ]{0,40}PRIVATE KEY"
    r"|\b(?:gh[pousr]_[A-Za-z0-9]{16,255}|github_pat_\w{16,255}|glpat-[\w-]{16,255}|xox[abeprs]-[\w-]{10,255}"
    r"|A(?:KIA|SIA)[0-9A-Z]{16}|AIza[\w-]{30,60}|[srp]k[-_](?:live[-_]|test[-_]|proj-)?[A-Za-z0-9]{16,255}"
    r"|hf_[A-Za-z0-9]{16,255}|npm_[A-Za-z0-9]{16,255}|pypi-[\w-]{16,500}"
    r"|dckr_pat_[\w-]{16,255}|SG\.[\w-]{16,255})"
    r"|\$(?:1|2[abxy]|5|6|y|argon2id?|apr1)\$[^\s:'\"]{8,500}"
)
_JWT = re.compile(r"\beyJ[\w-]{8,}(?P<more>\.[\w-]{4,4000})?")
"""One is only with `more`. What is none is found, too, so that a text is read once and not from each `eyJ` on."""
_IN_URL = re.compile(r"(?<=://)[^\s/]{1,500}(?=@)")
"""Up to the last `@` before the path: a password may have one, and quotes."""
_BEARER = re.compile(r"(?i)(?<=\bbearer )[^\s'\"]{6,4000}|(?<=\bbasic )[A-Za-z0-9+/=]{8,4000}")
_ASSIGNED = re.compile(
    r"""(?x) [0-9_.-]* (?P<name>[A-Za-z][A-Za-z0-9_.-]+) (?: ["']? [ \t]* (?: => | :=? | = ) [ \t]*
    (?: "(?P<double>[^"\n]{1,4000})" | '(?P<single>[^'\n]{1,4000})' | (?P<bare>[^\s"'()\[\]{}$<>,;&|]{4,4000}) ) )?
    | [0-9_.-]+"""
)
"""Any word, so that each is read once and not from each of its letters on; only some have a value."""
_LONGEST_NAME = 81
"""Characters of a name in a text; of a longer word they are the last ones."""
_WHOLE = re.compile(r"(-{0,2}(?P<name>[A-Za-z][\w.-]{0,80})=)(?P<value>\S{1,4000})")
"""A word of a command: no shell reads it, and so `$`, `;` and brackets are of its value."""
_OPTION = re.compile(
    r"""(?x) (?<![\w-]) (--?(?P<name>[A-Za-z][\w-]{0,80})[ \t]{1,20})
    (?P<value> "[^"\n]{1,4000}" | '[^'\n]{1,4000}' | [^\s;&|<>"'-][^\s;&|<>]{0,4000} )"""
)
"""In a script of a command."""
_CHANCE = re.compile(r"[A-Za-z0-9+/=_-]{20,500}")
_LEAST_BITS = 3.6
"""Per character; words of a language, paths and names have less."""
_LEAST_BITS_OF_HEX = 3.0
_LEAST_HEX = 32
"""Characters of one case with digits."""


def secret_variable(name: str, value: str) -> str:
    """Return why a variable's value looks like a secret; empty when it does not."""
    if not value or name in _NO_SECRET or value.lower() in _PLAIN:
        return ""
    if secret_name(name) and not (_last_word(name) in _PLACES and _PATH.fullmatch(value)):
        return "its name"
    return "its value" if suspicious(value) else ""


def secret_name(name: str) -> bool:
    """Return whether what has this name is a secret."""
    words = [word.lower() for word in _SPLIT.split(name[:200]) if word]
    joined = "".join(words)
    return any(part in joined for part in _PARTS) or not _WORDS.isdisjoint(words)


def suspicious(text: str) -> bool:
    """Return whether something in a text looks like a secret."""
    return masked(text) != text


def masked(text: str) -> str:
    """Return the text with `***` for everything in it that looks like a secret."""
    if len(text) > LONGEST:
        return MASK
    if "PRIVATE KEY" in text and _has_form(text):
        return MASK  # the key is in the lines after it
    found = _IN_URL.sub(_of_url, text)
    found = _BEARER.sub(MASK, _FORMS.sub(MASK, _JWT.sub(_of_jwt, found)))
    found = _ASSIGNED.sub(_of_assignment, found)
    return _CHANCE.sub(_of_chance, found)


def masked_words(words: Sequence[str]) -> list[str]:
    """Return a command's words as `masked` does; also what belongs to `--password`, or to `mysql -p`."""
    found: list[str] = []
    follows = False
    for word in masked_short(words):
        found.append(MASK if follows and not word.startswith("-") else _masked_word(word))
        option = re.fullmatch(r"--?([A-Za-z][\w-]{0,80})", word)
        follows = option is not None and secret_name(option[1])
    return found


def _masked_word(word: str) -> str:
    if (whole := _WHOLE.fullmatch(word)) and _assigned_secret(whole["name"], whole["value"].strip("\"'")):
        return f"{whole[1]}{MASK}"
    return masked(_OPTION.sub(_of_option, word))


def _of_option(match: re.Match[str]) -> str:
    return f"{match[1]}{MASK}" if _assigned_secret(match["name"], match["value"].strip("\"'")) else match[0]


def _of_url(match: re.Match[str]) -> str:
    """Return the user of an address without the password; a lone user is kept if it cannot be a token."""
    user, colon, _ = match[0].partition(":")
    if colon:
        return f"{user}:{MASK}"
    return match[0] if len(user) < 20 and not _has_form(user) else MASK


def _has_form(text: str) -> bool:
    return _FORMS.search(text) is not None or any(one["more"] for one in _JWT.finditer(text))


def _of_jwt(match: re.Match[str]) -> str:
    return MASK if match["more"] else match[0]


def _of_assignment(match: re.Match[str]) -> str:
    value = match["double"] or match["single"] or match["bare"]
    if not value:
        return match[0]
    name = match["name"][-_LONGEST_NAME:].lstrip("0123456789_.-")
    if not name:  # what is behind it may be a name
        cut = match.end("name") - match.start()
        return match[0][:cut] + _ASSIGNED.sub(_of_assignment, match[0][cut:])
    return match[0].replace(value, MASK) if _assigned_secret(name, value) else match[0]


def _assigned_secret(name: str, value: str) -> bool:
    """Return whether a value in a text is a secret by the name that it is assigned to."""
    if value.lower() in _PLAIN or value == MASK or value.startswith("/run/secrets/") or REFERENCE.fullmatch(value):
        return False
    if name in _NO_SECRET or not secret_name(name):
        return False
    last = _last_word(name)
    if last in _PLACES and _PATH.fullmatch(value):
        return False
    # code has keys and pins of all kinds
    return last not in _OFTEN_NONE or len(value) >= 16 or bool(re.search(r"[0-9]", value) and len(value) >= 6)


def _of_chance(match: re.Match[str]) -> str:
    word = match[0]
    kinds = (any(c.isdecimal() for c in word), any(c.islower() for c in word), any(c.isupper() for c in word))
    if not kinds[0] or word.count("/") > 2 or re.search(r"[A-Za-z]{12}", word):
        return word
    counts = Counter(word)
    bits = -sum(n / len(word) * math.log2(n / len(word)) for n in counts.values())
    if all(kinds):
        return MASK if bits >= _LEAST_BITS else word
    return MASK if len(word) >= _LEAST_HEX and word.isalnum() and bits >= _LEAST_BITS_OF_HEX else word


def _last_word(name: str) -> str:
    words = [word.lower() for word in _SPLIT.split(name[:200]) if word]
    return words[-1] if words else ""
