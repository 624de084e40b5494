"""Obstacles from a GeoJSON file: plan past them, and see where it comes nearest.

Coordinates are metres in the plane. A polygon may be concave; holes are free space.
"""

import json
from pathlib import Path

from twosra_mpc import Goal, Problem, Start, Workspace, load_robot, plan, read_obstacles
from twosra_mpc.plotting import plot_plan

SHELF = [[-0.05, 0.05], [0.20, 0.05], [0.20, 0.09], [-0.01, 0.09], [-0.01, 0.30], [-0.05, 0.30]]
CRATE = [[0.05, -0.25], [0.20, -0.25], [0.20, -0.12], [0.05, -0.12]]  # m


def feature(name: str, corners: list[list[float]]) -> dict[str, object]:
    """Return a polygon as GeoJSON has it: the first corner again at the end."""
    shape = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
    return {"type": "Feature", "properties": {"name": name}, "geometry": shape}


features = [feature("shelf", SHELF), feature("crate", CRATE)]
Path("lab.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))

problem = Problem(
    robot=load_robot("2sra-v1"),
    start=Start(x_m=-0.25, y_m=0.15, phi_rad=1.0, kappa_per_m=[0.0, 0.0]),
    goal=Goal(x_m=0.30, y_m=0.20, phi_rad=1.6, kappa_per_m=[20.0, 0.0]),
    obstacles=read_obstacles("lab.geojson"),
    workspace=Workspace(x_m=(-0.50, 0.50), y_m=(-0.40, 0.50)),
    clearance_m=0.015,  # kept by every point of the robot, at any time
)
made = plan(problem).require()
print(made)
print(f"nearest: {made.verification.limits['clearance_m']:.4f} m beyond the clearance")
plot_plan(made, "past-obstacles.png")
