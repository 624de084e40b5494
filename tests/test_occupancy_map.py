"""Maps of ROS: every occupied cell is within an obstacle, and nothing far from one is."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from conftest import Run
from numpy.typing import NDArray
from once import cases
from PIL import Image

from twosra_mpc import InputError, InputWarning, read_obstacles
from twosra_mpc.lab.worlds.occupancy_map import OccupancyMap, obstacles_on, read_map
from twosra_mpc.problem.world import Obstacle

pytestmark = pytest.mark.filterwarnings("error::twosra_mpc.errors.InputWarning")

MAP = """# a map
image: map.png
resolution: 0.01
origin: [-0.1, 0.2, 0.0]  # x, y, yaw
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
FREE, TAKEN, UNKNOWN = 254, 0, 205


def write_map(folder: Path, pixels: object, text: str = MAP) -> Path:
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(folder / "map.png")
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    return folder / "map.yaml"


def cells_of(occupied: NDArray[np.bool_]) -> OccupancyMap:
    return OccupancyMap(occupied, np.zeros_like(occupied), 0.01, (0.3, -0.2, 0.7))


def polygons(obstacles: tuple[Obstacle, ...]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(each.corners_m) for each in obstacles])


def cells(found: OccupancyMap) -> shapely.Geometry:
    rows, columns = np.nonzero(found.occupied)
    boxes = shapely.box(columns, rows, columns + 1, rows + 1)
    return shapely.transform(shapely.union_all(boxes), found.in_plane)


def walls(seed: int) -> NDArray[np.bool_]:
    """A room with an outer wall, jagged walls across, corners that touch, and specks."""
    rng, n = np.random.default_rng(seed), 60
    y, x = np.mgrid[:n, :n]
    taken = (np.minimum(x, y) < 3) | (np.maximum(x, y) >= n - 3)
    for _ in range(4):
        at, angle = rng.uniform(10, n - 10, 2), rng.uniform(0, np.pi)
        u = (x - at[0]) * np.cos(angle) + (y - at[1]) * np.sin(angle)
        v = (y - at[1]) * np.cos(angle) - (x - at[0]) * np.sin(angle) + rng.normal(0, 0.7, (n, n))
        taken |= (abs(u) < 15) & (abs(v) < 3)
    return np.asarray(taken | (rng.random((n, n)) < 0.02))


@pytest.mark.parametrize("tolerance", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_occupied_is_lost_and_nothing_far_is_added(seed: int, tolerance: float) -> None:
    given = cells_of(walls(seed))
    found, specks = obstacles_on(given, "wall", 0.01 * tolerance)
    assert specks == 0
    true, made = cells(given), polygons(found)
    assert true.difference(made.buffer(2e-9)).is_empty
    assert made.difference(true.buffer(0.01 * (tolerance + 0.05), join_style="mitre")).is_empty


def test_outlines_become_simpler() -> None:
    given = cells_of(walls(1))
    corners = [
        sum(len(each.corners_m) for each in obstacles_on(given, "", 0.01 * tolerance)[0])
        for tolerance in (0.0, 1.0, 3.0)
    ]
    assert corners[0] > 2 * corners[1] > 2 * corners[2]


def test_a_straight_wall_is_its_four_corners_whatever_the_tolerance() -> None:
    taken = np.zeros((40, 100), dtype=bool)
    taken[10:20, 5:95] = True
    found, _ = obstacles_on(cells_of(taken), "wall", 0.03)
    assert [len(each.corners_m) for each in found] == [4]
    assert polygons(found).symmetric_difference(cells(cells_of(taken))).area < 1e-9


def test_specks_are_left_out_and_counted() -> None:
    taken = np.zeros((20, 20), dtype=bool)
    taken[2:8, 2:8] = taken[15, 15] = taken[17:19, 3] = True
    found, specks = obstacles_on(cells_of(taken), "wall", least_area_m2=2.5e-4)
    assert (len(found), specks) == (1, 2)
    assert obstacles_on(cells_of(taken), "wall")[1] == 0
    assert obstacles_on(cells_of(np.zeros((5, 5), dtype=bool)), "wall") == ((), 0)


def test_cells_are_where_the_map_says(tmp_path: Path) -> None:
    pixels = np.full((3, 4), FREE)
    pixels[0, 3] = TAKEN  # upper right
    pixels[2, 0] = UNKNOWN  # lower left
    found = read_map(write_map(tmp_path, pixels), unknown_is_free=True)
    (made,) = obstacles_on(found, "wall")[0]
    np.testing.assert_allclose(made.corners_m.min(axis=0), (-0.07, 0.22), atol=1e-9)
    np.testing.assert_allclose(made.corners_m.max(axis=0), (-0.06, 0.23), atol=1e-9)
    turned = MAP.replace("0.2, 0.0]", "0.2, 1.5707963267948966]")
    found = read_map(write_map(tmp_path, pixels, turned), unknown_is_free=True)
    (made,) = obstacles_on(found, "wall")[0]
    np.testing.assert_allclose(made.corners_m.min(axis=0), (-0.13, 0.23), atol=1e-9)
    found = read_map(tmp_path / "map.yaml")
    assert (found.occupied.sum(), found.unknown.sum()) == (2, 1)
    assert found.occupied[0, 0]
    assert found.unknown[0, 0]


def test_a_map_may_be_negated_listed_in_lines_and_transparent(tmp_path: Path) -> None:
    listed = MAP.replace("[-0.1, 0.2, 0.0]", "").replace("negate: 0", "negate: true")
    listed = listed.replace("origin:   # x, y, yaw", "origin:\n- -0.1\n- 0.2\n- 0")
    path = write_map(tmp_path, [[255, 0]], f"---\n{listed}mode: 'trinary'\n")
    assert read_map(path).occupied.tolist() == [[True, False]]
    assert read_map(path).origin == (-0.1, 0.2, 0.0)
    path = write_map(tmp_path, [[[0, 0, 0, 255], [0, 0, 0, 100], [250, 250, 250, 255]]])
    found = read_map(path, unknown_is_free=True)
    assert (found.occupied.tolist(), found.unknown.tolist()) == (
        [[True, False, False]],
        [[False, True, False]],
    )


@pytest.mark.parametrize("seed", range(3))
def test_maps_of_every_mode_say_what_ros_says(seed: int, tmp_path: Path) -> None:
    """Unknown is what scale has between; thresholds cut raw, which ROS leaves to subscribers."""
    pixels = np.random.default_rng(seed).integers(0, 256, (16, 16))
    share, percent = 1.0 - pixels / 255, pixels / 100
    known = (share > 0.65, share < 0.196), ((percent > 0.65) & (percent <= 1), percent < 0.196)
    for mode, (occupied, free) in zip(("trinary", "scale", "raw"), known[:1] + known, strict=True):
        found = read_map(write_map(tmp_path, pixels, f"{MAP}mode: {mode}\n"), unknown_is_free=True)
        np.testing.assert_array_equal(found.occupied[::-1], occupied)
        np.testing.assert_array_equal(found.unknown[::-1], ~(occupied | free))


@pytest.mark.parametrize(("before", "after", "field", "words"), cases("occupancy_map")["wrong"])
def test_what_is_no_map_is_refused(
    before: str, after: str, field: str, words: str, tmp_path: Path
) -> None:
    path = write_map(tmp_path, [[0, 255]], MAP.replace(before, after))
    Image.fromarray(np.array([[0, 40000]], dtype=np.uint16)).save(tmp_path / "deep.png")
    with pytest.raises(InputError) as caught:
        read_map(path)
    assert f"map.yaml: {field}" in str(caught.value)
    assert words in str(caught.value)


def test_colours_are_averaged_as_ros_does(tmp_path: Path) -> None:
    """Yellow has a mean of 170 (a share of 0.333: unknown), green and red 85 (0.667: occupied)."""
    yellow, green, red, white = (255, 255, 0), (0, 255, 0), (255, 0, 0), (255, 255, 255)
    found = read_map(write_map(tmp_path, [[yellow, green, red, white]]), unknown_is_free=True)
    assert found.occupied.tolist() == [[False, True, True, False]]
    assert found.unknown.tolist() == [[True, False, False, False]]


def test_what_map_saver_calls_unknown_is_never_free(tmp_path: Path) -> None:
    """Its grey 205 has a share of 0.196, which is below the threshold that ROS 2 now writes."""
    path = write_map(tmp_path, [[UNKNOWN, FREE, TAKEN]], MAP.replace("0.196", "0.25"))
    with pytest.warns(InputWarning, match=r"1 cells of grey 205.*free_thresh = 0\.25.*unknown"):
        found = read_map(path)
    assert found.unknown.tolist() == [[True, False, False]]
    assert found.occupied.tolist() == [[True, False, True]]


def test_keys_of_other_programs_are_left_out_and_told(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="map_type is not known here"):
        read_map(write_map(tmp_path, [[0, 255]], f"{MAP}map_type: occupancy\n"))


@pytest.mark.parametrize(
    ("doubt", "before", "after", "saved"),
    [
        ("stored turned", "", "", {"exif": (turned := Image.Exif())}),
        ("several pictures", ".png", ".gif", {"append_images": [Image.new("L", (2, 1))]}),
        ("does not keep greys", ".png", ".jpg", {"quality": 95}),
        ("are these degrees", "0.0]", "90.0]", {}),
    ],
)
def test_what_may_be_meant_otherwise_is_doubted(
    doubt: str, before: str, after: str, saved: dict[str, Any], tmp_path: Path
) -> None:
    turned[0x0112] = 3
    path = write_map(tmp_path, [[0, 255]], MAP.replace(before, after))
    picture = Image.fromarray(np.array([[0, 255]], dtype=np.uint8))
    name = f"map{after if after.startswith('.') else '.png'}"
    picture.save(tmp_path / name, save_all="append_images" in saved, **saved)
    with pytest.warns(InputWarning, match=doubt) as told:
        assert read_map(path).occupied.tolist() == [[True, False]]
    assert len(told) == 1


def test_numbers_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    """Programs in C++ write 1e-05 without a point, text in YAML 1.1, which has 010 for eight."""
    numbers = MAP.replace("0.01", "1e-2").replace("-0.1, 0.2", "-1e-05, 010")
    merged = numbers.replace("negate: 0", "<<: {negate: 1, free_thresh: 0.1}")
    found = read_map(write_map(tmp_path, [[0]], merged))
    assert (found.cell_m, found.origin[:2]) == (0.01, (-1e-5, 10.0))
    assert not found.occupied.any()


def test_the_command_writes_what_scenarios_read(run_as_is: Run, tmp_path: Path) -> None:
    path, out = write_map(tmp_path, np.where(walls(0), TAKEN, FREE)), tmp_path / "lab.geojson"
    code, told, err = run_as_is("import-map", path, "--out", out, "--json", "--least-area", "2e-4")
    assert (code, err) == (0, "")
    found, said = read_obstacles(out), json.loads(told)
    assert said["obstacles"] == len(found)
    assert said["cells"] == [60, 60]
    assert said["specks_left_out"] > 0
    assert found[0].name.startswith("map ")
    assert run_as_is("import-map", path, "--tolerance", "-1").code == 2
    code, _, err = run_as_is("import-map", tmp_path / "none.yaml")
    assert code == 2
    assert "none.yaml" in err


def test_maps_that_are_too_rough_are_refused_before_they_are_traced() -> None:
    """Of random cells, in which nearly every corner of a cell is one of the outline."""
    rough = np.random.default_rng(0).random((400, 400)) < 0.3
    before = time.process_time()
    with pytest.raises(InputError, match=r"at most 20000: leave out specks .* or scale the image"):
        obstacles_on(OccupancyMap(rough, rough, 0.01, (0.0, 0.0, 0.0)), "rough")
    assert time.process_time() - before < 2.0
    rough[:, :] = False
    rough[10:20, 10:20] = rough[20, 20] = True  # they share a corner: no speck
    rough[50, 50:53] = rough[60, 60] = True
    found, specks = obstacles_on(
        OccupancyMap(rough, rough, 0.01, (0.0, 0.0, 0.0)), "few", 0.0, 4e-4
    )
    assert (len(found), specks) == (1, 2)
