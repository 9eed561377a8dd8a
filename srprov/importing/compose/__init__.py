"""Compose's own rules, one file each; `srprov.importing.read` puts them together in Compose's order.

values      the tree that all of them pass on: data, with the place where each was written
scalars     words of YAML -> numbers, booleans, text, as Compose's YAML library reads and prints them
source      files -> trees; what may be read
variables   `$VAR`, `${VAR:-default}` and their like
dotenv      files of variables
casts       text that a variable gave -> the number or boolean that its place wants
merge       one file over another, a service over the one that it extends
unique      which entries of a list stand for the same thing
extends     services that begin as others
include     files that bring a project of their own
shapes      which keys and which kinds of values there are
check       a tree against the shapes
forms       short forms -> long forms
volumes, ports, words, amounts
            short forms of one field each: mounts, ports, commands, durations and sizes
finish      names and dependencies that are implied, profiles, what refers to nothing
printing    the tree -> what Compose prints
"""
