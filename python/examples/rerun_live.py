"""Picture, touches and forces over time in Rerun: of the simulated skin, or of SOURCE, a port, tcp://HOST:PORT or a recording (.mcap).

    pip install tactile-skin rerun-sdk
    python python/examples/rerun_live.py [SOURCE] [--save FILE.rrd]
    python contrib/rerun_layout.py                      # in another terminal: the layout, to the viewer that is open
"""

import argparse

import numpy as np
import rerun as rr

import skin


def log(frame: skin.Frame) -> None:
    """A frame at the board's time. Places are pixels of the picture, y down."""
    rr.set_time("board", duration=frame.time_s or 0.0)
    rr.log("skin/picture", rr.DepthImage(np.flipud(frame.image).astype(np.float32), colormap="magma", depth_range=(0.0, 0.3)))
    left, right, _, top = frame.extent_mm
    pixels = frame.image.shape[1] / (right - left)
    places = [(pixels * (t.x_mm - left), pixels * (top - t.y_mm)) for t in frame.touches]
    radii = [pixels * (t.area_mm2 / np.pi) ** 0.5 for t in frame.touches]
    labels = [f"{100 * t.rise:+.0f} %" if t.force_n is None else f"{t.force_n:.1f} N" for t in frame.touches]
    rr.log("skin/touches", rr.Points2D(places, radii=radii, labels=labels, colors=[(127, 227, 255, 120)]))
    for touch in frame.touches:
        if touch.id is not None and touch.force_n is not None:
            rr.log(f"force/touch{touch.id}", rr.Scalars(touch.force_n))
    if frame.doubt:
        rr.log("doubt", rr.TextLog(frame.doubt, level="WARN"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", nargs="?")
    rr.script_add_args(parser)
    arguments = parser.parse_args()
    rr.script_setup(arguments, "skin")
    for frame in skin.open(arguments.source, simulate=arguments.source is None):
        log(frame)
