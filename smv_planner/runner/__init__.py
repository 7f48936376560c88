"""The transition runner (Machines 2021, section 4): one pure step from a situation and an event to the next situation.

`events` is what can happen and what the runner wants done about it, `situation` all it knows; `recovery` is how plans are
made and mended, `posed` the questions they answer. `step` shows in which order an event is worked off; each part of that is
a module:

- `hearing` takes in what hubs say, `orders` what people want, `asking` what the planners decide;
- `taking_over` becomes the one planner of a cell, `resources` knows which hubs are there;
- `plan_steps` follows the plan, `advancing` ends operations and guards invariants, `intentions` begin and end;
- `failures` says what no longer counts and when it does again, `operator` what a person is asked for;
- `goals` sends commands, after a last look by `gate`; `monitor` explains what was measured.

All of them change one `turn`, and import downwards only (`make lint`). `records` writes events and situations to journals.
"""
