#!/usr/bin/env python3
"""Publishes a skin, or several, by rclpy: reads the lines of `skin run --json` and publishes the topics of `skin run --ros2`.

    ros2 run skin_msgs skin_node.py --ros-args -p arguments:="['--skins', '/path/skins.toml']"

Parameters: `skin`, the program; `arguments`, what `skin run` is to be told beside --json; `images`, whether pictures are published.
There is no service ~/tare: a page (--listen 8477 among the arguments) takes baselines.
"""

import json
import math
import struct
import subprocess
import sys
import threading

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2, PointField
from skin_msgs.msg import Touch, Touches
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

RELIABLE = QoSProfile(depth=10)
SENSOR_DATA = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NAN = float("nan")
POINT = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "force", "rise", "id"]


def ros_name(skin):
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in skin)
    return f"skin_{name}" if name[0].isdigit() else name


def header(unix_s, frame):
    unix_ns = int(unix_s * 1e9)
    return Header(stamp=Time(sec=unix_ns // 10**9, nanosec=unix_ns % 10**9), frame_id=frame)


def quaternion(place):
    """x, y, z, w of turns about x, then y, then z."""
    half = [math.radians(angle) / 2 for angle in place["roll_pitch_yaw_deg"]]
    (cx, cy, cz), (sx, sy, sz) = map(math.cos, half), map(math.sin, half)
    return [
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    ]


def turned(q, v):
    x, y, z, w = q
    cross = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])]
    return [
        v[0] + w * cross[0] + y * cross[2] - z * cross[1],
        v[1] + w * cross[1] + z * cross[0] - x * cross[2],
        v[2] + w * cross[2] + x * cross[1] - y * cross[0],
    ]


def number(of, key, scale=1.0):
    value = of.get(key)
    return NAN if value is None else value * scale


def touch_message(of):
    covariance = [0.0] * 9
    if of.get("x_sd_mm") is None or of.get("y_sd_mm") is None:
        covariance[0] = -1.0
    else:
        covariance[0], covariance[4] = ((of[key] * 1e-3) ** 2 for key in ("x_sd_mm", "y_sd_mm"))
    return Touch(
        id=of["id"] or 0,
        position=Point(x=of["x_mm"] * 1e-3, y=of["y_mm"] * 1e-3, z=0.0),
        position_covariance=covariance,
        rise=float(of["rise"]),
        area=number(of, "area_mm2", 1e-6),
        area_stddev=number(of, "area_sd_mm2", 1e-6),
        total=number(of, "total_mm2", 1e-6),
        total_stddev=number(of, "total_sd_mm2", 1e-6),
        force=float(number(of, "force_n")),
        uncalibrated=of.get("uncalibrated", False),
    )


class Skin:
    """One skin: its publishers, and what its header said."""

    def __init__(self, node, line):
        self.name = ros_name(line.get("skin", "skin"))
        self.sheet_frame = f"{self.name}_sheet"
        self.serial = line["board"]["serial"]
        self.place = line.get("place")
        self.link = self.place["frame"] if self.place else self.sheet_frame
        self.turn = quaternion(self.place) if self.place else [0.0, 0.0, 0.0, 1.0]
        self.origin = [mm * 1e-3 for mm in self.place["position_mm"]] if self.place else [0.0] * 3
        self.grid = self.cells(line["cells"]) if "cells" in line else None
        self.last = None
        self.lost = 0
        self.away = None
        self.frames = 0
        publisher = node.create_publisher
        self.touches = publisher(Touches, f"{self.name}/touches", RELIABLE)
        self.points = publisher(PointCloud2, f"{self.name}/points", SENSOR_DATA)
        self.image = publisher(Image, f"{self.name}/image", SENSOR_DATA) if self.grid else None
        self.diagnostics = publisher(DiagnosticArray, f"{self.name}/diagnostics", RELIABLE)

    @staticmethod
    def cells(of):
        """Columns, rows, and for every cell its place in a picture whose first row is at the top."""
        side, centres = of["side_mm"], of["centres_mm"]
        # A grid is even about the sheet's bounds, so that its outermost cells may hold none of the sheet.
        left, top = min(x for x, _ in centres), max(y for _, y in centres)
        at = [(round((x - left) / side), round((top - y) / side)) for x, y in centres]
        columns, rows = max(c for c, _ in at) + 1, max(r for _, r in at) + 1
        return columns, rows, [row * columns + column for column, row in at]

    def transform(self, unix_s):
        out = TransformStamped(header=header(unix_s, self.link), child_frame_id=self.sheet_frame)
        at, turn = out.transform.translation, out.transform.rotation
        at.x, at.y, at.z = self.origin
        turn.x, turn.y, turn.z, turn.w = self.turn
        return out

    def picture(self, line):
        unix_s = line["unix_s"]
        self.last, self.frames = line, self.frames + 1
        self.touches.publish(
            Touches(
                header=header(unix_s, self.sheet_frame),
                frame=line["frame"],
                time_s=float(line["time_s"]),
                touches=[touch_message(touch) for touch in line["touches"]],
                doubt=line.get("doubt", ""),
            )
        )
        self.points.publish(self.point_cloud(unix_s, line["touches"]))
        if self.image:
            self.image.publish(self.image_message(unix_s, line["cells"]))

    def point_cloud(self, unix_s, touches):
        normal = turned(self.turn, [0.0, 0.0, 1.0])
        data = b""
        for touch in touches:
            at = turned(self.turn, [touch["x_mm"] * 1e-3, touch["y_mm"] * 1e-3, 0.0])
            at = [a + b for a, b in zip(at, self.origin)]
            data += struct.pack("<8fI", *at, *normal, number(touch, "force_n"), touch["rise"], touch["id"] or 0)
        kind = {"id": PointField.UINT32}
        fields = [
            PointField(name=name, offset=4 * k, datatype=kind.get(name, PointField.FLOAT32), count=1)
            for k, name in enumerate(POINT)
        ]
        step = 4 * len(POINT)
        return PointCloud2(
            header=header(unix_s, self.link),
            height=1,
            width=len(touches),
            fields=fields,
            is_bigendian=False,
            point_step=step,
            row_step=step * len(touches),
            data=data,
            is_dense=True,
        )

    def image_message(self, unix_s, cells):
        columns, rows, at = self.grid
        pixels = [NAN] * (columns * rows)
        for place, rise in zip(at, cells):
            pixels[place] = rise
        return Image(
            header=header(unix_s, self.sheet_frame),
            height=rows,
            width=columns,
            encoding="32FC1",
            is_bigendian=0,
            step=4 * columns,
            data=struct.pack(f"<{len(pixels)}f", *pixels),
        )

    def tell(self, unix_s):
        """How the skin is, since it was told last."""
        line, frames, self.frames = self.last, self.frames, 0
        status = DiagnosticStatus(name=f"{self.name}: board", hardware_id=self.serial)
        if self.away:
            status.level, status.message = DiagnosticStatus.ERROR, self.away
        elif not frames:
            status.level, status.message = DiagnosticStatus.STALE, "no frame"
        else:
            lost, self.lost = line["lost_frames"] - self.lost, line["lost_frames"]
            trouble = line.get("doubt") or next((fault["text"] for fault in line.get("faults", [])), None)
            trouble = trouble or (f"{lost} frames are lost" if lost > 0 else None)
            status.level = DiagnosticStatus.WARN if trouble else DiagnosticStatus.OK
            status.message = trouble or f"{frames} frames/s"
        if line:
            keys = ["lost_frames", "skipped_frames", "residual"]
            status.values = [KeyValue(key=key, value=str(line[key])) for key in keys]
        self.diagnostics.publish(DiagnosticArray(header=header(unix_s, ""), status=[status]))


class SkinNode(Node):
    def __init__(self):
        super().__init__("skin_node")
        program = self.declare_parameter("skin", "skin").value
        # Of an empty list rclpy does not know what is in it.
        arguments = self.declare_parameter("arguments", [""]).value
        images = self.declare_parameter("images", True).value
        command = [program, "run", "--json", *(["--cells"] if images else []), *filter(None, arguments)]
        self.transforms = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        self.skins = {}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.create_timer(1.0, self.tell)
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for text in self.process.stdout:
            self.line(json.loads(text))
        code = self.process.wait()
        self.get_logger().info(f"skin run has ended with exit code {code}")
        rclpy.try_shutdown()

    def line(self, line):
        skin = line.get("skin")
        if line["kind"] == "header":
            self.skins[skin] = Skin(self, line)
            placed = [s.transform(line["started_unix_s"]) for s in self.skins.values() if s.place]
            if placed:
                self.transforms.publish(TFMessage(transforms=placed))
        elif line["kind"] == "picture":
            self.skins[skin].picture(line)
        elif line["event"] in ("board_away", "board_back") and skin in self.skins:
            self.skins[skin].away = line["text"] if line["event"] == "board_away" else None

    def tell(self):
        now = self.get_clock().now().nanoseconds * 1e-9
        for skin in list(self.skins.values()):
            skin.tell(now)

    def stop(self):
        self.process.terminate()
        self.process.wait()


def main():
    rclpy.init()
    node = SkinNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.stop()
    return node.process.returncode


if __name__ == "__main__":
    sys.exit(main())
