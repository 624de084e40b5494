"""Drives that leave out poses: the fastest of all, though few of their legs are proved."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.screws import Bools, shortest


def times(start: Array, end: Array) -> Array:
    return np.linalg.norm(end - start, axis=-1)


@pytest.mark.parametrize("seed", range(12))
def test_no_drive_that_leaves_out_poses_and_is_clear_is_faster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, share = int(rng.integers(3, 11)), rng.uniform(0.1, 0.9)
    poses = rng.uniform(-1.0, 1.0, (count, 3))
    clear = np.eye(count, k=1, dtype=bool) | np.triu(rng.random((count, count)) < share)
    asked = 0

    def places(some: Array) -> Array:
        return np.asarray((some[:, None] == poses).all(axis=2).argmax(axis=1))

    def proof(start: Array, end: Array) -> Bools:
        nonlocal asked
        asked += len(start)
        found: Bools = clear[places(start), places(end)]
        return found

    found = shortest(poses, times, proof)
    assert clear[places(found[:-1]), places(found[1:])].all()
    assert asked <= (count - 1) * (count - 2) / 2
    inner = range(1, count - 1)
    subsets = itertools.chain.from_iterable(itertools.combinations(inner, k) for k in range(count))
    ways = ([0, *some, count - 1] for some in subsets)
    least = min(
        float(times(poses[way[:-1]], poses[way[1:]]).sum())
        for way in ways
        if clear[way[:-1], way[1:]].all()
    )
    assert times(found[:-1], found[1:]).sum() == pytest.approx(least, abs=1e-12)
