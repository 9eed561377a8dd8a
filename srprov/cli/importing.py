"""`srprov import`: experiments from what was written for other tools; no robot is asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import click

from srprov import names
from srprov.cli.codes import USAGE
from srprov.cli.output import counted, err, out, out_json
from srprov.cli.output_options import no_link
from srprov.codes import Code
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.conversion.experiment import Draft

_F = TypeVar("_F", bound=Callable[..., Any])
_FILES = click.Path(exists=True, dir_okay=False)


def _settings(_context: click.Context, _option: click.Parameter, given: Sequence[str]) -> dict[str, str]:
    """Read each NAME=VALUE."""
    for one in given:
        if not one.partition("=")[0] or "=" not in one:
            raise UsageError(f"--set {one[:60]}: is not NAME=VALUE", code=Code.OPTION_VALUE)
    return {name: value for name, _, value in (one.partition("=") for one in given)}


def _home(_context: click.Context, _option: click.Parameter, name: str) -> str:
    return names.checked("user", name, hint="it is the user that srprov or the lab has on the robots")


def _name(_context: click.Context, _option: click.Parameter, name: str) -> str:
    return names.checked("instance", name, hint="name it as an EDF would, e.g. --name trial-2") if name else ""


def _common(command: _F) -> _F:
    """Add what both kinds of files take."""
    options = (
        click.argument("files", nargs=-1, required=True, metavar="FILES...", type=_FILES),
        click.option("--set", "settings", multiple=True, metavar="VAR=VALUE", callback=_settings,
                     help="Value of a variable; wins over files. May be repeated."),
        click.option("--name", default="", metavar="NAME", callback=_name, help="Name of the experiment."),
        click.option("--strict", is_flag=True, help="Fail when a key would be dropped."),
        click.option("--format", "form", type=click.Choice(["text", "markdown", "json", "sarif"]), default="text",
                     show_default=True, help="How the report is shown."),
        click.option("-o", "--out", "target", required=True, metavar="DIR", callback=no_link,
                     help="New or empty folder to write."),
    )  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


@click.group(name="import")
def importing() -> None:
    """Make an experiment of files that were written for other tools; no robot is asked."""


@importing.command(short_help="Make an experiment of Docker Compose files.")
@_common
@click.option(
    "--profile", "profiles", multiple=True, metavar="NAME",
    help="Take services with this profile, and those without any; may be repeated. Default: all, with their profiles.",
)  # fmt: skip
@click.option(
    "--env-file", "env_files", multiple=True, metavar="FILE", type=_FILES,
    help="Variables for ${…} in the files (default: .env beside the first). May be repeated.",
)  # fmt: skip
@click.option(
    "--robot-map", default="", metavar="FILE", help="YAML map of files to robots: each file is what one robot runs."
)
@click.option(
    "--home", default="robot", show_default=True, metavar="USER", callback=_home,
    help="User of the robots whose home ~ in the files is.",
)  # fmt: skip
@click.option(
    "--root", metavar="DIR", type=click.Path(exists=True, file_okay=False),
    help="Folder of the whole project, your own: files may lie anywhere in it, and name what lies there. Default: "
    "that of the files, which lie in one.",
)  # fmt: skip
def compose(
    files: tuple[str, ...], settings: dict[str, str], name: str, strict: bool, form: str, target: str,
    profiles: tuple[str, ...], env_files: tuple[str, ...], robot_map: str, home: str, root: str | None,
) -> int:  # fmt: skip
    """Make an experiment of Docker Compose files, and say what became of each key that it does not keep as it is.

    Several files are merged as Compose merges them; with --robot-map each robot's files are merged by themselves.
    Variables come from --set, env files and defaults in the files, never from the environment.
    """
    from srprov import secret_files
    from srprov.conversion.compose import Wanted, draft

    wanted = Wanted(
        files=files, folder=target, profiles=profiles, env_files=env_files, settings=settings, robot_map=robot_map,
        name=name, home=home, root=root or "", own=secret_files.known(),
    )  # fmt: skip
    return _shown(lambda: draft(wanted), files, target, form, strict=strict)


@importing.command(short_help="Make an experiment of a definition of SwarmRob's, and its Dockerfiles.")
@_common
def swarmrob(
    files: tuple[str, ...], settings: dict[str, str], name: str, strict: bool, form: str, target: str
) -> int:  # fmt: skip
    """Make an experiment of one of SwarmRob's definitions (EDF), and of the Dockerfiles that are its CDFs.

    A service whose image is called like the folder of a Dockerfile is built by it. Variables in values come from --set.
    """
    from srprov import secret_files
    from srprov.conversion.swarmrob import draft

    return _shown(
        lambda: draft(files, target, settings, name, secret_files.known()), files, target, form, strict=strict
    )


def _shown(make: Callable[[], Draft], files: Sequence[str], target: str, form: str, *, strict: bool) -> int:
    """Make a draft, write it unless something is refused, and show the report in the form that was asked for."""
    from srprov.conversion import report
    from srprov.conversion.folder import check_target
    from srprov.importing.normal import Refused

    check_target(target)
    try:
        return _finished(make(), files, target, form, strict=strict)
    except Refused as error:
        if form == "json":
            out_json(report.refusal(error.problems))
        elif form == "sarif":
            out(report.as_sarif(report.of_problems(error.problems)))
        raise


def _finished(draft: Draft, files: Sequence[str], target: str, form: str, *, strict: bool) -> int:
    """Write what was made unless something is refused, and show the report."""
    from srprov.conversion import report
    from srprov.conversion.folder import EDF, REPORT, write
    from srprov.conversion.kept import Kept

    dropped = [one for one in draft.findings if one.kept is Kept.DROPPED]
    refused = bool(draft.refused) or (strict and bool(dropped))
    if not refused:
        write(draft, target, files)
    if form == "json":
        out_json(report.as_document(draft, "" if refused else target, sorted(draft.edf["services"])))
    elif form == "text":
        out(report.as_text(draft))
    else:
        out(report.as_sarif(report.told(draft), draft.notes) if form == "sarif" else report.as_markdown(draft, files))
    if refused:
        what = f"{len(draft.refused)} refused" if draft.refused else f"{len(dropped)} dropped, and --strict"
        err(f"error[{Code.NOT_TRANSLATED}]: nothing was written: {what}")
        return USAGE
    (out if form == "text" else err)(
        f"{target}/{EDF}: {counted(len(draft.edf['services']), 'service')}; see {target}/{REPORT}"
    )
    return 0
