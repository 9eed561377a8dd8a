"""What Compose checks once a project is complete: services and what they refer to. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from srprov.errors import Diagnostic
from srprov.importing.compose.finish import in_order, services
from srprov.importing.compose.paths import is_remote
from srprov.importing.compose.values import Value, plain, wrong
from srprov.importing.normal import Refused
from srprov.importing.position import Path

_TESTS = ("CMD", "CMD-SHELL", "NONE")


def consistent(tree: Value, everything: Value) -> None:
    """Check a project of chosen services; `everything` also has those whose profiles are off.

    Raises:
        Refused: With all that is wrong.
    """
    problems = [
        problem
        for name, service in services(tree).items()
        for check in _CHECKS
        for problem in check(_Service(tree, everything, service, ("services", name)))
    ]
    problems += _names(tree)
    secrets = tree.get("secrets")
    for name, secret in secrets.data.items() if secrets is not None else ():
        if not any(secret.get(key) is not None for key in ("file", "environment", "external")):
            problems.append(wrong(secret, f"secret '{name}' has neither a file nor a variable", ("secrets", name)))
    if problems:
        raise Refused(problems)
    in_order(tree)


def _names(tree: Value) -> Iterator[Diagnostic]:
    """Yield services that want a name of a container that another has."""
    owners: dict[str, str] = {}
    for service, value in services(tree).items():
        name = value.get("container_name")
        if name is None:
            continue
        if name.data in owners:
            message = f"service '{service}' has the container_name '{name.data}' of service '{owners[name.data]}'"
            yield wrong(name, message, ("services", service, "container_name"))
        owners.setdefault(name.data, service)


class _Service:
    """One service, and the project around it."""

    def __init__(self, tree: Value, everything: Value, value: Value, path: Path) -> None:
        self.tree = tree
        self.everything = everything
        self.value = value
        self.path = path
        self.name = path[-1]

    def get(self, *names: str) -> Any:  # noqa: ANN401 - JSON
        """Return plain data below the service, or None."""
        value: Value | None = self.value
        for name in names:
            value = value.get(name) if value is not None else None
        return plain(value) if value is not None else None

    def at(self, *names: str) -> Value:
        """Return the value below the service, or the nearest around it."""
        value = self.value
        for name in names:
            value = value.get(name) or value
        return value

    def has(self, kind: str, name: str) -> bool:
        """Return whether the project has something of a name."""
        things = self.tree.get(kind)
        return things is not None and things.get(name) is not None

    def problem(self, message: str, *names: str) -> Diagnostic:
        """Return a problem of the service."""
        return wrong(self.at(*names), f"service '{self.name}' {message}", (*self.path, *names))


def _image(service: _Service) -> Iterator[Diagnostic]:
    build = service.get("build")
    if build is None and not service.get("image") and service.get("provider") is None:
        yield service.problem("has neither an image nor a build")
    if not build:
        return
    if build.get("dockerfile_inline") and build.get("dockerfile"):
        yield service.problem("has both dockerfile and dockerfile_inline", "build", "dockerfile_inline")
    platform, platforms = service.get("platform"), build.get("platforms")
    if platform and platforms and platform not in platforms:
        yield service.problem(f"is not built for its platform '{platform}'", "build", "platforms")
    for name, context in (build.get("additional_contexts") or {}).items():
        other = str(context).removeprefix("service:")
        if is_remote(str(context)) and other != context and other not in services(service.tree):
            yield service.problem(f"has the context {name} of a service '{other}', which is not there", "build")


def _networks(service: _Service) -> Iterator[Diagnostic]:
    mode, networks = service.get("network_mode"), service.get("networks")
    if mode and networks:
        yield service.problem("has both network_mode and networks", "network_mode")
    for name in networks or ():
        if not service.has("networks", name):
            yield service.problem(f"uses the network '{name}', which is not there", "networks", name)
    if mode and mode.startswith("service:") and mode.removeprefix("service:") not in services(service.tree):
        yield service.problem(
            f"uses the network of '{mode.removeprefix('service:')}', which is not there", "network_mode"
        )


def _health(service: _Service) -> Iterator[Diagnostic]:
    test = service.get("healthcheck", "test")
    if test and test[0] not in _TESTS:
        yield service.problem(f"has a health check that begins with none of {', '.join(_TESTS)}", "healthcheck", "test")


def _dependencies(service: _Service) -> Iterator[Diagnostic]:
    for name, wish in (service.get("depends_on") or {}).items():
        if name in services(service.tree):
            continue
        if name in services(service.everything):
            if wish.get("required", True):
                yield service.problem(f"depends on '{name}', whose profile is off", "depends_on", name)
        else:
            yield service.problem(f"depends on '{name}', which is not there", "depends_on", name)


def _targets(service: _Service) -> Iterator[Diagnostic]:
    """Nothing is mounted where something else is already."""
    seen: set[str] = set()
    for kind in ("tmpfs", "volumes"):
        value = service.value.get(kind)
        for number, mount in enumerate(value.data if value is not None else ()):
            target = plain(mount).get("target", "") if kind == "volumes" else str(mount.data).partition(":")[0]
            if target in seen:
                message = f"service '{service.name}' mounts two things at '{target}'"
                yield wrong(mount, message, (*service.path, kind, number))
            seen.add(target)


def _things(service: _Service) -> Iterator[Diagnostic]:
    for mount in service.get("volumes") or ():
        source = mount.get("source")
        if mount.get("type") == "volume" and source and not service.has("volumes", source):
            yield service.problem(f"uses the volume '{source}', which is not there", "volumes")
    for kind in ("configs", "secrets"):
        for mounted in service.get(kind) or ():
            if not service.has(kind, mounted.get("source", "")):
                yield service.problem(f"uses '{mounted.get('source', '')}' of {kind}, which is not there", kind)
    for mounted in service.get("build", "secrets") or ():
        if not service.has("secrets", mounted.get("source", "")):
            yield service.problem(
                f"is built with the secret '{mounted.get('source', '')}', which is not there", "build"
            )
    for name in service.get("models") or ():
        if not service.has("models", name):
            yield service.problem(f"uses the model '{name}', which is not there", "models", name)


def _limits(service: _Service) -> Iterator[Diagnostic]:
    pairs = (
        ("cpus", "limits", "cpus"),
        ("mem_limit", "limits", "memory"),
        ("mem_reservation", "reservations", "memory"),
        ("pids_limit", "limits", "pids"),
    )
    for own, group, other in pairs:
        there = service.get("deploy", "resources", group)
        if service.get(own) and there is not None and there.get(other) != service.get(own):
            yield service.problem(f"has two values for {own}: its own, and deploy.resources.{group}.{other}", own)


def _replicas(service: _Service) -> Iterator[Diagnostic]:
    scale, replicas = service.get("scale"), service.get("deploy", "replicas")
    if scale is not None and replicas is not None and scale != replicas:
        yield service.problem("has two values for how many there are: scale, and deploy.replicas", "scale")
    many = scale if scale is not None else replicas
    if many is not None and many > 1 and service.get("container_name"):
        yield service.problem("has a container_name, which only one container can have", "container_name")


def _watch(service: _Service) -> Iterator[Diagnostic]:
    for watch in service.get("develop", "watch") or ():
        if watch.get("action") not in ("rebuild", "restart") and not watch.get("target"):
            yield service.problem("watches files without a target", "develop", "watch")


_CHECKS: tuple[Callable[[_Service], Iterator[Diagnostic]], ...] = (
    _image, _networks, _health, _dependencies, _targets, _things, _limits, _replicas, _watch
)  # fmt: skip
