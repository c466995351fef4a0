"""Times other solvers on the problems that the solver benchmark writes.

    SKIN_BENCH_PROBLEMS=$PWD/problems cargo bench -p host --bench solver
    cargo run --release --manifest-path host/benches/peers/nnls-crate/Cargo.toml -- problems
    pip install -r host/benches/peers/requirements.txt
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python host/benches/peers/peers.py problems

Every solver gets the reduced matrix (rank x cells), so that the reduction is not counted against it. Plain problems go to
scipy.optimize.nnls and, as their dual (least |r - b| with A^T r <= 0, whose multipliers are x), to DAQP; those with a ridge
to scipy.optimize.nnls with the ridge as further rows. What other programs left in the folder (the crate nnls, the
benchmark's own Lawson-Hanson) is judged beside them. Times are medians over the frames of the best of as many runs as the
benchmark makes; KKT is the largest |min(x_j |a_j|, g_j / |a_j|)| over |b|; the objective is relative to skin's, less
one. The floor is one product of the transposed matrix with a vector.

DAQP is asked for 1e-11, since its default leaves 1e-6, and its time is the solve alone as it reports it, without setting
up the problem. Its published wheel is built for any processor and takes 1.5 to 1.8 times as long as one built for this one
(CFLAGS="-O3 -march=native -ffast-math" pip install --no-binary daqp -r host/benches/peers/requirements.txt).
"""

import ctypes
import pathlib
import sys
import time

import daqp
import numpy
import scipy.optimize

RUNS = 12
MOST_SECONDS = 1.0


def kkt(a, b, ridge, x):
    norms = numpy.linalg.norm(a, axis=0)
    gradient = a.T @ (a @ x - b) + ridge**2 * x
    return numpy.abs(numpy.minimum(x * norms, gradient / norms)).max() / numpy.linalg.norm(b)


def objective(a, b, ridge, x):
    return 0.5 * numpy.sum((a @ x - b) ** 2) + 0.5 * ridge**2 * (x @ x)


def scipy_nnls(a, ridge):
    cells = a.shape[1]
    stacked = numpy.vstack([a, ridge * numpy.eye(cells)]) if ridge > 0 else a
    padding = numpy.zeros(stacked.shape[0] - a.shape[0])

    def solve(b):
        right = numpy.concatenate([b, padding])
        start = time.perf_counter()
        x = scipy.optimize.nnls(stacked, right, maxiter=50 * cells)[0]
        return x, time.perf_counter() - start, True

    return solve


def daqp_dual(a, _):
    # Rows of norm 1, as its tolerances are absolute.
    norms = numpy.linalg.norm(a, axis=0)
    rows, cells = a.shape
    hessian = numpy.eye(rows)
    constraints = numpy.ascontiguousarray((a / norms).T)
    upper, lower = numpy.zeros(cells), numpy.full(cells, -1e30)
    sense = numpy.zeros(cells, dtype=ctypes.c_int)

    def solve(b):
        scale = numpy.linalg.norm(b)
        _, _, flag, info = daqp.solve(
            hessian, -b / scale, constraints, upper, lower, sense, primal_tol=1e-11, iter_limit=100_000
        )
        return numpy.maximum(info["lam"], 0.0) * scale / norms, info["solve_time"], flag == 1

    return solve


def measure(solve, frames):
    times, solutions, failed = [], [], 0
    for b in frames:
        best, begin = numpy.inf, time.perf_counter()
        for _ in range(RUNS):
            x, seconds, good = solve(b)
            best = min(best, seconds)
            if time.perf_counter() - begin > MOST_SECONDS:
                break
        times.append(best)
        solutions.append(x)
        failed += not good
    return 1e6 * numpy.median(times), solutions, failed


def main(folder):
    print("| problem | solver | us | / floor | / skin cold | / skin warm | KKT | objective |")
    print("|---|---|---|---|---|---|---|---|")
    for path in sorted(folder.glob("*_a.npy")):
        name = path.name.removesuffix("_a.npy")
        a, b, x, ridge, us = (numpy.load(folder / f"{name}_{part}.npy") for part in ("a", "b", "x", "ridge", "us"))
        ridge = ridge.item()
        frames = numpy.ascontiguousarray(b.T)
        ours = [x[:, k] for k in range(x.shape[1])]
        reference = [objective(a, f, ridge, s) for f, s in zip(frames, ours)]
        floor = numpy.load(folder / f"{name}_floor.npy").item()

        def row(label, median, solutions):
            pairs = list(zip(frames, solutions, reference))
            worst = max(kkt(a, f, ridge, s) for f, s, _ in pairs)
            off = max((objective(a, f, ridge, s) - r) / (r + 0.5e-14 * (f @ f)) for f, s, r in pairs)
            over = [f"{median / floor:.0f}"] + [f"{median / u:.3g}" for u in us[0]]
            print(f"| {name} | {label} | {median:.0f} | {' | '.join(over)} | {worst:.0e} | {off:.0e} |", flush=True)

        row("skin, cold", us[0, 0], ours)
        row("skin, warm", us[0, 1], ours)
        for path in sorted(folder.glob(f"{name}_us.*.npy")):
            label = path.stem.removeprefix(f"{name}_us.")
            solutions = numpy.load(folder / f"{name}_x.{label}.npy")
            row(label.replace("-", " "), numpy.load(path).item(), list(solutions.T))
        peers = [("scipy.optimize.nnls", scipy_nnls)] + ([("DAQP, dual", daqp_dual)] if ridge == 0 else [])
        for label, make in peers:
            try:
                median, solutions, failed = measure(make(a, ridge), frames)
            except RuntimeError as error:
                print(f"| {name} | {label} | {error} | | | | | |")
                continue
            note = f", {failed} of {len(frames)} not solved" if failed else ""
            row(label + note, median, solutions)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
