"""What a plan file asks for, by its values: a plan file is data, never authority.

Takes what was read from one. Its permissions are those that its resources need, said by the function that says it for
an EDF; what srprov's own playbooks could not state needs the permission `playbook`. Commands, removals, needs and order
are derived again in `controller.saved`, from the robots as they are. Touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.image_claim import is_own_image, misnamed
from srprov.controller.overlay_claim import astray, had_twice, record_text, too_many, underlays_of, wrong_link
from srprov.controller.placement_claim import PlacementClaim, misplaced, unrecorded
from srprov.controller.robot_files import is_record_path
from srprov.controller.stated import (
    definition_of,
    led_elsewhere,
    of_the_controller,
    pulled_for_nobody,
    sent_for_nobody,
    unstated,
)
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.dockerfile import unclear
from srprov.definitions.model import Experiment, NetworkSettings, Service
from srprov.definitions.secretmodel import SecretSource
from srprov.errors import RefusedError, UsageError
from srprov.facts.model import HostFacts
from srprov.image_reference import BUILT
from srprov.modules import MODULES, PROBING
from srprov.modules.dataset import DataParams
from srprov.modules.file import FileParams
from srprov.modules.image import ImageParams
from srprov.modules.module import Names, canonical
from srprov.modules.network import NetworkParams
from srprov.modules.secret import names_of
from srprov.modules.unit import UnitParams
from srprov.modules.vxlan import VxlanParams
from srprov.modules.vxlan_filter import VxlanFilterParams
from srprov.network.identity import link_names, network_name, tunnel_name
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile
from srprov.planning.planread import named
from srprov.planning.policy import Permission, fetch, permissions
from srprov.record.memory import built_for
from srprov.resource import Resource

_SHOWN = 200
"""Characters of what a resource says that are shown with a permission."""


def check_file(saved: PlanFile, file: str) -> None:
    """Refuse a plan file that claims what its own values do not say.

    Raises:
        UsageError: With all of it.
    """
    if wrong := list(too_many(wants_of(saved))) or list(_wrong(saved)):
        hint = "somebody changed it, or another version of srprov made it: plan again"
        raise UsageError(f"{file} contradicts itself:\n{named(wrong)}", hint=hint, code=Code.PLAN_CHANGED)


def asked(saved: PlanFile) -> tuple[Permission, ...]:
    """Return the permissions that a plan's resources need, whatever its file says of them."""
    plan = saved.plan
    steps = [step.want for step in plan.steps if step.want]
    builds = _builds(saved)
    placed = [(want.host, _of_edf(one, builds)) for want, one in services_of(saved)]
    services = [*(one for _, one in placed), *pulled_for_nobody(wants_of(saved), placed)]
    used = {use.source for service in services for use in service.secrets}
    sources = {name: SecretSource(name=name) for name in used | names_of(steps)}
    sources |= {source.name: source for source in plan.secrets}
    by_place = {str(place): service for place, service in enumerate(services)}
    whole = Experiment(name=plan.instance, file="", folder="", services=by_place, secrets=sources)
    reach = [one for network in _networks(saved) for one in permissions(replace(whole, services={}, network=network))]
    unused = [sources[name] for name in sent_for_nobody(steps, placed)]
    names = _names(saved)
    contexts = {tag: saved.contexts[tag] for tag in builds.keys() & {service.cdf for service in services}}
    built = {(one.host, one.name) for one in steps if one.module == "image" and one.params.source == "build"}
    claim = PlacementClaim(plan, names, wants_of(saved), underlays_of(saved))
    # of what is right already, only checks are asked on the robots
    strange = [want for want in steps if not _is_own(want, names, plan, contexts, built, claim)]
    strange += [want for want in saved.also_wanted if want.module in PROBING]
    wants = wants_of(saved)
    more = (*astray(steps, wants, underlays_of(saved)), *unstated(wants), *unrecorded(wants))
    strange += [want for want in more if want not in strange]
    return (
        *permissions(whole, builds),
        *reach,
        *(Permission(kind=one.kind, service="", what=f"{one.name}, from {one.origin}") for one in unused),
        *of_the_controller(steps),
        *sorted({fetch(url) for want in wants_of(saved) if (url := _url(want))}, key=lambda one: one.what),
        *(Permission(kind="playbook", service=want.id, what=_shown(want)) for want in strange),
    )


def wants_of(saved: PlanFile) -> tuple[Resource, ...]:
    """Return all that a plan wants, what is right already too."""
    return (*(step.want for step in saved.plan.steps if step.want), *saved.also_wanted)


def _url(want: Resource) -> str:
    return want.params.url if isinstance(want.params, DataParams) else ""


def services_of(saved: PlanFile) -> Iterator[tuple[Resource, Service]]:
    """Return every resource that an EDF states as a service or a part of one, with that."""
    for want in wants_of(saved):
        if service := MODULES[want.module].service_of(want.name, want.params):
            yield want, service


def _networks(saved: PlanFile) -> set[NetworkSettings]:
    """Return the overlays that a plan makes, as EDFs would ask for them."""
    every = [want.params for want in wants_of(saved)]
    made = {
        NetworkSettings(subnet=one.subnet, vni=one.vni, port=one.port)
        for one in every
        if isinstance(one, NetworkParams)
    }
    return made | {NetworkSettings(persist=True) for one in every if isinstance(one, UnitParams)}


def _builds(saved: PlanFile) -> dict[str, ContainerDefinition]:
    """Return tag -> what is known of its CDF, of the images whose build context is in the file, and has this tag.

    A tag is believed by name: whoever has no context for one may run an image of somebody else.
    """
    if not saved.contexts:
        return {}
    from srprov.images.tag import read_context

    found = {}
    for name, context in saved.contexts.items():
        tag, text = read_context(context)
        if tag and unclear(text) is None and name.startswith(BUILT) and name.rpartition(":")[2] == tag:
            found[name] = definition_of(name, text)
    return found


def _of_edf(service: Service, builds: Mapping[str, ContainerDefinition]) -> Service:
    """Return a service as an EDF states it: with the CDF, where its image is built."""
    return replace(service, image="", cdf=service.image) if service.image in builds else service


def _names(saved: PlanFile) -> Names:
    bridge, link = link_names(saved.plan.instance)
    return Names(
        instance=saved.plan.instance,
        source=saved.plan.source,
        bridge=bridge,
        link=link,
        network=network_name(saved.plan.instance),
        tunnel=tunnel_name(saved.plan.instance),
        vteps=frozenset(filter(None, underlays_of(saved).values())),
    )


def check_copies(saved: PlanFile, known: Mapping[str, Collection[str]], facts: Mapping[str, HostFacts]) -> None:
    """Refuse copies of images that no run of this machine had built, in a plan that was not written here.

    Args:
        saved: The plan.
        known: What `built_for` says of a tag -> ids of images that this machine had built under it.
        facts: The robots as they are, which say what they run; the plan could say anything.

    Raises:
        RefusedError: Names them.
    """
    images = [step.want for step in saved.plan.steps if step.want and isinstance(step.want.params, ImageParams)]
    archs = {one.host: facts[one.host].arch if one.host in facts else "" for one in images}
    strange = {
        one.name
        for one in images
        if one.params.id and one.params.id not in known.get(built_for(one.name, archs[one.host]), ())
    }
    if strange:
        raise RefusedError(
            f"only this plan, which was not written here, says that {', '.join(sorted(strange))} on a robot is the "
            "image that was built under this tag",
            hint="plan its EDF here",
            code=Code.STRANGE_PLAN,
        )


def _is_own(
    want: Resource, names: Names, plan: Plan, contexts: Mapping[str, bytes], built: Collection[tuple[str, str]],
    claim: PlacementClaim,
) -> bool:  # fmt: skip
    """Return whether srprov's own playbooks could state a resource for this placement.

    `contexts` are those of its images, `built` the (robot, image) that the plan builds.
    """
    if isinstance(want.params, ImageParams) and want.params.source in ("build", "copy"):
        return want.name in contexts and is_own_image(want.params, want.name, contexts[want.name], built)
    is_file = isinstance(want.params, FileParams) and is_record_path(want.name)
    if is_file and not claim.is_record(record_text(want.params)):
        return False
    at_home = want.service == "" or plan.assignment.get(want.service) == want.host
    return at_home and MODULES[want.module].is_own(want.name, want.params, names)


def _shown(want: Resource) -> str:
    text = canonical(want.written)
    return f"states, as root: {text if len(text) <= _SHOWN else text[: _SHOWN - 1] + '…'}"


def _wrong(saved: PlanFile) -> Iterator[str]:
    """Say what in a file contradicts the rest of it."""
    plan = saved.plan
    relied = {*(step.host for step in plan.steps), *(one.host for one in saved.also_wanted)}
    placed = set(plan.assignment.values())
    taken = ((one, MODULES[one.module].taken_from(one.params)) for one in wants_of(saved))
    copies = {(want.name, source, want.host) for want, source in taken if source}
    relied |= {source for _, source, _ in copies}
    for host in sorted((relied | (placed - plan.unreachable.keys())) - saved.fingerprints.keys()):
        yield f"fingerprints: {host} has none, and the plan relies on it"
    if copies != {(move.volume, move.source, move.target) for move in plan.data if move.how == "move"}:
        yield "data: what is copied is not what is said there"
    waits = {need.id for step in plan.steps for need in step.waits}
    for needed in sorted(waits | {need.id for want in wants_of(saved) for need in want.needs}):
        if needed.partition("/")[0] not in saved.fingerprints.keys() | plan.unreachable.keys():
            yield f"{needed}: something waits for it, and the plan knows no such robot"
    sources = {source.name for source in plan.secrets}
    written = names_of(step.want for step in plan.steps if step.want)
    for name in sorted(written | {use.source for _, one in services_of(saved) for use in one.secrets}):
        if name not in sources:
            yield f"secrets: nothing says where '{name}' comes from"
    overlays = {one.host: one.params for one in wants_of(saved) if isinstance(one.params, NetworkParams)}
    for want in wants_of(saved):
        if isinstance(want.params, VxlanParams | VxlanFilterParams):
            yield from wrong_link(want, want.params, [overlays[want.host]] if want.host in overlays else [])
    yield from misnamed(wants_of(saved))
    yield from had_twice(wants_of(saved))
    yield from misplaced(plan, wants_of(saved))
    yield from led_elsewhere(wants_of(saved))
    listed = set(plan.permissions)
    for one in asked(saved):
        if one not in listed:
            yield f"permissions: {one.service} asks for {one.kind} ({one.what}), which is not among them"
