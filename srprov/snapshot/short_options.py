"""Options of one letter that are known to take a password: `mysql -phunter2`, `mosquitto_sub -P hunter2`.

Takes the words of a command; gives them with `***` for such passwords. Pure; linear in the text.

Source: the manuals of the programs.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from srprov.redaction import MASK

_LETTERS = {
    "curl": "u", "mosquitto_pub": "P", "mosquitto_rr": "P", "mosquitto_sub": "P", "redis-cli": "a", "sshpass": "p",
    "mysql": "p", "mysqladmin": "p", "mysqldump": "p", "mariadb": "p", "mariadb-admin": "p", "mariadb-dump": "p",
}  # fmt: skip
_ASKS = frozenset(name for name in _LETTERS if name.startswith(("mysql", "mariadb")))
"""The word after the option is no password: the program asks for one."""
_TOKENS = re.compile(r"""\s+|[;&|]+|(?:"[^"]*"|'[^']*'|[^\s;&|"']+)+|["']""")
REFERENCE = re.compile(r"\$(?:\w+|[({].*)", re.DOTALL)
"""What a shell puts a value in the place of: it is no secret itself."""


def masked_short(words: Sequence[str]) -> list[str]:
    """Return a command's words without such passwords; a word with spaces in it may be a script."""
    return list(_masked(words))


def _of_script(text: str) -> str:
    return "".join(_masked(_TOKENS.findall(text)))


def _masked(tokens: Iterable[str]) -> Iterator[str]:
    option, asks, follows = "", False, False
    for token in tokens:
        if not token.strip():
            yield token
        elif token.strip(";&|") == "":  # the next command of a script
            option, follows = "", False
            yield token
        elif follows:
            follows = False
            yield _hidden(token)
        elif option and token.startswith(option):
            follows = token == option and not asks
            yield option + _hidden(token[2:]) if len(token) > len(option) else token
        elif token[0] == token[-1] and token[0] in "\"'":
            yield token[0] + _of_script(token[1:-1]) + token[-1] if len(token) > 2 else token
        elif len(token.split()) > 1 and len(parts := _TOKENS.findall(token)) > 1:
            yield "".join(_masked(parts))
        else:
            if (name := token.rsplit("/", 1)[-1]) in _LETTERS:
                option, asks = f"-{_LETTERS[name]}", name in _ASKS
            yield token


def _hidden(value: str) -> str:
    return value if REFERENCE.fullmatch(value.strip("\"'")) else MASK
