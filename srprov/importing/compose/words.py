"""A command in one text -> its words, as Compose splits them: no shell, and not as a shell would. Pure.

Quotes and backslashes are as in a shell. What stands after `;`, `&`, `|`, `<` or `>` is left out; a backtick or `$(`
keeps spaces within its word; other parentheses are refused.
"""

from __future__ import annotations

_SPACE = " \t\r\n"


def split(text: str) -> list[str]:
    """Return the words of a command.

    Raises:
        ValueError: A quote, a backtick or a parenthesis is not closed, or stands where none may.
    """
    return _Words().split(text)


class _Words:
    """What is known after each character."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.word: list[str] = []
        self.begun = False
        self.quote = ""
        """The quote that is open: a single or double one."""
        self.tick = False
        self.dollar = False
        """Inside of `$(`."""

    def split(self, text: str) -> list[str]:
        escaped = False
        for char in text:
            if escaped:
                self._add(char)
                escaped = False
            elif char == "\\" and self.quote != "'":
                escaped = True
            elif char in _SPACE:
                self._space(char)
            elif char in ";&|<>" and not (self.quote or self.tick or self.dollar):
                self._redirect(char)
                break
            else:
                self._char(char)
        if escaped or self.quote or self.tick or self.dollar:
            raise ValueError("a quote, a backtick or a parenthesis is not closed")
        self._end()
        return self.words

    def _redirect(self, char: str) -> None:
        """Leave out the number of a stream that stands before `>`."""
        if char == ">" and self.word and self.word[0][:1].isdigit():
            self.begun = False

    def _space(self, char: str) -> None:
        if self.quote or self.tick or self.dollar:
            self.word.append(char)
        else:
            self._end()

    def _end(self) -> None:
        if self.begun:
            self.words.append("".join(self.word))
        self.word, self.begun = [], False

    def _add(self, char: str) -> None:
        self.word.append(char)
        self.begun = True

    def _char(self, char: str) -> None:
        if char in "\"'" and self.quote in ("", char) and not self.dollar:
            self.begun = self.begun or bool(self.quote)
            self.quote = "" if self.quote else char
            return
        if char == "`" and not self.quote and not self.dollar:
            self.tick = not self.tick
        elif char == ")" and not self.quote and not self.tick:
            self.dollar = not self.dollar
        elif char == "(" and not self.quote and not self.tick:
            if self.dollar or self.word[-1:] != ["$"]:
                raise ValueError("a parenthesis stands where Compose takes none; quote it")
            self.dollar = True
            self.word.append(char)
            return
        self._add(char)
