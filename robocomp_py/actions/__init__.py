"""Actions: operations that take long, with feedback, cancellation and a result. See `contract.interface.Action`.

    goal     what both sides hold of a goal, and the bounds
    server   executes the goals of one action, a step at each `compute`
    client   begins goals, and learns how they end
    binding  connects both with the channels of a component

Components without actions import nothing of this package.
"""
