"""A run of trials as one file that strangers can check: `bundle` makes it, `verify` looks at it without a network.

Takes the folder of a run, or a bundle; gives a bundle, or findings. Pure but for files: no robot is asked, and nothing
that a bundle holds is run.

    stored_zip     the archive: stored entries, equal bytes for equal contents
    files          what is in a folder or in an archive, read within limits
    session        one session of a run, from its record
    story          a run, from all of its files
    private_words  addresses, hosts and users of the lab, and what stands for them
    public_words   what no robot's name for itself takes the place of
    secrets        what must not leave the house
    crate          what there is, as an RO-Crate says it; crate_*: its parts
    papers         README
    citation       CITATION.cff and LICENSE
    deposits       what archives ask for
    checklist      what reviewers ask, and what a bundle shows of it
    descriptions   all of these, and by which rules they are written
    make           the folder of a run -> a bundle
    checks_*       each check of `verify`, one file for each part of what is compared
    verify         a bundle -> findings
"""
