"""What a frame costs in Python beyond what it costs in Rust.

    python python/benches/overhead.py [FRAMES]

A loop over frames is timed, five turns at a time, without and with the touches read. The time in Rust (`Frame.compute_us`) is taken
from it; the difference is the overhead. It has in it what any loop does: the frame of the turn before is let go. No clock is read
between the turns, since that costs microseconds of its own where caches are cold. Three ways to frames:

- one by one: `frame = reconstructor.frame(values)`.
- fifty in a call: `for frame in reconstructor.frames(values)`.
- a recording of a hand: `for frame in skin.open("hand.mcap")`, those of its turns that have touches.

Five fingers, with noise, so that every frame is reconstructed anew; and the unpressed sheet, where nothing is computed.

The last line tells how cold the machine itself is. `hashlib` computes as long as a frame of five fingers, in a few kilobytes: it puts
nothing out of the caches. What a call of `math.sqrt` costs after it is not the doing of the sums.
"""

import hashlib
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

import skin

FINGERS = [(30.0, -20.0), (-35.0, 25.0), (10.0, 60.0), (-60.0, -30.0), (0.0, -5.0)]
NOISE = 1e-4
TOGETHER = 50
TURNS = 5

Blocks = np.ndarray


def blocks_us(frames: Iterable[skin.Frame], read: bool) -> Blocks:
    """Of each five turns of a loop, us a turn: in all, and of it in Rust; and how many touches the last one has, where they are read."""
    source = iter(frames)
    blocks: list[tuple[float, float, int]] = []
    while True:
        turns, rust_us = 0, 0.0
        touches: tuple[skin.Touch, ...] = ()
        begin = time.perf_counter_ns()
        if read:
            for frame in islice(source, TURNS):
                rust_us += frame.compute_us or 0.0
                touches = frame.touches
                turns += 1
        else:
            for frame in islice(source, TURNS):
                rust_us += frame.compute_us or 0.0
                turns += 1
        end = time.perf_counter_ns()
        if turns < TURNS:
            return np.array(blocks)
        blocks.append((1e-3 * (end - begin) / TURNS, rust_us / TURNS, len(touches)))


def measured(pressed: bool, count: int) -> tuple[skin.Reconstructor, list[np.ndarray]]:
    noise = np.random.default_rng(1)
    unpressed = skin.forward()
    values = skin.forward(touches=[(x, y, 10.0, 0.2) for x, y in FINGERS]) if pressed else unpressed
    baseline = unpressed * (1 + NOISE * noise.standard_normal((24, unpressed.size)))
    return skin.Reconstructor(baseline), list(values * (1 + NOISE * noise.standard_normal((count, values.size))))


def one_by_one(reconstructor: skin.Reconstructor, rows: list[np.ndarray], read: bool) -> Blocks:
    return blocks_us(map(reconstructor.frame, rows), read)


def together(reconstructor: skin.Reconstructor, rows: list[np.ndarray], read: bool) -> Blocks:
    """The same of frames that come fifty in a call: each bears its part of the call."""
    calls = []
    for first in range(0, len(rows), TOGETHER):
        values = np.array(rows[first : first + TOGETHER])
        begin = time.perf_counter_ns()
        frames = reconstructor.frames(values)
        call_us = 1e-3 * (time.perf_counter_ns() - begin) / len(frames)
        blocks = blocks_us(handed_over(frames), read)
        # Which frame took how long in Rust is not known of a part of the call.
        blocks[:, 0] += call_us
        blocks[:, 1] = np.mean(blocks[:, 1])
        calls.append(blocks)
    return np.concatenate(calls)


def handed_over(frames: list[skin.Frame]) -> Iterator[skin.Frame]:
    """The frames of a list, none of which is kept in it."""
    frames.reverse()
    while frames:
        yield frames.pop()


def say(name: str, blocks: Callable[[bool], Blocks]) -> None:
    plain, touched = blocks(False), blocks(True)
    if touched[:, 2].any():
        there = touched[:, 2] > 0
        plain, touched = plain[there], touched[there]
    over, read, rust = plain[:, 0] - plain[:, 1], touched[:, 0] - touched[:, 1], touched[:, 1]
    print(
        f"{name}: overhead {np.median(over):.1f} us a frame, {np.median(read):.1f} with its touches read"
        f" (95 %: {np.quantile(read, 0.95):.1f}), in Rust {np.median(rust):.0f}; {TURNS * len(touched)} frames"
    )


def sqrt_us(wait_us: float) -> float:
    """What a call of `math.sqrt` costs after so long a time in which hashlib computes, and Python does nothing."""
    begin = time.perf_counter_ns()
    hashlib.pbkdf2_hmac("sha256", b"skin", b"skin", 10_000)
    rounds = round(10_000 * wait_us / (1e-3 * (time.perf_counter_ns() - begin)))
    costs = []
    for _ in range(40):
        hashlib.pbkdf2_hmac("sha256", b"skin", b"skin", max(rounds, 1))
        begin = time.perf_counter_ns()
        math.sqrt(2.0)
        costs.append(1e-3 * (time.perf_counter_ns() - begin))
    return float(np.median(costs))


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rust_us = 0.0
    for name, pressed in (("unpressed", False), ("five fingers", True)):
        reconstructor, rows = measured(pressed, count)
        say(f"{name}, one by one", partial(one_by_one, reconstructor, rows))
        say(f"{name}, {TOGETHER} in a call", partial(together, reconstructor, rows))
        rust_us = reconstructor.frame(rows[0]).compute_us or 0.0
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "hand.mcap")
        program = [sys.executable, "-m", "skin", "record", file, "--scene", "hand", "--seconds", "9"]
        subprocess.run(program, check=True, capture_output=True)

        def recording(read: bool) -> Blocks:
            with skin.open(file) as frames:
                return blocks_us(frames, read)

        say("recording of a hand", recording)
    print(f"the machine: math.sqrt costs {sqrt_us(1.0):.2f} us, and {sqrt_us(rust_us):.2f} after {1e-3 * rust_us:.0f} ms of hashlib")


if __name__ == "__main__":
    main()
