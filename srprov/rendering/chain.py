"""All playbooks of one robot in their order: srprov's own, and what users added before, between and after them.

Takes the playbooks that ship and those of users; gives the robot's resources. What a user added stands in order, item
by item: each waits for all that comes before it, and all that comes after it waits for it. Touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.playbookmodel import ADDED, AFTER, BEFORE, REPLACES, Playbook
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.modules.module import Module, Running
from srprov.rendering.limited import Rendered, render_texts
from srprov.rendering.render import render
from srprov.rendering.user import render_user
from srprov.resource import Condition, Need, Resource

Entry = tuple[str, Playbook | None]
"""A playbook's name, and the playbook itself unless it is srprov's own."""


def arrange(ours: Collection[str], theirs: Iterable[Playbook]) -> tuple[Entry, ...]:
    """Return all playbooks in order: those `before`, then ours and the user's by file name, then those `after`."""
    every = list(theirs)
    own = {one.base: one for one in every if one.place in (ADDED, REPLACES)}
    middle = [(name, own.get(name)) for name in sorted({*ours, *own})]
    first = [(one.name, one) for one in every if one.place == BEFORE]
    return (*first, *middle, *((one.name, one) for one in every if one.place == AFTER))


def render_all(
    ours: Mapping[str, str],
    theirs: Iterable[Playbook],
    contexts: Mapping[str, Mapping[str, Any]],
    *,
    modules: Mapping[str, Module[Any]],
    blobs: Mapping[str, bytes],
) -> list[Resource]:
    """Render all playbooks for all robots; what a user added only for robots that run a service.

    Raises:
        DefinitionError: With all that is wrong in users' playbooks, for any robot.
        RenderError: One of srprov's own does not render.
    """
    entries = arrange(ours, theirs)
    if not any(playbook for _, playbook in entries):
        return [
            one
            for host, context in contexts.items()
            for one in render(ours, host, context, modules=modules, blobs=blobs)
        ]
    chains: dict[str, _Chain] = {}
    problems: dict[Diagnostic, None] = {}
    rendered = _rendered(entries, contexts)
    for host, context in contexts.items():
        chain = chains[host] = _Chain(host)
        for name, playbook in entries:
            if playbook is None:
                chain.add(render({name: ours[name]}, host, context, modules=modules, blobs=blobs))
            elif text := rendered.get((host, name)):
                try:
                    chain.add(render_user(playbook, context, text, modules=modules, blobs=blobs), playbook)
                except DefinitionError as error:
                    problems.update(dict.fromkeys(error.problems))
    running = {kind for kind, module in modules.items() if isinstance(module, Running)}
    stated = {host: chain.resources.keys() for host, chain in chains.items()}
    # what a playbook that did not render would have stated is no mistake of others
    for chain in chains.values() if not problems else ():
        problems.update(dict.fromkeys(chain.finish(stated, running)))
    if problems:
        raise DefinitionError(list(problems))
    return [resource for chain in chains.values() for resource in chain.resources.values()]


def _rendered(entries: Iterable[Entry], contexts: Mapping[str, Mapping[str, Any]]) -> dict[tuple[str, str], Rendered]:
    """Render users' playbooks for every robot where they count; one that took too much is the last that is there."""
    wanted = {
        (host, name): (playbook, context)
        for host, context in contexts.items()
        for name, playbook in entries
        if playbook is not None and (playbook.place == REPLACES or context["services"])
    }
    return dict(zip(wanted, render_texts(list(wanted.values())), strict=False))


class _Chain:
    """One robot's resources as they come."""

    def __init__(self, host: str) -> None:
        self.host = host
        self.resources: dict[str, Resource] = {}
        self.problems: list[Diagnostic] = []
        self._last: list[str] = []
        """What all that comes now waits for: the last resource that a user added."""
        self._since: list[str] = []
        """Those of ours that came since then; the next one that a user added waits for all of them."""
        self._users: dict[str, Playbook] = {}
        self._earlier: dict[str, set[str]] = {}
        """Resource that a user added -> those that stand before it."""

    def add(self, some: Iterable[Resource], playbook: Playbook | None = None) -> None:
        """Add the resources of one playbook, ours when none is given."""
        standing = playbook is not None and playbook.place != REPLACES
        for resource in some:
            if resource.id in self.resources:
                self._clash(resource, playbook)
                continue
            named = {need.id for need in resource.needs}
            waits = (*self._last, *self._since) if standing else self._last
            order = tuple(Need(one, Condition.AFTER.value) for one in waits if one not in named)
            if standing:
                self._earlier[resource.id] = set(self.resources)
                self._last, self._since = [resource.id], []
            else:
                self._since.append(resource.id)
            self.resources[resource.id] = replace(resource, needs=(*resource.needs, *order))
            if playbook is not None:
                self._users[resource.id] = playbook

    def finish(self, stated: Mapping[str, Collection[str]], running: Collection[str]) -> list[Diagnostic]:
        """Return what is wrong with the needs of users' resources, and resources that stand twice.

        What is needed of a robot that is out of reach cannot be judged; `stated` has the ids of all others. `running`
        are the kinds that can be waited for.
        """
        for identity, playbook in self._users.items():
            resource = self.resources[identity]
            for need in resource.needs:
                host, _, name = need.id.partition("/")
                if need.condition == Condition.AFTER.value or host not in stated:
                    continue
                if need.id not in stated[host]:
                    hint = did_you_mean(name, [one.split("/", 1)[1] for one in stated[host]])
                    self._tell(resource, playbook, f"needs {need.id}, which no playbook states", hint)
                elif host == self.host and need.id not in self._earlier.get(identity, self.resources):
                    hint = "a playbook is done from top to bottom; put this one behind it"
                    self._tell(resource, playbook, f"needs {need.id}, which comes later", hint)
                elif need.condition != Condition.PRESENT.value and name.partition(":")[0] not in running:
                    only = " or ".join(f"a {kind}" for kind in sorted(running))
                    self._tell(resource, playbook, f"needs {need.id} {need.condition}, which only {only} can be")
        return self.problems

    def _clash(self, resource: Resource, playbook: Playbook | None) -> None:
        """Tell that a resource stands twice, at the user's: the one that is ours is where it belongs."""
        first = self.resources[resource.id]
        owner = playbook or self._users.get(resource.id)
        assert owner is not None  # those of one of our playbooks were compared when it was rendered
        told, other = (resource, first) if playbook else (first, resource)
        message = f"{resource.module}:{resource.name} stands in {other.source} as well"
        self._tell(told, owner, message, "give it another name", Code.TWICE)

    def _tell(
        self, resource: Resource, playbook: Playbook, message: str, hint: str = "", code: Code = Code.PLAYBOOK
    ) -> None:
        file, line, column = resource.source.rsplit(":", 2)
        excerpt = playbook.source.excerpt(int(line))
        self.problems.append(Diagnostic(Location(file, int(line), int(column)), message, "", excerpt, hint, code=code))
