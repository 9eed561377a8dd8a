"""Steps before they have a number: what a resource lacks, or what goes. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from srprov.errors import PlanError
from srprov.modules import MODULES, RANK
from srprov.resource import Action, Change, Observed, Resource, resource_id
from srprov.wire import Command


@dataclass(frozen=True, kw_only=True, slots=True)
class Draft:
    """A step before it has a number."""

    host: str
    module: str
    name: str
    change: Change
    commands: tuple[Command, ...]
    want: Resource | None = None
    found: Observed | None = None

    @property
    def key(self) -> tuple[str, int, int, str]:
        """Place in the order, and identity: at most one removal and one other step per resource."""
        removes = self.change.action is Action.DELETE
        rank = len(RANK) - RANK[self.module] if removes else RANK[self.module]
        return (self.host, 0 if removes else 1, rank, self.name)

    @property
    def id(self) -> str:
        """The resource's address."""
        return resource_id(self.host, self.module, self.name)


def draft_of(resource: Resource, change: Change) -> Draft:
    """Return the step that makes a resource right."""
    commands = MODULES[resource.module].commands(resource, change)
    return Draft(
        host=resource.host, module=resource.module, name=resource.name, change=change, commands=commands, want=resource
    )


def removal_of(host: str, item: Observed, cause: str, *, destructive: bool = False) -> Draft:
    """Return the step that takes away what was found."""
    change = Change(action=Action.DELETE, cause=cause, destructive=destructive, before=item.state)
    commands = MODULES[item.module].removal(item)
    return Draft(host=host, module=item.module, name=item.name, change=change, commands=commands, found=item)


def checked(resource: Resource, item: Observed | None) -> Change | None:
    """Ask the module; a user's playbook may give it values that no schema knows to be wrong.

    Raises:
        PlanError: The module cannot make anything of them.
    """
    try:
        change = MODULES[resource.module].check(resource, item.state if item else None)
        if change is not None:
            MODULES[resource.module].commands(resource, change)
        return change
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        message = f"{resource.source}: no {resource.module} can be made of these values: {error!r}"
        raise PlanError(message, hint="compare them with the playbook of srprov that states this module") from error
