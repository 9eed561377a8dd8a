"""One file per kind of resource: how to ask, how to read, what is missing, what makes it right. Pure.

`MODULES` lists them in the order in which a robot is built up; taking down goes the other way.
"""

from __future__ import annotations

from typing import Any

from srprov.modules.command import CommandModule
from srprov.modules.container import ContainerModule
from srprov.modules.dataset import DataModule
from srprov.modules.file import FileModule
from srprov.modules.image import ImageModule
from srprov.modules.module import Module, Probing, Running
from srprov.modules.network import NetworkModule
from srprov.modules.secret import SecretModule
from srprov.modules.tree import TreeModule
from srprov.modules.unit import UnitModule
from srprov.modules.volume import VolumeModule
from srprov.modules.vxlan import VxlanModule
from srprov.modules.vxlan_filter import VxlanFilterModule
from srprov.modules.wireguard import WireguardModule
from srprov.modules.wireguard_peers import WireguardPeersModule
from srprov.modules.wireguard_routes import WireguardRoutesModule

_ALL: tuple[Module[Any], ...] = (
    ImageModule(),
    NetworkModule(),
    VxlanFilterModule(),
    WireguardModule(),
    WireguardPeersModule(),
    WireguardRoutesModule(),
    VxlanModule(),
    UnitModule(),
    FileModule(),
    TreeModule(),
    DataModule(),
    SecretModule(),
    VolumeModule(),
    CommandModule(),
    ContainerModule(),
)

MODULES: dict[str, Module[Any]] = {module.kind: module for module in _ALL}
PROBING: dict[str, Probing] = {module.kind: module for module in _ALL if isinstance(module, Probing)}
"""Kinds that only show when they are asked for."""
RUNNING: dict[str, Running] = {module.kind: module for module in _ALL if isinstance(module, Running)}
"""Kinds that run a service."""
RANK: dict[str, int] = {module.kind: rank for rank, module in enumerate(_ALL)}
