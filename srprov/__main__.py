"""`python -m srprov`."""

from srprov.cli.main import entry

entry()
