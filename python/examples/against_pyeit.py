"""The same frames reconstructed by skin and by pyEIT: set-up, time of a frame, error of the place.

    pip install tactile-skin pyeit
    python python/examples/against_pyeit.py [FRAMES]

The frames are simulated by skin's finite elements, on a mesh that neither of the two has, with noise of 0.01 %. pyEIT gets them
in its own order, and has the settings of its example eit_dynamic_jac.py. The place in its picture is the middle of the cells above
half of the largest value.
"""

import sys
import time

import numpy as np
import pyeit.eit.jac as jac
import pyeit.eit.protocol as protocol
import pyeit.mesh as mesh

import skin

RADIUS_MM, DISC_MM, RISE, NOISE = 10.0, 97.5, 0.2, 1e-4


def simulated(frames: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, baseline and frames of single fingers, up to 75 mm from the middle."""
    random = np.random.default_rng(7)
    angle, radius = random.uniform(0, 2 * np.pi, frames), 75 * np.sqrt(random.uniform(0, 1, frames))
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    def noisy(values: np.ndarray) -> np.ndarray:
        return values * (1 + NOISE * random.standard_normal(values.shape))

    unpressed = skin.forward()
    baseline = noisy(np.tile(unpressed, (24, 1)))
    pressed = np.array([skin.forward(touches=[(x, y, RADIUS_MM, RISE)]) for x, y in places])
    return places, baseline, noisy(pressed)


def by_skin(baseline: np.ndarray, frames: np.ndarray) -> tuple[float, float, np.ndarray]:
    begin = time.perf_counter()
    reconstructor = skin.Reconstructor(baseline, order="pyeit")
    set_up_s = time.perf_counter() - begin
    times, found = [], []
    for values in frames:
        begin = time.perf_counter()
        touches = reconstructor.frame(values).touches
        times.append(time.perf_counter() - begin)
        found.append((touches[0].x_mm, touches[0].y_mm) if touches else (np.nan, np.nan))
    return set_up_s, float(np.median(times)), np.array(found)


def by_pyeit(baseline: np.ndarray, frames: np.ndarray) -> tuple[float, float, np.ndarray]:
    begin = time.perf_counter()
    model = mesh.create(16, h0=0.08)
    scan = protocol.create(16, dist_exc=1, step_meas=1, parser_meas="std")
    solver = jac.JAC(model, scan)
    solver.setup(p=0.5, lamb=0.01, method="kotre", perm=1, jac_normalized=True)
    set_up_s = time.perf_counter() - begin
    # Its first electrode is at -x, and the next ones follow clockwise.
    centres = model.node[model.element][:, :, :2].mean(axis=1) * [-DISC_MM, DISC_MM]
    before = baseline.mean(axis=0)
    times, found = [], []
    for values in frames:
        begin = time.perf_counter()
        picture = -np.real(solver.solve(values, before, normalize=True))
        high = picture > 0.5 * picture.max()
        place = (centres[high] * picture[high, None]).sum(axis=0) / picture[high].sum()
        times.append(time.perf_counter() - begin)
        found.append(place)
    return set_up_s, float(np.median(times)), np.array(found)


def main() -> None:
    places, baseline, frames = simulated(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
    for name, method in (("skin", by_skin), ("pyEIT", by_pyeit)):
        set_up_s, frame_s, found = method(baseline, frames)
        errors = np.hypot(*(found - places).T)
        missed = int(np.isnan(errors).sum())
        print(
            f"{name:5}  set-up {set_up_s:6.2f} s  frame {1e3 * frame_s:7.2f} ms  error median {np.nanmedian(errors):5.2f} mm, "
            f"largest {np.nanmax(errors):5.2f} mm  missed {missed} of {len(errors)}"
        )


if __name__ == "__main__":
    main()
