"""What an EDF says of its trials: parameters, how trials are run, what they give. Values only; times in seconds."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from types import MappingProxyType

import msgspec


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter and the values that it takes."""

    name: str
    """Of the environment variable."""
    values: tuple[str, ...]
    """As containers see them, in the order of the file; no two are equal."""
    services: tuple[str, ...] | None = None
    """Those that get it; None: all that are not kept."""
    unit: str = ""
    description: str = ""


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """Something that becomes true in a trial; which fields count is a matter of its kind."""

    kind: str
    """`completed`, `healthy`, `exit`, `log`, `after` or `metric`"""
    services: tuple[str, ...] = ()
    code: int = 0
    pattern: str = ""
    seconds: float = 0.0
    metric: str = ""
    below: float | None = None
    above: float | None = None
    equals: float | None = None


class Conditions(msgspec.Struct, frozen=True, kw_only=True):
    """Several conditions, of which one, or all, must hold."""

    items: tuple[Condition, ...]
    every: bool


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """A file or folder of a container that comes home."""

    path: str
    required: bool = False
    most_bytes: int = 0
    """0: no limit"""


def folder_of(path: str) -> str:
    """Return the folder that holds a result: itself, or the one above a file, which is what has a suffix."""
    clean = posixpath.normpath(path)
    return posixpath.dirname(clean) if "." in posixpath.basename(clean)[1:] else clean


class Margin(msgspec.Struct, frozen=True):
    """How much two runs may differ and still count as equal."""

    value: float
    """In the metric's unit; of a relative one, a share of the first run's."""
    relative: bool = False

    @property
    def text(self) -> str:
        """Return it as it is written."""
        return f"{self.value * 100:g} %" if self.relative else f"{self.value:g}"


class Metric(msgspec.Struct, frozen=True, kw_only=True):
    """A number that a trial gives, from a JSON file of its results or from a log."""

    name: str
    service: str
    file: str = ""
    pointer: str = ""
    """RFC 6901"""
    pattern: str = ""
    """For a log; else empty."""
    reduce: str = "last"
    unit: str = ""
    better: str = ""
    """`less`, `more` or nothing"""
    margin: Margin | None = None
    """None: nobody said how much it may differ."""
    description: str = ""


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot must be like before a trial is begun; None: no matter."""

    clock_offset_s: float | None = None
    """From the controller's clock, in either direction."""
    disk_free_bytes: int | None = None
    """Where Docker keeps its data."""
    battery_percent: int | None = None
    temperature_c: float | None = None
    wait_s: float = 120.0
    """For a robot that is not so."""

    @property
    def any(self) -> bool:
        """Whether there is one."""
        known = (self.clock_offset_s, self.disk_free_bytes, self.battery_percent, self.temperature_c)
        return any(one is not None for one in known)


class TrialSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How trials are run."""

    repetitions: int = 1
    design: str = "product"
    """`product`, `zip`, `one-at-a-time` or `list`"""
    exclude: tuple[Mapping[str, str], ...] = ()
    include: tuple[Mapping[str, str], ...] = ()
    order: str = "listed"
    """`random` or `listed`"""
    seed: int = 0
    paired_seeds: bool = False
    """All trials of a repetition have the same seed."""
    ready_s: float = 60.0
    settle_s: float = 0.0
    until: Conditions | None = None
    """None: all services without a `restart` have ended."""
    timeout_s: float = 600.0
    stop_signal: str = ""
    stop_grace_s: float | None = None
    stop_first: tuple[str, ...] = ()
    success: Conditions | None = None
    retries: int = 1
    stop_on_failure: bool = False
    max_failures: int = 3
    pause_s: float = 0.0
    prompt: str = ""
    keep: tuple[str, ...] = ()
    limits: Limits = msgspec.field(default_factory=Limits)


class TrialDefinitions(msgspec.Struct, frozen=True, kw_only=True):
    """All that an EDF says of trials."""

    parameters: tuple[Parameter, ...] = ()
    """In the order of the file."""
    settings: TrialSettings = msgspec.field(default_factory=TrialSettings)
    results: Mapping[str, tuple[Result, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service -> its results."""
    metrics: tuple[Metric, ...] = ()

    @property
    def designed(self) -> bool:
        """Whether it says more than `results`, which `collect` brings home without any trial."""
        return bool(self.parameters or self.metrics) or self.settings != TrialSettings()
