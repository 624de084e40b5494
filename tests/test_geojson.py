"""Obstacles from GeoJSON and shapely: nothing is lost, and what is wrong is named."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import box
from test_problem import SCENARIO, changed

from twosra_mpc import InputError, InputWarning, load_problem, obstacles_of, read_obstacles
from twosra_mpc.lab.worlds.occupancy_map import feature_collection
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import Obstacle, World

pytestmark = pytest.mark.filterwarnings("error::twosra_mpc.errors.InputWarning")

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
HOLE = [[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8], [0.2, 0.2]]


def polygon(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def union(obstacles: tuple[Obstacle, ...]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(each.corners_m) for each in obstacles])


def scattered_holes(seed: int) -> shapely.Polygon:
    """A round outline with a dent and many holes that do not touch, some in rings of others."""
    rng = np.random.default_rng(seed)
    whole = shapely.Point(0, 0).buffer(1.0).difference(box(-0.05, 0.6, 0.05, 1.2))
    for x in np.linspace(-0.6, 0.6, 4):
        for y in np.linspace(-0.55, 0.45, 4):
            corners = np.array([x, y]) + rng.uniform(-0.12, 0.12, (6, 2))
            hole = shapely.convex_hull(shapely.MultiPoint(corners))
            if whole.buffer(-0.01).contains(hole):
                whole = whole.difference(hole)
    return whole


@pytest.mark.parametrize("seed", range(5))
def test_holes_are_cut_and_nothing_is_lost(seed: int) -> None:
    whole = scattered_holes(seed)
    assert len(whole.interiors) > 3
    pieces = [shapely.Polygon(each.corners_m) for each in obstacles_of(whole)]
    assert all(piece.is_valid for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area, rel=1e-12)
    assert shapely.union_all(pieces).symmetric_difference(whole).area < 1e-12


def test_a_ring_within_a_ring_is_two_pieces_of_each() -> None:
    outer = box(-2, -2, 2, 2).difference(box(-1.5, -1.5, 1.5, 1.5))
    inner = box(-1, -1, 1, 1).difference(box(-0.5, -0.5, 0.5, 0.5))
    found = obstacles_of([shapely.MultiPolygon([outer, inner])], ["ring"])
    assert [each.name for each in found] == ["ring 1", "ring 2", "ring 3", "ring 4"]
    assert union(found).symmetric_difference(outer.union(inner)).area < 1e-12


def test_corners_may_turn_either_way_repeat_and_have_heights() -> None:
    backwards = [[x, y, 7.0] for x, y in reversed(SQUARE)]
    (found,) = obstacles_of(polygon([backwards[0], *backwards]))
    assert found == Obstacle(polygon_m=SQUARE[:-1]) or len(found.corners_m) == 4
    assert union((found,)).equals(box(0, 0, 1, 1))


def test_shapely_and_geojson_are_read_alike_and_names_become_different(tmp_path: Path) -> None:
    shapes = [box(0, 0, 1, 1), box(2, 0, 3, 1), box(4, 0, 5, 1)]
    made = obstacles_of(shapes, ["wall", "wall", "box"])
    assert World(obstacles=made).names == ("wall 1", "wall 2", "box")
    collection = {
        "type": "FeatureCollection",
        "features": [
            feature(json.loads(shapely.to_geojson(shape)), name=name)
            for shape, name in zip(shapes, ("wall", "wall", "box"), strict=True)
        ],
    }
    (tmp_path / "lab.geojson").write_text(json.dumps(collection))
    assert read_obstacles(tmp_path / "lab.geojson") == made
    assert obstacles_of(feature_collection(made)) == made


def test_a_collection_of_geometries_is_read() -> None:
    found = obstacles_of(shapely.GeometryCollection([box(0, 0, 1, 1), box(2, 0, 3, 1)]))
    assert [each.name for each in found] == ["", ""]


def test_a_scenario_names_a_file_beside_it(tmp_path: Path) -> None:
    made = obstacles_of([box(2, 2, 3, 3)], ["wall"])
    (tmp_path / "lab.geojson").write_text(json.dumps(feature_collection(made)))
    scenario = changed(SCENARIO, "obstacles", "lab.geojson")
    (tmp_path / "mine.json").write_text(json.dumps(scenario))
    assert load_problem(tmp_path / "mine.json").obstacles == made
    assert Problem(**changed(SCENARIO, "obstacles", str(tmp_path / "lab.geojson"))).world.names == (
        "wall",
    )


def geographic(name: str) -> dict[str, Any]:
    return {**polygon(SQUARE), "crs": {"type": "name", "properties": {"name": name}}}


@pytest.mark.parametrize(
    "name",
    [
        *("urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::4258", "OGC:CRS83"),
        *("http://www.opengis.net/def/crs/EPSG/0/4326", "[EPSG:4326]", "EPSG:4326+5773", "CRS84h"),
        *("EPSG:7844", "EPSG:6318", "epsg:9057", "4258"),
    ],
)
def test_degrees_are_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "lab.geojson"
    part = geographic(name)
    within = {"type": "GeometryCollection", "geometries": [polygon(SQUARE), part]}
    for document in (part, feature(part), within, {**polygon(SQUARE), "coordRefSys": name}):
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match=r"lab\.geojson: crs = .*in metres.*these are degrees"):
            read_obstacles(path)


def test_frames_in_metres_are_taken_and_others_are_doubted() -> None:
    for code in ("25832", "3857", "32632", "2056", "3360", "6538", "102003", "27700", "31467"):
        assert len(obstacles_of(geographic(f"EPSG:{code}"))) == 1
    for name in ("urn:ogc:def:crs:EPSG::25832", "WGS 84 / UTM zone 32N"):
        assert len(obstacles_of(geographic(name))) == 1
    for name in ("EPSG:999999", "workshop", "IAU_2015:30100"):
        with pytest.warns(InputWarning, match=f"crs = '{name}' is not known here"):
            obstacles_of(geographic(name))


@pytest.mark.parametrize(
    "name",
    [
        *("EPSG:2230", "urn:ogc:def:crs:EPSG::2263", "http://www.opengis.net/def/crs/EPSG/0/26741"),
        *("EPSG:3361", "EPSG:6539", "ESRI:102672", "EPSG:3404", "EPSG:8066"),
        *("NAD83 / California zone 6 (ftUS)", "NAD83(2011) / Oregon GIC Lambert (ft)"),
    ],
)
def test_feet_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"crs = .*in metres.*these are feet"):
        obstacles_of(geographic(name))


@pytest.mark.parametrize(
    ("own", "allowed"),
    [
        *(("metre", True), ("Meter", True), ("m", True), ("degree", False), ("Foot_US", False)),
        *(("US survey foot", False), ("us-ft", False), ("grad", False), ("yard", False)),
    ],
)
def test_the_unit_that_a_description_gives_last_is_that_of_its_axes(
    own: str, allowed: bool
) -> None:
    """In WKT 1 and 2, in PROJJSON with and without factors, in a string of PROJ."""
    base = 'GEOGCS["WGS 84",SPHEROID["x",6378137,298.25],UNIT["Degree",0.01745]]'
    angle = 'BASEGEOGCRS["x",ELLIPSOID["x",1,2,LENGTHUNIT["metre",1]],ANGLEUNIT["degree",0.01]]'
    given = {"conversion": {"parameters": [{"value": 9, "unit": "degree"}]}}
    for unit in (own, {"type": "LinearUnit", "name": own, "conversion_factor": 0.3}):
        axes = {"coordinate_system": {"axis": [{"name": "E", "unit": unit}]}}
        frames: list[Any] = [{"type": "ProjectedCRS", **given, **axes}]
        frames += [f'PROJCS["a",{base},PARAMETER["b",1],UNIT["{own}",1.0]]']
        frames += [f'PROJCRS["a",{angle},CS[Cartesian,2],AXIS["E",east,LENGTHUNIT["{own}",1]]]']
        frames += [f"+proj=lcc +datum=NAD83 +units={own} +no_defs"] * (" " not in own)
        for frame in frames:
            if allowed:
                assert len(obstacles_of({**polygon(SQUARE), "crs": frame})) == 1
            else:
                with pytest.raises(InputError, match=r"^crs = .*these are"):
                    obstacles_of({**polygon(SQUARE), "crs": frame})


def test_a_frame_of_geopandas_says_its_unit() -> None:
    """As pyproj describes the axes of a coordinate reference system."""
    shapes = shapely.GeometryCollection([box(0, 0, 1, 1)]).__geo_interface__
    for unit, allowed in (("metre", True), ("degree", False), ("US survey foot", False)):
        crs = SimpleNamespace(axis_info=[SimpleNamespace(unit_name=unit)] * 2)
        series = SimpleNamespace(__geo_interface__=shapes, crs=crs)
        if allowed:
            assert len(obstacles_of(series)) == 1
        else:
            with pytest.raises(InputError, match=unit):
                obstacles_of(series)


@pytest.mark.parametrize(
    "shape", [box(8.65, 49.87, 8.6508, 49.8705), box(0.001, 0.002, 0.0011, 0.0021)]
)
def test_what_is_as_small_or_as_far_away_as_degrees_is_doubted(shape: shapely.Geometry) -> None:
    with pytest.warns(InputWarning, match="are these degrees"):
        assert len(obstacles_of(shape)) == 1


def test_features_without_a_place_are_left_out_and_counted(tmp_path: Path) -> None:
    collection = {
        "type": "FeatureCollection",
        "features": [feature(None), feature(polygon(SQUARE), name="crate"), feature(polygon())],
    }
    (tmp_path / "lab.geojson").write_text(json.dumps(collection))
    with pytest.warns(InputWarning, match=r"lab\.geojson: features without a geometry .*: 2$"):
        (found,) = read_obstacles(tmp_path / "lab.geojson")
    assert found.name == "crate"


@pytest.mark.parametrize("seed", range(8))
def test_whatever_geos_calls_valid_is_read_and_nothing_is_lost(seed: int) -> None:
    """Holes that touch the outline, and each other, in points; differences, in any direction."""
    rng = np.random.default_rng(seed)
    whole: Any = box(0, 0, 1, 1)
    corner = rng.uniform(0.05, 0.3, (2, 2))
    whole = whole.difference(shapely.Polygon([(0, 0), corner[0], corner[1]]))
    middle = rng.uniform(0.45, 0.55, 2)
    for turn in rng.permutation(4)[:3]:
        wedge = middle + 0.2 * np.array([[np.cos(a), np.sin(a)] for a in 1.57 * turn + (0, 0.8)])
        whole = whole.difference(shapely.Polygon([middle, *wedge]))
    assert whole.is_valid
    pieces = [shapely.Polygon(each.corners_m) for each in obstacles_of(whole)]
    assert all(piece.is_valid for piece in pieces)
    assert shapely.union_all(pieces).symmetric_difference(whole).area < 1e-12


def test_names_differ_whatever_was_given() -> None:
    names = ["wall", "wall 1", "wall", "", "wall 2", "", "box"]
    found = obstacles_of([box(2 * i, 0, 2 * i + 1, 1) for i in range(7)], names)
    given = [each.name for each in found if each.name]
    assert len(set(given)) == len(given) == 5
    assert {"wall 1", "wall 2", "box"} <= set(given)
    many_lines = {**feature(polygon(SQUARE)), "properties": {"name": "a\r\n wall\t"}}
    assert obstacles_of(many_lines)[0].name == "a wall"


WRONG: list[tuple[Any, str, str]] = [
    ({"type": "Point", "coordinates": [0, 0]}, "type = 'Point'", "an obstacle is an area"),
    (feature({"type": "LineString", "coordinates": SQUARE}), "geometry.type", "'LineString'"),
    ({"features": []}, "type = None", "Polygon"),
    ({"type": "FeatureCollection", "features": []}, "features = []", "not empty"),
    (feature(None), "features = '1 without a geometry'", "at least one polygon"),
    ({"type": "Feature", "properties": {}}, "geometry = None", "a GeoJSON object"),
    (polygon([[0, 0], [1, 0]]), "coordinates.0", "at least three corners"),
    (polygon([[0, 0], [1, 1], [1, 0], [0, 1]]), "coordinates", "does not cross itself"),
    (polygon([[0, 0], [1, "x"], [1, 0]]), "coordinates.0", "points [x, y]"),
    (polygon([[0, 0], [1], [1, 0]]), "coordinates.0", "points [x, y]"),
    (polygon([["0", "0"], ["1", "1"], ["1", "0"]]), "coordinates.0", "points [x, y]"),
    (polygon([[0, 0], [179.9, 0], [180, 0.1]]), "coordinates.0 = 180.0", "degrees or millimetres"),
    (polygon([[0, 0], [1, float("nan")], [1, 0]]), "coordinates.0", "finite"),
    (polygon([[0, 0], [600, 0], [600, 400]]), "coordinates.0 = 600.0", "millimetres"),
    (polygon(SQUARE, [[x + 0.5, y] for x, y in HOLE]), "coordinates", "holes within the outline"),
    (polygon(SQUARE, [[x + 5, y] for x, y in HOLE]), "coordinates", "holes within the outline"),
    (polygon(SQUARE, HOLE, HOLE), "coordinates", "holes within the outline"),
    ({"type": "MultiPolygon", "coordinates": [[SQUARE], []]}, "coordinates.1", "not empty"),
]


@pytest.mark.parametrize(("document", "field", "words"), WRONG)
def test_what_is_no_proper_area_is_refused(document: Any, field: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        obstacles_of(document)
    assert str(caught.value).startswith(field)
    assert words in str(caught.value)


def test_errors_name_file_and_feature(tmp_path: Path) -> None:
    path = tmp_path / "lab.geojson"
    line = {"type": "LineString", "coordinates": SQUARE}
    collection = {
        "type": "FeatureCollection",
        "features": [feature(polygon(SQUARE)), feature(line)],
    }
    path.write_text(json.dumps(collection))
    with pytest.raises(InputError, match=r"lab\.geojson: features\.1\.geometry\.type"):
        read_obstacles(path)
    path.write_text("{")
    with pytest.raises(InputError, match=r"valid JSON \(Expecting"):
        read_obstacles(path)
    with pytest.raises(InputError, match=r"obstacles.*none\.geojson"):
        Problem(**changed(SCENARIO, "obstacles", "none.geojson"))
    with pytest.raises(InputError, match="names = 2"):
        obstacles_of([box(0, 0, 1, 1)], ["a", "b"])
