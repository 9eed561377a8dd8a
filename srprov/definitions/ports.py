"""`ports` and `expose` of a container -> one entry per port, no more than a service may have.

Takes nodes that the schema has looked at; gives tuples. Ranges are counted before they become entries. Pure.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.definitions import values
from srprov.definitions.containermodel import EVERYWHERE, Port
from srprov.definitions.values import guarded, scalars, text
from srprov.yamldoc.nodes import Findings, Node, Path


def published(node: Node | None, findings: Findings, path: Path) -> tuple[Port, ...]:
    """Return `ports`, one entry for each; at one address a port is published once."""
    taken: dict[tuple[int, str], dict[str, Node]] = {}
    every: list[Port] = []
    none: tuple[Port, ...] = ()
    for item in scalars(node):
        for port in guarded(lambda given: values.ports(text(given)), item, none, findings, path):
            others = taken.get((port[1], port[3]))  # by address
            if others is None:
                others = taken[port[1], port[3]] = {}
            elif (first := _taken(port[0], others)) is not None:
                message = f"port {port[1]}/{port[3]} is published twice; already on line {first.line}"
                findings.add(item, message, path, code=Code.WRONG_VALUE)
                break
            others[port[0]] = item
            every.append(port)
            if len(every) > values.MOST_PORTS:
                findings.add(item, f"more than {values.MOST_PORTS} ports are published", path, code=Code.TOO_LARGE)
                return none
    return tuple(every)


def _taken(address: str, others: dict[str, Node]) -> Node | None:
    same = others if address in EVERYWHERE else (address, *EVERYWHERE)
    return next((others[one] for one in same if one in others), None)


def exposed(node: Node | None, findings: Findings, path: Path) -> tuple[tuple[int, str], ...]:
    """Return `expose`, each port once. Its engine lists them with every container, in an answer that must be read."""
    every: list[tuple[int, str]] = []
    none: tuple[tuple[int, str], ...] = ()
    for item in scalars(node):
        every += guarded(lambda given: values.exposed(text(given)), item, none, findings, path)
        if len(every) > values.MOST_PORTS:
            findings.add(item, f"more than {values.MOST_PORTS} ports are exposed", path, code=Code.TOO_LARGE)
            return none
    return tuple(dict.fromkeys(every))
