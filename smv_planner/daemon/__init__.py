"""The planner as a service: the pure runner meets the network, the disk, the clock and a process that plans.

`loop` is one turn after the other, `planners` and `worker` are both ends of the process that plans, `documents` and
`orders` are what the planner tells everybody and what it is told, `chronicle` is how it uses its journal, `status` is for
who asks on the same machine.
"""
