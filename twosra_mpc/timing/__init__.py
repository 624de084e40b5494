"""Transition timing: the events of a mode sequence, and how far apart they must be."""

from twosra_mpc.timing import overlapped, sequential, thermal  # noqa: F401  # they register
from twosra_mpc.timing.network import EventLayout as EventLayout
from twosra_mpc.timing.network import TemporalNetwork as TemporalNetwork
from twosra_mpc.timing.network import latest_times as latest_times
from twosra_mpc.timing.network import resting_s as resting_s
from twosra_mpc.timing.transitions import SegmentHeating as SegmentHeating
from twosra_mpc.timing.transitions import Transition as Transition
from twosra_mpc.timing.transitions import TransitionModel as TransitionModel
from twosra_mpc.timing.transitions import model_of as model_of
from twosra_mpc.timing.transitions import transition_model as transition_model
