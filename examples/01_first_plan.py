"""First plan: load a problem, plan it, read what is proved of the plan, save it.

A mode lists the stiffness of the segments: 1 is soft (its metal is liquid), 0 is rigid.
"""

from twosra_mpc import load_problem, plan, save_setpoints

result = plan(load_problem("paper-1"))
made = result.require()  # raises NoPlanError, with the reason, if there is no plan

for phase in made.phases:
    print(f"{phase.start_s:6.1f} to {phase.end_s:6.1f} s: move in mode {phase.mode}")
for change in made.transitions:
    print(f"{change.heater_s:6.1f} to {change.done_s:6.1f} s: segment {change.segment} {change.to}")
print(f"{made.duration_s:.1f} s; no plan takes less than {made.lower_bound:.1f} s")

result.save("plan.json")  # all of it: robot, problem, motion, bound
save_setpoints(made, "setpoints.csv", rate_Hz=10.0)  # wheels and heaters only
