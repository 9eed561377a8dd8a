"""What others wrote for other tools -> experiments: at present Docker Compose files.

Takes files of strangers; gives values, and the files of an experiment. Reads files inside of the folders that the user
named, and nothing of the environment.

    position  where something was written
    normal    a Compose project, merged, interpolated and in long forms, each value with its place
    read      Compose files -> that project, or all that Compose or srprov refuses
"""
