"""YAML documents as values that know their place: the one reader for every YAML file that users write.

Takes a path or text; gives nodes with file, line and column, or `DefinitionError`. Touches files, for reading.

    loader   YAML text -> nodes, within limits of size, depth and count
    syntax   why a text is no YAML, in words
    nodes    the value tree, what a scalar may mean, and `Findings`
    fields   typed fields of a document that has no JSON Schema
    writer   values -> YAML text
    canonical  a document in one form, with its comments: written (values), layout (text -> how it is written), form
"""
