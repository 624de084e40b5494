"""The waits of the published trials: fixed sleeps of their controller, whatever the metal does.

Source: ``mainController.py`` of the authors' 2sr-agent-control at the commits of the trials; gaps
of 300, 301 and 502 s in the logs agree.
"""

from __future__ import annotations

from twosra_mpc.arguments import public
from twosra_mpc.robot.modes import RIGID, Mode, ModeSequence, is_rigid

HEAT_ONE_S, HEAT_BOTH_S = 102.0, 100.0
FREEZE_S = 300.0  # soft to rigid
COOL_S = 400.0  # soft to otherwise soft: everything cools, and is heated anew


@public
def fixed_waits_s(sequence: ModeSequence) -> tuple[float, ...]:
    """Wait before each phase, and after the last one until all is rigid, (phases + 1,) [s].

    The robot is rigid at first.
    """
    modes = (RIGID, *sequence, RIGID)
    return tuple(map(_wait_s, modes[:-1], modes[1:]))


def _wait_s(before: Mode, after: Mode) -> float:
    if before == after:
        return 0.0
    if is_rigid(after):
        return FREEZE_S
    heating_s = HEAT_BOTH_S if all(after) else HEAT_ONE_S
    return heating_s if is_rigid(before) else COOL_S + heating_s
