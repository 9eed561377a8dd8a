"""Compose's own rules, one file each; `project` and `srprov.importing.read` put them together in Compose's order.

Trees go through all of them; none changes a tree, each makes a new one.

    values      the tree: data, with the place where each was written
    scalars     words of YAML -> numbers, booleans, text, as Compose's YAML library reads and prints them
    source      files -> trees; what may be read
    resets      `!reset` and `!override`
    variables   `$VAR`, `${VAR:-default}` and their like
    dotenv      files of variables; envfiles, service_env: those of a project and of a service
    casts       text that a variable gave -> the number or boolean that its place wants
    loading     what all files of a project share while they are read
    extends     services that begin as others
    include     files that bring a project of their own
    paths       paths of other folders -> paths of the project's
    merge       one file over another, a service over the one that it extends
    unique      which entries of a list stand for the same thing
    shapes      which keys and which kinds of values there are; shapes_more: those beside services
    check       a tree against the shapes
    forms       short forms -> long forms; volumes, ports: those of one field
    defaults    what Compose puts in where a key is left out
    project     all of this for all files
    finish      names and dependencies that are implied, profiles, what nothing uses
    consistency what services refer to
    words       a command -> its words; amounts: durations and sizes
    printers    one value -> what Compose prints of it
    printing    the tree -> what Compose prints of it
    notes       what Compose does that one would not guess
"""
