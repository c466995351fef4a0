"""Picture, touches and forces in Rerun: of the simulated skin, a board or a recording, live or into a file.

    pip install tactile-skin rerun-sdk
    python python/examples/rerun_live.py [SOURCE] [--save FILE.rrd] [--frames N]

SOURCE is a port, tcp://HOST:PORT or a recording (.mcap); without one the skin is simulated. Without --save the viewer opens.
"""

import argparse
from itertools import islice

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

import skin

BLUEPRINT = rrb.Blueprint(
    rrb.Horizontal(
        rrb.Spatial2DView(name="Skin", origin="skin"),
        rrb.Vertical(rrb.TimeSeriesView(name="Forces, N", origin="force"), rrb.TextLogView(name="Doubts", origin="doubt")),
    ),
    collapse_panels=True,
)


def log(frame: skin.Frame, known: set[int]) -> None:
    """A frame at the board's time. Lengths in the 2D view are mm, y down as in pictures."""
    rr.set_time("board", duration=frame.time_s or 0.0)
    rr.log("skin/picture", rr.DepthImage(np.flipud(frame.image).astype(np.float32), colormap="magma", depth_range=(0.0, 0.3)))
    left, right, _, top = frame.extent_mm
    pixels_per_mm = frame.image.shape[1] / (right - left)
    places = [((t.x_mm - left) * pixels_per_mm, (top - t.y_mm) * pixels_per_mm) for t in frame.touches]
    radii = [float(np.sqrt(t.area_mm2 / np.pi)) * pixels_per_mm for t in frame.touches]
    labels = [f"{100 * t.rise:+.0f} %" if t.force_n is None else f"{t.force_n:.1f} N" for t in frame.touches]
    rr.log("skin/touches", rr.Points2D(places, radii=radii, labels=labels, colors=[(127, 227, 255, 120)]))
    forces = {t.id: t.force_n for t in frame.touches if t.id is not None and t.force_n is not None}
    for number in known | forces.keys():
        # A touch that has gone weighs nothing.
        rr.log(f"force/touch{number}", rr.Scalars(forces.get(number, 0.0)))
    known.clear()
    known.update(forces)
    if frame.doubt:
        rr.log("doubt", rr.TextLog(frame.doubt, level="WARN"))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("source", nargs="?", help="a port, tcp://HOST:PORT or a recording; none: the simulated skin")
    arguments.add_argument("--save", metavar="FILE.rrd", help="into a file, in place of the viewer")
    arguments.add_argument("--frames", type=int, help="so many frames; none: all")
    asked = arguments.parse_args()
    rr.init("skin", spawn=asked.save is None)
    if asked.save is not None:
        rr.save(asked.save, default_blueprint=BLUEPRINT)
    else:
        rr.send_blueprint(BLUEPRINT)
    known: set[int] = set()
    with skin.open(asked.source, simulate=asked.source is None) as frames:
        for frame in islice(frames, asked.frames):
            log(frame, known)


if __name__ == "__main__":
    main()
