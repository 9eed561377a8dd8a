"""The documentation as a site: `python -m tools.site`, or `make docs`.

    pages.py     which page stands where in the navigation
    stage.py     the repository's own Markdown files, copied as they lie, with links that a site can follow
    verbs.py     a page for each verb, from click
    fields.py    a page for each file format and each JSON document, from the schemas
    markup.py    text -> Markdown that shows exactly it
    conf.py      Sphinx's settings

Nothing of the site is written by hand: whoever changes a page, an option or a schema changes the site. Pages ask no
other host for anything.
"""
