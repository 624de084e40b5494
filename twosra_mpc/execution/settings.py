"""Settings of runs: when one is content, how long it waits, and when it gives up."""

from __future__ import annotations

from dataclasses import dataclass, field

from twosra_mpc.arguments import public
from twosra_mpc.validation import Count, NonNegative, Positive, Value


class Patience(Value):
    """Patience: when a run goes on, looks again, or gives a plan up. Shares are of the accuracy.

    Attributes:
        rest_s: Longest rest between two looks at the heaters.
        late: A transition that takes so many times the planned time has failed.
        least_transition_s: What is taken for the planned time, at least.
        slow: A phase that is waited for so much longer than its change was planned to take is late.
        longest_change_s: A segment that has been changing for so long keeps nobody waiting.
        melt_on_s: How long a segment that seems to be stiff is held soft before planning again;
            twice as long the next time, and four times from then on.
        come_nearer_s: How long the end of a phase is tried for after its time.
        look_s: Longest look at the resting robot.
        objects_s: How long objects are looked at when a task is judged.
        long_look_s: The same, before a melt is decided on.
        blind_s: Wheels stand when no frame has come in for so long, or for five periods.
        unseen_s: A camera that has sent no frame for so long does not say where the robot is; after
            twice as long the run ends.
        near_enough: Share at which a phase may end.
        finest: Share below which nothing is asked for, however certain the belief is.
        loose: Poses of rigid phases that are not the last may be so many times farther off.
        tube: Share beyond which the plan's clock slows down for a robot that lags behind.
        stuck: After its time a phase is given as long again whenever the deviation has come down
            to this part of what it was.
        tries: How often the end of a phase is driven for again where it may be too far off.
        known: Share that the standard deviation may have at most where a goal counts as reached.
        certain: Share that the standard deviation shall come down to in a look.
        certain_of_a_melt: The same in a long look.
        doubtful: Distance of a share from a decision that makes it worth a long look.
        corridor_m: A robot that is farther from its plan has left it.
        corridor_rad: The same for its heading.
        stiff_per_m: A curvature farther from the plan is of metal that is not yet all liquid.
        stop_m: Nearer to an obstacle no robot drives, however sure it is of where it is.
        stop_deviations: So many standard deviations of that distance it stays farther away.
        narrow_m: Corridor of the outline of rigid drives where something is around.
        listen_s: How long a robot is listened to for its first temperature reports.
        silent_s: A segment that has not reported for so long, or not readably, is an error.
        outage_s: A robot that stands may send neither frames nor reports for so long.
        held_up_s: A command that turns the wheels and lasts so much too long is an error.
    """

    rest_s: Positive = 1.0  # the follow-up robot reports once a second
    late: Positive = 3.0  # chosen: the robot files' 5 to 95 % ranges stay below 2
    least_transition_s: Positive = 20.0  # its controller calls a heater stuck after as long
    slow: Positive = 0.5  # the robot files' 5 to 95 % ranges stay below
    longest_change_s: Positive = 1500.0  # six freezes of 2sra-v1
    melt_on_s: Positive = 30.0  # half a melt of 2sra-v1
    come_nearer_s: Positive = 15.0
    look_s: Positive = 6.0
    objects_s: Positive = 1.5
    long_look_s: Positive = 20.0
    blind_s: Positive = 0.5  # at 0.05 m/s: 25 mm
    unseen_s: Positive = 2.0  # later frames are of no use to the filter; 18 frames at 9 Hz
    near_enough: Positive = 0.3
    finest: Positive = 0.05
    loose: Positive = 3.0
    tube: Positive = 5.0
    stuck: Positive = 0.7
    tries: Count = 4
    known: Positive = 0.5  # of 50 runs at `moderate` and 8 at `hard` the largest was 0.17
    certain: Positive = 0.15
    certain_of_a_melt: Positive = 0.08
    doubtful: Positive = 0.3
    corridor_m: Positive = 0.05
    corridor_rad: Positive = 1.0
    stiff_per_m: Positive = 5.0
    stop_m: Positive = 0.002
    stop_deviations: Positive = 3.0  # in all 8 to 11 mm at `moderate`, at most
    narrow_m: Positive = 0.02
    listen_s: Positive = 5.0  # five reports of the follow-up robot
    silent_s: Positive = 5.0  # five reports missed
    outage_s: Positive = 40.0
    held_up_s: Positive = 0.5  # at 10 rad/s of a 2sra-v1 wheel: 75 mm too far


@public
@dataclass(frozen=True)
class ExecutorSettings:
    """Settings of an executor: when it is content, and when it gives up.

    Attributes:
        patience: How long it waits, and how near to a plan it wants the robot.
        replans: How often the remaining problem is planned again at most.
        grasps: How often an object may be lost before the run ends.
        stops: How often it may have been stopped near something at most.
        corrections: How often in a row the pose is corrected at most.
        doubts: How often the robot may be seen not to do what is commanded.
        longest_s: Longest run.
        dead_zone_rad_s: Of the robot's drives, as far as it is known.
        motor_lag_s: Time constant of their motors, likewise.
        clearance_m: What a run's plans keep to obstacles, or as much as there is room for.
    """

    patience: Patience = field(default_factory=Patience)
    replans: Count = 8
    corrections: Count = 6
    doubts: Count = 2
    grasps: Count = 3
    stops: Count = 4
    longest_s: Positive = 7200.0
    dead_zone_rad_s: NonNegative = 0.0
    motor_lag_s: NonNegative = 0.0
    clearance_m: NonNegative = 0.0
