"""The whole station in virtual time: runner, planners and emulated hubs behind the real messages, with faults.

Nothing here waits, and nothing is random but by a seed: the same seed gives the same bytes.
"""
