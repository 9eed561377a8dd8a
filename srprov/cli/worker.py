"""`srprov worker`: what runs at a site all the time, so that its robots can be reached from elsewhere."""

from __future__ import annotations

import click

from srprov import names
from srprov.cli.output import catch_logs, err


@click.command()
@click.option("--site", required=True, metavar="NAME", help="The site, as inventories call it: srprov_site.")
@click.option("--engine", required=True, metavar="tls://HOST:PORT", help="Scheduler of the Dask cluster.")
@click.option(
    "--host", default="", metavar="ADDRESS",
    help="Address of this machine that is listened on and that others reach [default: the one towards the scheduler]",
)  # fmt: skip
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port for it [default: the system's choice]"
)
def worker(site: str, engine: str, host: str, port: int) -> int:
    """Serve the robots of a site, until Ctrl-C, to experiments that are run elsewhere with --engine.

    Robots are reached from here as this user reaches them: with the keys, known hosts and ssh configuration of this
    machine. Certificates are those of Dask's configuration: whoever has one of the same authority can run programs
    here.
    """
    from srprov.transport.sites.serving import Serving, serve

    names.checked("site", site)
    catch_logs()
    serve(
        Serving(site=site, scheduler=engine, host=host, port=port),
        lambda address: err(f"site {site}: serving at {address}; Ctrl-C ends it"),
    )
    return 0
