"""What the shells of a lab's robot may say first: nothing that runs there, whoever wrote the lab's specification."""

from __future__ import annotations

import json

import pytest

from srprov.errors import DefinitionError
from srprov.lab.greeting import strange_line
from srprov.lab.spec import parse

GREETINGS = (
    "echo",
    "echo welcome to robot3",
    "echo -n 'it is $(not) run'  \t>&2",
    'echo "two words" three/four:5 >&2',
    r"printf '\377\376 not UTF-8\n'",
    'printf "and no newline" >&2',
    "sleep 0.2",
    "# a comment with $(anything) \\",
    "",
)
PROGRAMS = (
    "id",
    "echo $(id)",
    "echo `id`",
    'echo "$(id)"',
    'echo "\\`id\\`"',
    "echo x; id",
    "echo x\rid",
    "echo\x0bx",
    "echo x >/etc/passwd",
    "echo x >&2 >/etc/passwd",
    "echo x | sh",
    "echo x & id",
    "echo 'x'\\",
    "echo ~root",
    "echo /root/*",
    "echo 'x",
    "printf -v PATH /tmp",
    "printf '-v' PATH",
    "printf '%n' 'a[$(id)]'",
    "printf '%s' x",
    "sleep $(id)",
    "PATH=/tmp echo x",
    ". /srv/x",
    "(echo x)",
)


def _spec(text: str) -> str:
    return f"defaults: {{bashrc: {json.dumps(text)}}}\n"


def test_a_login_prints_texts_and_waits() -> None:
    text = "\n".join(GREETINGS)
    assert strange_line(text) == ""
    (robot,) = parse(_spec(text), "lab-spec.yml").build(1)
    assert robot.bashrc == text


@pytest.mark.parametrize("line", PROGRAMS)
def test_a_projects_spec_runs_nothing_on_the_robots_of_a_lab(line: str) -> None:
    """They share this machine's kernel: who is root there is root here."""
    with pytest.raises(DefinitionError) as raised:
        parse(_spec(f"echo welcome\n{line}"), "lab-spec.yml")
    (problem,) = raised.value.problems
    assert "is no line that a login may have" in problem.message
