"""Firewall rules that drop: read from iptables-save and nft, and which of them dropped packets of a pair. Pure."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from ipaddress import ip_address, ip_network

import msgspec

from srprov.untrusted import lines_of, text

_SAVES = ("iptables-save", "ip6tables-save", "iptables-legacy-save", "ip6tables-legacy-save")
RULES = (
    "".join(f"command -v {one} >/dev/null && {{ echo '## {one}'; {one} -c 2>/dev/null; }}; " for one in _SAVES)
    + "command -v nft >/dev/null && { echo '## nft'; nft list ruleset 2>/dev/null; }; true"
)
"""Asks a robot for its rules with their counters; what is not installed says nothing."""
_MOST_LINES = 20_000
_MOST_MET = 50
"""Rules of a robot that are compared with what failed: a second makes few counters of rules that drop rise."""
_FIRST_ANY = 1024
_APPENDED = re.compile(r"\[([0-9]{1,18}):[0-9]{1,18}\] -A (\S{1,64}) (.{0,500})")
_POLICY = re.compile(r":(\S{1,64}) DROP \[([0-9]{1,18}):[0-9]{1,18}\]")
_COUNTED = re.compile(r"counter packets ([0-9]{1,18})")
_XTABLES = re.compile(r"table ip6? (filter|nat|mangle|raw|security) \{")
"""What iptables-save shows in its own words."""


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    """A rule, or a chain's policy, that drops or rejects."""

    where: str
    """Program, table and chain."""
    words: str
    """As the program shows it; empty: the chain's policy."""
    packets: int | None
    """How many met it; None: it does not count."""

    @property
    def text(self) -> str:
        """Return it for people."""
        return f"{self.where}: {self.words}" if self.words else f"{self.where}: the policy of the chain is to drop"


class Packet(msgspec.Struct, frozen=True, kw_only=True):
    """What may meet a rule."""

    source: str
    target: str
    protocols: tuple[str, ...]
    port: int = 0
    """UDP, where it goes to; 0: it differs."""


def parse_rules(out: str) -> tuple[Rule, ...]:
    """Return the rules that drop or reject."""
    found: list[Rule] = []
    part: list[str] = []
    program = ""
    for line in [*lines_of(out, _MOST_LINES), "## "]:
        if line.startswith("## "):
            found += _saved(program, part) if program in _SAVES else _listed(part) if program == "nft" else []
            program, part = text(line[3:], length=24), []
        else:
            part.append(line)
    return tuple(found)


def _saved(program: str, lines: Sequence[str]) -> Iterator[Rule]:
    table, name = "", program.removesuffix("-save")
    for line in lines:
        if line.startswith("*"):
            table = text(line[1:], length=16)
        elif policy := _POLICY.match(line):
            yield Rule(where=f"{name} {table} {text(policy[1])}", words="", packets=int(policy[2]))
        elif (rule := _APPENDED.match(line)) and re.search(r"-j (DROP|REJECT)\b", rule[3]):
            yield Rule(where=f"{name} {table} {text(rule[2])}", words=text(rule[3]), packets=int(rule[1]))


def _listed(lines: Sequence[str]) -> Iterator[Rule]:
    table = chain = ""
    for line in map(str.strip, lines):
        if line.startswith("table "):
            table = "" if _XTABLES.match(line) else text(line.removesuffix("{"), length=80)
        elif line.startswith("chain "):
            chain = text(line.removesuffix("{").removeprefix("chain "), length=64)
        elif not table:
            continue
        elif re.search(r"\bpolicy drop\b", line):
            yield Rule(where=f"nft {table} {chain}", words="", packets=None)
        elif re.search(r"(^|\s)(drop|reject)\b", line):
            counted = _COUNTED.search(line)
            words = text(re.sub(r"counter packets \S+ bytes \S+ ?", "", line))
            yield Rule(where=f"nft {table} {chain}", words=words, packets=int(counted[1]) if counted else None)


def that_dropped(before: Sequence[Rule], after: Sequence[Rule]) -> tuple[Rule, ...]:
    """Return the first rules that met packets in between, those with words first, and those that do not count last."""
    counts: Counter[tuple[str, str]] = Counter()
    for one in before:
        counts[one.where, one.words] += one.packets or 0
    met = []
    for one in after:
        key = one.where, one.words
        if one.packets is None or one.packets > counts[key]:
            met.append(one)
    return tuple(sorted(met, key=lambda one: (not one.words, one.packets is None))[:_MOST_MET])


def may_match(rule: Rule, packets: Sequence[Packet]) -> bool:
    """Return whether a rule may have met one of these packets; one that does not count must name them."""
    if rule.where.startswith("nft "):
        return _nft_matches(rule, packets)
    if not rule.words:
        return True
    conditions = _conditions(rule.words)
    return conditions is not None and any(_matches(conditions, one) for one in packets)


@lru_cache(maxsize=1024)
def _conditions(words: str) -> tuple[tuple[str, str, bool], ...] | None:
    """Return a rule's options, each with its value and whether it is negated; None: they cannot be read."""
    try:
        split = shlex.split(words)
    except ValueError:
        return None
    found, negated = [], False
    for option, value in zip(split, [*split[1:], ""], strict=True):
        if option in ("-s", "-d", "-p", "--dport"):
            found.append((option, value, negated))
        negated = option == "!" or (negated and not option.startswith("-"))
    return tuple(found)


def _matches(conditions: Sequence[tuple[str, str, bool]], packet: Packet) -> bool:
    for option, value, negated in conditions:
        if option in ("-s", "-d"):
            address = packet.source if option == "-s" else packet.target
            if _within(address, value) == negated:
                return False
        elif option == "-p":
            if (value in packet.protocols or value == "all") == negated:
                return False
        elif not negated and not _covers(value, packet.port):
            return False
    return True


def _nft_matches(rule: Rule, packets: Sequence[Packet]) -> bool:
    """Return whether it names an address or the port; counters tell it of the others."""
    words = set(re.split(r"[\s{},]+", rule.words))
    named = any(words & {one.source, one.target} or (one.port and str(one.port) in words) for one in packets)
    has_address = bool(re.search(r"\b(saddr|daddr|dport|sport)\b", rule.words))
    return named or (rule.packets is not None and not has_address)


@lru_cache(maxsize=65_536)
def _within(address: str, network: str) -> bool:
    try:
        return ip_address(address) in ip_network(network, strict=False)
    except (ValueError, TypeError):
        return False


def _covers(ports: str, port: int) -> bool:
    """Return whether a range has a port; with 0, whether it has one that the kernel gives to who asks for any."""
    first, _, last = ports.partition(":")
    if not first.isdecimal():
        return False
    low, high = int(first[:6]), int(last[:6] if last.isdecimal() else first[:6])
    return low <= port <= high if port else high >= _FIRST_ANY
