"""Frames as they come: of the simulated skin, of recordings, of ports that are none."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import skin

SKIN = [sys.executable, "-m", "skin"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("recording") / "touches.mcap"
    command = [*SKIN, "record", str(file), "--scene", "one-touch", "--seconds", "5"]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return file


def numbers(touch: skin.Touch) -> list[float]:
    given = [touch.x_sd_mm, touch.y_sd_mm, touch.area_sd_mm2, touch.total_sd_mm2, touch.force_n]
    own = [touch.x_mm, touch.y_mm, touch.rise, touch.area_mm2, touch.total_mm2]
    return own + [number for number in given if number is not None]


# While it is tared something touches it.
@pytest.mark.filterwarnings("ignore::skin.SkinWarning")
def test_the_simulated_skin_is_touched() -> None:
    with skin.open(simulate=True) as frames:
        assert frames.name == "simulated skin" and not frames.closed
        last = -1.0
        seen = False
        for frame in frames:
            assert frame.values.shape == (208,) and frame.values.dtype == np.float64
            assert np.isfinite(frame.values).all()
            assert frame.time_s is not None and frame.time_s > last
            last = frame.time_s
            assert all(np.isfinite(numbers(touch)).all() for touch in frame.touches)
            # The demo's first finger comes down at (-30, 20) mm. At first there is little to tell where, and it is said how little.
            for touch in (touch for touch in frame.touches if touch.id is not None and not seen):
                assert touch.x_sd_mm is not None and touch.y_sd_mm is not None
                assert np.hypot((touch.x_mm + 30) / touch.x_sd_mm, (touch.y_mm - 20) / touch.y_sd_mm) < 5
                seen = True
            if any(touch.rise > 0.1 for touch in frame.touches):
                break
        (touch,) = frame.touches
        assert seen and np.hypot(touch.x_mm + 30, touch.y_mm - 20) < 3
        assert touch.force_n is not None and touch.force_n > 0 and touch.uncalibrated
        frames.tare()
        # A baseline is made of 24 frames at least.
        assert next(frames).sequence > frame.sequence + 24
    assert frames.closed
    assert list(frames) == []
    frames.close()
    with pytest.raises(skin.SkinError, match="closed"):
        frames.tare()


def test_a_calibration_that_is_stored_for_the_board_is_used(tmp_path: Path) -> None:
    # As `skin calibrate` stores it: by the serial number, which of a simulated board is sim.
    file = tmp_path / "calibration-sim.toml"
    file.write_text("delayed_ratio = 0.3333\ntau_s = 5.0\nunit_rise_mpa = 0.2546\nexponent = 1.0\nforce_sd_n = 0.1\n")
    with skin.open(simulate=True, state_dir=tmp_path) as frames, pytest.warns(skin.SkinWarning, match="stored for this board: the rubber"):
        touch = next(touch for frame in frames for touch in frame.touches)
    assert touch.force_n is not None and not touch.uncalibrated
    with skin.open(simulate=True, state_dir=tmp_path, calibration="none") as frames:
        assert next(touch for frame in frames for touch in frame.touches).uncalibrated


def test_every_frame_of_a_scene() -> None:
    with skin.open(scene="hand", every_frame=True) as frames:
        sequences = [frame.sequence for frame in islice(frames, 50)]
    assert np.array_equal(np.diff(sequences), np.ones(49))


def test_a_recording_has_what_was_shown(recording: Path) -> None:
    kept = skin.load(recording)
    frames, values = kept.values.shape
    assert values == 208 and len(kept) == frames == len(kept.times_s) == len(kept.touches) == len(kept.sequences)
    assert (np.diff(kept.times_s) > 0).all() and kept.times_s[0] == 0
    assert len(kept.baseline) >= 24
    shown = [k for k, touches in enumerate(kept.touches) if touches is not None]
    assert shown and not set(kept.baseline.tolist()) & set(shown)
    with skin.open(recording) as played:
        again = list(played)
    assert [frame.sequence for frame in again] == kept.sequences[shown].tolist()
    assert [frame.touches for frame in again] == [kept.touches[k] for k in shown]
    assert all(np.array_equal(frame.values, kept.values[k]) for frame, k in zip(again, shown, strict=True))
    assert any(frame.touches for frame in again)
    # Nothing is waited for: the time is that of the sums.
    assert all(frame.compute_us is not None and frame.compute_us > 0 for frame in again)


def test_what_cannot_be_made_at_first_is_not_lost(recording: Path) -> None:
    # Without NumPy, as of a broken environment. Then it can be had.
    code = """import sys, skin
with skin.open(sys.argv[1]) as frames:
    frame = next(frame for frame in frames if frame.touches)
sys.modules["numpy"] = None
for name in ("values", "image"):
    try:
        getattr(frame, name)
        print("made")
    except ImportError:
        print("none")
del sys.modules["numpy"]
import numpy as np
print(frame.sequence, frame.values.shape, frame.image.shape, float(np.nanmax(frame.image)), *frame.values)
"""
    command = [sys.executable, "-c", code, str(recording)]
    said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout
    assert said.startswith("none\nnone\n")
    with skin.open(recording) as played:
        frame = next(frame for frame in played if frame.touches)
    expected = [frame.sequence, frame.values.shape, frame.image.shape, float(np.nanmax(frame.image)), *frame.values.tolist()]
    assert said.splitlines()[2] == " ".join(map(str, expected))


def test_a_recording_can_be_reconstructed_anew(recording: Path) -> None:
    kept = skin.load(recording)
    # Where it presses most.
    totals = [sum(touch.total_mm2 for touch in touches or ()) for touches in kept.touches]
    most = int(np.argmax(totals))
    (frame,) = skin.reconstruct(kept.values[most], kept.values[kept.baseline], sheet=kept.sheet)
    then = kept.touches[most]
    assert then is not None
    assert len(frame.touches) == len(then) == 1
    assert np.hypot(frame.touches[0].x_mm - then[0].x_mm, frame.touches[0].y_mm - then[0].y_mm) < 1


def test_a_recording_says_its_options_itself(recording: Path) -> None:
    with pytest.raises(skin.SkinError, match="leave sheet out"):
        skin.open(recording, sheet=skin.Sheet.paper())
    with skin.open(recording) as played, pytest.raises(skin.SkinError, match="baselines are those"):
        played.tare()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"source": "/nowhere/port"}, "/nowhere/port"),
        ({"source": "/nowhere/touches.mcap"}, "/nowhere/touches.mcap"),
        ({"source": "/nowhere/port", "simulate": True}, "exclude one another"),
        ({"simulate": True, "baseline_frames": 1}, "2 or more"),
        ({"simulate": True, "plan": "nonsense"}, "no plan of this name"),
        ({"simulate": True, "wires": [1, 2, 3]}, "each of the 16 once"),
        ({"scene": "nonsense"}, "nonsense"),
        ({"scene": "hand", "sheet": skin.Sheet.paper()}, "its own sheet"),
    ],
)
def test_what_cannot_be_opened_is_said(options: dict[str, object], words: str) -> None:
    with pytest.raises(skin.SkinError) as error:
        skin.open(**options)  # type: ignore[arg-type]
    assert words in str(error.value)


def test_python_goes_on_while_a_board_is_waited_for() -> None:
    heard = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def listen() -> None:
            board, _ = server.accept()
            if board.recv(1):
                heard.set()
            board.close()

        thread = threading.Thread(target=listen)
        thread.start()
        with pytest.raises(skin.SkinError):
            skin.open(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        assert heard.is_set()
        thread.join()


def test_frames_that_nobody_takes_are_lost_and_counted_and_it_is_no_cable() -> None:
    # While a baseline is taken the link keeps 256 frames, and the port those of a second. What comes then is lost.
    kept = 256 + 2 * 115
    with skin.open(simulate=True) as frames, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        before = next(frames)
        frames.tare()
        # Lost frames are said again after 10 s.
        time.sleep(12)
        already = len(said)
        # With the frame after those that were kept it is known how many are lost.
        for frame in islice(frames, 60):
            lost = [text for text in (str(warning.message) for warning in said[already:]) if "lost" in text]
            if lost:
                break
            before = frame
    (text,) = lost
    told = re.match(r"(\d+) of (\d+) frames are lost: they were read too late", text)
    assert told is not None, text
    count, of = map(int, told.groups())
    passed = frame.sequence - before.sequence
    # The board's numbers say the same. A machine that is busy simulates fewer frames than 115 a second.
    assert 50 < count < of <= passed and passed - count <= kept


def test_threads_share_the_frames_and_one_may_close() -> None:
    frames = skin.open(simulate=True, every_frame=True)
    seen: list[int] = []
    enough = threading.Event()

    def take() -> None:
        for frame in frames:
            seen.append(frame.sequence)
            if len(seen) > 60:
                enough.set()

    threads = [threading.Thread(target=take) for _ in range(3)]
    for thread in threads:
        thread.start()
    assert enough.wait(timeout=60)
    frames.close()
    for thread in threads:
        thread.join(timeout=60)
        assert not thread.is_alive()
    assert len(seen) == len(set(seen))
    assert set(np.diff(sorted(seen)).tolist()) == {1}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_is_told_apart() -> None:
    with skin.open(simulate=True) as frames:
        next(frames)
        child = os.fork()
        if child == 0:
            try:
                next(frames)
            except skin.SkinError as error:
                frames.close()
                del frames
                os._exit(7 if "forked" in str(error) else 8)
            finally:
                os._exit(9)
        _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) == 7
        # The parent's goes on.
        assert next(frames).values.shape == (208,)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_a_loop() -> None:
    code = "import skin\nwith skin.open(simulate=True) as frames:\n    next(frames)\n    print('ready', flush=True)\n    list(frames)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGINT)
        assert b"KeyboardInterrupt" in process.stderr.read()
        assert process.wait(timeout=60) != 0
