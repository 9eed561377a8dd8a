"""Words that mean something to a shell, to Jinja, to YAML, to a terminal, to Markdown or to ssh; and more like them."""

from __future__ import annotations

import re

from hypothesis import strategies as st

CANARY = "srprov-canary"
_T = f"touch {CANARY}"
WORDS = (
    f"$({_T})", f"`{_T}`", f"; {_T}", f"\n{_T}\n", f"'; {_T}; '", f'"; {_T}; "', f"|{_T}", f"&& {_T} #", f">{CANARY}",
    f"-oProxyCommand={_T}", f"${{x:-$({_T})}}", f"'\n{_T}\n", f"\\'; {_T}", "it's", 'say "x"', "a\\", "\\n",
    "{{7*7}}", "{{ 7*7 }}", "{% raw %}", "{% endraw %}", "{% for x in y %}", "{# gone #}", "{{ ''.__class__ }}",
    "-rf", "--help", "*", "?", "[a-z]", "~", "$HOME", "!!", "#no", "a b", " lead", "trail ", "\ttab", "a\rb", "a\nb",
    "", "%{HOME}", "!!python/object:os.system", "&a", "*a", "- x", "a: b", "null", "0x10", "1e3", "yes", "@file",
    "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\x1b]8;;http://x\x1b\\link", "\x9b2J", "\x1bc", "\x07", "\x7f\x08\x08",
    "\u202eevil", "\u2066x\u2069", "\u200fx", "\u2028line", "\ufeffx", "é😀", "x" * 300, "| cell |", "$x$", "# head",
    "<script>alert(1)</script>", "</details>", "![x](http://x)", "[x](javascript:x)", "```",
)  # fmt: skip
"""Each by itself; none holds a NUL, which no shell word, argument or environment can."""

LETTERS = st.characters(codec="utf-8", exclude_characters="\0")
PIECES = (
    st.sampled_from(WORDS) | st.text(LETTERS, max_size=6) | st.sampled_from(list("'\"\\$`;&|<>(){}[]*?~#!%\n\t \r-"))
)
texts = st.sampled_from(WORDS) | st.lists(PIECES, max_size=4).map("".join)
"""Any text but NUL, most often a hostile one."""
names = texts.map(lambda text: text.replace("/", "|")[:100]).filter(lambda text: text not in ("", ".", ".."))
"""As a part of a path: no `/`, and not the folder itself or the one above."""

_FORBIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff\U000e0000-\U000e007f]"
)
_OUR_COLOURS = re.compile(r"\x1b\[(?:0|3[0-7]|1)m")


def unprintable(text: str) -> list[str]:
    """Return what a terminal would not just show, but for newlines, tabs and srprov's own colours."""
    return sorted(set(_FORBIDDEN.findall(_OUR_COLOURS.sub("", text))))
