"""The keys of a plan file, each with its type, for `planread`; `schemas/plan.schema.json` says what each means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from srprov.modules.params import AnyText
from srprov.planning.plan import DataMove, PlaybookUse
from srprov.planning.policy import Permission
from srprov.resource import Need


@dataclass(frozen=True, kw_only=True, slots=True)
class WantKeys:
    """What should be true, but for robot, kind and name."""

    params: Mapping[str, Any]
    needs: tuple[Need, ...]
    source: str


@dataclass(frozen=True, kw_only=True, slots=True)
class AlsoKeys(WantKeys):
    """What should be true and is, so that no step is about it."""

    robot: str
    module: str
    name: str


@dataclass(frozen=True, kw_only=True, slots=True)
class FoundKeys:
    """What a step removes."""

    instance: str
    state: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class CommandKeys:
    """One of `run`, `put`, `copy_image` and `engine`, with what belongs to it."""

    timeout_s: float
    run: str | None = None
    put: str = ""
    secret: str = ""
    mode: str = "0"
    in_place: bool = False
    bytes_: int = 0
    sha256: str = ""
    copy_image: str = ""
    id: str = ""
    way: Literal["", "thin", "registry", "whole"] = ""
    runs: tuple[str, ...] = ()
    copy_volume: str = ""
    send_data: str = ""
    url: str = ""
    into: str = ""
    from_: str = ""
    engine: str = ""
    path: str = ""
    params: Mapping[str, str] = field(default_factory=dict)
    body: str = ""
    accept: tuple[int, ...] = ()
    stream: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class StepKeys:
    """One step."""

    number: int
    robot: str
    module: str
    name: str
    action: Literal["create", "update", "replace", "delete", "run"]
    cause: AnyText
    destructive: bool
    needs: tuple[int, ...]
    waits: tuple[Need, ...]
    commands: tuple[CommandKeys, ...]
    before: Mapping[str, Any] | None
    want: WantKeys | None
    found: FoundKeys | None


@dataclass(frozen=True, kw_only=True, slots=True)
class SecretKeys:
    """Where a secret's value comes from."""

    at: tuple[str, int, int]
    env: str = ""
    file: str = ""
    command: tuple[str, ...] = ()
    folder: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Document:
    """The keys of a plan file; `schemas/plan.schema.json` says what each means."""

    plan: int
    format: int
    srprov: str
    instance: str
    source: str
    assignment: Mapping[str, str]
    cost: float
    costs: Mapping[str, float]
    permissions: tuple[Permission, ...]
    secrets: Mapping[str, SecretKeys]
    playbooks: tuple[PlaybookUse, ...]
    data: tuple[DataMove, ...]
    notes: tuple[str, ...]
    unreachable: Mapping[str, str]
    unchanged: int
    counts: Mapping[str, int]
    steps: tuple[StepKeys, ...]
    also_wanted: tuple[AlsoKeys, ...]
    contexts: Mapping[str, str]
    limit: tuple[str, ...]
    fingerprints: Mapping[str, Mapping[str, Any]]
    inputs: Mapping[str, AnyText]
    proof: str
    blobs: Mapping[str, str]
