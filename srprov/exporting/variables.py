"""Variables of the controller's environment: their names go into the export, their values never do. Pure.

An EDF may name a variable without a value, which is then the controller's. Definitions are read for an export with an
environment in which each variable has a value that nobody could have written, so none is read, and each is known again.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, eq=False, slots=True)
class Open(Mapping[str, str]):
    """An environment that has every variable; its values stand for them."""

    token: str = field(default_factory=lambda: f"open{secrets.token_hex(16)}")

    def __getitem__(self, name: str) -> str:
        """Return what stands for the value of a variable."""
        return f"{self.token}.{name}"

    def __iter__(self) -> Iterator[str]:
        """Name no variable: there is no list of all."""
        return iter(())

    def __len__(self) -> int:
        """Return 0, as nothing is listed."""
        return 0

    def stands_for(self, value: str) -> str:
        """Return the variable whose value this stands for; empty: it is a value."""
        before, _, name = value.partition(".")
        return name if before == self.token else ""

    def as_args(self, dockerfile: str) -> tuple[str, tuple[str, ...]]:
        """Return a Dockerfile that takes such variables as ARGs, right before they are set, and their names."""
        wanted = re.compile(rf"{self.token}\.([A-Za-z_][A-Za-z0-9_.-]*)")
        names = tuple(sorted(set(wanted.findall(dockerfile))))
        if not names:
            return dockerfile, ()
        lines: list[str] = []
        for line in dockerfile.split("\n"):
            if line.startswith("ENV ") and not any(one.startswith("ARG ") for one in lines):
                lines += [f"ARG {name}" for name in names]
            lines.append(wanted.sub(lambda match: f"${{{match[1]}}}", line))
        return "\n".join(lines), names
