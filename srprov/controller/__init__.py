"""The flow: the only room that knows the order of the others.

Takes what the user asked for (`PlanRequest`), definitions, and the questions that a connected `Fleet` has begun to
ask; gives a `Planned`, then a `RunReport`. Prints nothing and asks the user nothing. A dry run is not a flag: it is not
calling `run`.

    request      what the user asks for beside the files      fleet        the robots and the sessions with them
    plan         make_plan: a straight list of calls           choice       what is left to decide after the first look
    source       an EDF, or a plan from a file                 saved        plans in files
    remove       make_removal                                  render_inputs  what contexts are made of
    run          lock, do, record, report                      report       a run as JSON and as lines
    permissions  what the user must allow                      secrets      their values
    ownership    what robots say of an instance                robot_images a robot's images in a context
    context      what playbooks are rendered with              services     a service in it
    phases       the clock of a run
    status       what of an instance runs where                waiting      for another run of the instance
    history      earlier runs, for fairness                    playbooks    srprov's own, and the user's

Importing this package imports none of these: the robots are dialled before planning is imported.
"""
