"""A `command` or `entrypoint` that is one text -> its words, exactly as Compose splits it.

Takes text; gives words. Pure, in time that grows with the text alone. It is no shell's grammar: a backslash takes the
next character as it is, also in double quotes; `$(…)` and backquotes keep what is in them together, in double quotes
too; and the first `;`, `&`, `|`, `<` or `>` outside of quotes ends the command, without a word of what follows.

Source: what Docker Compose 2.40.3 makes of command strings (by go-shellwords, without variables or backquotes).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_BLANK = " \t\r\n"
_END = ";&|<>"
_PLAIN = re.compile(r"""[^ \t\r\n'"\\`();&|<>]+""")
"""What is part of a word wherever it stands."""


@dataclass
class _State:
    """Words so far, and what the place that was reached is inside of."""

    words: list[str] = field(default_factory=list)
    word: list[str] = field(default_factory=list)
    begun: bool = False
    """There is a word, perhaps an empty one."""
    inside: set[str] = field(default_factory=set)
    """`\\`, `"`, `'`, a backquote, or `)` for what ends with one."""

    def end_word(self) -> None:
        if self.begun:
            self.words.append("".join(self.word))
        self.word, self.begun = [], False

    def toggle(self, what: str) -> None:
        self.inside ^= {what}


def split(text: str) -> tuple[tuple[str, ...], str]:
    """Return the words of a command line, and the rest of the text that Compose would pass over.

    Raises:
        ValueError: A quote or `$(` is not closed, nothing follows a backslash, or a parenthesis belongs to nothing.
    """
    state, at = _State(), 0
    while at < len(text):
        plain = _PLAIN.match(text, at) if "\\" not in state.inside else None
        if plain:
            state.begun = True
            state.word.append(plain[0])
            at = plain.end()
            continue
        if text[at] in _END and not state.inside:
            if text[at] == ">" and "".join(state.word[:1])[:1] in tuple("0123456789"):
                state.begun = False  # the number of a stream
            break
        _take(state, text[at])
        at += 1
    state.end_word()
    if state.inside:
        raise ValueError("no escaped character" if "\\" in state.inside else "no closing quotation")
    return tuple(state.words), text[at:]


def _take(state: _State, letter: str) -> None:
    """Take one character, which does not end the command."""
    inside = state.inside
    if "\\" in inside:
        state.toggle("\\")
    elif letter == "\\" and "'" not in inside:
        state.toggle("\\")
        return
    elif letter == "\\":
        state.word.append(letter)
        return
    elif letter in _BLANK and not inside:
        state.end_word()
        return
    elif letter in "\"'" and not inside & {")", "'" if letter == '"' else '"'}:
        state.begun = state.begun or letter in inside
        state.toggle(letter)
        return
    elif letter in "`()":
        _substitution(state, letter)
    elif letter in _BLANK:
        state.word.append(letter)
        return
    state.begun = True
    state.word.append(letter)


def _substitution(state: _State, letter: str) -> None:
    """Begin or end what is kept together."""
    quoted = state.inside & {'"', "'"}
    if letter == "`" and not quoted and ")" not in state.inside:
        state.toggle("`")
    elif letter == ")" and not quoted and "`" not in state.inside:
        state.toggle(")")
    elif letter == "(" and not quoted and "`" not in state.inside:
        if ")" in state.inside or not "".join(state.word[-1:]).endswith("$"):
            raise ValueError("a parenthesis that belongs to nothing")
        state.toggle(")")
