"""Devices that do what the effects of a model say, and whatever may go wrong with them.

The planner is told nothing of this package: it meets emulated devices through the same messages as real ones. Time comes
in as `at` and chance as a `Draw`, so the same seed gives the same behaviour.
"""
