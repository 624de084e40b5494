"""Curvature from photographs: segments of known curvature, and pictures that show none."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from PIL import Image

from benchmarks.files.photographs import (
    LENGTH_M,
    SCALE_M,
    camera,
    draw,
    photograph,
    save,
    write_folder,
)
from twosra_mpc import InputError, InputWarning
from twosra_mpc.lab.figures.experiment_figures import plot_curvature
from twosra_mpc.lab.photographs.arc import Arc, fit_arc
from twosra_mpc.lab.photographs.picture import Camera, find_segment, pictures_in, read_photograph
from twosra_mpc.lab.photographs.published_steps import published_curvature
from twosra_mpc.lab.photographs.study import (
    COLUMNS,
    deviation,
    estimate_folder,
    load_cycles,
    read_references,
    save_estimates,
)
from twosra_mpc.robot.coordinates import Array

MOST = 60.0  # 1/m
CURVATURES = [-45.0, -20.0, 0.5, 25.0, 50.0]
OPTIONS = ("--scale", str(SCALE_M), "--length", str(LENGTH_M), "--towards", "39,35")


def fit(grey: Array, towards: tuple[float, float]) -> Arc:
    seen, how = photograph(grey), camera(towards)
    return fit_arc(seen, find_segment(seen, how), how)


@pytest.fixture(scope="module")
def drawn() -> tuple[Array, list[Arc]]:
    """Curvatures drawn at random, in pictures of three blurs and two noises, and arcs fitted."""
    rng = np.random.default_rng(11)
    truth, found = [], []
    for number in range(60):
        kappa = float(rng.uniform(-MOST, MOST))
        grey, end = draw(
            rng,
            kappa,
            heading=float(rng.uniform(0, 2 * np.pi)),
            blur_px=(0.6, 0.8, 1.0)[number % 3],
            noise=(2.0, 4.0)[number % 2],
            middle=(35 + float(rng.uniform(-0.5, 0.5)), 35 + float(rng.uniform(-0.5, 0.5))),
        )
        truth.append(kappa)
        found.append(fit(grey, end))
    return np.array(truth), found


def test_the_arc_is_within_1_5_per_metre(drawn: tuple[Array, list[Arc]]) -> None:
    truth, found = drawn
    off = np.array([arc.curvature_per_m for arc in found]) - truth
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert abs(off @ truth) / (truth @ truth) < 0.015  # not drawn to straight, nor from it


def test_standard_errors_cover(drawn: tuple[Array, list[Arc]]) -> None:
    truth, found = drawn
    off = np.array([arc.curvature_per_m for arc in found]) - truth
    errors = np.array([arc.standard_error_per_m for arc in found])
    assert 0.90 <= np.mean(np.abs(off) < 1.96 * errors) <= 0.98


def test_arcs_are_called_arcs(drawn: tuple[Array, list[Arc]]) -> None:
    assert np.mean([not arc.fits for arc in drawn[1]]) <= 0.05


def test_what_is_no_arc_is_found_out() -> None:
    rng, along = np.random.default_rng(3), np.linspace(-1.0, 1.0, 801)
    bent = [draw(rng, 0.0, bend=60.0 * along**1, heading=h) for h in np.linspace(0.0, 3.0, 8)]
    assert not any(fit(*one).fits for one in bent)


def test_the_slightly_bent_are_not_called_straight() -> None:
    rng = np.random.default_rng(4)
    truth = np.linspace(-4.0, 4.0, 9)
    found = [fit(*draw(rng, kappa)) for kappa in truth.tolist()]
    slope = np.polyfit(truth, [arc.curvature_per_m for arc in found], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.15)


def test_followed_the_other_way_it_turns_the_other_way() -> None:
    grey, (x, y) = draw(np.random.default_rng(1), 30.0)
    there, back = fit(grey, (x, y)), fit(grey, (70 - x, 70 - y))
    assert there.curvature_per_m == pytest.approx(-back.curvature_per_m)
    assert there.curvature_per_m > 0


def test_the_published_steps_are_near_and_repeat_to_the_bit() -> None:
    rng = np.random.default_rng(2)
    for kappa in (25.0, -50.0):
        grey, end = draw(rng, kappa, heading=np.pi / 2)
        seen, how = photograph(grey), camera(end)
        region = find_segment(seen, how)
        one, two = (published_curvature(seen, region, how) for _ in range(2))
        assert (one.mean_per_m, one.spread_per_m) == (two.mean_per_m, two.spread_per_m)
        assert one.mean_per_m == pytest.approx(abs(kappa), rel=0.2)
        assert one.spread_per_m > 0
        assert one.known > 0.8


def test_along_a_row_the_published_steps_know_little_and_the_arc_all() -> None:
    row = np.full((70, 70), 12.0)
    row[34:37, 30:39] = 250.0
    seen, how = photograph(row), camera((39.0, 35.0))
    found = published_curvature(seen, find_segment(seen, how), how)
    assert found.known < 0.5
    assert abs(fit(row, (39.0, 35.0)).curvature_per_m) < 0.5


def test_without_scikit_image_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skimage", None)
    seen, how = photograph(ONE), camera((40.0, 35.0))
    with pytest.raises(InputError, match="vision"):
        published_curvature(seen, find_segment(seen, how), how)


def test_half_the_pixels_are_half_the_scale() -> None:
    grey, (x, y) = draw(np.random.default_rng(6), 40.0, noise=0.0)
    twice = np.kron(grey, np.ones((2, 2)))
    seen = photograph(twice)
    how = Camera(scale_m=SCALE_M / 2, length_m=LENGTH_M, towards_px=(2 * x, 2 * y))
    found = fit_arc(seen, find_segment(seen, how), how)
    assert found.curvature_per_m == pytest.approx(40.0, abs=1.5)


EMPTY, (ONE, _) = np.full((70, 70), 12.0), draw(np.random.default_rng(0), 10.0)


@pytest.mark.parametrize(
    ("grey", "words"),
    [
        (EMPTY, "there is none"),
        (np.maximum(ONE, np.roll(ONE, 20, axis=0)), "there are 2"),
        (np.roll(ONE, 32, axis=1), "cut off at the border"),
        (np.kron(ONE, np.ones((3, 3))), "mm long"),
        (np.where(ONE > 250, ONE, 12.0), "mm long"),
        (12.0 + 240.0 * (np.hypot(*(np.mgrid[:70, :70] - 35)) < 3.5), "as wide as long"),
    ],
)
def test_pictures_without_one_whole_segment_are_refused(grey: Array, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fit(grey, (40.0, 35.0))


def test_a_scale_is_positive() -> None:
    for scale_m, length_m, field in ((0.0, 0.04, "scale_m"), (0.01, -1.0, "length_m")):
        with pytest.raises(InputError, match=field):
            Camera(scale_m=scale_m, length_m=length_m, towards_px=(0.0, 0.0))


def test_no_image_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "shot.png").write_text("not an image")
    with pytest.raises(InputError, match=r"shot\.png"):
        read_photograph(tmp_path / "shot.png")
    Image.fromarray(np.zeros((9, 9), dtype=np.uint16)).save(tmp_path / "deep.png")
    with pytest.raises(InputError, match="8 bits"):
        read_photograph(tmp_path / "deep.png")
    for folder in (tmp_path / "none", tmp_path / "shot.png"):
        with pytest.raises(InputError, match="folder"):
            pictures_in(folder)


def test_one_picture_of_a_file_is_taken_and_none_that_is_hidden(tmp_path: Path) -> None:
    """A Mac leaves a file ``._shot.png`` beside each that it copies."""
    (tmp_path / "._shot.png").write_text("no picture")
    save(grey := draw(np.random.default_rng(1), 20.0)[0], whole := tmp_path / "shot.png")
    assert pictures_in(tmp_path) == [whole]
    pages = [Image.fromarray(page.astype(np.uint8)) for page in (grey, 255.0 - grey)]
    pages[0].save(several := tmp_path / "shots.tif", save_all=True, append_images=pages[1:])
    with pytest.warns(InputWarning, match="several pictures"):
        found = read_photograph(several)
    assert found.grey.tolist() == read_photograph(whole).grey.tolist()


PICTURES = [Path("a/shot-0.png"), Path("a/shot-2.png")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,k2\n0,1\n", "column k1 = 'missing'"),
        ("k1,k1\n0,1\n", "column k1 = 'given twice'"),
        ("k1\n1\n2\nx\n", "k1, row 2 = 'x'"),
        ("k1\n1\n2\nnan\n", "k1, row 2 = 'nan'"),
        ("k1\n1\n2\n", "shot-2.png"),
        ("picture,k1\nshot-0.png,1\n", "shot-2.png"),
        ("picture,k1\nshot-0.png,1\nshot-0.png,1\n", "picture, row 1"),
        ("picture,picture,k1\nshot-0.png,1,1\n", "column picture"),
    ],
)
def test_references_that_are_none_are_refused_by_row(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "references.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_references(path, "k1", PICTURES)
    assert caught.value.source == str(path)


def test_references_are_found_by_row_or_by_name(tmp_path: Path) -> None:
    path = tmp_path / "references.csv"
    path.write_text("k1\n1\n2\n3\n")
    assert read_references(path, "k1", PICTURES).tolist() == [1.0, 3.0]
    path.write_text("picture,k1\nshot-2.png,7\nother.png,x\nshot-0.png,5\n")
    assert read_references(path, "k1", PICTURES).tolist() == [5.0, 7.0]


def test_repeats_are_cut_at_rest_and_averaged() -> None:
    reference = 60 * np.tile(np.sin(np.linspace(0, np.pi, 26, endpoint=False)), 4)
    assert [part.start for part in load_cycles(reference)] == [0, 27, 53, 79]
    errors = np.repeat([6.0, -6.0, 6.0, -6.0], [27, 26, 26, 25])
    found = deviation([(reference + errors, reference)])
    assert (found.pictures, found.cycles) == (104, 4)
    assert found.mse_per_m2 == pytest.approx(36.0)
    assert found.cycle_mse_per_m2 == pytest.approx(0.0, abs=1e-20)


def test_a_folder_is_measured_and_written(tmp_path: Path) -> None:
    end = write_folder(tmp_path / "shots", CURVATURES)
    save(EMPTY, tmp_path / "shots" / "shot-005.png")
    done: list[int] = []
    found = estimate_folder(tmp_path / "shots", camera(end), tell=lambda n, _: done.append(n))
    assert done == [1, 2, 3, 4, 5, 6]
    assert [each.arc_per_m for each in found[:5]] == pytest.approx(CURVATURES, abs=3.0)
    assert "there is none" in found[5].refused
    save_estimates(found, tmp_path / "found.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "found.csv").read_text())))
    assert tuple(rows[0]) == COLUMNS
    assert [row["picture"] for row in rows] == [f"shot-{n:03d}.png" for n in range(6)]
    assert float(rows[4]["arc_per_m"]) == pytest.approx(found[4].arc_per_m, rel=1e-5)
    assert (rows[5]["arc_per_m"], rows[0]["refused"]) == ("", "")
    figure = plot_curvature(found, camera(end))
    titles = [ax.get_title() for ax in figure.axes]
    assert titles[:4] == ["Photograph", "Contour", "Medial line", "Fitted arc"]


def test_the_command_compares_and_draws(run_as_is: Run, tmp_path: Path) -> None:
    write_folder(tmp_path / "shots", CURVATURES)
    (tmp_path / "camera.csv").write_text("k1\n" + "".join(f"{k}\n" for k in CURVATURES))
    (tmp_path / "each").mkdir()
    code, out, err = run_as_is(
        *("estimate-curvature", "shots", *OPTIONS, "--reference", "camera.csv", "--column", "k1"),
        *("--csv", "found.csv", "--plot", "found.png", "--figures", "each", "--json"),
    )
    assert code == 0, err
    document = json.loads(out)
    assert document["deviations"]["arc"]["mse_per_m2"] < 4.0
    assert document["refused"] == 0
    assert (tmp_path / "found.png").stat().st_size > 0
    assert len(list((tmp_path / "each").glob("*.png"))) == len(CURVATURES)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scale", "0", "--length", "0.04", "--towards", "39,35"), "scale_m"),
        ((*OPTIONS[:-1], "39"), "towards"),
        ((*OPTIONS, "--reference", "camera.csv"), "column kappa_per_m"),
        ((*OPTIONS, "--figures", "nowhere"), "figures"),
    ],
)
def test_bad_input_writes_nothing(
    run_as_is: Run, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    write_folder(tmp_path / "shots", [20.0])
    (tmp_path / "camera.csv").write_text("k1\n20\n")
    code, _, err = run_as_is("estimate-curvature", "shots", *options, "--csv", "found.csv")
    assert code == 2
    assert words in err
    assert not (tmp_path / "found.csv").exists()


def test_a_file_that_is_no_image_stops_the_folder(run_as_is: Run, tmp_path: Path) -> None:
    write_folder(tmp_path / "shots", [20.0])
    (tmp_path / "shots" / "shot-001.png").write_text("no image")
    code, _, err = run_as_is("estimate-curvature", "shots", *OPTIONS, "--csv", "found.csv")
    assert code == 2
    assert "shot-001.png" in err
    assert not (tmp_path / "found.csv").exists()
