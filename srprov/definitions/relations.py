"""Pools, relations, replicas and `per_robot` of an EDF: reading them, and what about them cannot be.

Takes the root of an EDF; gives values, or adds to `Findings`. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from srprov.codes import Code
from srprov.definitions.model import Pool
from srprov.definitions.values import scalars, text
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq


def pools(root: Map) -> tuple[Pool, ...]:
    """Return the pools in name order."""
    found = []
    for _, pool in _pools(root):
        services = _services(pool)
        discount = nodes.as_number(pool.entries["discount"]) if "discount" in pool.entries else None
        name = text(pool.entries.get("name")) or _default_name(pool)
        found.append(Pool(name=name, services=services, discount=1.0 if discount is None else discount))
    return tuple(sorted(found, key=lambda pool: (pool.name, pool.services)))


def different_robot(root: Map) -> tuple[tuple[str, ...], ...]:
    """Return the groups of which no two services may share a robot, sorted."""
    return tuple(
        sorted({tuple(sorted({item.text for item in scalars(group)})) for _, group in _different_robot_groups(root)})
    )


def check(
    root: Map, known: Mapping[str, Map], same_robot: Sequence[Sequence[str]], sharing: Sequence[Sequence[str]],
    findings: Findings,
) -> None:  # fmt: skip
    """Add relations that contradict each other, names that clash, and groups of services that run on every robot.

    `sharing` has the groups that share a volume.
    """
    _check_contradictions(root, same_robot, "same_robot puts", findings)
    _check_contradictions(root, sharing, "the volume that they share puts", findings)
    _check_per_robot(root, known, same_robot, findings)
    _check_instances(known, findings)
    seen: set[str] = set()
    for index, pool in _pools(root):
        given = pool.entries.get("name")
        name = text(given) or _default_name(pool)
        if name and name in seen:
            hint = "give each a 'name' of its own" if given is None else ""
            findings.add(
                given or pool,
                f"there are two pools '{name}'",
                ("pools", index, "name") if given else ("pools", index),
                hint,
                code=Code.TWICE,
            )
        seen.add(name)


def _services(pool: Map) -> tuple[str, ...]:
    return tuple(sorted({item.text for item in scalars(pool.entries.get("services"))}))


def _default_name(pool: Map) -> str:
    """Return what a pool without a name is called."""
    return "+".join(_services(pool))


def _pools(root: Map) -> Iterator[tuple[int, Map]]:
    given = root.entries.get("pools")
    for index, pool in enumerate(given.items if isinstance(given, Seq) else ()):
        if isinstance(pool, Map):
            yield index, pool


def _different_robot_groups(root: Map) -> Iterator[tuple[int, Node]]:
    relations = root.entries.get("relations")
    given = relations.entries.get("different_robot") if isinstance(relations, Map) else None
    yield from enumerate(given.items if isinstance(given, Seq) else ())


def _check_contradictions(root: Map, same_robot: Sequence[Sequence[str]], what: str, findings: Findings) -> None:
    home = {name: at for at, together in enumerate(same_robot) for name in together}
    for index, group in _different_robot_groups(root):
        by_home: dict[int, list[Scalar]] = {}
        for item in scalars(group):
            if item.text in home:
                by_home.setdefault(home[item.text], []).append(item)
        for both in by_home.values():
            if len({item.text for item in both}) > 1:
                names = " and ".join(f"'{item.text}'" for item in both[:2])
                message = f"{names} must run on different robots, but {what} them on one"
                findings.add(both[1], message, ("relations", "different_robot", index), code=Code.RELATION)


def _check_per_robot(
    root: Map, known: Mapping[str, Map], same_robot: Sequence[Sequence[str]], findings: Findings
) -> None:
    """Check what names a service of which there are several, or one on each robot."""
    everywhere = {name for name, entry in known.items() if "per_robot" in entry.entries}
    for index, pool in _pools(root):
        _refuse_per_robot(pool.entries.get("services"), everywhere, "a pool", ("pools", index, "services"), findings)
    for index, group in _different_robot_groups(root):
        _refuse_per_robot(group, everywhere, "different_robot", ("relations", "different_robot", index), findings)
    for together in same_robot:
        for name in sorted(everywhere & set(together)):
            message = f"'{name}' runs on each robot ('per_robot'), so same_robot cannot name it"
            findings.add(known[name].keys["per_robot"], message, ("services", name, "per_robot"), code=Code.RELATION)


def _refuse_per_robot(node: Node | None, everywhere: set[str], where: str, path: Path, findings: Findings) -> None:
    for item in scalars(node):
        if item.text in everywhere:
            findings.add(
                item,
                f"'{item.text}' runs on each robot ('per_robot'), so {where} cannot name it",
                path,
                code=Code.RELATION,
            )


def _check_instances(known: Mapping[str, Map], findings: Findings) -> None:
    """Check `replicas` and `per_robot`: not both, no pin with `per_robot`, and no name that an instance will have."""
    for name, entry in sorted(known.items()):
        path: Path = ("services", name)
        for other in ("robot", "replicas"):
            if "per_robot" in entry.entries and other in entry.entries:
                findings.add(
                    entry.keys[other],
                    f"'{other}' and 'per_robot' exclude each other",
                    (*path, other),
                    code=Code.RELATION,
                )
        count = entry.entries.get("replicas")
        number = nodes.as_int(count) if isinstance(count, Scalar) else None
        per_robot = isinstance(entry.entries.get("per_robot"), Map)
        if not per_robot and (number is None or number < 2):
            continue
        for other in sorted(one for one in known if one.startswith(f"{name}-") and one != f"{name}-"):
            which = other[len(name) + 1 :]
            taken = number is not None and re.fullmatch("[0-9]{1,6}", which) is not None and 1 <= int(which) <= number
            if taken or per_robot:
                message = f"'{other}' is also the name of an instance of '{name}'"
                if taken:
                    findings.add(known[other], message, ("services", other), f"rename '{other}'", code=Code.NAME)
