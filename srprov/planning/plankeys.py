"""The keys of a plan file, each with its type, for `planread`; `schemas/plan.schema.json` says what each means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import msgspec

from srprov.modules.params import AnyText
from srprov.planning.plan import DataMove, PlaybookUse
from srprov.planning.policy import Permission
from srprov.resource import Need


class WantKeys(msgspec.Struct, frozen=True, kw_only=True):
    """What should be true, but for robot, kind and name."""

    params: Mapping[str, Any]
    needs: tuple[Need, ...]
    source: str


class AlsoKeys(WantKeys, frozen=True, kw_only=True):
    """What should be true and is, so that no step is about it."""

    robot: str
    module: str
    name: str


class FoundKeys(msgspec.Struct, frozen=True, kw_only=True):
    """What a step removes."""

    instance: str
    state: Mapping[str, Any]


class CommandKeys(msgspec.Struct, frozen=True, kw_only=True):
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
    base: str = ""
    runs: tuple[str, ...] = ()
    copy_volume: str = ""
    send_data: str = ""
    url: str = ""
    into: str = ""
    from_: str = ""
    engine: str = ""
    path: str = ""
    params: Mapping[str, str] = msgspec.field(default_factory=dict)
    body: str = ""
    accept: tuple[int, ...] = ()
    stream: bool = False


class DifferenceKeys(msgspec.Struct, frozen=True, kw_only=True):
    """One changed value: `old` and `new`, or one of `note` and `diff`."""

    field: AnyText
    old: str | None = None
    new: str | None = None
    note: AnyText = AnyText("")
    diff: tuple[AnyText, ...] = ()


class StepKeys(msgspec.Struct, frozen=True, kw_only=True):
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
    makes: AnyText = AnyText("")
    differences: tuple[DifferenceKeys, ...] = ()


class SecretKeys(msgspec.Struct, frozen=True, kw_only=True):
    """Where a secret's value comes from."""

    at: tuple[str, int, int]
    env: str = ""
    file: str = ""
    command: tuple[str, ...] = ()
    folder: str = ""


class Document(msgspec.Struct, frozen=True, kw_only=True):
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
    targets: tuple[str, ...] = ()
