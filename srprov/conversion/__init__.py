"""A Compose project, or several, -> an experiment: EDF, CDFs and files, with a report of what became of each key.

Takes normal forms (`importing`); gives a folder that validates, or says at file, line and column why not. Reads the
files that the projects name, below the folders of their files only, and writes the experiment's folder.

    kept, table, table_*       each key of the specification: exact, adapted, dropped or refused, and why
    notes                      what became of each key of one project
    project, experiment        projects on their way -> a draft
    services, fields, mounts, network, names_used, deploy, builds, granted   one service
    folder                     a draft -> the folder, checked
    report, matrix             what was done, and what can be, for people and tools
    robots                     which file is which robot's
"""
