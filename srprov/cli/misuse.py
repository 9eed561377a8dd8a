"""What is wrong with a command line, in srprov's words: click's errors -> errors with a code and what to do.

Takes click's error and the words of the command line; gives errors. Looks whether files are there, and opens none.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterator, Sequence

import click

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import SrprovError, UsageError, did_you_mean, visible

_READ = (".edf", ".cdf", ".yml", ".yaml", ".ini")
"""Endings of files that verbs read and none writes where its output goes."""
_WRITES = frozenset({"-o", "--out", "--svg", "--png", "--events"})
_ABSENT = re.compile(r"(File|Directory|Path) (.+) does not exist\.", re.DOTALL)
_NOT_AMONG = re.compile(r"(.+?) is not (?:one of .+|.+\.)", re.DOTALL)
_NO_COMMAND = re.compile(r"No such command (.+?)\.(?: Did you mean .*)?\Z", re.DOTALL)
_TOO_MANY = re.compile(r"Got unexpected extra arguments? \((.*)\)", re.DOTALL)
_SIGNS = re.compile(r"[][.]")
"""What a metavar says of how often its word may stand."""
_NO_VALUE = re.compile(r"Option .* requires (?:an argument|[0-9]+ arguments)\.", re.DOTALL)
_ELSEWHERE = {"up": "apply", "down": "destroy", "rm": "destroy", "ps": "status", "shell": "ssh",
              "history": "runs", "show": "runs show", "hosts": "facts", "check": "validate", "copy": "cp"}  # fmt: skip
"""What other tools call a verb -> the verb."""
_OPTIONS = {
    "--auto-approve": "--yes", "--assume-yes": "--yes", "--only": "--target",
    "--service": "--target", "--services": "--target", "--inventory-file": "--inventory", "--hosts": "--limit",
    "--name": "--instance", "--project-name": "--instance", "--output": "--out", "--parallel": "--forks",
}  # fmt: skip
"""What other tools call an option -> the option; told where the verb has it."""
_OTHERWISE = {
    "--dry-run": "`srprov plan` shows what would change, and changes nothing",
    "--check": "`srprov plan` shows what would change, and changes nothing",
    "--scale": "write `replicas: 2` at the service in the EDF",
    "--var": "values stand in the EDF: `environment` of a service, `parameters` of trials",
    "--extra-vars": "values stand in the EDF: `environment` of a service, `parameters` of trials",
    "--build": "`apply` builds what is missing; `pull_policy` in the EDF says more",
    "--force": "--yes leaves out the question, --adopt takes over what another file made, --allow gives permission",
    "--detach": "`apply` always leaves services running",
}
"""What other tools have an option for -> how it is done here; told of `plan` and `apply`, which they mean."""
_LONGEST = 200
"""Characters of a word of the command line that are shown again."""


def missing_files(words: Sequence[str]) -> Iterator[SrprovError]:
    """Yield an error for each file on a command line that looks like one to be read and is not there."""
    for before, word in zip(["", *words], words, strict=False):
        if before not in _WRITES and not word.startswith("-") and word.endswith(_READ) and not os.path.lexists(word):
            yield _no_file(word)


def as_error(error: click.ClickException) -> SrprovError:
    """Return one of click's errors as one of srprov's: the user's word first, then what is wrong with it."""
    context = getattr(error, "ctx", None)
    name = context.command_path if context else "srprov"
    if (unknown := _NO_COMMAND.match(error.message)) and context:
        return _no_verb(_bare(unknown[1]), name, context)
    if isinstance(error, click.NoSuchOption):
        known = (
            [one for param in context.command.params for one in (*param.opts, *param.secondary_opts)] if context else []
        )
        hint = _option_hint(error.option_name, name, known)
        return UsageError(f"{name} has no option '{_short(error.option_name)}'", hint=hint, code=Code.UNKNOWN_OPTION)
    if isinstance(error, click.MissingParameter):
        what = _name(error.param) if error.param else "an argument"
        said = f"`{name} --help` says what it is"
        if isinstance(error.param, click.Option) and error.param.help:
            said = f"{min(error.param.opts, key=len)} {error.param.metavar or 'VALUE'}: {error.param.help}"
        return UsageError(f"{name} needs {what}", hint=said, code=Code.WHICH)
    if isinstance(error, click.BadParameter) and error.param:
        return _bad_value(error.message, error.param)
    if isinstance(error, click.BadOptionUsage):
        said = f"{error.option_name} needs a value" if _NO_VALUE.fullmatch(error.message) else _sentence(error.message)
        return UsageError(visible(said), hint="`--help` behind the verb says which", code=Code.OPTION_VALUE)
    if isinstance(error, click.FileError):
        return UsageError(f"{error.ui_filename}: {error.message}", code=Code.NO_FILE)
    more = _TOO_MANY.fullmatch(error.message)
    said = f"{name} takes no further '{_short(more[1])}'" if more else _sentence(error.format_message())
    hint = f"`{name} --help` says what it takes"
    if more and context and any(param.name == "targets" for param in context.command.params):
        hint = f"--target SERVICE is for a part of the experiment; {hint}"
    return UsageError(said, hint=hint, code=Code.OPTIONS)


def _option_hint(option: str, name: str, known: Sequence[str]) -> str:
    """Return what to do about an option that a verb does not have."""
    if _OPTIONS.get(option) in known:
        return f"`{_OPTIONS[option]}` does that"
    if option in _OTHERWISE and "--target" in known:
        return _OTHERWISE[option]
    longer = next((f"did you mean '{one}'?" for one in known if one.startswith(f"{option}-")), "")
    return did_you_mean(option, known) or longer or f"`{name} --help` lists its options"


def _no_verb(word: str, name: str, context: click.Context) -> SrprovError:
    group = context.command
    known = group.list_commands(context) if isinstance(group, click.Group) else []
    hint = did_you_mean(word, known) or f"`{name} --help` lists the verbs"
    if name == "srprov" and word in _ELSEWHERE:
        hint = f"`srprov {_ELSEWHERE[word]}` does that"
    if name == "srprov" and (os.path.isfile(word) or word.endswith(_READ)):
        hint = f"name a verb before the file: srprov validate {shlex.quote(_short(word))}"
    return UsageError(f"{name} has no verb '{_short(word)}'", hint=hint, code=Code.UNKNOWN_VERB)


def _bad_value(message: str, param: click.Parameter) -> SrprovError:
    if isinstance(param.type, click.Path | click.File):
        if absent := _ABSENT.fullmatch(message):
            return _no_file(_bare(absent[2]), param)
        code = Code.CANNOT_WRITE if message.startswith("cannot write") else Code.NO_FILE
        return UsageError(f"{_name(param)}: {_sentence(message)}", code=code)
    if isinstance(param.type, click.Choice) and (match := _NOT_AMONG.match(message)):
        word, known = _bare(match[1]), [str(one) for one in param.type.choices]
        hint = did_you_mean(word, known) or f"known: {', '.join(known)}"
        return UsageError(f"{_name(param)} cannot be '{_short(word)}'", hint=hint, code=Code.OPTION_VALUE)
    hint = ""
    if "-f" in param.opts and (match := _NOT_AMONG.match(message)) and _bare(match[1]).endswith(_READ):
        hint = "the file stands without an option: srprov VERB FILE -i INVENTORY"
    return UsageError(f"{_name(param)}: {_sentence(message)}", hint=hint, code=Code.OPTION_VALUE)


def _no_file(path: str, param: click.Parameter | None = None) -> SrprovError:
    near = did_you_mean(os.path.basename(path), regular_file.names_beside(path))
    where = f" ({_name(param)})" if param else ""
    return UsageError(f"there is no file '{_short(path)}'{where}", hint=near, code=Code.NO_FILE)


def _name(param: click.Parameter) -> str:
    """Return how the user writes a parameter: `--format`, or the word that stands for an argument."""
    if isinstance(param, click.Argument):
        return _SIGNS.sub("", param.metavar or param.human_readable_name)
    return max(param.opts, key=len)


def _bare(quoted: str) -> str:
    """Return a word that click has quoted."""
    return quoted[1:-1] if len(quoted) > 1 and quoted[0] == quoted[-1] and quoted[0] in "'\"" else quoted


def _short(word: str) -> str:
    return visible(word[:_LONGEST])


def _sentence(text: str) -> str:
    text = visible(text.strip().removesuffix("."))
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
