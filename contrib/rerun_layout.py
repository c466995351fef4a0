"""The layout for python/examples/rerun_live.py in Rerun: picture with touches, forces over time, doubts.

    python contrib/rerun_layout.py                      # to the viewer that is open
    python contrib/rerun_layout.py skin.rbl             # into a file, for: rerun skin.rrd skin.rbl
"""

import sys

import rerun as rr
import rerun.blueprint as rrb

LAYOUT = rrb.Blueprint(
    rrb.Horizontal(
        rrb.Spatial2DView(name="Skin", origin="skin"),
        rrb.Vertical(rrb.TimeSeriesView(name="Forces, N", origin="force"), rrb.TextLogView(name="Doubts", origin="doubt")),
    ),
    collapse_panels=True,
)

if __name__ == "__main__":
    if len(sys.argv) > 1:
        LAYOUT.save("skin", sys.argv[1])
    else:
        rr.init("skin")
        rr.connect_grpc()
        rr.send_blueprint(LAYOUT)
