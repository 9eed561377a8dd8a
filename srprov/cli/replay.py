"""`srprov replay`: a bundle's trials again, on other robots, and what is the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click
from click.core import ParameterSource
from msgspec.structs import replace

from srprov.cli import inputs, options, output_options
from srprov.cli.compare import MARGINS, STRICT, margins_of, show_comparison
from srprov.cli.execute import refuse_without_terminal
from srprov.cli.output import clean, err
from srprov.cli.seconds import Seconds
from srprov.cli.standing import signers_option
from srprov.cli.trial_session import Manner, check_wanted, run_session, show_report
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.controller.trial_request import TrialsRequest
    from srprov.definitions.model import Inventory
    from srprov.evidence.replay import Replay
    from srprov.evidence.replay_images import Kept
    from srprov.evidence.verified import Bundle
    from srprov.facts.model import Snapshot
    from srprov.session import Pulse


@click.command()
@click.argument("bundle", metavar="BUNDLE", type=click.Path(exists=True, dir_okay=False),
                callback=output_options.no_link_in)  # fmt: skip
@click.option("-i", "--inventory", "inventories", multiple=True, metavar="FILE",
              help="Inventory; may be repeated. Needed without --lab.")  # fmt: skip
@click.option("--lab", is_flag=True, help="On robots of an embedded lab that is brought up for it, and taken down "
              "after it (Linux, root). That it can be done is shown so, not that the numbers hold.")  # fmt: skip
@options.robots_anywhere
@options.locking
@options.planning
@click.option("-o", "--out", "target", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
              callback=output_options.no_link,
              help="A new folder: the bundle's definitions go to DIR/experiment, the run to DIR/run.")  # fmt: skip
@click.option("--map", "pairs", multiple=True, metavar="OLD=NEW",
              help="NEW of the inventory does the part of OLD in the bundle; may be repeated. Others keep their "
              "names.")  # fmt: skip
@click.option("--no-bundled-images", is_flag=True,
              help="Take images by their names, also those that the bundle has.")  # fmt: skip
@click.option("--only", multiple=True, metavar="TRIAL|POINT",
              help="Only this trial, or trials of this point; only these are compared, then.")  # fmt: skip
@click.option("--resume", is_flag=True, help="Go on with the replay in DIR that was cut off.")
@MARGINS
@STRICT
@signers_option("Only a bundle that somebody signed whom this allowed_signers file names.")
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@click.option("--wait-timeout", type=Seconds(min=0), default=300.0, show_default=True, metavar="S",
              help="Seconds for a service that is kept over all trials to become healthy.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def replay(
    bundle: str, inventories: tuple[str, ...], lab: bool, as_json: bool, forks: int, timeout: float,
    request: PlanRequest, unreachable: str, lock_wait: float, stop_timeout: float, pulse: Pulse, target: Path,
    pairs: tuple[str, ...], no_bundled_images: bool, only: tuple[str, ...], resume: bool, margins: tuple[str, ...],
    strict: bool, signers: str | None, yes: bool, wait_timeout: float, events: TextIO | None, no_color: bool,
) -> int:  # fmt: skip
    """Run the trials of a bundle again, on robots of yours, and compare what comes of it.

    The bundle is verified first. The same trials with the same seeds in the same order, services on the robots that
    do the parts of their old ones, with the bundle's images where it has them. What the experiment asks for needs
    --allow, as that of any file of a stranger.
    """
    from srprov.controller.trial_request import TrialsRequest
    from srprov.evidence import replay as evidence
    from srprov.evidence import replay_images

    _refuse(yes=yes, unreachable=unreachable)
    _check_robots(inventories, pairs, lab=lab)
    asked, judged_by = dict(map(_pair, pairs)), margins_of(margins)
    ours = None if lab else inputs.load_inventory(inventories)
    output_options.note(f"verifying {bundle}")
    verified = evidence.check(bundle, signers or "")
    again = evidence.read(verified)
    wanted = TrialsRequest(folder=target / "run", only=only, resume=resume)
    kept = replay_images.bring(verified, output_options.note, wanted=not no_bundled_images)
    request = replace(request, placed=again.placed, bundled=kept.images)
    manner = Manner(
        forks=forks, timeout=timeout, lock_wait=lock_wait, stop_timeout=stop_timeout, wait_timeout=wait_timeout,
        pulse=pulse, events=events, color=not no_color, as_json=as_json, yes=yes,
    )  # fmt: skip
    code = _again(verified, again, kept, ours, asked, request, wanted, manner)
    if code:
        err(f"not compared with {bundle}, as it is not whole; --resume goes on")
        return code
    return show_comparison(
        [bundle], [str(target / "run")], judged_by, strict=strict, as_json=as_json, only=only, verified=[verified]
    )


def _again(
    bundle: Bundle, again: Replay, kept: Kept, ours: Inventory | None, asked: dict[str, str], request: PlanRequest,
    wanted: TrialsRequest, manner: Manner,
) -> int:  # fmt: skip
    """Run the trials; without an inventory of the user's, on a lab. Return the exit code."""
    from srprov.controller.owners import note_brought, note_bundle
    from srprov.controller.source import read_definitions
    from srprov.evidence import replay as evidence

    assert wanted.folder is not None  # the verb names it
    folder = wanted.folder.parent / "experiment"
    if ours is not None:
        evidence.mapped(ours, again.robots, asked)  # before anything is written
    evidence.unpack(bundle, folder, lambda: note_brought(str(folder), bundle.digest))  # also when it is refused below
    definitions = read_definitions(str(folder / again.edf), request.allowed, request.profiles)
    check_wanted(definitions, wanted)
    name, edf = request.instance or definitions.experiment.name, definitions.experiment.file
    note_bundle(name, edf, bundle.digest, str(folder))
    with ExitStack() as stack:
        if ours is None:
            from srprov.cli.replay_lab import lab_for

            ours, asked = stack.enter_context(lab_for(again))

        def robots(snapshot: Snapshot) -> Iterator[tuple[str, Iterable[str]]]:
            yield from told(again, kept, asked, snapshot)

        inventory = evidence.mapped(ours, again.robots, asked)
        report = run_session(definitions, inventory, request, wanted, manner, robots)
    if report.exit_code:
        show_report(report, as_json=False)
    return report.exit_code


def told(
    again: Replay, kept: Kept, asked: dict[str, str], snapshot: Snapshot
) -> Iterator[tuple[str, Iterable[str]]]:  # fmt: skip
    """Yield what is shown with the plan: who does whose part, where each image comes from. What robots say is cleaned.

    Of images it is not: whose they are follows from no secret's value.
    """
    from srprov.evidence import replay as evidence
    from srprov.evidence import replay_images

    yield "Who does whose part", map(clean, evidence.differences(again, asked, snapshot))
    yield "Images", replay_images.in_words(kept, snapshot, again.placed)


def _check_robots(inventories: tuple[str, ...], pairs: tuple[str, ...], *, lab: bool) -> None:
    """Refuse neither robots nor a lab, and both."""
    source = click.get_current_context().get_parameter_source("inventories")
    if lab and (pairs or (inventories and source is not ParameterSource.DEFAULT_MAP)):
        raise UsageError("--lab brings robots of its own", hint="leave --map and --inventory out", code=Code.OPTIONS)
    if not lab and not inventories:
        raise UsageError(
            "nobody says on which robots", hint="name an inventory with -i, or try it with --lab", code=Code.WHICH
        )


def _refuse(*, yes: bool, unreachable: str) -> None:
    """Refuse what cannot be, before anything is read."""
    refuse_without_terminal(yes)
    if unreachable != "fail":
        raise UsageError("trials need all their robots", hint="leave --unreachable out", code=Code.OPTIONS)


def _pair(text: str) -> tuple[str, str]:
    """Read OLD=NEW."""
    old, _, new = text.partition("=")
    if not old or not new:
        raise UsageError(f"--map {text} is none", hint="for example --map robot1=kuka3", code=Code.OPTION_VALUE)
    return old, new
