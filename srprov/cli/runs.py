"""`srprov runs`: which runs were recorded on this machine; `runs show`: the steps or the trials of one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from srprov import private
from srprov.cli import options, output_options
from srprov.cli.output import err, out, out_json
from srprov.cli.status import table
from srprov.codes import Code
from srprov.errors import UsageError, did_you_mean, visible

if TYPE_CHECKING:
    from srprov.record.runs import KeptRun, TrialsRun

_SHOWN = ("begun", "verb", "instance", "result", "run")


@click.command()
@click.argument("words", metavar="[DIR | show RUN]", nargs=-1)
@options.RUNS
@options.JSON
@click.option("--svg", metavar="FILE", default=None, callback=output_options.written,
              help="show: draw a number of its trials over a parameter, and over the order.")  # fmt: skip
@click.option("--metric", default="", metavar="NAME", help="--svg: which (default: the first metric, or duration_s).")
@click.option("--over", default="", metavar="PARAMETER", help="--svg: which (default: the first parameter).")
def runs(words: tuple[str, ...], runs: Path | None, as_json: bool, svg: str | None, metric: str, over: str) -> int:
    """List the runs that were recorded here, or those in DIR; no robot is asked.

    That is what `apply`, `build`, `stop`, `start`, `restart`, `images prune` and `destroy` left, and runs of trials,
    also those that are under way.

    `srprov runs show RUN` shows what came of each step of one, or how its trials ended, with their parameters and
    metrics. RUN is a name of the list, or a folder.
    """
    places = homes(runs)
    if words[:1] == ("show",) and len(words) == 2:
        folder = run_folder(words[1], places)
        if svg is not None:
            return _draw(folder, svg, metric, over)
        return _show(folder, as_json)
    if svg is not None:
        raise UsageError("--svg draws the trials of one run", hint="srprov runs show RUN --svg FILE", code=Code.OPTIONS)
    if words[1:] or words[:1] == ("show",):
        raise UsageError(
            "one folder is listed, or one run shown",
            hint="srprov runs [DIR], or srprov runs show RUN; of trials, RUN/trials/TRIAL has logs and results",
            code=Code.OPTIONS,
        )
    if words in (("list",), ("ls",)) and not Path(words[0]).exists():
        words = ()
    found = sorted(_found([Path(words[0])] if words else places), key=lambda one: one.begun)
    if as_json:
        out_json({"runs": [msgspec.to_builtins(one) for one in found]})
    elif found:
        out(table([_line(one, within=not words) for one in found], _SHOWN))
    else:
        out("no runs in " + " and ".join(visible(str(one)) for one in ([words[0]] if words else places)))
    return 0


def homes(runs: Path | None) -> list[Path]:
    """Return the folders where runs are kept unless their user says otherwise."""
    from srprov.record import default_root

    return [runs or default_root(), default_root().parent / "trials"]


def run_folder(name: str, homes: Sequence[Path]) -> Path:
    """Return the folder of the run that a user names, or the file of a plan or bundle.

    Raises:
        UsageError: There is none, or a relative path has a link in it: what is made of it may be published.
    """
    from srprov.definitions import refuse_link

    if "/" not in name:
        for home in homes:
            if (home / name).is_dir() and name not in ("", ".", ".."):
                return home / name
        if not Path(name).exists():
            kept = [one.name for home in homes if home.is_dir() for one in home.iterdir()]
            hint = did_you_mean(name, kept) or "`srprov runs` lists runs"
            raise UsageError(f"there is no run '{visible(name)}', nor a file of that name", hint=hint, code=Code.NO_RUN)
    refuse_link(name)
    return Path(name)


def _found(folders: Sequence[Path]) -> Iterator[KeptRun]:
    """Return runs; say which cannot be read, and go on."""
    from srprov.record.runs import kept_runs

    for folder in folders:
        if len(folders) > 1 and not folder.exists():
            continue
        for one in kept_runs(folder):
            if isinstance(one, UsageError):
                err(f"warning: {one.message}")
            else:
                yield one


def _line(one: KeptRun, *, within: bool) -> dict[str, Any]:
    begun = one.begun[:19] + "Z" * bool(one.begun)
    return {**msgspec.to_builtins(one), "begun": begun, "result": _result(one), "run": one.run if within else one.path}


def _result(one: KeptRun) -> str:
    """Return how a run ended, in words."""
    if one.trials is not None:
        return f"{one.done} of {one.trials} trials count" + ("" if one.ended else "; not ended")
    if not one.ended:
        return "not ended"
    return f"{one.changed} changed" + (f", {one.failed} failed or not done" if one.failed else "")


def _show(folder: Path, as_json: bool) -> int:
    from srprov.record.runs import is_trials, kept_run, trials_run

    if not is_trials(folder):
        one = kept_run(folder)
        if as_json:
            out_json(msgspec.to_builtins(one))
        else:
            out(table([_line(one, within=False)], _SHOWN))
            _show_steps(folder)
        return 0
    found = trials_run(folder)
    if as_json:
        out_json(found.document)
        return 0
    out(_trials(found))
    err(f"{found.done} of {found.trials} trials count")
    if (folder / "trials").is_dir():
        err(f"{visible(str(folder / 'trials'))}/TRIAL has the logs and results of each")
    if found.ended_early:
        err(f"it is not complete: {visible(found.ended_early)}")
    return 0


def _show_steps(folder: Path) -> None:
    """Say what came of each step, and why where it was not done; and which file says what was to be done."""
    from srprov.record.runs import kept_steps

    steps = kept_steps(folder)
    for one in steps:
        first, *more = one["message"].splitlines() or [""]
        why = f": {visible(first)}" if first else ""
        out("\n" * (one is steps[0]) + f"{visible(one['outcome'])}: {visible(one['id'])}{why}")
        for line in more:
            out(f"  {visible(line.removeprefix('  '))}")
    if (folder / "plan.txt").is_file():
        err(f"{visible(str(folder / 'plan.txt'))} has what each step was to change, and its commands")


def _trials(found: TrialsRun) -> str:
    """Return a row for each attempt: parameters and metrics by their own names, and why where it does not count."""
    names = list(dict.fromkeys(name for row in found.rows for name in row if name.startswith(("p_", "m_"))))
    names.sort(key=lambda name: not name.startswith("p_"))
    first = ("order", "trial", "attempt", "status", "verdict", "duration_s")
    rows = [{**dict.fromkeys((*first, *names, "why"), ""), **_cells(row)} for row in found.rows]
    return table(rows, (*first, *names, "why"))


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    from srprov.trials.judge import COUNTED

    def cell(value: object) -> object:
        return f"{value:.6g}" if isinstance(value, float) else "" if value is None else value

    return {
        **{key: cell(value) for key, value in row.items()},
        "why": "" if row["status"] in COUNTED else row["reason"],
    }


def _draw(folder: Path, target: str, metric: str, over: str) -> int:
    """Draw the attempts that count, each value and the means."""
    from srprov.record.runs import trials_run
    from srprov.report.plot import draw
    from srprov.trials.judge import COUNTED

    rows = [row for row in trials_run(folder).rows if row["status"] in COUNTED]
    first = {
        begin: next((name for row in rows for name in row if name.startswith(begin)), "") for begin in ("m_", "p_")
    }
    known = {name for row in rows for name in row}
    number = (f"m_{metric}" if f"m_{metric}" in known else metric) if metric else first["m_"] or "duration_s"
    text = draw(rows, number, f"p_{over}" if over else first["p_"])
    try:
        private.write_output(target, text.encode())
    except OSError as error:
        raise UsageError(
            f"cannot write {target}: {error.strerror}", hint="name another file with --svg", code=Code.CANNOT_WRITE
        ) from None
    return 0
