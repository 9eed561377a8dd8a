"""One line at the bottom of a terminal that says what is going on. Everything else is printed above it.

It never takes more than one row, so nothing that was printed before has to be drawn again. rich is imported here, and
only for a terminal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from srprov.cli.output import clean, printed_by

_REFRESHES_PER_S = 8


@contextmanager
def status_line(status: Callable[[], str], *, color: bool) -> Iterator[None]:
    """Show on standard error what `status` returns, cut to the terminal's width, until the block ends."""
    from rich.console import Console
    from rich.live import Live
    from rich.spinner import Spinner
    from rich.text import Text

    console = Console(stderr=True, no_color=not color)
    spinner = Spinner("dots")

    def line() -> Text:
        frame, words = str(spinner.render(console.get_time())), " ".join(clean(status()).split())
        return Text.assemble((frame, "green"), " ", words, no_wrap=True, overflow="ellipsis")

    def above(text: str, style: str | None) -> None:
        console.print(Text(text, style=style or ""), soft_wrap=True)  # the terminal folds it, as without this line

    live = Live(
        console=console, get_renderable=line, refresh_per_second=_REFRESHES_PER_S, transient=True, redirect_stdout=False
    )
    with live, printed_by(above):
        yield
