"""Which services of a plan a user's words mean: `SERVICE`, one of its instances, or `SERVICE@ROBOT`. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from srprov.codes import Code
from srprov.definitions.model import Experiment
from srprov.errors import UsageError, did_you_mean


def services_of(
    words: Sequence[str], experiment: Experiment, placed: Mapping[str, str], gone: Collection[str] = ()
) -> tuple[str, ...]:
    """Return the instances that words mean, sorted.

    Args:
        words: As the user wrote them.
        experiment: With every instance as a service of its own.
        placed: Instance -> the robot that it is placed on.
        gone: Services that are on robots, and not in the experiment any more.

    Raises:
        UsageError: A word means nothing.
    """
    found: set[str] = set()
    for word in words:
        name, at, robot = word.partition("@")
        some = {key for key, one in experiment.services.items() if name in (key, one.instance_of)} | ({name} & {*gone})
        if not some:
            known = sorted({one.instance_of or key for key, one in experiment.services.items()})
            hint = did_you_mean(name, experiment.services) or f"there are: {', '.join(known)}"
            raise UsageError(f"the experiment has no service '{name}'", hint=hint, code=Code.NO_SUCH_NAME)
        here = {key for key in some if not at or placed.get(key) == robot}
        if not here:
            where = ", ".join(f"{key} on {placed[key]}" for key in sorted(some) if key in placed) or "nowhere"
            raise UsageError(f"{name} is not placed on '{robot}'", hint=f"it is placed: {where}", code=Code.NO_MATCH)
        found |= here
    return tuple(sorted(found))
