"""Robots at other sites: a worker there has their connections, as a Dask cluster finds and reaches it.

Dask carries bytes between two processes of srprov, and decides nothing: `cluster.py` is its client here, `outpost.py`
the actor at the site that starts a process for one run, `carrier.py` the way of the bytes. Everything above them is as
for worker processes of this machine (`workers/`). `serving.py` is what runs at a site all the time, `settings.py` what
is asked of a cluster: TLS.
"""
