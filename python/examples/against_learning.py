"""A learned regressor against skin's reconstruction, on the same frames.

    pip install tactile-skin scikit-learn
    python python/examples/against_learning.py [FRAMES]

`skin dataset` makes frames of single touches on one sheet. A multi-layer perceptron of scikit-learn learns the place from the relative
changes of the values. Both are asked for the places of other frames of that sheet, whose touches were solved by finite elements and
not by the multiple scattering that made the frames to learn from. skin gets the baseline and nothing else; it has not seen the sheet.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.compose import TransformedTargetRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import skin

TESTED = 200
SCENES = """
seed = {seed}
frames_per_sheet = {frames}
physics = "{physics}"
[touch]
count = [0, 1]
radius_mm = {{ uniform = [6.0, 16.0] }}
rise = {{ log_uniform = [0.05, 0.6] }}
rim_mm = 3.0
[board.electronics]
noise_codes = 0.4
"""

Frames = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def made(folder: Path, name: str, **given: object) -> Frames:
    """Values, places and baselines of a shard."""
    scenes = folder / f"{name}.toml"
    scenes.write_text(SCENES.format(**given), encoding="utf-8")
    command = ["--scenes", str(scenes), "--count", str(given["frames"]), "--out", str(folder / name), "--format", "npz"]
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "skin", "dataset", *command], check=True, capture_output=True)
    print(f"{given['frames']} frames ({given['physics']}): {time.perf_counter() - begin:.1f} s")
    with np.load(folder / name / "shard-00000.npz") as shard:
        return shard["values_v"], np.stack([shard["x_mm"], shard["y_mm"]], axis=1), shard["baseline_v"]


def said(name: str, errors: NDArray[np.float64], took_s: float) -> None:
    median, high = np.nanquantile(errors, [0.5, 0.95])
    missed = int(np.isnan(errors).sum())
    print(f"{name}: error {median:.2f} mm (median), {high:.2f} mm (95 %), {missed} missed; {1e3 * took_s / len(errors):.2f} ms a frame")


def main() -> None:
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    with tempfile.TemporaryDirectory() as name:
        values, places, baseline = made(Path(name), "learned", frames=frames, seed=1, physics="discs")
        # The sheet is the paper's in both; what is drawn, noise and physics are others.
        tested, truth, its_baseline = made(Path(name), "tested", frames=TESTED, seed=2, physics="mesh")

    def change(values: NDArray[np.float64], baseline: NDArray[np.float64]) -> NDArray[np.float64]:
        mean = baseline.mean(axis=0)
        return np.asarray(values / mean - 1)

    network = MLPRegressor(hidden_layer_sizes=(256, 128), early_stopping=True, max_iter=300, random_state=1)
    model = TransformedTargetRegressor(make_pipeline(StandardScaler(), network), transformer=StandardScaler())
    begin = time.perf_counter()
    model.fit(change(values, baseline), places)
    print(f"learned from {frames} frames in {time.perf_counter() - begin:.0f} s")
    begin = time.perf_counter()
    guessed = model.predict(change(tested, its_baseline))
    said("scikit-learn", np.hypot(*(guessed - truth).T), time.perf_counter() - begin)

    reconstructor = skin.Reconstructor(its_baseline)
    begin = time.perf_counter()
    found = [frame.touches for frame in reconstructor.frames(tested)]
    took_s = time.perf_counter() - begin
    places_found = np.array([(t[0].x_mm, t[0].y_mm) if t else (np.nan, np.nan) for t in found])
    said("skin", np.hypot(*(places_found - truth).T), took_s)


if __name__ == "__main__":
    main()
