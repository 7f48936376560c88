"""What planner and hubs say to each other, as values and automata without clock and transport.

Communication is state-based (Industry 4.0, section 3.4): the planner repeats the whole goal state of a resource, its hub
the whole measured state, in which it mirrors the goal that it obeys. A lost message costs a period, nothing else. The
author of a driver needs this package and a transport.
"""
