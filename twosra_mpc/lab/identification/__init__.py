"""Thermal models from heating logs, and logs of motion replayed."""

from twosra_mpc.lab.identification.heating_log import HeatingLog, read_heating_log
from twosra_mpc.lab.identification.thermal_fit import ThermalFit, identify

__all__ = ["HeatingLog", "ThermalFit", "identify", "read_heating_log"]
