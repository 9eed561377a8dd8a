"""Containers and images of a plan file that no EDF leads to: what else of the plan would have to be there. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.dockerfile import fetches, images_of
from srprov.definitions.model import Service
from srprov.definitions.nested import nested
from srprov.modules.container_form import service_of, stands_on
from srprov.modules.container_params import ContainerParams
from srprov.modules.differences import ELSEWHERE
from srprov.modules.image import ImageParams
from srprov.modules.secret import SecretParams
from srprov.planning.policy import Permission
from srprov.resource import Condition, Resource, resource_id


def unstated(wants: Collection[Resource]) -> Iterator[Resource]:
    """Yield the containers that mount what srprov keeps on their robot, and do not need what of the plan states that.

    Whoever only names a data set's hash would get what the robot has for others; and so would a container that does not
    need what states it, which is made also where that fails, or is left out.
    """
    stated = {one.id for one in wants}
    for one in wants:
        if isinstance(one.params, ContainerParams):
            mounted = {resource_id(one.host, kind, name) for kind, name in stands_on(one.params)}
            needed = {need.id for need in one.needs if need.condition == Condition.PRESENT.value}
            if not mounted <= stated & needed:
                yield one


def led_elsewhere(wants: Collection[Resource]) -> Iterator[str]:
    """Say which mounts another container of the same robot may lead elsewhere, by a volume that both have.

    `validate` refuses such an EDF. Replicas have volumes of their own, and those of `per_robot` are on robots apart.
    """
    services: dict[str, dict[str, Service]] = {}
    for one in wants:
        if isinstance(one.params, ContainerParams):
            services.setdefault(one.host, {})[one.id] = service_of(one.params)
    for some in services.values():
        yield from (one.words for one in nested(some))


def definition_of(name: str, dockerfile: str) -> ContainerDefinition:
    """Return a CDF as far as the Dockerfile of its image tells it: what its build takes and fetches."""
    taken, fetched = images_of(dockerfile), fetches(dockerfile)
    return ContainerDefinition(name=name, file="", folder="", images=taken, fetches=fetched)


def pulled_for_nobody(wants: Collection[Resource], placed: Collection[tuple[str, Service]]) -> Iterator[Service]:
    """Yield a service for each image that is pulled where no container of the plan runs it: to pull it is to ask.

    The robot's engine asks whom the name says; and who pulls an image under the tag of a build gives it to its service.
    `placed` are robots and what runs there.
    """
    images = (one for one in wants if isinstance(one.params, ImageParams) and one.params.source == "pull")
    pulled = {(one.host, one.name) for one in images} - {(robot, one.image) for robot, one in placed}
    for name in sorted({name for _, name in pulled}):
        yield Service(name="other images", image=name)


def sent_for_nobody(wants: Collection[Resource], placed: Collection[tuple[str, Service]]) -> list[str]:
    """Return the secrets that go to a robot where no container of the plan has them."""
    sent = {(one.host, one.params.name) for one in wants if isinstance(one.params, SecretParams)}
    return sorted({name for _, name in sent - {(robot, use.source) for robot, one in placed for use in one.secrets}})


def of_the_controller(steps: Sequence[Resource]) -> Iterator[Permission]:
    """Yield what it takes that containers have values of the controller's environment, or files from elsewhere.

    What they are said to have of these, later plans and records hide.
    """
    for want in steps:
        for name in want.params.taken if isinstance(want.params, ContainerParams) else ():
            if name == ELSEWHERE:
                yield Permission(kind="outside", service=want.params.service, what="files from elsewhere")
            else:
                what = f"{name}, from the controller's environment"
                yield Permission(kind="env", service=want.params.service, what=what)
