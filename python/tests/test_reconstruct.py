"""Frames of a simulated sheet, and of whatever hardware, to touches."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import skin

PLACES = [(30.0, -20.0), (0.0, 0.0), (-61.5, 14.0), (10.0, 70.0)]
RADIUS_MM, RISE = 12.5, 0.2


@pytest.fixture(scope="module")
def unpressed() -> np.ndarray:
    return skin.forward()


@pytest.fixture(scope="module")
def pressed() -> np.ndarray:
    return np.array([skin.forward(touches=[(x, y, RADIUS_MM, RISE)]) for x, y in PLACES])


def places(frames: list[skin.Frame]) -> np.ndarray:
    return np.array([[(touch.x_mm, touch.y_mm) for touch in frame.touches] for frame in frames])


def test_a_touch_is_found_where_it_presses(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    frames = skin.reconstruct(pressed, unpressed)
    assert [len(frame.touches) for frame in frames] == [1] * len(PLACES)
    assert np.abs(places(frames)[:, 0] - PLACES).max() < 0.3
    for frame in frames:
        (touch,) = frame.touches
        assert touch.total_mm2 == pytest.approx(np.pi * RADIUS_MM**2 * RISE, rel=0.03)
        assert touch.x_sd_mm is not None and 0 < touch.x_sd_mm < 1
        # A pair or two whose reciprocals differ by the error of the mesh may be left out.
        assert frame.changed and frame.doubt is None and 200 <= frame.used <= 208


def test_what_was_found_presses_the_same_again(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    (frame,) = skin.reconstruct(pressed[0], unpressed)
    again = skin.forward(touches=frame.touches)
    change, error = pressed[0] - unpressed, again - pressed[0]
    assert np.linalg.norm(error) < 0.02 * np.linalg.norm(change)


def test_an_unpressed_sheet_has_no_touches(unpressed: np.ndarray) -> None:
    (frame,) = skin.reconstruct(unpressed, unpressed)
    assert frame.touches == () and not frame.changed
    assert frame.sequence == 0 and frame.time_s is None


def test_the_picture_is_the_sheet(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    (frame,) = skin.reconstruct(pressed[0], unpressed)
    left, right, bottom, top = frame.extent_mm
    rows, columns = frame.image.shape
    x = left + (np.arange(columns) + 0.5) * (right - left) / columns
    y = bottom + (np.arange(rows) + 0.5) * (top - bottom) / rows
    radius = np.hypot(x[None, :], y[:, None])
    assert np.isfinite(frame.image[radius < 97]).all()
    assert np.isnan(frame.image[radius > 98]).all()
    # Row 0 is the lowest, and what rises most is under the touch.
    row, column = np.unravel_index(np.nanargmax(frame.image), frame.image.shape)
    assert np.hypot(x[column] - PLACES[0][0], y[row] - PLACES[0][1]) < RADIUS_MM


def test_arrays_are_the_memory_that_rust_filled(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    (frame,) = skin.reconstruct(pressed[0], unpressed)
    assert frame.values is frame.values and frame.image is frame.image and frame.touches is frame.touches
    for array in (frame.values, frame.image):
        # NumPy did not take memory of its own.
        assert not array.flags.owndata and array.base is not None and array.flags.c_contiguous


def rotated(sheet: skin.Sheet) -> np.ndarray:
    """For every value whose sense pairs begin at the drive pair, as of pyEIT's fmmu, its place among the sheet's own."""
    drive, sense = sheet.measurements[:, 0] - 1, sheet.measurements[:, 2] - 1
    return np.lexsort(((sense - drive) % sheet.electrodes, drive))


def test_an_order_is_only_an_order(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    own = places(skin.reconstruct(pressed, unpressed))
    plain: list[Literal["pyeit", "adjacent16", "eidors"]] = ["pyeit", "adjacent16", "eidors"]
    for order in plain:
        assert np.array_equal(places(skin.reconstruct(pressed, unpressed, order=order)), own)
    turn = rotated(skin.Sheet.paper())
    assert not np.array_equal(turn, np.arange(208))
    turned: list[Literal["pyeit-fmmu", "eidors-rotated"]] = ["pyeit-fmmu", "eidors-rotated"]
    for name in turned:
        found = places(skin.reconstruct(pressed[:, turn], unpressed[turn], order=name))
        # Rounding may decide whether a pair takes part.
        assert np.abs(found - own).max() < 0.01


def test_values_of_driven_electrodes_are_passed_over(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    sheet = skin.Sheet.paper()
    drive, sense = sheet.measurements[:, 0] - 1, sheet.measurements[:, 2] - 1

    def whole(frame: np.ndarray) -> np.ndarray:
        full = np.full(256, 17.0)
        full[16 * drive + sense] = frame
        return full

    own = skin.reconstruct(pressed[1], unpressed)
    found = skin.reconstruct(whole(pressed[1]), whole(unpressed), order="eidors")
    assert found[0].touches == own[0].touches
    assert found[0].values.shape == (256,)


def test_it_does_not_matter_how_an_array_lies_in_memory(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    own = [frame.touches for frame in skin.reconstruct(pressed, unpressed)]
    wide = np.zeros((len(PLACES), 416))
    wide[:, ::2] = pressed
    for laid in (np.asfortranarray(pressed), wide[:, ::2], pressed.tolist(), pressed.astype(">f8")):
        assert [frame.touches for frame in skin.reconstruct(laid, unpressed)] == own


def test_of_complex_values_the_magnitudes_are_taken(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    turn = np.exp(0.4j)
    found = places(skin.reconstruct(turn * pressed, turn * unpressed))
    # Rounding may decide whether a pair takes part.
    assert np.abs(found - places(skin.reconstruct(pressed, unpressed))).max() < 0.01


def test_a_missing_value_is_done_without(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    holed = pressed[0].copy()
    holed[[3, 77]] = np.nan, np.inf
    (frame,) = skin.reconstruct(holed, unpressed)
    (touch,) = frame.touches
    assert np.hypot(touch.x_mm - PLACES[0][0], touch.y_mm - PLACES[0][1]) < 0.5
    assert 200 <= frame.used <= 206


def test_one_by_one_or_all_together(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    one, other = skin.Reconstructor(unpressed, frame_s=0.1), skin.Reconstructor(unpressed, frame_s=0.1)
    together = one.frames(pressed)
    single = [other.frame(values) for values in pressed]
    assert [frame.touches for frame in together] == [frame.touches for frame in single]
    assert [frame.sequence for frame in single] == [0, 1, 2, 3]
    assert [frame.time_s for frame in single] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert np.abs(one.electrodes_mm - skin.Sheet.paper().electrodes_mm).max() < 0.5


def test_threads_that_ask_a_frame_at_once_get_the_same_objects(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    reconstructor = skin.Reconstructor(unpressed)
    for values in pressed:
        frame = reconstructor.frame(values)
        start = threading.Barrier(4)
        got: list[tuple[object, object, object]] = []

        def ask(frame: skin.Frame = frame, start: threading.Barrier = start, got: list[tuple[object, object, object]] = got) -> None:
            start.wait()
            got.append((frame.touches, frame.image, frame.values))

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(got) == 4 and all(one is other for objects in got for one, other in zip(objects, got[0], strict=True))
        assert len(frame.touches) == 1 and np.array_equal(frame.values, values)


def test_threads_find_what_one_finds(unpressed: np.ndarray, pressed: np.ndarray) -> None:
    alone = skin.reconstruct(pressed, unpressed)
    found: list[list[skin.Frame]] = []
    threads = [
        threading.Thread(target=lambda: found.append(skin.reconstruct(pressed, unpressed))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    assert all([f.touches for f in frames] == [f.touches for f in alone] for frames in found)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_many_frames_in_one_call() -> None:
    # Of a pressed sheet with noise, none of them the last one's. Python itself looks for signals only when the call is over.
    code = """import numpy as np, skin, time
unpressed, pressed = skin.forward(), skin.forward(touches=[(30.0, -20.0, 12.5, 0.2)])
reconstructor = skin.Reconstructor(unpressed)
values = pressed * (1 + 1e-4 * np.random.default_rng(1).standard_normal((10_000, pressed.size)))
began = time.monotonic()
reconstructor.frames(values[:200])
whole_s = 50 * (time.monotonic() - began)
began = time.monotonic()
try:
    print("ready", flush=True)
    reconstructor.frames(values)
except KeyboardInterrupt:
    print((time.monotonic() - began) / whole_s)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGINT)
        part, said = process.communicate()
        assert float(part) < 0.5, said


def test_another_sheet(tmp_path: Path) -> None:
    sheet = skin.Sheet.disc(100.0, 32, 3.0, contact_mm=0.5)
    assert sheet.electrodes == 32 and sheet.measurements.shape == (32 * 29, 4)
    assert sheet.electrodes_mm[0] == pytest.approx([50, 0], abs=0.1)
    assert np.hypot(*sheet.outline_mm.T) == pytest.approx(np.full(len(sheet.outline_mm), 50.0), rel=1e-3)
    file = tmp_path / "sheet.toml"
    file.write_text(sheet.text, encoding="utf-8")
    assert skin.Sheet.load(file) == sheet == skin.Sheet.parse(sheet.text)
    assert sheet != skin.Sheet.paper()
    frame = skin.forward(sheet, [(-20.0, 10.0, 6.0, 0.3)])
    (found,) = skin.reconstruct(frame, skin.forward(sheet), sheet=sheet, order="pyeit")
    (touch,) = found.touches
    assert np.hypot(touch.x_mm + 20, touch.y_mm - 10) < 0.3


def test_ohms_law(unpressed: np.ndarray) -> None:
    # Reciprocity: drive and sense exchanged give the same transfer impedance, which goes with the sheet resistance.
    ohm = skin.forward(drive="current")
    pairs = skin.Sheet.paper().measurements
    place = {tuple(row): k for k, row in enumerate(pairs.tolist())}
    back = [place[c, d, a, b] for a, b, c, d in pairs.tolist()]
    assert ohm == pytest.approx(ohm[back], rel=1e-9)
    twice = skin.Sheet.disc(195.0, 16, 10.0, sheet_resistance_ohm=2000.0)
    assert skin.forward(twice, drive="current") == pytest.approx(2 * ohm, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda v: skin.reconstruct(v[:100], v), "the baseline has 208"),
        (lambda v: skin.reconstruct(v, v[:100]), "100 values a frame, but the sheet's measurements are 208"),
        (lambda v: skin.reconstruct(v, v, order="pyEIT"), "choose adjacent16, pyeit"),  # type: ignore[arg-type]
        (lambda v: skin.reconstruct(v[:207], v[:207], order="pyeit"), "the order pyeit has N(N-3)"),
        (lambda v: skin.reconstruct(np.ones(40), np.ones(40), order="pyeit"), "of 8 electrodes, but the sheet has 16"),
        (lambda v: skin.reconstruct(v, np.nan * v), "it holds no value"),
        (lambda v: skin.reconstruct([], v), "no values in it"),
        (lambda v: skin.reconstruct(np.ones((2, 2, 208)), v), "an array of 3 axes"),
        (lambda v: skin.reconstruct(v, v, method="magic"), "choose nnls"),  # type: ignore[arg-type]
        (lambda v: skin.reconstruct(v, v, rise="sideways"), "up, down and either"),  # type: ignore[arg-type]
        (lambda v: skin.reconstruct(v, v, drive="steam"), "choose voltage or current"),  # type: ignore[arg-type]
        (lambda v: skin.reconstruct(v, v, frame_s=0.0), "a time in seconds above 0"),
        (lambda v: skin.Reconstructor(v).frame([v, v]), "several frames"),
        (lambda v: skin.forward(touches=[(0.0, 0.0, -1.0, 0.2)]), "a radius greater than 0"),
        (lambda v: skin.forward(touches=[(0.0, 0.0, 5.0, -1.0)]), "a relative rise greater than -1"),
        (lambda v: skin.Sheet.disc(-1.0, 16, 10.0), "positive"),
        (lambda v: skin.Sheet.disc(195.0, 1000, 0.1), "at most 256"),
        (lambda v: skin.Sheet.load("/nowhere/sheet.toml"), "/nowhere/sheet.toml: cannot be read"),
        (lambda v: skin.Sheet.parse("outline = 3"), "outline"),
        (lambda v: skin.load("/nowhere/x.mcap"), "/nowhere/x.mcap"),
    ],
)
def test_what_is_wrong_is_said(unpressed: np.ndarray, call: object, words: str) -> None:
    assert callable(call)
    with pytest.raises(skin.SkinError) as error:
        call(unpressed)
    assert words in str(error.value)


def test_what_is_no_number_is_a_type_or_value_error(unpressed: np.ndarray) -> None:
    with pytest.raises((TypeError, ValueError)):
        skin.reconstruct("touch", unpressed)
    with pytest.raises(TypeError):
        skin.forward(touches=[(1.0, 2.0)])  # type: ignore[list-item]
    with pytest.raises(AttributeError):
        skin.Sheet.paper().electrodes = 3  # type: ignore[misc]
