"""What the user must allow, checked in one place: before a plan is made, and before it is done.

Everything that an experiment asks for beyond its own containers is a `Permission` of `planning.policy`; here it is held
against what the user allowed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import RefusedError, UsageError, did_you_mean
from srprov.planning.policy import ASKED_FIRST, KINDS, Permission, permissions, require

if TYPE_CHECKING:
    from srprov.definitions.labpolicy import LabPolicy
    from srprov.definitions.model import Definitions, Inventory
    from srprov.planning.plan import DataMove, Plan


def check_kinds(allowed: Collection[str]) -> None:
    """Refuse a kind that does not exist: a typing mistake must not look like a permission.

    Raises:
        UsageError: Names it, and the kinds that there are.
    """
    unknown = sorted(set(allowed) - set(kinds()))
    if unknown:
        several = "one --allow for each kind" if any("," in one for one in unknown) else ""
        hint = "; ".join(filter(None, (several or did_you_mean(unknown[0], kinds()), f"known: {', '.join(kinds())}")))
        raise UsageError(f"--allow knows no kind {', '.join(unknown)}", hint=hint, code=Code.OPTION_VALUE)


def kinds() -> tuple[str, ...]:
    """Return what --allow takes."""
    return (*KINDS, "all")


def permit_planning(asked: Iterable[Permission], allowed: Collection[str]) -> None:
    """Refuse what even a plan must not do without permission: read secrets, render a stranger's playbook.

    Raises:
        RefusedError: Names all of it, and the flags that would allow it.
    """
    require([one for one in asked if one.kind in ASKED_FIRST], allowed)


def permit_files(definitions: Definitions, allowed: Collection[str]) -> None:
    """Refuse to tell what files elsewhere say, such as what a CDF requires of robots, where nothing else is done.

    Raises:
        RefusedError: As `permit_planning`.
    """
    asked = permissions(definitions.experiment, definitions.containers)
    require([one for one in asked if one.kind == "outside"], allowed)


def permit_run(
    plan: Plan, allowed: Collection[str], inventory: Inventory | None = None, policies: Sequence[LabPolicy] = ()
) -> None:
    """Refuse to do a plan that asks for what the user did not allow, or what a lab's policy does not allow at all.

    Raises:
        RefusedError: Names all of it, and the flags that would allow it; or the policy's file and line; or data that
            would be left behind.
    """
    if policies and inventory:
        from srprov.controller.labpolicy import enforce

        enforce(plan, inventory, policies)
    require(plan.permissions, allowed)
    require_decided(plan.data)


def may_trigger(allowed: Collection[str], inventory: Inventory, policies: Sequence[LabPolicy] = ()) -> frozenset[str]:
    """Return where a build may run what its base brings: ONBUILD instructions, of which a plan cannot know.

    Args:
        allowed: What the user allows.
        inventory: The robots.
        policies: Each of them must allow it on the robot that builds.
    """
    wanted = {"built-image", "engine-fetch"}
    if "all" not in allowed and not wanted <= set(allowed):
        return frozenset()
    if not policies:
        return frozenset(inventory.hosts)
    from srprov.controller.labpolicy import allows

    return frozenset(
        robot
        for robot in inventory.hosts
        if all(allows(policy, kind, robot, inventory) for policy in policies for kind in wanted)
    )


def require_decided(moves: Iterable[DataMove]) -> None:
    """Refuse a plan that would leave data behind without the user's word.

    Raises:
        RefusedError: Names the data.
    """
    if open_ones := [one for one in moves if not one.how]:
        raise RefusedError(
            "; ".join(one.text.partition(";")[0] for one in open_ones),
            hint="--data move copies it and removes it there, --data leave starts without it; or take the pin away",
            code=Code.NOT_ALLOWED,
        )
