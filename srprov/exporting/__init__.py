"""An experiment -> Docker Compose files: the way back, and a twin for a single PC.

Takes definitions, where services run, and functions that read files; gives an `Export`: files, and for each field of
the EDF what became of it. `folder.write` puts it on the disk; nothing else here touches anything. Values of secrets
and of the controller's environment are never read.

    classes             what becomes of each field: the table
    convert             the whole: one Compose file per machine
    services, runtime, mounts, images, reach  the parts of a service
    report, readme      what is said of it
    text, folder        how it is written
"""

from srprov.exporting.convert import export
from srprov.exporting.wanted import Wanted

__all__ = ["Wanted", "export"]
