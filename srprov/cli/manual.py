"""The manual page in the language of man(7).

Takes the verbs as `commands.py` has them, gives the text of `srprov.1`. Equal verbs give equal bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import click

from srprov import __version__
from srprov.cli.commands import Option, Verb, verbs

_REVISED = "2026-11-23"
"""When the sentences of this file were last changed; a manual page has a date."""
_LONGEST = 80
"""Bytes of a line."""
_INTRODUCTION = (
    "srprov sets up experiments that run on several robots. An EDF says which services there are, CDFs say what "
    "their containers are made of, an inventory lists the robots. srprov decides which robot runs what, builds the "
    "images, joins the containers in a network of their own, starts them in order, and says what it changed. Done "
    "again, it changes nothing.",
    "Robots need SSH, Docker and iproute2. Nothing of srprov is installed on them.",
)
EXIT_CODES = {
    "0": "Done, or nothing to do.",
    "1": "A bug in srprov.",
    "2": "plan --detailed-exitcode, status --exit-code, verify or compare found a difference.",
    "3": "A step, a trial, a probe, a condition of wait or a required result failed.",
    "4": "A robot could not be reached.",
    "5": "Invalid input or usage, or an answer that could not be written.",
    "6": "A robot changed since the plan was made.",
    "7": "Another controller holds a robot.",
    "8": "No robot, or no combination of robots, can run the services.",
    "9": "Refused by policy, or by you at the prompt.",
    "130": "Interrupted.",
}
ENVIRONMENT = {
    "SRPROV_VERB_OPTION": "The default of an option, such as SRPROV_APPLY_FORKS for srprov apply --forks. The command "
    "line wins; it wins over configuration files.",
    "SRPROV_RUNS": "The folder that runs are recorded in, as --runs.",
    "SRPROV_LAB": "The name of the embedded lab, as lab --name.",
    "NO_COLOR": "Where it is set, nothing is coloured.",
    "XDG_CONFIG_HOME, XDG_STATE_HOME, XDG_CACHE_HOME": "In place of ~/.config, ~/.local/state and ~/.cache.",
}
FILES = {
    "~/.config/srprov/srprov.toml": "Your own defaults of options.",
    "./srprov.toml, ./pyproject.toml": "Those of a project, the latter in its table [tool.srprov].",
    "~/.config/srprov/policy.yml, /etc/srprov/policy.yml": "What is allowed at all.",
    "~/.config/srprov/playbooks/": "Your own playbooks.",
    "~/.local/state/srprov/runs/": "A record of each run.",
    "~/.cache/srprov/": "Layers of images, and git repositories. It may be removed at any time.",
    "/var/lib/srprov/, /run/srprov/, /var/log/srprov.log": "On a robot: an instance's files and the placement; "
    "secrets, in memory; a line for each run.",
}
_EXAMPLES = (
    ("Look at the robots, check the files, look before you leap, then do it:",
     ("srprov facts -i robots.yml", "srprov validate experiment.edf", "srprov plan experiment.edf -i robots.yml",
      "srprov apply experiment.edf -i robots.yml")),
    ("Robots on this machine, as root:", ("srprov lab up -n 3", "srprov apply experiment.edf -i inventory/lab.yml")),
)  # fmt: skip


def page(group: click.Group) -> str:
    """Return the page of `srprov`, which `group` is."""
    return "\n".join(_lines(list(verbs(group)))) + "\n"


def _lines(listed: list[Verb]) -> Iterator[str]:
    yield f'.TH SRPROV 1 {_REVISED} "srprov {__version__}" "User Commands"'
    yield from (".nh", ".ad l")  # words and options are searched for, and must not be broken
    yield from (".SH NAME", r"srprov \- provision multi\-robot experiments over SSH, without agents")
    yield from (".SH SYNOPSIS", r"\fBsrprov\fR \fIVERB\fR [\fIOPTIONS\fR] \fIARGUMENTS\fR")
    yield from (".SH DESCRIPTION", *_separated(_INTRODUCTION))
    yield ".SH VERBS"
    for verb in listed:
        yield from _verb(verb)
    for title, table in (("EXIT STATUS", EXIT_CODES), ("ENVIRONMENT", ENVIRONMENT), ("FILES", FILES)):
        yield f".SH {title}"
        for name, words in table.items():
            yield from (".TP", _bold(name), *_filled(words))
    yield ".SH EXAMPLES"
    for number, (words, commands) in enumerate(_EXAMPLES):
        yield from ([".PP"] if number else [])
        yield from (*_filled(words), *_as_is(commands))
    yield from (".SH SEE ALSO", r"\fBssh\fR(1), \fBssh_config\fR(5), \fBdocker\fR(1), \fBip\-link\fR(8)")


def _verb(verb: Verb) -> Iterator[str]:
    yield f".SS {_text(verb.usage)}"
    for number, part in enumerate(verb.paragraphs):
        if part.as_is:
            yield from _as_is(part.text.splitlines())
        else:
            yield from ([".PP"] if number else [])
            yield from _filled(part.text)
    for option in verb.options:
        if "--help" not in option.names:
            yield from (".TP", _heading(option), *_filled(option.help))


def _heading(option: Option) -> str:
    names = ", ".join(_bold(name) for name in option.names)
    return f"{names} \\fI{_text(option.value)}\\fR" if option.value else names


def _separated(texts: tuple[str, ...]) -> Iterator[str]:
    for number, text in enumerate(texts):
        yield from ([".PP"] if number else [])
        yield from _filled(text)


def _filled(text: str) -> Iterator[str]:
    """Yield lines that man(1) fills; short ones, as its checkers ask for."""
    line = ""
    for word in text.split():
        longer = f"{line} {word}".lstrip()
        if line and len(_text(longer)) > _LONGEST:
            yield _text(line)
            longer = word
        line = longer
    yield _text(line)


def _as_is(lines: list[str] | tuple[str, ...]) -> Iterator[str]:
    """Yield lines that must not be wrapped, set in."""
    yield from (".PP", ".RS 4", ".nf", *(_text(line.rstrip()) for line in lines), ".fi", ".RE")


def _bold(text: str) -> str:
    return f"\\fB{_text(text)}\\fR"


def _text(text: str) -> str:
    """Return a text as roff reads it back: no character of it is a command.

    A minus is escaped, since a bare one is a hyphen, which is another character in UTF-8 and cannot be typed.
    """
    plain = text.replace("\\", "\\e").replace("-", "\\-").replace("`", "\\(ga").replace("'", "\\(aq")
    plain = plain.replace("^", "\\(ha").replace("~", "\\(ti").replace("…", "\\[u2026]")
    return "\\&" + plain if re.match(r"[.']", plain) else plain
