"""Bending coordinates W of a curvature, by quadrature, and the curvature of a W."""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.path_models import path_model
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Body

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
# Edges of the quadrature's panels [rad]; fine at 0, where spirals bend.
_PANELS = np.array([0.0, 0.02, 0.1, 0.5, 1.5, 4.0, 8.0, math.inf])
_TABLE = 2001  # points of the table that inverts W


@per_body(256)
def bending_coordinate(body: Body, segment: int, kappa: float) -> float:
    """W of a segment (from 0) at a curvature [1/m]."""
    return float(bending_coordinates(body, segment, np.array([kappa]))[0])


def bending_coordinates(body: Body, segment: int, kappa: Array) -> Array:
    """W of a segment (from 0) at curvatures (m,) [1/m]."""
    edges = np.minimum(_PANELS, np.abs(kappa)[:, None] * body.geometry.lengths_m[segment])
    half = np.diff(edges)[..., None] / 2
    points = edges[:, :-1, None] + half * (1 + _NODES)
    values, used = np.zeros(points.shape), half[..., 0] > 0
    (values[used],) = by_rows(_density(body, segment), points[used])
    parts = half * _WEIGHTS * values
    return np.sign(kappa) * parts.sum(axis=(1, 2))


@per_body(4)
def _density(body: Body, segment: int) -> ca.Function:
    """1 / g at as many bends of a segment [rad] as a panel has nodes."""
    alpha = ca.SX.sym("alpha", len(_NODES))
    shares = [path_model(body).share(segment, each) for each in ca.vertsplit(alpha)]
    return ca.Function("density", [alpha], [ca.densify(1 / ca.vertcat(*shares))])


@per_body(4)
def inverse_table(body: Body, segment: int) -> tuple[Array, Array]:
    """A grid of curvatures a little beyond the limits, and W there."""
    limit, length = 1.01 * body.limits.curvature_per_m, body.geometry.lengths_m[segment]
    half = np.linspace(0.0, limit, _TABLE // 2 + 1)
    widths = np.diff(half) * length
    points = half[:-1, None] * length + widths[:, None] / 2 * (1 + _NODES)
    (values,) = by_rows(_density(body, segment), points)
    cumulative = np.concatenate([[0.0], np.cumsum(values @ _WEIGHTS * widths / 2)])
    kappa = np.concatenate([-half[:0:-1], half])
    return kappa, np.concatenate([-cumulative[:0:-1], cumulative])


class Inverse(NamedTuple):
    """W -> kappa: cubic in every cell of a table, clipped at its ends.

    Attributes:
        table: W at the ends of the cells, (m + 1,).
        powers: Factors of the powers of what W is beyond a cell's lower end, cubic first, (4, m).
    """

    table: Array
    powers: Array

    def __call__(self, coordinates: Array) -> Array:
        """Curvatures [1/m] with these W."""
        table, powers = self
        w = np.minimum(np.maximum(coordinates, table[0]), table[-1])
        cell = np.searchsorted(table[1:-1], w, side="right")
        beyond, (cubic, square, slope, value) = w - table[cell], powers[:, cell]
        return ((cubic * beyond + square) * beyond + slope) * beyond + value


@per_body(4)
def inverse(body: Body, segment: int) -> Inverse:
    """Hermite's interpolation of the table, with the slope dkappa / dW = g / l at its points."""
    kappa, table = inverse_table(body, segment)
    length = body.geometry.lengths_m[segment]
    points = np.resize(kappa * length, (math.ceil(len(kappa) / len(_NODES)), len(_NODES)))
    slopes = 1 / (length * by_rows(_density(body, segment), points)[0].ravel()[: len(kappa)])
    widths = np.diff(table)
    secants = np.diff(kappa) / widths
    bent = (slopes[:-1] + slopes[1:] - 2 * secants) / widths
    square = (secants - slopes[:-1]) / widths - bent
    return Inverse(table, np.array([bent / widths, square, slopes[:-1], kappa[:-1]]))
