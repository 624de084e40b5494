from twosra_mpc.execution.tracking.setup import SolverSettings as SolverSettings
from twosra_mpc.execution.tracking.setup import TrackerLimits as TrackerLimits
from twosra_mpc.execution.tracking.setup import TrackerWeights as TrackerWeights
from twosra_mpc.execution.tracking.tracker import Command as Command
from twosra_mpc.execution.tracking.tracker import CommandStatus as CommandStatus
from twosra_mpc.execution.tracking.tracker import Measurement as Measurement
from twosra_mpc.execution.tracking.tracker import Tracker as Tracker
