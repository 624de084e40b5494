"""``twosra simulate-heater`` and its figure."""

from __future__ import annotations

import inspect
import json
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from matplotlib import rcParams
from thermal_problems import UNEQUAL

from twosra_mpc import cli
from twosra_mpc.control.stiffness_controller import StiffnessController, stiffness_controller
from twosra_mpc.control.thermistor import temperature_sensor
from twosra_mpc.lab.bench.heater_loop import HeaterRun, simulate_heater
from twosra_mpc.lab.commands.heater_command import simulate_heater_command
from twosra_mpc.lab.figures.heating_figures import plot_heater
from twosra_mpc.robot.description import load_robot, segment_model

# --- the figure ----------------------------------------------------------------------------------


def melted(name: str, ambient_C: float) -> tuple[HeaterRun, StiffnessController]:
    """A melt and a freeze of a robot's segment, and the controller that made it."""
    robot = load_robot(name)
    controller = stiffness_controller(robot, ambient_C, 0)
    plant, sensor = segment_model(robot, ambient_C, 0), temperature_sensor(robot, ambient_C, 0)
    profile = [(0.0, "soft"), (80.0, "rigid")]
    return simulate_heater(plant, sensor, controller, profile, 400.0, step_s=0.2), controller


def test_the_figure_shows_the_run() -> None:
    run, controller = melted("2sra-v1", 25.0)
    before = dict(rcParams)
    figure = plot_heater(run, controller, "2sra-v1")
    assert dict(rcParams) == before
    bars, temperature, melt, current = figure.axes
    drawn = {str(line.get_label()): line.get_ydata() for line in temperature.lines}
    np.testing.assert_array_equal(drawn["segment"], run.temperature_C)
    np.testing.assert_array_equal(drawn["by the sensor"], run.measured_C)
    thresholds = {
        "soft above 63.2 °C": 63.2,
        "rigid below 58.5 °C": 58.5,
        "melting point 61 °C": 61,
    }
    for name, height in thresholds.items():
        assert list(drawn[name]) == pytest.approx([height, height])
    np.testing.assert_array_equal(melt.lines[0].get_ydata(), run.melt_fraction)
    np.testing.assert_array_equal(current.lines[0].get_ydata(), run.current_A)
    reported = [bar for bar in bars.patches if bar.get_y() < 0.5]
    starts = sorted(bar.get_x() for bar in reported)
    assert starts == pytest.approx([0.0, *(event.time_s for event in run.events)])


def test_a_segment_without_a_melting_point_has_no_line_for_it() -> None:
    run, controller = melted("2sr-v2", 22.6)
    temperature = plot_heater(run, controller, "2sr-v2").axes[1]
    assert not any("melting point" in str(line.get_label()) for line in temperature.lines)


# --- the command ---------------------------------------------------------------------------------


class Printed(NamedTuple):
    """What a run of the program left behind; output with its white space made single."""

    code: object
    out: str
    err: str


@pytest.fixture
def twosra(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Callable[[str], Printed]]:
    """Run the program in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)

    monkeypatch.setenv("COLUMNS", "300")  # workers of a test run have terminals of 80

    def run(arguments: str) -> Printed:
        with pytest.raises(SystemExit) as caught:
            cli.main(arguments.split())
        captured = capsys.readouterr()
        return Printed(
            caught.value.code, " ".join(captured.out.split()), " ".join(captured.err.split())
        )

    yield run
    signal.signal(signal.SIGTERM, before)


def test_the_command_sums_up_and_writes(twosra: Callable[[str], Printed], tmp_path: Path) -> None:
    code, out, err = twosra(
        "simulate-heater --profile soft:80,rigid:300 --out run.csv --plot run.png"
    )
    assert (code, err) == (0, "")
    assert "soft 0 s to 80 s 62." in out
    assert "rigid 80 s to 380 s" in out
    assert [out.count(word) for word in ("changing", "soft", "rigid")] == [2, 2, 2]
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 3802


def test_every_example_of_the_help_runs(twosra: Callable[[str], Printed]) -> None:
    text = inspect.cleandoc(simulate_heater_command.help or "")
    examples = [line.strip() for line in text.splitlines() if line.startswith("  twosra ")]
    assert len(examples) == 3
    for example in examples:
        assert twosra(example.removeprefix("twosra ")).code == 0


def test_a_warm_segment_melts_sooner(twosra: Callable[[str], Printed]) -> None:
    cold = twosra("simulate-heater --profile soft:90")
    warm = twosra("simulate-heater --profile soft:90 --start-temperature 55 --ambient 20")
    assert "90 s 62." in cold.out
    assert "90 s 4" in warm.out


def test_a_segment_melts_in_its_own_time(twosra: Callable[[str], Printed], tmp_path: Path) -> None:
    path = tmp_path / "unequal.json"
    path.write_text(json.dumps(UNEQUAL.model_dump(mode="json")), encoding="utf-8")
    melts = []
    for segment in (1, 2, 3):
        answer = twosra(f"simulate-heater --robot {path} --segment {segment} --json")
        melts.append(json.loads(answer.out)["stretches"][0]["changed_s"])
    assert melts == sorted(set(melts))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--profile melt:3", "profile.0 = 'melt:3' is not acceptable; allowed: soft:SECONDS"),
        ("--profile soft:60,rigid", "profile.1 = '' is not acceptable; allowed: a positive number"),
        ("--profile soft:-1", "profile.0 = '-1' is not acceptable"),
        ("--profile soft:nan", "profile.0 = 'nan' is not acceptable"),
        ("--ambient 70", "ambient_C = 70.0 is not acceptable"),
        ("--start-temperature 200", "start_temperature_C = 200.0 is not acceptable"),
        ("--segment 3", "segment = 3 is not acceptable; allowed: from 1 to 2"),
        ("--robot no-such", "robot = 'no-such' is not acceptable"),
        ("--out no/such/folder.csv", "output = 'no/such/folder.csv' is not acceptable"),
        ("--plot run.docx", "output = 'run.docx' is not acceptable"),
    ],
)
def test_bad_input_is_named(twosra: Callable[[str], Printed], arguments: str, message: str) -> None:
    code, out, err = twosra(f"simulate-heater {arguments}")
    assert (code, out) == (2, "")
    assert message in err
