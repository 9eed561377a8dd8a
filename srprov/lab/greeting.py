"""What the shells of a lab's robot say first, as the option `bashrc` has it: texts that they print, and waits. Pure.

A `lab-spec.yml` comes with a project, and the robots of a lab share this machine's kernel and see its files: whatever
else stood there would run as root. So a line is one of a few forms, in which a shell finds nothing to expand.
"""

from __future__ import annotations

import re

_TEXT = r"(?:'[^']*'|\"[^\"$`\\]*\"|[A-Za-z0-9_.,:/@+=%-]+)+"
"""One word of a shell's, whatever quotes it has."""
_FORMAT = r"(?:'(?!-)[^'%]*'|\"(?!-)[^\"$`\\%]*\")"
"""What printf takes, without any value: by `%n` and `-v` it would work out the name of a variable."""
_ERR = r"(?:[ \t]*>&2)?"
_LINE = re.compile(
    rf"echo(?:[ \t]+-[neE]+)?(?:[ \t]+{_TEXT})*{_ERR}|printf[ \t]+{_FORMAT}{_ERR}"
    r"|sleep[ \t]+[0-9]{1,4}(?:\.[0-9]{1,6})?|(?:#.*)?"
)
FORMS = "`echo TEXT`, `printf 'TEXT'` without a `%`, either with `>&2`, `sleep SECONDS`, and comments"


def strange_line(text: str) -> str:
    """Return the first line that does anything but print a text or wait, or nothing."""
    return next((line for line in text.split("\n") if not _LINE.fullmatch(line.strip(" \t"))), "")
