"""Touches as sets of points [dx, dy, dz, Fx, Fy, Fz] in the frame of the robot's link, as policies learned with LeRobot take them.

    pip install tactile-skin
    python python/examples/point_set.py FILE.npz [SOURCE] [--frames N] [--points N] [--position X Y Z] [--rpy ROLL PITCH YAW]

For every frame and touch the file has, as float32 and NaN where there is no touch:

- `observation.tactile`, shape (frames, points, 6): displacement of the touch since it came down, m, and force on the link, N.
- `observation.tactile.position`, shape (frames, points, 3): where it is, m.
- `timestamp`, shape (frames,): s.

`features` says so as JSON, with names and units. The skin measures where it is pressed and how hard. It knows neither how deep it is
pressed nor how it is sheared: in its own frame dz, Fx and Fy are 0, and `unknown` says so. A turned link mixes zeros with the rest.
A touch is a row as long as it keeps its number; a new touch takes the lowest free row.
"""

import argparse
import json
from collections.abc import Iterable
from itertools import islice

import numpy as np
from numpy.typing import NDArray

import skin

NAMES = ["dx", "dy", "dz", "Fx", "Fy", "Fz"]
UNKNOWN = "shear forces (Fx, Fy) and indentation (dz) in the skin's own frame are not measured and are 0"


def rotation(roll_deg: float, pitch_deg: float, yaw_deg: float) -> NDArray[np.float64]:
    """From the skin's frame to the link's: about the fixed x, then y, then z axis, as URDF has it and skins.toml's place."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles := np.radians([roll_deg, pitch_deg, yaw_deg])), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def point_sets(
    frames: Iterable[skin.Frame], points: int, position_mm: NDArray[np.float64], turn: NDArray[np.float64]
) -> dict[str, NDArray[np.float32]]:
    """The arrays of frames."""
    sets, places, times = [], [], []
    rows: dict[int, int] = {}
    began: dict[int, NDArray[np.float64]] = {}
    for frame in frames:
        tactile, where = np.full((points, 6), np.nan), np.full((points, 3), np.nan)
        touches = {touch.id: touch for touch in frame.touches if touch.id is not None}
        rows = {number: row for number, row in rows.items() if number in touches}
        for number, touch in touches.items():
            free = [row for row in range(points) if row not in rows.values()]
            if number not in rows and not free:
                continue  # More touches than points: the weakest are listed last.
            row = rows.setdefault(number, free[0] if free else 0)
            place = np.array([touch.x_mm, touch.y_mm, 0.0])
            displacement = place - began.setdefault(number, place)
            # It presses into the skin, whose normal is z.
            force = np.array([0.0, 0.0, np.nan if touch.force_n is None else -touch.force_n])
            tactile[row] = np.concatenate([turn @ (1e-3 * displacement), turn @ force])
            where[row] = 1e-3 * (position_mm + turn @ place)
        sets.append(tactile)
        places.append(where)
        times.append(np.nan if frame.time_s is None else frame.time_s)
    return {
        "observation.tactile": np.array(sets, dtype=np.float32).reshape(-1, points, 6),
        "observation.tactile.position": np.array(places, dtype=np.float32).reshape(-1, points, 3),
        "timestamp": np.array(times, dtype=np.float32),
    }


def features(points: int) -> dict[str, object]:
    """What the arrays are, as a data set's info.json has it."""
    return {
        "observation.tactile": {
            "dtype": "float32",
            "shape": [points, 6],
            "names": NAMES,
            "units": ["m"] * 3 + ["N"] * 3,
            "unknown": UNKNOWN,
        },
        "observation.tactile.position": {"dtype": "float32", "shape": [points, 3], "names": ["x", "y", "z"], "units": ["m"] * 3},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", metavar="FILE.npz")
    arguments.add_argument("source", nargs="?", help="a port, tcp://HOST:PORT or a recording; none: the simulated skin")
    arguments.add_argument("--frames", type=int, default=500)
    arguments.add_argument("--points", type=int, default=5)
    arguments.add_argument("--position", type=float, nargs=3, default=[0.0, 0.0, 0.0], metavar="MM")
    arguments.add_argument("--rpy", type=float, nargs=3, default=[0.0, 0.0, 0.0], metavar="DEG")
    asked = arguments.parse_args()
    turn = rotation(*asked.rpy)
    with skin.open(asked.source, simulate=asked.source is None) as frames:
        arrays = point_sets(islice(frames, asked.frames), asked.points, np.array(asked.position), turn)
    np.savez_compressed(asked.file, features=json.dumps(features(asked.points)), **arrays)  # type: ignore[arg-type]
    touched = int(np.isfinite(arrays["observation.tactile"][:, :, 0]).any(axis=1).sum())
    print(f"{asked.file}: {len(arrays['timestamp'])} frames, {touched} of them touched")


if __name__ == "__main__":
    main()
