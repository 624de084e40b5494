r"""The temperature sensor of a segment: contact, lag, thermistor, divider, converter, decoding.

The sensor touches the segment's surface at ``T_a + gain (T - T_a)`` and follows it through two
lags. Its voltage is rounded to a code of the converter, and firmware turns the code back into a
temperature. Part and firmware are separate values, so a part can be off by its tolerance.
`NtcDivider` is a 10 k thermistor, :math:`R = R_{25} \exp[B (1/T - 1/298.15)]`, with a fixed
resistor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot

Lag = tuple[float, float]

_ZERO_C_K = 273.15  # kelvin of 0 degrees C
_ROOM_K = 298.15  # 25 degrees C, at which resistances are stated


@dataclass(frozen=True)
class NtcDivider:
    """An NTC thermistor in series with a fixed resistor. Defaults: MF52AT, 2.2 k pull-up, 3.3 V.

    Attributes:
        resistance_25_ohm: Resistance of the thermistor at 25 C.
        beta_K: B, its fall with temperature.
        fixed_ohm: The fixed resistor.
        supply_V: Voltage over both.
        ntc_to_ground: Whether the thermistor is the lower of the two: voltage falls with heat.
        range_C: Temperatures the thermistor is made for.
    """

    resistance_25_ohm: float = 10e3
    beta_K: float = 3950.0
    fixed_ohm: float = 2.2e3
    supply_V: float = 3.3
    ntc_to_ground: bool = True
    range_C: tuple[float, float] = (-40.0, 125.0)

    def resistance_ohm(self, temperature_C: float) -> float:
        """Resistance of the thermistor."""
        inverse = 1 / (temperature_C + _ZERO_C_K) - 1 / _ROOM_K
        return self.resistance_25_ohm * math.exp(self.beta_K * inverse)

    def voltage_V(self, temperature_C: float) -> float:
        """Voltage between the two resistors."""
        ntc = self.resistance_ohm(temperature_C)
        lower = ntc if self.ntc_to_ground else self.fixed_ohm
        return self.supply_V * lower / (ntc + self.fixed_ohm)

    def temperature_C(self, voltage_V: float) -> float:
        """Invert the divider and the thermistor's law."""
        lower_share = voltage_V / self.supply_V
        ntc_share = lower_share if self.ntc_to_ground else 1 - lower_share
        ntc = self.fixed_ohm * ntc_share / (1 - ntc_share)
        return 1 / (1 / _ROOM_K + math.log(ntc / self.resistance_25_ohm) / self.beta_K) - _ZERO_C_K

    def off_by(self, resistance: float = 0.0, beta: float = 0.0, fixed: float = 0.0) -> NtcDivider:
        """Return the same circuit with relative errors of its parts, e.g. 0.01 for one per cent."""
        return replace(
            self,
            resistance_25_ohm=self.resistance_25_ohm * (1 + resistance),
            beta_K=self.beta_K * (1 + beta),
            fixed_ohm=self.fixed_ohm * (1 + fixed),
        )


STANDARD = NtcDivider()


@dataclass(frozen=True)
class TemperatureSensor:
    """A sensor on a segment and the firmware that reads it. A lag is two temperatures [C].

    Attributes:
        ambient_C: Temperature of the air.
        part: The circuit as it is.
        assumed: The circuit as the firmware takes it to be.
        gain: Share of the segment's excess over the air that the sensor touches.
        lags_s: Two time constants, one after the other; 0 is no lag.
        noise_C: Standard deviation of a reading.
        bits: Resolution of the converter.
    """

    ambient_C: float
    part: NtcDivider = STANDARD
    assumed: NtcDivider = STANDARD
    gain: float = 1.0
    lags_s: tuple[float, float] = (4.0, 4.0)
    noise_C: float = 0.02
    bits: int = 12

    def settled(self, temperature_C: float) -> Lag:
        """Lag after a long time at one temperature of the segment."""
        touched = self.touched_C(temperature_C)
        return (touched, touched)

    def touched_C(self, temperature_C: float) -> float:
        """Temperature at the sensor when the segment is at this one."""
        return self.ambient_C + self.gain * (temperature_C - self.ambient_C)

    def follow(self, lag: Lag, before_C: float, after_C: float, duration_s: float) -> Lag:
        """Lag after the segment's temperature has changed evenly from one value to another."""
        before, after = self.touched_C(before_C), self.touched_C(after_C)
        return follow(lag, self.lags_s, before, after, duration_s)

    def read_C(self, lag: Lag, error_C: float = 0.0) -> float:
        """Temperature that the firmware makes of the sensor.

        Args:
            lag: Where the sensor is.
            error_C: Noise of this reading.

        Returns:
            Temperature [C]; NaN, a fault, from a converter at its end (as a sensor that has come
            off or is shorted makes it), or outside the range that the circuit is made for.
        """
        voltage = self.part.voltage_V(lag[1] + error_C)
        top = 2**self.bits - 1
        code = min(top, max(0, round(voltage / self.part.supply_V * top)))
        if code in (0, top):
            return math.nan
        read = self.assumed.temperature_C(code / top * self.assumed.supply_V)
        coldest, hottest = self.assumed.range_C
        return read if coldest <= read <= hottest else math.nan


def follow(
    lag: Lag, lags_s: tuple[float, float], before: float, after: float, duration_s: float
) -> Lag:
    """Two lags, one after the other, driven by a quantity that changes evenly: exactly.

    Behind a ramp of slope s the first lag trails by s tau_1, the second by s (tau_1 + tau_2);
    deviations from that decay.

    Args:
        lag: Outputs of the first and of the second.
        lags_s: Their time constants tau_1 and tau_2, 0 for none.
        before: The quantity now.
        after: The quantity after ``duration_s``.
        duration_s: Time that passes, not negative.
    """
    if duration_s == 0.0:
        return lag
    (one, two), (tau_1, tau_2) = lag, lags_s
    slope = (after - before) / duration_s
    first = one - (before - slope * tau_1)
    second = two - (before - slope * (tau_1 + tau_2))
    kept_1 = math.exp(-duration_s / tau_1) if tau_1 else 0.0
    kept_2 = math.exp(-duration_s / tau_2) if tau_2 else 0.0
    passed = _passed_on(tau_1, tau_2, duration_s)
    return (
        after - slope * tau_1 + first * kept_1,
        after - slope * (tau_1 + tau_2) + second * kept_2 + first * passed,
    )


def _passed_on(tau_1: float, tau_2: float, duration_s: float) -> float:
    """Share of a deviation of the first lag that the second shows after ``duration_s``."""
    slow, fast = max(tau_1, tau_2), min(tau_1, tau_2)
    if fast == 0.0:
        return math.exp(-duration_s / slow) if slow and tau_1 else 0.0
    rate = 1 / fast - 1 / slow
    grown = -math.expm1(-rate * duration_s) / rate if rate else duration_s
    return math.exp(-duration_s / slow) * grown / tau_2


def temperature_sensor(
    robot: Robot, ambient_C: float, segment: int, part: NtcDivider = STANDARD
) -> TemperatureSensor:
    """Build the sensor of a segment; gain and lag are those of the robot's file, if it has any.

    Args:
        robot: The robot.
        ambient_C: Temperature of the air.
        segment: Which segment, from 0.
        part: Circuit, which the firmware knows; default: the thermistor in its divider.

    Raises:
        InputError: If the robot file has no ``[segment]``, or the air is not within the circuit's
            range.
    """
    coldest, hottest = part.range_C
    if not coldest <= ambient_C <= hottest:
        allowed = f"from {coldest:zg} to {hottest:zg} C, the sensor's range"
        raise InputError("ambient_C", ambient_C, allowed)
    gain, lags_s = robot.thermal_segment(segment).sensor_gain_and_lags_s
    return TemperatureSensor(ambient_C, part, part, gain, lags_s)
