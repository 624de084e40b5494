from twosra_mpc.lab.studio.server import Server as Server
from twosra_mpc.lab.studio.server import widget as widget
