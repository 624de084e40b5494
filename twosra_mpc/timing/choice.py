"""The transition model that a problem's timing names."""

from __future__ import annotations

from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming
from twosra_mpc.thermal.heating import HeatingPlan, KeepWarm
from twosra_mpc.thermal.model import segment_model
from twosra_mpc.thermal.uncertainty import EXACT, windows
from twosra_mpc.timing.constant import Overlapped, Sequential
from twosra_mpc.timing.thermal import Thermal
from twosra_mpc.timing.transitions import TransitionModel

_KEEP_WARM_BELOW_C = 3.0  # how far below its threshold a solid segment is kept warm


def transition_model(problem: Problem) -> TransitionModel:
    """Build the transition model that the problem's timing names."""
    match problem.transition_times:
        case OverlappedTiming() as times:
            return Overlapped(
                times,
                problem.robot.heater,
                problem.ambient,
                problem.start_mode,
                problem.temperatures,
                problem.heaters_at_once,
            )
        case SequentialTiming() as times:
            return Sequential(
                times, problem.robot.heater, problem.start_mode, problem.heaters_at_once
            )
        case ThermalTiming():
            return thermal_transitions(problem)


def thermal_transitions(problem: Problem) -> Thermal:
    """Build the transition model of timing "thermal"."""
    robot, heater = problem.robot, problem.robot.heater
    quantile = problem.transition_quantile
    solid_below_C, _ = problem.stiffness_thresholds_C
    warm = KeepWarm(solid_below_C - _KEEP_WARM_BELOW_C, problem.cost_weights.energy_s_per_J)
    may_keep_warm = problem.heaters_at_once == 2  # a single heater may be needed elsewhere
    heating = HeatingPlan(
        model=segment_model(robot, problem.ambient),
        melt_current_A=heater.melt_current_A,
        soft_setpoint_C=heater.soft_setpoint_C,
        rigid_setpoint_C=heater.rigid_setpoint_C,
        windows=EXACT if quantile is None else windows(robot, problem.ambient, quantile),
        keep_warm=warm if problem.heating == "keep_warm" and may_keep_warm else None,
    )
    return Thermal(heating, problem.start_mode, problem.temperatures, problem.heaters_at_once)
