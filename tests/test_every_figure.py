"""Every figure: words do not lie on each other, and of curves that are equal both are seen."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from unittest.mock import patch

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from once import simulated, solved

from twosra_mpc import Disc, Obstacle, Plan, load_problem, plan
from twosra_mpc.lab.figures import plot_comparison, plot_error_decrease, plot_forward_kinematics
from twosra_mpc.plans.branches import Branch, Policy
from twosra_mpc.plotting import figures, plot_plan, plot_run
from twosra_mpc.plotting.playback import plan_playback
from twosra_mpc.plotting.scene import Scene

RIM_PT, TOUCHING = 0.09, 2.0  # by which a line is wider than that over it; room about letters

FAR = Obstacle(name="a name " * 12, disc=Disc(x_m=0.4, y_m=0.4, radius_m=0.05))
BRANCHES = tuple(Branch(0.3, 3, "splits by more than 4 %", 2.0, ((1, 0),), s) for s in (600, 650))
MISSED = Policy("mean", 530.0, 403.0, BRANCHES, 500.0, 420.0)
Made = Callable[[str], Plan]


def films(made: Plan) -> Iterator[Figure]:
    """Pictures of a film, one after the other in the same figure."""
    scene = Scene(plan_playback(made), ("robot", "done"), 10.0)
    for row in range(0, 1001, 500):
        scene.show(row)
        yield scene.figure


def one(figure: Figure) -> Iterator[Figure]:
    yield figure


def run_of(scenario: str) -> Figure:
    simulation = simulated(scenario, 2)
    return plot_run(simulation.run, simulation.truth)


FIGURES: dict[str, Callable[[Made], Iterator[Figure]]] = {
    "plan": lambda made: one(plot_plan(made("paper-1"), policy=MISSED)),
    "three segments": lambda made: one(plot_plan(made("three-segments"))),
    "mission": lambda made: one(plot_plan(made("pick-and-place"))),
    "among obstacles": lambda made: one(plot_plan(made("scattered"))),
    "long name": lambda _: one(plot_plan(plan(load_problem("rigid-move", obstacles=[FAR])))),  # type: ignore[arg-type]
    "film": lambda made: films(made("paper-1")),
    "film of a mission": lambda made: films(made("pick-and-place")),
    "comparison": lambda made: one(plot_comparison({"both": [made("paper-1"), made("paper-2")]})),
    "run": lambda made: one(run_of("paper-2")),
    "error": lambda made: one(plot_error_decrease()),
    "kinematics": lambda made: one(plot_forward_kinematics()),
}


@pytest.mark.parametrize("name", FIGURES)
def test_words_and_curves_of_every_figure_are_seen(name: str) -> None:
    for figure in FIGURES[name](lambda scenario: solved(scenario).require()):
        drawn = drawn_words(figure)
        for (words, box), (others, place) in itertools.combinations(drawn, 2):
            assert not box.overlaps(place), f"{words!r} lies on {others!r}"
        for words, box in drawn:
            assert figure.bbox.count_contains(box.corners()) == 4, f"{words!r} is cut off"
        for ax in figure.axes:
            for under, over in itertools.combinations(curves(ax), 2):
                assert are_told_apart(under, over), (ax.get_ylabel(), under, over)


def drawn_words(figure: Figure) -> list[tuple[str, Bbox]]:
    """Words that are drawn, and the places that are seen of them."""
    found: dict[Text, Bbox] = {}
    draw = Text.draw

    def noted(words: Text, renderer: RendererAgg) -> None:
        box: Bbox | None = words.get_window_extent(renderer).padded(-TOUCHING)
        if words.get_clip_on() and (seen := words.get_clip_box()) is not None:
            box = Bbox.intersection(box, Bbox(seen.get_points()))
        if words.get_visible() and words.get_text().strip() and box is not None:
            found[words] = box
        draw(words, renderer)

    figure.draw_without_rendering()  # puts everything in its place
    with patch.object(Text, "draw", noted):
        figure.draw_without_rendering()
    return [(words.get_text(), box) for words, box in found.items()]


def curves(ax: Axes) -> list[Line2D]:
    """Curves over time, that which lies lowest first; not what is yet to come, pale."""
    if ax.get_aspect() != "auto":
        return []
    long = [
        each for each in ax.lines if len(each.get_xdata()) > 2 and each.get_linestyle() != "None"
    ]
    opaque = [each for each in long if each.get_alpha() is None]
    return sorted(opaque, key=Line2D.get_zorder)


def are_told_apart(under: Line2D, over: Line2D) -> bool:
    """Both are seen where they are equal: a rim of one, and another colour or gaps of the other."""
    differ = not np.allclose(to_rgb(under.get_color()), to_rgb(over.get_color()))
    gaps = over.get_gapcolor() is not None
    return under.get_linewidth() > over.get_linewidth() + RIM_PT and (differ or gaps)


def test_curves_of_one_look_are_not_told_apart() -> None:
    first, second = (Line2D([], [], **figures.segment_curve(j)) for j in (0, 1))
    assert are_told_apart(first, second)
    assert not are_told_apart(second, first)
    assert not are_told_apart(first, first)
    assert are_told_apart(first, Line2D([], [], **figures.segment_curve(0, "--")))
