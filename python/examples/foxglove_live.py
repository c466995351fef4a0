"""The skin live in Foxglove, over its WebSocket: of the simulated skin, a board or a recording.

    pip install tactile-skin foxglove-sdk
    python python/examples/foxglove_live.py [SOURCE] [--port N] [--frames N]

Open ws://localhost:8765 in Foxglove, with the layout contrib/foxglove-layout.json: the topics are those of a recording. SOURCE is a
port, tcp://HOST:PORT or a recording (.mcap); without one the skin is simulated.
"""

import argparse
from itertools import islice

import foxglove
import numpy as np
from foxglove.channels import PointCloudChannel, RawImageChannel
from foxglove.messages import PackedElementField, PackedElementFieldNumericType, PointCloud, RawImage

import skin

FIELDS = ["x", "y", "z", "rise", "force"]


class Topics:
    """What is published. Lengths in the cloud are m in the frame `sheet`; a force that nothing tells is NaN."""

    def __init__(self) -> None:
        self.picture = RawImageChannel("/picture")
        self.points = PointCloudChannel("/touches/points")
        self.touches = foxglove.Channel("/touches", schema={"type": "object", "title": "skin.Touches"})

    def log(self, frame: skin.Frame) -> None:
        """Publishes a frame."""
        rows, columns = frame.image.shape
        # Row 0 of a picture is the highest; off the sheet it is 0.
        rise = np.nan_to_num(np.flipud(frame.image)).astype("<f4")
        self.picture.log(
            RawImage(frame_id="sheet", width=columns, height=rows, encoding="32FC1", step=4 * columns, data=rise.tobytes())
        )
        numbers = [
            (1e-3 * t.x_mm, 1e-3 * t.y_mm, 0.0, t.rise, np.nan if t.force_n is None else t.force_n) for t in frame.touches
        ]
        kind = PackedElementFieldNumericType.Float32
        fields = [PackedElementField(name=name, offset=4 * k, type=kind) for k, name in enumerate(FIELDS)]
        data = np.array(numbers, dtype="<f4").tobytes()
        self.points.log(PointCloud(frame_id="sheet", point_stride=4 * len(FIELDS), fields=fields, data=data))
        names = ["id", "x_mm", "y_mm", "x_sd_mm", "y_sd_mm", "rise", "area_mm2", "force_n"]
        touches = [{name: getattr(t, name) for name in names} for t in frame.touches]
        self.touches.log({"frame": frame.sequence, "time_s": frame.time_s, "touches": touches, "doubt": frame.doubt})


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("source", nargs="?", help="a port, tcp://HOST:PORT or a recording; none: the simulated skin")
    arguments.add_argument("--port", type=int, default=8765)
    arguments.add_argument("--frames", type=int, help="so many frames; none: all")
    asked = arguments.parse_args()
    server = foxglove.start_server(name="skin", port=asked.port)
    topics = Topics()
    with skin.open(asked.source, simulate=asked.source is None) as frames:
        for frame in islice(frames, asked.frames):
            topics.log(frame)
    server.stop()


if __name__ == "__main__":
    main()
