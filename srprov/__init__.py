"""srprov: an agentless, declarative provisioner for multi-robot experiments.

User files and robots are read into values, values become a plan, the plan is executed, everything is recorded. The
rooms stand in that order; `tests/test_rooms.py` holds them to it:

    cli/          one small file per verb; the only room that prints, asks the user or exits
    controller/   the flow; the only room that knows the order of the others
    yamldoc/      YAML text -> values that know file, line and column; the one reader
    definitions/  user files -> Inventory, Experiment (EDF), ContainerDefinition (CDF)
    transport/    SSH, the engine over the same connection, and the controller itself; the only room with sockets
    facts/        robots -> HostFacts and everything of ours that exists there
    assignment/   who runs what; pure
    network/      VNI, subnet, addresses, FDB, hosts file; pure
    git/          repositories of others, on the controller: names -> commits -> files
    snapshot/     robots that were set up by hand -> an experiment: questions and parsers; pure
    images/       CDF -> Dockerfile, build context and content tag; pure
    rendering/    playbook and context -> Resources; pure
    modules/      one file per kind of resource: queries, parse, check, commands; pure
    planning/     desired and found -> Plan, as text and as JSON; pure
    execution/    Plan and sessions -> RunResult; the only room that changes robots
    trials/       which trials there are, and what came of them; pure
    record/       the folder on the controller that keeps a run: inputs, facts, plan, events, result
    importing/    files of other tools, such as Docker Compose's -> values that know their place
    conversion/   those values -> the folder of an experiment, and what became of each key
    exporting/    an experiment -> files for other tools, such as Docker Compose
    oci/          images as files: an OCI layout, and the packages in its layers; pure
    evidence/     a run of trials as one file, and whether such a file is true
    explaining/   the code of an error -> what it means, with examples
    report/       a run, a plan or a bundle as one HTML page
    lab/          the embedded lab: robots on this machine

Beside them stand values that rooms share: wire.py, session.py, resource.py, errors.py, codes.py, names.py, private.py,
secret.py, untrusted.py, robot_answers.py, plain_tar.py, sizes.py, git_address.py, pace.py.
docs/architecture.md has the flow as a picture, and a glossary.
"""

__version__ = "0.1.0"
