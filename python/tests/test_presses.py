"""Calibration from presses at known places, on frames of `skin dataset`."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import skin

SCENES = """
frames_per_sheet = 40
seed = 5
[sheet]
contact_mm = { log_uniform = [0.3, 3.0] }
electrode_off_mm = { normal = [0.0, 2.0] }
[touch]
radius_mm = { uniform = [10.0, 12.0] }
rise = { uniform = [0.2, 0.3] }
rim_mm = 5.0
"""
LEARNED = 20


class Presses:
    def __init__(self, folder: Path) -> None:
        (folder / "scenes.toml").write_text(SCENES, encoding="utf-8")
        command = ["--scenes", str(folder / "scenes.toml"), "--count", "40", "--out", str(folder), "--format", "npz"]
        subprocess.run([sys.executable, "-m", "skin", "dataset", *command], check=True, capture_output=True, timeout=300)
        with np.load(folder / "shard-00000.npz") as shard:
            self.values = shard["values_v"]
            self.places = np.stack([shard["x_mm"], shard["y_mm"]], axis=1)
            self.unpressed = shard["baseline_v"].mean(axis=0)
            self.measurements = shard["measurements"]


@pytest.fixture(scope="module")
def presses(tmp_path_factory: pytest.TempPathFactory) -> Presses:
    return Presses(tmp_path_factory.mktemp("presses"))


@pytest.fixture(scope="module")
def calibration(presses: Presses) -> skin.PressCalibration:
    return skin.calibrate_presses(presses.values[:LEARNED], presses.places[:LEARNED], presses.unpressed)


def places(located: list[skin.Presses]) -> np.ndarray:
    return np.array([(frame.presses[0].x_mm, frame.presses[0].y_mm) for frame in located])


def test_presses_that_were_not_learned_from_are_located(presses: Presses, calibration: skin.PressCalibration) -> None:
    assert np.array_equal(presses.measurements, skin.Sheet.paper().measurements)
    located = calibration.locate(presses.values[LEARNED:], presses.unpressed)
    errors = np.hypot(*(places(located) - presses.places[LEARNED:]).T)
    # As far as it says itself of presses like these; a median of ten is within three times that of the others.
    assert np.median(errors) < 3 * calibration.error_mm
    assert calibration.presses == LEARNED and calibration.error_mm < 10
    assert calibration.explained is not None and calibration.explained > 0.8
    assert calibration.error_95th_percentile_mm is not None
    assert calibration.error_95th_percentile_mm > calibration.error_mm
    for frame in located:
        assert len(frame.presses) == 1 and 0.5 < frame.presses[0].strength < 2
        assert 0 < frame.presses[0].x_sd_mm < 20 and frame.explained > 0.8


def test_nothing_pressed_is_no_press(presses: Presses, calibration: skin.PressCalibration) -> None:
    (frame,) = calibration.locate(presses.unpressed, presses.unpressed)
    assert frame.presses == ()


def test_changes_are_what_frames_with_one_before_each_are(presses: Presses, calibration: skin.PressCalibration) -> None:
    before = np.tile(presses.unpressed, (LEARNED, 1))
    changes = presses.values[:LEARNED] - before
    rest = presses.values[LEARNED:] - presses.unpressed
    located = calibration.locate(rest)
    for other in (
        skin.calibrate_presses(presses.values[:LEARNED], presses.places[:LEARNED], before),
        skin.calibrate_presses(changes, presses.places[:LEARNED]),
    ):
        assert np.array_equal(places(other.locate(rest)), places(located))


def test_a_file_locates_the_same(presses: Presses, calibration: skin.PressCalibration, tmp_path: Path) -> None:
    file = tmp_path / "skin.cal"
    calibration.save(file)
    again = skin.PressCalibration.load(file)
    rest = presses.values[LEARNED:]
    assert np.array_equal(
        places(again.locate(rest, presses.unpressed)), places(calibration.locate(rest, presses.unpressed))
    )
    assert again.presses == LEARNED and again.explained is None
    assert np.array_equal(again.measurements, skin.Sheet.paper().measurements)
    # pyEIT's order is that of the sheet's own measurements.
    pyeit = again.locate(rest, presses.unpressed, order="pyeit")
    assert np.array_equal(places(pyeit), places(again.locate(rest, presses.unpressed)))
    with skin.open(simulate=True, calibration=file) as frames:
        assert next(frames).values.shape == (208,)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda p: skin.calibrate_presses(p.values[:3], p.places[:3], p.unpressed), "3 presses are too few"),
        (lambda p: skin.calibrate_presses(p.values, p.places[:5], p.unpressed), "5 places for 40 pressed frames"),
        (lambda p: skin.calibrate_presses(p.values, p.values, p.unpressed), "give x and y of each"),
        (lambda p: skin.calibrate_presses(p.values, p.places, p.unpressed[:9]), "unpressed: 9 values a frame"),
        (lambda p: skin.calibrate_presses(p.values, p.places, p.values[:7]), "unpressed: 7 frames for 40 pressed ones"),
        (lambda p: skin.calibrate_presses(p.values, 0 * p.places, p.unpressed), "spread them over the sheet"),
        (lambda p: skin.calibrate_presses(0 * p.values, p.places), "change nothing that can be measured"),
        (lambda p: skin.calibrate_presses(p.values[:, :9], p.places), "9 values a frame, but the sheet's measurements"),
        (lambda p: skin.PressCalibration.load("/nowhere/skin.cal"), "/nowhere/skin.cal"),
    ],
)
def test_what_is_wrong_is_said(presses: Presses, call: object, words: str) -> None:
    assert callable(call)
    with pytest.raises(skin.SkinError) as error:
        call(presses)
    assert words in str(error.value)
