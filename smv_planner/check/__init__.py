"""The trusted kernel: nothing is a plan before this package has accepted it.

It replays what an engine reports against the model's meaning, not against any encoding, and depends on `model` and
`problem` alone. Engines are never trusted (ARCHITECTURE.md, decision 1). Whatever may take long looks at the clock, and leaves
by `clock.Over` when the time is up: that is neither an acceptance nor a refusal.
"""

from smv_planner.check.plan import CheckedPlan, Refused, check_plan
from smv_planner.check.proofs import check_proof

__all__ = ["CheckedPlan", "Refused", "check_plan", "check_proof"]
