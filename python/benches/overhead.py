"""What a frame costs in Python beyond what it costs in Rust.

    python python/benches/overhead.py [FRAMES]

The time in Rust (`Frame.compute_us`) is taken from the time of a turn of a loop over frames; the difference is the overhead, without
and with its touches read. The frame of the turn before is let go in it, as in any loop. Three ways to frames:

- one by one: `frame = reconstructor.frame(values)`. After a frame's sums the processor's caches hold nothing of Python.
- fifty in a call: `for frame in reconstructor.frames(values)`.
- a recording of a hand: `for frame in skin.open("hand.mcap")`, those of its frames that have touches.

Five fingers, with noise, so that every frame is reconstructed anew; and the unpressed sheet, where nothing is computed.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import skin

FINGERS = [(30.0, -20.0), (-35.0, 25.0), (10.0, 60.0), (-60.0, -30.0), (0.0, -5.0)]
NOISE = 1e-4
TOGETHER = 50


def turns_us(frames: Iterable[skin.Frame]) -> np.ndarray:
    """Of each turn of a loop, us: until the frame was there, until its touches were read, of these its time in Rust; and its touches."""
    turns = []
    begin = time.perf_counter_ns()
    for frame in frames:
        there = time.perf_counter_ns()
        touches = frame.touches
        read = time.perf_counter_ns()
        turns.append((1e-3 * (there - begin), 1e-3 * (read - begin), frame.compute_us or 0.0, len(touches)))
        begin = time.perf_counter_ns()
    return np.array(turns)


def measured(pressed: bool, count: int) -> tuple[skin.Reconstructor, list[np.ndarray]]:
    noise = np.random.default_rng(1)
    unpressed = skin.forward()
    values = skin.forward(touches=[(x, y, 10.0, 0.2) for x, y in FINGERS]) if pressed else unpressed
    baseline = unpressed * (1 + NOISE * noise.standard_normal((24, unpressed.size)))
    return skin.Reconstructor(baseline), list(values * (1 + NOISE * noise.standard_normal((count, values.size))))


def together(reconstructor: skin.Reconstructor, rows: list[np.ndarray]) -> np.ndarray:
    """The same of frames that come fifty in a call: each bears its part of the call."""
    calls = []
    for first in range(0, len(rows), TOGETHER):
        values = np.array(rows[first : first + TOGETHER])
        begin = time.perf_counter_ns()
        frames = reconstructor.frames(values)
        call_us = 1e-3 * (time.perf_counter_ns() - begin) / len(frames)
        calls.append(turns_us(frames) + [call_us, call_us, 0.0, 0.0])
        # Which frame took how long in Rust is not known of a part of the call.
        calls[-1][:, 2] = calls[-1][:, 2].mean()
    return np.concatenate(calls)


def say(name: str, turns: np.ndarray) -> None:
    there, read, rust, _ = turns.T
    print(
        f"{name}: overhead {np.median(there - rust):.1f} us a frame, {np.median(read - rust):.1f} with its touches read"
        f" (95 %: {np.quantile(read - rust, 0.95):.1f}), in Rust {np.median(rust):.0f}; {len(turns)} frames"
    )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for name, pressed in (("unpressed", False), ("five fingers", True)):
        reconstructor, rows = measured(pressed, count)
        say(f"{name}, one by one", turns_us(map(reconstructor.frame, rows)))
        say(f"{name}, {TOGETHER} in a call", together(reconstructor, rows))
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "hand.mcap")
        program = [sys.executable, "-m", "skin", "record", file, "--scene", "hand", "--seconds", "9"]
        subprocess.run(program, check=True, capture_output=True)
        with skin.open(file) as frames:
            turns = turns_us(frames)
    say("recording of a hand", turns[turns[:, 3] > 0])


if __name__ == "__main__":
    main()
