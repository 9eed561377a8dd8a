"""What must be done before a step of a plan, and what of the wanted is copied from another robot. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from srprov.codes import Code
from srprov.errors import PlanError
from srprov.modules import MODULES, RUNNING
from srprov.planning.plan import Step
from srprov.planning.reach import Reach
from srprov.planning.steps import Key
from srprov.resource import Action, Resource, resource_id


def taken(wanted: Mapping[str, Resource]) -> dict[str, Resource]:
    """Return the id of each resource that is replaced by one on another robot -> that one.

    Raises:
        PlanError: One would be replaced by itself.
    """
    sources = {key: MODULES[one.module].taken_from(one.params) for key, one in wanted.items()}
    for key, source in sources.items():
        if source == wanted[key].host:
            message = f"{key} cannot be copied from {source}, where it is"
            raise PlanError(message, hint="name another robot", code=Code.OPTIONS)
    return {
        resource_id(source, wanted[key].module, wanted[key].name): wanted[key]
        for key, source in sources.items()
        if source
    }


class Before:
    """What must be done before a step: an index of the removals, and of what needs what."""

    def __init__(self, by_key: Mapping[Key, Step], wanted: Mapping[str, Resource]) -> None:
        self._taken = taken(wanted)
        self._changed = {one.id: key for key, one in by_key.items() if one.want is not None}
        self._reach = Reach(wanted, self._changed)
        self._removals: dict[tuple[str, ...], set[Key]] = {}
        """Keys of removals by robot and kind, by id, and by service."""
        self._shared: dict[tuple[str, str], frozenset[Key]] = {}
        self._made: dict[str, dict[str, set[Key]]] = {}
        """Keys of all other steps by kind and robot."""
        self._users: dict[str, set[str]] = {}
        """Ids of what needs one that is copied, by its id."""
        for key, one in by_key.items():
            if one.want is not None:
                self._made.setdefault(one.module, {}).setdefault(one.host, set()).add(key)
            if one.change.action is Action.DELETE:
                for at in ((one.host, one.module), (one.id,), ("", "", one.service)):
                    self._removals.setdefault(at, set()).add(key)
        for resource in wanted.values() if self._taken else ():
            for id_ in (resource.id, *(need.id for need in resource.needs)):
                self._users.setdefault(id_, set()).add(resource.id)

    def of(self, step: Step) -> Collection[Key]:
        """Return the steps that must have succeeded before one."""
        if step.want is None:
            return self._of_removal(step)
        needs = {self._changed[one] for one in self._reach.of(step.want.needs)}
        if source := MODULES[step.module].taken_from(step.want.params):
            needs.update(*(self._gone(source, kind) for kind in RUNNING))
        module = MODULES[step.module]
        needs.update(*(self._gone(step.host, kind) for kind in MODULES if module.made_after_removal_of(kind)))
        # nothing stands twice, and no service runs twice
        return needs.union(self._gone(step.id), self._gone("", "", step.service) if step.service else ())

    def _gone(self, *at: str) -> Collection[Key]:
        return self._removals.get(at, ())

    def _of_removal(self, step: Step) -> Collection[Key]:
        place = step.host, step.module
        if place not in self._shared:  # a robot may have very many, and all wait for the same
            first = (self._gone(step.host, kind) for kind, one in MODULES.items() if one.removed_before(step.module))
            self._shared[place] = frozenset[Key]().union(*first, *self._made_before(step))
        # what was copied goes last: after the copy, and after what needs the copy was made
        if (heir := self._taken.get(step.id)) is None:
            return self._shared[place]
        return self._shared[place] | {self._changed[one] for one in self._users[heir.id] if one in self._changed}

    def _made_before(self, step: Step) -> Iterator[Collection[Key]]:
        """Return the steps that are no removals, by kind and robot, which one that is comes after."""
        after = MODULES[step.module].removed_after_making
        for kind, of_robots in self._made.items():
            if after(kind, here=True):
                yield of_robots.get(step.host, ())
            if after(kind, here=False):
                yield from (keys for host, keys in of_robots.items() if host != step.host)
