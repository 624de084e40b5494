"""A sweep: what a stronger heater current is worth, for optimal plans and for the greedy rule."""

from matplotlib.figure import Figure

from twosra_mpc import load_problem, plan

problem = load_problem("paper-2")
robot = problem.robot
currents_A = [0.65, 0.70, 0.75, 0.80, 0.85, 0.90]

figure = Figure(figsize=(6, 3))
ax = figure.add_subplot(xlabel="heater current [A]", ylabel="duration [s]")
for planner, marker in (("optimal", "o-"), ("greedy", "s--")):
    durations_s = []
    for current_A in currents_A:
        heater = robot.heater.with_values(melt_current_A=current_A)
        changed = problem.with_values(robot=robot.with_values(heater=heater), planner=planner)
        durations_s.append(plan(changed).require().duration_s)
    ax.plot(currents_A, durations_s, marker, label=planner)
    print(
        f"{planner}: {durations_s[0]:.0f} s at {currents_A[0]} A, {durations_s[-1]:.0f} s at 0.9 A"
    )
ax.set_ylim(bottom=0)
ax.legend()
figure.savefig("sweep.png", dpi=120, bbox_inches="tight")
