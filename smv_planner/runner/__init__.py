"""The transition runner (Machines 2021, section 4): one pure step from a situation and an event to the next situation.

`events` is what can happen and what the runner wants done about it, `situation` all it knows, `step` the runner itself,
`recovery` how plans are made and mended, `gate` the last look at a command before it leaves.
"""
