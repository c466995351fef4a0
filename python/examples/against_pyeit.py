"""The same frames reconstructed by skin and by three methods of pyEIT: set-up, time of a frame, error of the place, as a table.

    pip install tactile-skin pyeit
    python python/examples/against_pyeit.py [FRAMES [NOISE]]

The frames are single fingers, simulated by skin's finite elements on a mesh that none of the methods has, with noise of 0.01 % of each
value unless NOISE says otherwise. pyEIT gets them in its own order, and has the settings of its own examples. The place in its pictures
is the middle of the cells above half of the largest value. Times are of the processor, on one thread.
"""

import os

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

import importlib.metadata
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pyeit.eit.bp as bp
import pyeit.eit.greit as greit
import pyeit.eit.jac as jac
import pyeit.eit.protocol as protocol
import pyeit.mesh as mesh

import skin

RADIUS_MM, DISC_MM, RISE = 10.0, 97.5, 0.2


def simulated(frames: int, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, baseline and frames of single fingers, up to 75 mm from the middle."""
    random = np.random.default_rng(7)
    angle, radius = random.uniform(0, 2 * np.pi, frames), 75 * np.sqrt(random.uniform(0, 1, frames))
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    def noisy(values: np.ndarray) -> np.ndarray:
        return values * (1 + noise * random.standard_normal(values.shape))

    unpressed = skin.forward()
    baseline = noisy(np.tile(unpressed, (24, 1)))
    pressed = np.array([skin.forward(touches=[(x, y, RADIUS_MM, RISE)]) for x, y in places])
    return places, baseline, noisy(pressed)


def by_skin(baseline: np.ndarray) -> Callable[[np.ndarray], tuple[float, float]]:
    reconstructor = skin.Reconstructor(baseline, order="pyeit")

    def place(values: np.ndarray) -> tuple[float, float]:
        touches = reconstructor.frame(values).touches
        return (touches[0].x_mm, touches[0].y_mm) if touches else (np.nan, np.nan)

    return place


def by_pyeit(baseline: np.ndarray, method: str) -> Callable[[np.ndarray], tuple[float, float]]:
    model = mesh.create(16, h0=0.08)
    scan = protocol.create(16, dist_exc=1, step_meas=1, parser_meas="std")
    solver: Any
    if method == "JAC":
        solver = jac.JAC(model, scan)
        solver.setup(p=0.5, lamb=0.01, method="kotre", perm=1, jac_normalized=True)
        cells = model.node[model.element][:, :, :2].mean(axis=1)
    elif method == "GREIT":
        solver = greit.GREIT(model, scan)
        solver.setup(p=0.5, lamb=0.01, perm=1, jac_normalized=True)
        cells = np.stack([solver.xg.ravel(), solver.yg.ravel()], axis=1)
    else:
        solver = bp.BP(model, scan)
        solver.setup(weight="none")
        cells = model.node[:, :2]
    inside = np.hypot(*cells.T) <= 1.0
    # Its first electrode is at -x, and the next ones follow clockwise.
    cells = cells * [-DISC_MM, DISC_MM]
    before = baseline.mean(axis=0)

    def place(values: np.ndarray) -> tuple[float, float]:
        picture = np.where(inside, -np.real(solver.solve(values, before, normalize=True)).ravel(), -np.inf)
        high = picture > 0.5 * picture.max()
        x_mm, y_mm = (cells[high] * picture[high, None]).sum(axis=0) / picture[high].sum()
        return float(x_mm), float(y_mm)

    return place


def main() -> None:
    places, baseline, frames = simulated(
        int(sys.argv[1]) if len(sys.argv) > 1 else 50, float(sys.argv[2]) if len(sys.argv) > 2 else 1e-4
    )
    methods: list[tuple[str, Callable[[np.ndarray], Callable[[np.ndarray], tuple[float, float]]]]] = [("skin", by_skin)]
    methods += [(f"pyEIT {name}", lambda b, n=name: by_pyeit(b, n)) for name in ("JAC", "GREIT", "BP")]  # type: ignore[misc]
    print(f"{len(frames)} frames; pyEIT {importlib.metadata.version('pyeit')}, NumPy {np.__version__}\n")
    print("| method | set-up, s | a frame, ms | error of the place: median, 95 %, largest, mm | missed |\n|---|---|---|---|---|")
    for name, method in methods:
        begin = time.process_time()
        place = method(baseline)
        set_up_s = time.process_time() - begin
        times, found = [], []
        for values in frames:
            begin = time.process_time()
            found.append(place(values))
            times.append(time.process_time() - begin)
        errors = np.hypot(*(np.array(found) - places).T)
        median, high, largest = np.nanquantile(errors, [0.5, 0.95, 1.0])
        print(
            f"| {name} | {set_up_s:.2f} | {1e3 * float(np.median(times)):.2f} | {median:.2f}, {high:.2f}, {largest:.2f} "
            f"| {int(np.isnan(errors).sum())} of {len(errors)} |"
        )


if __name__ == "__main__":
    main()
