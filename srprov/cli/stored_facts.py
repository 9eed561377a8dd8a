"""Facts from a file: what `facts --json` wrote, or the facts.json of a run's record."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click
from msgspec.structs import replace

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.definitions.model import Inventory
    from srprov.facts.model import Snapshot

FACTS = click.option(
    "--facts",
    "stored",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Decide from what `facts --json` wrote, or again as the run whose facts.json it is; no robot is asked.",
)


def stored_facts(path: Path, inventory: Inventory) -> tuple[Snapshot, object]:
    """Read facts from a file, and of a run's record what else led to its decision.

    Robots of the inventory that it does not have count as out of reach. What facts say of robots stands in plans and
    exports, so a link of a project does not lead to those of another lab.

    Raises:
        UsageError: It holds no facts, is reached by a link that leads out of its folder, or has a further name.
    """
    from srprov.cli.facts_ranges import check_ranges
    from srprov.definitions import refuse_link_out
    from srprov.facts.host import with_inventory
    from srprov.facts.stored import read_document
    from srprov.untrusted import parse_json

    refuse_link_out(str(path), "--facts ")
    try:
        content, about = regular_file.read_with_status(path)
        if about.st_nlink > 1 and not path.is_absolute():  # an archive may have given it this one
            hint = f"if you mean it, name its whole path: --facts {quote(str(path.absolute()))}"
            raise UsageError(f"{path} has another name (a hard link)", hint=hint, code=Code.STRANGE_FILE)
        document = parse_json(content.decode())
        found = read_document(document)
        check_ranges(document["robots"])
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise UsageError(
            f"{path}: {why}", hint="give a file that `srprov facts --json` wrote", code=Code.FACTS_FILE
        ) from error
    hosts = inventory.hosts
    facts = {name: with_inventory(hosts[name], one) for name, one in found.facts.items() if name in hosts}
    away = {
        name: found.unreachable.get(name, "not in the stored facts") for name in inventory.hosts if name not in facts
    }
    stored = replace(found, facts=facts, observed={name: () for name in facts}, unreachable=away)
    return stored, document.get("decided")
