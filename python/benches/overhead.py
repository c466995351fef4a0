"""What a frame costs in Python beyond what it costs in Rust.

    python python/benches/overhead.py [FRAMES]

Every frame is timed in Rust (`Frame.compute_us`) and around the call in Python; the difference is the overhead. Frames of a hand of
five fingers, with noise, so that every one is reconstructed anew; and of the unpressed sheet, where nothing is computed.
"""

import sys
import time

import numpy as np

import skin

FINGERS = [(30.0, -20.0), (-35.0, 25.0), (10.0, 60.0), (-60.0, -30.0), (0.0, -5.0)]
NOISE = 1e-4


def overheads_us(pressed: bool, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Overhead and time in Rust of every frame."""
    noise = np.random.default_rng(1)
    unpressed = skin.forward()
    values = skin.forward(touches=[(x, y, 10.0, 0.2) for x, y in FINGERS]) if pressed else unpressed
    baseline = unpressed * (1 + NOISE * noise.standard_normal((24, unpressed.size)))
    reconstructor = skin.Reconstructor(baseline)
    measured = values * (1 + NOISE * noise.standard_normal((frames, values.size)))
    overheads, rust = [], []
    for frame_values in measured:
        begin = time.perf_counter_ns()
        frame = reconstructor.frame(frame_values)
        touches, image = frame.touches, frame.image
        taken_us = 1e-3 * (time.perf_counter_ns() - begin)
        assert frame.compute_us is not None and image.size and len(touches) <= len(FINGERS)
        overheads.append(taken_us - frame.compute_us)
        rust.append(frame.compute_us)
    return np.array(overheads), np.array(rust)


def main() -> None:
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for name, pressed in (("unpressed", False), ("five fingers", True)):
        overhead, rust = overheads_us(pressed, frames)
        median, high = np.quantile(overhead, [0.5, 0.95])
        print(f"{name}: overhead {median:.1f} us a frame (95 %: {high:.1f} us), in Rust {np.median(rust):.0f} us; {frames} frames")


if __name__ == "__main__":
    main()
