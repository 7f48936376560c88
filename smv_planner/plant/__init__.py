"""The emulated plant in real time: devices of `emulation` behind hubs that speak over the network.

The planner meets it as it meets real hubs. What may go wrong is switched while it runs.
"""
