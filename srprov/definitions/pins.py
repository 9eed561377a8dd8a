"""`robot:` of services against the inventory: a pin on a robot that nobody knows is a mistake in a file.

Takes an Experiment and an Inventory; gives problems. Pure.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.definitions.model import Experiment, Inventory
from srprov.errors import Diagnostic, did_you_mean
from srprov.names import few

_SHOWN = 12


def unknown_pins(experiment: Experiment, inventory: Inventory) -> tuple[Diagnostic, ...]:
    """Return one problem for each service that is pinned to a robot which the inventory does not have."""
    return tuple(
        Diagnostic(
            location=service.location,
            message=f"'{service.name}' is pinned to '{service.robot}', which is not in the inventory",
            path=f"services.{service.name}.robot",
            hint=_hint(service.robot, inventory),
            code=Code.NO_MATCH,
        )
        for service in experiment.services.values()
        if service.robot and service.robot not in inventory.hosts
    )


def _hint(wanted: str, inventory: Inventory) -> str:
    if suggestion := did_you_mean(wanted, inventory.hosts):
        return suggestion
    return f"it has: {few(list(inventory.hosts), _SHOWN)}"
