"""Git repositories of others, on the controller: a name becomes a commit, and a commit its files.

Takes addresses (`git_address`); gives commits and files as values. Runs git, which may reach the network, and keeps
what it fetched in bare repositories below the user's cache folder. Robots have no part in it.

    program     git itself: its environment, its limits, its end
    cache       the bare repositories: resolve, fetch, read
    tree        what a commit holds, and what of it cannot be taken
    head        the commit of a checkout on this machine, which git is not asked for
"""
