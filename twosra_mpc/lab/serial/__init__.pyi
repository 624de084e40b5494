from twosra_mpc.lab.serial.robot import PoseSource as PoseSource
from twosra_mpc.lab.serial.robot import SerialRobot as SerialRobot
from twosra_mpc.lab.serial.robot import connected as connected
from twosra_mpc.lab.serial.stream import ThinkAside as ThinkAside
