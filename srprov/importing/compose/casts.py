"""Text -> the number or boolean that its place wants: a variable gives only text, and so do quotes. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from srprov.errors import Diagnostic
from srprov.importing.compose.scalars import Date
from srprov.importing.compose.values import Rules, Value, dotted, wrong
from srprov.importing.compose.variables import Variables
from srprov.importing.position import Path

_INTEGER = re.compile(r"[-+]?[0-9]{1,19}", re.ASCII)
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
_WORDS = {"true": True, "y": True, "yes": True, "on": True, "false": False, "n": False, "no": False, "off": False}


def boolean(text: str) -> bool:
    """Return what a word for yes or no means, in any case.

    Raises:
        ValueError: It is none.
    """
    if text.lower() not in _WORDS:
        raise ValueError(f"'{text[:60]}' is neither true nor false")
    return _WORDS[text.lower()]


def integer(text: str) -> int:
    """Return a whole number in decimal digits.

    Raises:
        ValueError: It is none, or has more than 64 bits.
    """
    number = int(text) if _INTEGER.fullmatch(text) else 2**63
    if not -(2**63) <= number < 2**63:
        raise ValueError(f"'{text[:60]}' is no whole number")
    return number


def number(text: str) -> float:
    """Return a number.

    Raises:
        ValueError: It is none.
    """
    if not _NUMBER.fullmatch(text) or len(text) > 100:
        raise ValueError(f"'{text[:60]}' is no number")
    return float(text)


_PATTERNS: Mapping[Callable[[str], object], str] = {
    boolean: """services.*.init services.*.depends_on.*.required services.*.depends_on.*.restart
        services.*.healthcheck.disable services.*.oom_kill_disable services.*.privileged services.*.read_only
        services.*.stdin_open services.*.tty services.*.volumes.*.read_only services.*.volumes.*.volume.nocopy
        networks.*.external networks.*.internal networks.*.attachable networks.*.enable_ipv4 networks.*.enable_ipv6
        volumes.*.external secrets.*.external configs.*.external""",
    integer: """services.*.cpu_count services.*.cpu_period services.*.cpu_quota services.*.cpu_rt_period
        services.*.cpu_rt_runtime services.*.cpu_shares services.*.deploy.replicas
        services.*.deploy.update_config.parallelism services.*.deploy.rollback_config.parallelism
        services.*.deploy.restart_policy.max_attempts services.*.deploy.placement.max_replicas_per_node
        services.*.healthcheck.retries services.*.oom_score_adj services.*.pids_limit services.*.ports.*.target
        services.*.scale services.*.ulimits.* services.*.ulimits.*.hard services.*.ulimits.*.soft
       """,
    number: """services.*.cpu_percent services.*.cpus services.*.deploy.update_config.max_failure_ratio
        services.*.deploy.rollback_config.max_failure_ratio""",
}
RULES = Rules({pattern: cast for cast, patterns in _PATTERNS.items() for pattern in patterns.split()})


def interpolate(value: Value, variables: Variables) -> Value:
    """Return a tree with variables put in and text cast; what is wrong is added to the variables' problems."""
    return _Casting(variables).walk(value, RULES, ())


class _Casting:
    def __init__(self, variables: Variables) -> None:
        self.variables = variables

    def walk(self, value: Value, rules: Rules | None, path: Path) -> Value:
        data: Any = value.data
        if isinstance(data, dict):
            data = {name: self.walk(item, rules and rules.step(name), (*path, name)) for name, item in data.items()}
        elif isinstance(data, list):
            data = [self.walk(item, rules and rules.step(at), (*path, at)) for at, item in enumerate(data)]
        elif isinstance(data, str) and not isinstance(data, Date):
            data = self._text(value, rules, path)
        else:
            return value
        return Value(data, value.at, value.key, value.tag)

    def _text(self, value: Value, rules: Rules | None, path: Path) -> object:
        text = self.variables.put_in(value.data, value.at)
        if rules is None or rules.here is None:
            return text
        try:
            return rules.here(text)
        except ValueError as error:
            if not any(one.location == value.at for one in self.variables.problems):
                problem = wrong(value, f"{path[-1]}: {error}", path)
                self.variables.problems.append(
                    Diagnostic(problem.location, problem.message, dotted(path), code=problem.code)
                )
            return text
