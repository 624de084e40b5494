"""Made-up heating logs: a two-node segment integrated by SciPy, with a firmware of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from twosra_mpc.lab.identification.heating_log import HeatingLog
from twosra_mpc.lab.identification.thermal_fit import Parameters

Array = NDArray[np.float64]

TRUE = Parameters(
    power_K_per_s=1.09,
    coupling_per_s=0.0175,
    body_ratio=3.5,
    body_loss_per_s=0.0033,
    sensor_lag_s=2.8,
    law_gain_per_K=0.037,
    law_duty_at_54C=0.40,
)
GAIN, AIR_C = 1.0, 22.6
SOFT_C, ENOUGH_C = 53.5, 40.0  # readings that end a heating and, if not said otherwise, a cooling


@dataclass(frozen=True)
class TrueHistory:
    """What happened: times, (core, body, first lag, second lag) [C], and (end of phase, mode)."""

    time_s: Array
    state_C: Array
    phases: tuple[tuple[float, str], ...]

    def log(self, rate_Hz: float = 2.0, noise_C: float = 0.02, seed: int = 0) -> HeatingLog:
        """Sample the sensor."""
        time = np.arange(0.0, self.time_s[-1], 1 / rate_Hz)
        sensor = np.interp(time, self.time_s, self.state_C[:, 3])
        sensor += noise_C * np.random.default_rng(seed).standard_normal(len(time))
        ends = [end for end, _ in self.phases]
        mode = np.array([mode for _, mode in self.phases])[np.searchsorted(ends, time, "right")]
        return HeatingLog("made-up", time, sensor, mode, AIR_C)


def true_history(
    holds_s: Sequence[float],
    true: Parameters = TRUE,
    hold_duty: Callable[[float], float] | None = None,
    enough_C: float = ENOUGH_C,
) -> TrueHistory:
    """Integrate cycles of heating to 53.5 C, holding for these times, and cooling."""

    def swinging(since_s: float) -> float:
        return 0.25 + 0.2 * np.sin(since_s / 3)

    def rate(core: float, body: float, one: float, two: float, duty: float) -> list[float]:
        p, a, beta, b, lag = true[:5]
        contact = AIR_C + GAIN * (core - AIR_C)
        body_rate = a / beta * (core - body) - b * (body - AIR_C)
        return [p * duty - a * (core - body), body_rate, (contact - one) / lag, (one - two) / lag]

    def law(_: float, sensor_C: float) -> float:
        duty = true.law_duty_at_54C + true.law_gain_per_K * (54.0 - sensor_C)
        return min(1.0, max(0.0, duty))

    times, states, phases = [np.zeros(1)], [np.full((1, 4), AIR_C)], []

    def run(mode: str, duty: Callable[[float, float], float], limit_s: float, until: float) -> None:
        start = times[-1][-1]

        def reached(t: float, x: Array) -> float:
            del t
            return x[3] - until

        reached.terminal, reached.direction = True, np.sign(until - states[-1][-1, 3])
        done = solve_ivp(
            lambda t, x: rate(*x, duty(t, x[3])),
            (0.0, limit_s),
            states[-1][-1],
            events=reached,
            max_step=0.5,
            rtol=1e-8,
        )
        times.append(start + done.t[1:])
        states.append(done.y.T[1:])
        phases.append((float(times[-1][-1]), mode))

    for hold_s in holds_s:
        run("heating", law, 500.0, SOFT_C)
        if hold_s > 0:
            run("hold", lambda t, _: (hold_duty or swinging)(t), hold_s, 1e3)
        run("cooling", lambda *_: 0.0, 3000.0, enough_C)
    return TrueHistory(np.concatenate(times), np.concatenate(states), tuple(phases))


def write_log(log: HeatingLog, path: Path) -> Path:
    """Write a log as its authors do, with a column that nobody reads."""
    lines = ["time_s,temp_C,command,mode"]
    for t, y, mode in zip(log.time_s, log.sensor_C, log.mode, strict=True):
        lines.append(f"{t:z.4f},{y:z.4f},{int(mode != 'cooling')},{mode}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
