"""A robot that was set up by hand -> an experiment: its containers as services, the host itself as a CDF.

Takes what robots say to questions that only read; gives values, and the texts of files. Pure: the questions are text.
What a robot says is untrusted: lengths and counts are bounded, and what cannot be kept becomes a note, never an error.

    notes         what could not be taken over as it is, in words
    suspicion     what looks like a secret, and texts without it
    hider         texts without the values that became secrets
    questions     what every robot is asked first
    gitscript     what is asked of its repositories, with no way to start a program
    debian        packages: installed by hand, and what else an image needs to have the same ones
    sources       where apt fetches packages that are not the distribution's
    python        what pip installed
    repositories  git: commits, remotes, patches
    mounts, settings, containers    one container -> one service
    host          one robot's answers -> its CDF and the files that it takes
    folder        robots -> the files of the experiment
    yamltext      values -> YAML
    report        what was found and what was not, as text and as JSON
"""
