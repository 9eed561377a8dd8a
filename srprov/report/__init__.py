"""A run, a plan or a bundle as one HTML page: a file that needs no network and runs nothing.

Takes the files of a record (`read`, `trials_read`), which may be anybody's; gives a page as text. All but the reading
is pure: values in, text out, and equal records give equal bytes.

    read         the record of a run, and a plan file, as Material      trials_read   a run of trials, and a bundle
    model        the files of a record as values                        material      all that one page is made of
    html         markup, made and escaped in one place                  style         how pages look
    words        numbers, sizes, names                                  parts         tables, folds, lists
    timeline     when robots acted and waited                           spans         stretches of time
    head, placement, changes, lanes, probe, trials, plot, rest          the sections
    embed        the data inside a page, put in and taken out           page          a page
"""
