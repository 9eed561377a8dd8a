"""Whether an instance's overlay works: what robots are asked, what their answers mean, and why something fails.

Takes a placement record, and what robots say; gives values. Pure, but for the programs of its own that it reads.
`execution/probing.py` sends and asks.

    request   whom to ask        script    with which program and words
    answers   what came back     pairs     what that means for each pair
    look      a closer look      causes    why a pair fails
    document  the result as JSON and text
"""
