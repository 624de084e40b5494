"""Thermal photographs of segments of known curvature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.spatial import cKDTree

from twosra_mpc.lab.photographs.picture import Camera, Photograph
from twosra_mpc.robot.coordinates import Array

LENGTH_M, WIDTH_M, SIZE = 0.04, 0.006, 70
SCALE_M = LENGTH_M / 8.4
DARK, BRIGHT, FINER = 12.0, 255.0, 6
MIDDLE = (35.0, 35.0)


def draw(
    rng: np.random.Generator,
    kappa: float,
    *,
    heading: float = 0.0,
    blur_px: float = 0.8,
    noise: float = 2.0,
    middle: tuple[float, float] = MIDDLE,
    bend: Array | None = None,
) -> tuple[Array, tuple[float, float]]:
    """Draw a strip: grey values (70, 70) of 8 bits, and the pixel (x, y) at which it ends.

    It is seen from above, x right and y up, heading so in its middle; ``bend`` (801,) is added to
    its curvature [1/m] along it.
    """
    s = np.linspace(-0.5, 0.5, 801) * LENGTH_M
    turned = np.full(len(s), kappa) + (0.0 if bend is None else bend)
    angle = np.concatenate([[0.0], np.cumsum((turned[1:] + turned[:-1]) / 2 * np.diff(s))])
    angle += heading - angle[400]
    steps = np.column_stack([np.cos(angle), -np.sin(angle)])  # a picture's y is down
    line = np.cumsum(np.vstack([[0.0, 0.0], (steps[1:] + steps[:-1]) / 2 * (s[1] - s[0])]), axis=0)
    line = (line - line[400]) / SCALE_M + middle
    fine = (np.arange(SIZE * FINER) + 0.5) / FINER - 0.5
    x, y = np.meshgrid(fine, fine)
    near = (np.abs(x - middle[0]) < 9) & (np.abs(y - middle[1]) < 9)
    far, at = cKDTree(line).query(np.column_stack([x[near], y[near]]))
    strip = np.zeros_like(x)
    edge = np.clip((WIDTH_M / 2 / SCALE_M - far) * FINER + 0.5, 0.0, 1.0)
    strip[near] = edge * ((at > 0) & (at < 800))
    strip = ndimage.gaussian_filter(strip, blur_px * FINER)
    grey = strip.reshape(SIZE, FINER, SIZE, FINER).mean(axis=(1, 3))
    grey = DARK + (BRIGHT - DARK) * grey / grey.max() + noise * rng.standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255), (float(line[-1, 0]), float(line[-1, 1]))


def camera(towards: tuple[float, float]) -> Camera:
    """The camera of these pictures, which look at a robot from above."""
    return Camera(scale_m=SCALE_M, length_m=LENGTH_M, towards_px=towards)


def photograph(grey: Array) -> Photograph:
    """A picture of grey values (rows, columns)."""
    return Photograph(Path("drawn.png"), grey)


def save(grey: Array, path: Path) -> Path:
    """Write grey values as a picture."""
    Image.fromarray(grey.astype(np.uint8)).save(path)
    return path


def write_folder(folder: Path, curvatures: list[float]) -> tuple[float, float]:
    """Write a picture each, held at its right end, and return where that end is [px]."""
    rng = np.random.default_rng(5)
    folder.mkdir()
    for number, kappa in enumerate(curvatures):
        _, end = draw(rng, kappa, heading=-0.5 * kappa * LENGTH_M, noise=0.0)
        middle = (43.0 - (end[0] - MIDDLE[0]) - 4.0, 35.0 - (end[1] - MIDDLE[1]))
        grey, _ = draw(rng, kappa, heading=-0.5 * kappa * LENGTH_M, middle=middle)
        save(grey, folder / f"shot-{number:03d}.png")
    return (39.0, 35.0)
