"""NuSMV as a library, in a process of its own: NuSMV exits, asserts and crashes, and cannot be interrupted.

Run as a script, without the rest of the package: `nusmv_child.py MODEL BOUND LOOP`. Checks the model's one LTL
specification and prints the answer as JSON on standard output. All that NuSMV itself prints goes to standard error.
"""

from __future__ import annotations

import json
import os
import sys


def main() -> None:
    model, bound, loop = sys.argv[1:]
    answer = os.dup(1)
    os.dup2(2, 1)
    with open(answer, "w", encoding="ascii") as output:
        json.dump(check(model, int(bound), loop), output)
    os._exit(0)  # NuSMV's own farewell takes time and may fail


def check(model: str, bound: int, loop: str) -> dict[str, object]:
    """The counterexample, as its variables for each state and its inputs in between; or how far there is none."""
    from pynusmv import glob
    from pynusmv.bmc import ltlspec, utils
    from pynusmv.bmc.glob import go_bmc
    from pynusmv.init import init_nusmv
    from pynusmv.prop import propStatuses
    from pynusmv.trace import Trace
    from pynusmv_lower_interface.nusmv.cinit import cinit
    from pynusmv_lower_interface.nusmv.opt import opt
    from pynusmv_lower_interface.nusmv.prop import prop as lower_prop
    from pynusmv_lower_interface.nusmv.trace import trace as lower_trace

    init_nusmv()
    cinit.set_nusmv_stdout("/dev/null")
    opt.set_verbose_level(opt.OptsHandler_get_instance(), 1)  # names each bound on standard error
    glob.load_from_file(model)
    go_bmc()
    (specification,) = glob.prop_database()
    ltlspec.check_ltl_incrementally(specification, bound, utils.loop_from_string(loop))
    if specification.status != propStatuses["False"]:
        return {"none_within": bound}

    manager = lower_trace.TracePkg_get_global_trace_manager()
    number = lower_prop.Prop_get_trace(specification._ptr) - 1
    trace = Trace(lower_trace.TraceManager_get_trace_at_index(manager, number))
    steps = list(trace)  # a step is an input and the state that follows it
    states, inputs = list(trace.state_frozen_vars), list(trace.input_vars)
    return {
        "description": trace.description,
        "states": [{str(name): str(step.value[name]) for name in states} for step in steps],
        "inputs": [{str(name): str(step.value[name]) for name in inputs} for step in steps[1:]],
    }


if __name__ == "__main__":
    main()
