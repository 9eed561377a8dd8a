"""Units of systemd that restore the overlay when a robot boots, before any apply: one-shot, without a daemon.

The name is `srprov-INSTANCE.service`. A unit is made of the parameters of the VXLAN link, and runs what would make that
link, and before it the rules that close the overlay, on a robot without them; nothing else can be written into one. It
is enabled and not started: on a robot that runs, the link is there.

Source: systemd.unit(5), systemd.service(5); what is below /etc/systemd/system is the administrator's.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from srprov.modules.module import Module, Names
from srprov.modules.params import ParameterError
from srprov.modules.vxlan import VxlanParams, link_calls
from srprov.modules.vxlan_fdb import FLOOD
from srprov.modules.vxlan_filter import VxlanFilterParams, closing_script
from srprov.resource import Action, Change, Observed, State
from srprov.robot_answers import all_lines
from srprov.wire import AnyQuery, Command, Query, Reply, Run, printed, quote

FOLDER = "/etc/systemd/system"
_WANTS = "multi-user.target.wants"
_MARK = "# Written by srprov"
_NAME = re.compile(r"srprov-([a-z0-9-]{1,32})\.service", re.ASCII)
_PLAIN = re.compile(r"[\w.:/@+-]+", re.ASCII)
_LIST = f"""\
cd {FOLDER} 2>/dev/null || exit 0
for u in srprov-*.service; do
  l= ; read -r l 2>/dev/null <"$u"
  case $l in '{_MARK}'*) ;; *) continue ;; esac
  [ -e "{_WANTS}/$u" ] && printf 'enabled ' || printf 'disabled '
  sha256sum "$u"
done
:"""
_SAID = re.compile(r"(enabled|disabled) ([0-9a-f]{64})  (\S+)", re.ASCII)
_UNIT = """\
{mark} for the instance {instance}; `srprov destroy` removes it.
[Unit]
Description=Overlay network of the srprov instance {instance}
# Docker makes the bridge when it starts.
Wants=docker.service
# Firewalls may begin with no rules at all: ours come after theirs.
After=docker.service nftables.service netfilter-persistent.service firewalld.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=-/sbin/ip link del dev {link}
ExecStart=/bin/sh -c "{rules}"
{calls}

[Install]
WantedBy=multi-user.target
"""


class UnitParams(VxlanParams, frozen=True, kw_only=True):
    """What a playbook says of a unit: the link that it restores."""

    link: str

    def __post_init__(self) -> None:
        """Refuse words that would need quotes in a unit: no link has any."""
        VxlanParams.__post_init__(self)
        if self.netns:
            raise ParameterError("netns", "a unit cannot restore an overlay that is encrypted")
        _filter_of(self)
        for call in link_calls(self.link, self):
            if odd := [word for word in call if not _PLAIN.fullmatch(word)]:
                raise ParameterError("link", f"{odd[0]!r} cannot stand in a unit")


class UnitModule(Module[UnitParams]):
    """The module of kind `unit`."""

    kind = "unit"
    params = UnitParams
    common = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """Hash the units that begin with our mark, and say which are enabled."""
        return (Query(command=_LIST),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read `enabled sha256  name` lines."""
        found = []
        for said in map(_SAID.fullmatch, all_lines(replies[0].out)):
            name = _NAME.fullmatch(said[3]) if said else None
            if said and name:
                state = {"enabled": said[1] == "enabled", "sha256": said[2]}
                found.append(Observed(module=self.kind, name=name[0], instance=name[1], state=state))
        return tuple(found)

    def check(self, name: str, want: UnitParams, found: State | None) -> Change | None:
        """Compare by hash; one that differs is written whole. Nothing is started or stopped."""
        text = unit_text(want)
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=_write(name, text))
        differs = found["sha256"] != hashlib.sha256(text.encode()).hexdigest()
        causes = ["content differs"] * differs + ["not enabled"] * (not found["enabled"])
        if not causes:
            return None
        return Change(action=Action.UPDATE, cause="; ".join(causes), before=found, commands=_write(name, text))

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Disable and delete it. It has nothing to stop: the link is removed by itself."""
        unit = quote(found.name)
        lines = (
            f"cd {FOLDER} 2>/dev/null || exit 0",
            f"systemctl --quiet disable {unit} 2>/dev/null",
            f"systemctl --quiet stop {unit} 2>/dev/null",
            f"rm -f {unit} {_WANTS}/{unit} || exit",
            "systemctl daemon-reload",
        )
        return (Run(script="\n".join(lines)),)

    def is_own(self, name: str, want: UnitParams, names: Names) -> bool:
        """Compare names, and where packets go: to robots of the plan."""
        own = (want.link, want.bridge, want.instance) == (names.link, names.bridge, names.instance)
        there = {want.local, *(vtep for _, vtep in want.fdb)} <= names.vteps
        return own and there and name == unit_name(names.instance)

    def misplaced(self, name: str, want: UnitParams, context: Mapping[str, Any]) -> tuple[str, str] | None:
        """Say so of one with another name, too: it would not be found again."""
        if wrong := super().misplaced(name, want, context):
            return wrong
        right = unit_name(context["instance"])
        return None if name == right else (f"the unit '{name}' is not the instance's", f"call it {right}")

    def removed_before(self, other: str) -> bool:
        """Go before what it would bring back."""
        return other == "vxlan"


def unit_name(instance: str) -> str:
    """Return the name of an instance's unit."""
    return f"srprov-{instance}.service"


def unit_text(want: UnitParams) -> str:
    """Return the unit. A new kind of thing that a boot loses adds its calls here."""
    calls = "\n".join(f"ExecStart=/sbin/{' '.join(call)}" for call in link_calls(want.link, want))
    rules = _quoted(closing_script(want.link, _filter_of(want)))
    return _UNIT.format(mark=_MARK, instance=want.instance, link=want.link, rules=rules, calls=calls)


def _filter_of(want: UnitParams) -> VxlanFilterParams:
    """Return who may send into the link: whom it floods."""
    peers = tuple(vtep for mac, vtep in want.fdb if mac == FLOOD)
    return VxlanFilterParams(instance=want.instance, vni=want.vni, port=want.port, local=want.local, peers=peers)


def _quoted(script: str) -> str:
    """Return a script as it stands in double quotes in a unit."""
    for one, written in (("\\", "\\\\"), ("\n", "\\n"), ('"', "\\042"), ("$", "$$"), ("%", "%%")):
        script = script.replace(one, written)
    return script


def _write(name: str, text: str) -> tuple[Command, ...]:
    """Return the one script that puts a unit in its place, whole, and enables it."""
    path = quote(f"{FOLDER}/{name}")
    # an experiment may be called as another program is: the worker of a site has such a unit, too
    script = f"""\
if [ -e {path} ]; then
  read -r l <{path}
  case $l in '{_MARK}'*) ;; *) echo {quote(f"{name} is there, and srprov did not write it")} >&2; exit 1 ;; esac
fi
{printed(text)} >{path}.new && chmod 644 {path}.new && mv -f {path}.new {path} || exit
systemctl daemon-reload && systemctl --quiet enable {quote(name)}"""
    return (Run(script=script),)
