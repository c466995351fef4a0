"""What a frame costs in Python beyond what it costs in Rust.

    python python/benches/overhead.py [FRAMES]

Every frame is timed in Rust (`Frame.compute_us`) and around the call in Python; the difference is the overhead. Frames of a hand of
five fingers, with noise, so that every one is reconstructed anew; and of the unpressed sheet, where nothing is computed. They are
handed over in one call (`frames`), fifty at a time, or one by one (`frame`): then the interpreter is called when the frame's
sums have driven it out of the processor's caches.
"""

import sys
import time

import numpy as np

import skin

FINGERS = [(30.0, -20.0), (-35.0, 25.0), (10.0, 60.0), (-60.0, -30.0), (0.0, -5.0)]
NOISE = 1e-4
TOGETHER = 50


def overheads_us(pressed: bool, count: int, together: int) -> tuple[np.ndarray, np.ndarray]:
    """Overhead and time in Rust of a frame, for every call with so many together."""
    noise = np.random.default_rng(1)
    unpressed = skin.forward()
    values = skin.forward(touches=[(x, y, 10.0, 0.2) for x, y in FINGERS]) if pressed else unpressed
    baseline = unpressed * (1 + NOISE * noise.standard_normal((24, unpressed.size)))
    reconstructor = skin.Reconstructor(baseline)
    measured = values * (1 + NOISE * noise.standard_normal((count, values.size)))
    overheads, rust = [], []
    for call in np.split(measured, range(together, count, together)):
        frames: list[skin.Frame] = []
        # Who asks for frames takes touches and picture of each.
        if together == 1:
            begin = time.perf_counter_ns()
            frame = reconstructor.frame(call)
            touches, image = frame.touches, frame.image
            taken_us = 1e-3 * (time.perf_counter_ns() - begin)
            frames.append(frame)
        else:
            begin = time.perf_counter_ns()
            for frame in reconstructor.frames(call):
                touches, image = frame.touches, frame.image
                frames.append(frame)
            taken_us = 1e-3 * (time.perf_counter_ns() - begin)
        assert image.size and len(touches) <= len(FINGERS)
        in_rust_us = sum(frame.compute_us or 0.0 for frame in frames)
        overheads.append((taken_us - in_rust_us) / len(call))
        rust.append(in_rust_us / len(call))
    return np.array(overheads), np.array(rust)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for name, pressed in (("unpressed", False), ("five fingers", True)):
        for how, together in (("one by one", 1), (f"{TOGETHER} in a call", TOGETHER)):
            overhead, rust = overheads_us(pressed, count, together)
            median, high = np.quantile(overhead, [0.5, 0.95])
            print(
                f"{name}, {how}: overhead {median:.1f} us a frame (95 % of the calls: {high:.1f} us), in Rust {np.median(rust):.0f} us;"
                f" {count} frames"
            )


if __name__ == "__main__":
    main()
