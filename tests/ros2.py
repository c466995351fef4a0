#!/usr/bin/env python3
"""`skin run --ros2`, read by another implementation of DDS: Cyclone, from the package cyclonedds. Nothing leaves this computer.

    tests/ros2.py [SKIN [SECONDS [SKINS...]]]

SKIN is the program, target/debug/skin unless said; SECONDS is how long four skins send, 6 unless said. With numbers of SKINS nothing
is tested: so many send for so long, in a network of their own, and what it costs is said (docs/scale.md; as root, on Linux).
Needs the packages cyclonedds and numpy; rosbags where it is there. Exit code 77: skipped, with the reason.
"""

import atexit
import ctypes
import fcntl
import importlib.util
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import types
from dataclasses import dataclass

ROOT = pathlib.Path(__file__).resolve().parent.parent
SKIN = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/debug/skin").resolve()
SECONDS = float(sys.argv[2]) if len(sys.argv) > 2 else 6.0
SCALES = [int(count) for count in sys.argv[3:]]
# One of its own, so that two tests at once do not meet.
DOMAIN = 1 + os.getpid() % 100
os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
    <General><AllowMulticast>false</AllowMulticast><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
    <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex>
        <Peers><Peer address="127.0.0.1"/></Peers></Discovery>
    </Domain></CycloneDDS>"""

try:
    import numpy
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.types import array, float64, int32, int64, sequence, uint8, uint32, uint64
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration
except ImportError as missing:
    print(f"skipped: {missing} (pip install cyclonedds numpy rosbags)")
    sys.exit(77)


# --- the types, as their definitions have them --------------------------------------------------------------------------


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Touch(IdlStruct, typename="skin_msgs::msg::dds_::Touch_"):
    id: uint32
    position: Vector
    position_covariance: array[float64, 9]
    rise: float64
    area: float64
    area_stddev: float64
    total: float64
    total_stddev: float64
    force: float64
    uncalibrated: bool


@dataclass
class Touches(IdlStruct, typename="skin_msgs::msg::dds_::Touches_"):
    header: Header
    frame: uint32
    time_s: float64
    touches: sequence[Touch]
    doubt: str


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    translation: Vector
    rotation: Quaternion


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class NodeEntities(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    namespace: str
    name: str
    readers: sequence[array[uint8, 16]]
    writers: sequence[array[uint8, 16]]


@dataclass
class ParticipantEntities(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: array[uint8, 16]
    nodes: sequence[NodeEntities]


# A request as nodes on Cyclone send it, with the client's number and that of its request in front.
@dataclass
class CycloneRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    client: uint64
    number: int64
    filler: uint8


@dataclass
class CycloneReply(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    client: uint64
    number: int64
    success: bool
    message: str


# As nodes on Fast DDS send it.
@dataclass
class PlainRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    filler: uint8


@dataclass
class PlainReply(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    success: bool
    message: str


FORM = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
KEPT = Policy.History.KeepLast(20000)
BEST_EFFORT_QOS = Qos(FORM, Policy.Reliability.BestEffort, Policy.Durability.Volatile, KEPT)
RELIABLE_QOS = Qos(FORM, RELIABLE, Policy.Durability.Volatile, KEPT)
LATCHED_QOS = Qos(FORM, RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
KINDS = {"touches": (Touches, RELIABLE_QOS), "image": (Image, BEST_EFFORT_QOS), "points": (PointCloud2, BEST_EFFORT_QOS),
         "diagnostics": (DiagnosticArray, RELIABLE_QOS)}


class Subscriber:
    """A participant that keeps what comes of some topics."""

    def __init__(self, topics):
        self.participant = DomainParticipant(DOMAIN)
        self.began = time.monotonic()
        self.messages, self.first, self.readers = {}, {}, {}
        for name, (kind, qos) in topics.items():
            topic = Topic(self.participant, name, kind, qos=qos)
            self.readers[name] = DataReader(self.participant, topic, qos=qos)
            self.messages[name] = []
        self.ended = False
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.ended:
            if not self.take():
                time.sleep(0.005)

    def take(self):
        some = False
        for name, reader in self.readers.items():
            # What is no sample tells that a publisher has gone.
            taken = [m for m in reader.take(N=500) if type(m).__name__ != "InvalidSample"]
            if taken:
                some = True
                self.first.setdefault(name, time.monotonic() - self.began)
                self.messages[name] += taken
        return some

    def wait(self, name, count=1, seconds=120.0):
        until = time.monotonic() + seconds
        while len(self.messages[name]) < count:
            assert time.monotonic() < until, f"{name}: {len(self.messages[name])} of {count} messages in {seconds} s"
            time.sleep(0.01)

    def close(self):
        # What is on its way arrives.
        time.sleep(0.3)
        self.ended = True
        self.thread.join()
        while self.take():
            pass
        return self.messages


def topics(skins, kinds, namespace=""):
    out = {f"rt{namespace}/{skin}/{kind}": KINDS[kind] for skin in skins for kind in kinds}
    return out | {"rt/tf_static": (TFMessage, LATCHED_QOS), "ros_discovery_info": (ParticipantEntities, LATCHED_QOS)}


class Running:
    """`skin` with its lines."""

    def __init__(self, *arguments):
        self.errors = tempfile.TemporaryFile("w+")
        command = [SKIN, *map(str, arguments)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.errors, text=True)
        self.lines = []
        # Whatever becomes of the test, it ends.
        atexit.register(self.process.kill)
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        for line in self.process.stdout:
            self.lines.append(json.loads(line))

    def wait(self, condition, seconds=120.0, after=0):
        """The first line of which it holds."""
        until, at = time.monotonic() + seconds, after
        while True:
            while at < len(self.lines):
                if condition(self.lines[at]):
                    return self.lines[at]
                at += 1
            assert time.monotonic() < until and self.process.poll() is None, self.said()
            time.sleep(0.02)

    def end(self):
        """Waits for its own end."""
        code = self.process.wait(timeout=120)
        self.thread.join()
        assert code == 0, (code, self.said())
        return self.lines

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        return self.end()

    def said(self):
        self.errors.seek(0)
        return self.errors.read()[-3000:]

    def pictures(self, skin=None):
        return [line for line in self.lines if line["kind"] == "picture" and line.get("skin") == skin]


# --- what has to be the same ---------------------------------------------------------------------------------------------

SD = {"area_stddev": "area_sd_mm2", "total_stddev": "total_sd_mm2"}


def near(value, printed, what):
    """Whether they are the same to the six digits that are printed; not a number is what is not there."""
    if printed is None:
        assert numpy.isnan(value), (what, value)
    else:
        assert abs(value - printed) <= 5.1e-6 * abs(printed), (what, value, printed)


def same_touches(message, line):
    assert message.frame == line["frame"] and len(message.touches) == len(line["touches"])
    assert abs(message.time_s - line["time_s"]) < 1e-6 and message.doubt == line.get("doubt", "")
    assert abs(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec - line["unix_s"]) < 1e-5
    for touch, printed in zip(message.touches, line["touches"]):
        assert touch.id == (printed["id"] or 0) and touch.position.z == 0
        near(touch.position.x * 1e3, printed["x_mm"], "x")
        near(touch.position.y * 1e3, printed["y_mm"], "y")
        near(touch.rise, printed["rise"], "rise")
        near(touch.area * 1e6, printed["area_mm2"], "area")
        near(touch.total * 1e6, printed["total_mm2"], "total")
        near(touch.force, printed.get("force_n"), "force")
        for field, key in SD.items():
            near(getattr(touch, field) * 1e6, printed.get(key), field)
        covariance = numpy.reshape(touch.position_covariance, (3, 3))
        if printed.get("x_sd_mm") is None:
            assert covariance[0, 0] == -1
        else:
            near(1e3 * covariance[0, 0] ** 0.5, printed["x_sd_mm"], "x_sd")
            near(1e3 * covariance[1, 1] ** 0.5, printed["y_sd_mm"], "y_sd")
            assert numpy.count_nonzero(covariance) == 2
        assert touch.uncalibrated == printed.get("uncalibrated", False)


def turn(place):
    """About the frame's x, then y, then z."""
    out = numpy.eye(3)
    for axis, angle in enumerate(numpy.radians(place["roll_pitch_yaw_deg"])):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        about = numpy.eye(3)
        about[a, a] = about[b, b] = numpy.cos(angle)
        about[a, b], about[b, a] = -numpy.sin(angle), numpy.sin(angle)
        out = about @ out
    return out


CLOUD = numpy.dtype([(n, "<f4") for n in ["x", "y", "z", "normal_x", "normal_y", "normal_z", "force", "rise"]] + [("id", "<u4")])


def cloud_of(message):
    assert [f.name for f in message.fields] == list(CLOUD.names) and message.point_step == CLOUD.itemsize
    assert [f.offset for f in message.fields] == [CLOUD.fields[n][1] for n in CLOUD.names]
    assert {f.datatype for f in message.fields[:-1]} == {7} and message.fields[-1].datatype == 6
    assert (message.height, message.row_step) == (1, message.width * message.point_step)
    return numpy.frombuffer(bytes(message.data), CLOUD)


def same_points(message, line, place):
    """The cloud is the touches where the place puts them."""
    cloud = cloud_of(message)
    assert message.header.frame_id == place["frame"] and len(cloud) == len(line["touches"]) == message.width
    rotation = turn(place)
    for point, touch in zip(cloud, line["touches"]):
        mm = rotation @ [touch["x_mm"], touch["y_mm"], 0.0] + place["position_mm"]
        found = numpy.array([point[n] for n in ("x", "y", "z")], float)
        # Six digits of each, and those of 32 bits.
        assert numpy.abs(found - 1e-3 * mm).max() < 2e-6, (found, mm)
        normal = numpy.array([point[n] for n in ("normal_x", "normal_y", "normal_z")])
        assert numpy.abs(normal - rotation[:, 2]).max() < 1e-6
        assert point["id"] == (touch["id"] or 0)
        force = touch.get("force_n")
        assert numpy.isnan(point["force"]) if force is None else abs(point["force"] - force) <= 6e-6 * force


def same_image(message, line, cells):
    """Every cell is a pixel, and the others are none."""
    pixels = numpy.frombuffer(bytes(message.data), "<f4").reshape(message.height, message.width)
    assert message.encoding == "32FC1" and message.step == 4 * message.width
    centres = numpy.array(cells["centres_mm"])
    # The grid lies evenly about the sheet.
    column = numpy.rint(centres[:, 0] / cells["side_mm"] + (message.width - 1) / 2).astype(int)
    row = numpy.rint((message.height - 1) / 2 - centres[:, 1] / cells["side_mm"]).astype(int)
    printed = numpy.array(line["cells"])
    assert numpy.count_nonzero(numpy.isfinite(pixels)) == len(printed)
    assert numpy.allclose(pixels[row, column], printed, rtol=6e-6, atol=0), line["frame"]


# --- the tests -------------------------------------------------------------------------------------------------------------

# Something presses, and stays; far from every line in which a disc is its own mirror.
PRESSED = """duration_s = 3000.0
[[touch]]
shape = "disc"
radius_mm = 12.5
keys = [{ t_s = 0.3, x_mm = 53.0, y_mm = 28.0, force_n = 0.0 }, { t_s = 0.6, force_n = 25.0 }, { t_s = 3000.0 }]
"""
EMPTY = "duration_s = 3000.0\n"


class Client:
    """Asks for a new baseline as a node on Cyclone or on Fast DDS does."""

    def __init__(self, request, reply):
        self.participant = DomainParticipant(DOMAIN)
        qos = Qos(FORM, RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(10))
        self.writer = DataWriter(self.participant, Topic(self.participant, "rq/skin/tareRequest", request, qos=qos), qos=qos)
        self.reader = DataReader(self.participant, Topic(self.participant, "rr/skin/tareReply", reply, qos=qos), qos=qos)
        until = time.monotonic() + 60
        while not (self.writer.get_matched_subscriptions() and self.reader.get_matched_publications()):
            assert time.monotonic() < until, "no server of /skin/tare"
            time.sleep(0.02)

    def close(self):
        del self.writer, self.reader, self.participant

    def call(self, request, is_own, seconds=60.0):
        self.writer.write(request)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for reply in filter(is_own, self.reader.take(N=10)):
                return reply
            time.sleep(0.01)
        raise AssertionError("no answer")


CLIENTS = [(CycloneRequest, CycloneReply, lambda k: CycloneRequest(7, k, 0), lambda r, k: (r.client, r.number) == (7, k)),
           # That it is theirs such nodes know by DDS, which tells it not here; what greets them has no text.
           (PlainRequest, PlainReply, lambda k: PlainRequest(0), lambda r, k: r.message != "")]


def asked(running):
    """What becomes of a request, asked as nodes on Cyclone and as those on Fast DDS ask."""
    for k, (request, reply, make, is_own) in enumerate(CLIENTS):
        before = len(running.lines)
        client = Client(request, reply)
        answer = client.call(make(k), lambda r: is_own(r, k))
        running.wait(lambda line: line["kind"] == "picture", after=max(before, len(running.lines)))
        # It is a client no more: the next one asks in another way.
        client.close()
        yield answer, [line["event"] for line in running.lines[before:] if line["kind"] == "event"]


def hurried(count=60):
    """Each asks as soon as it knows the server, which may not know it yet; all are answered."""
    for k in range(count):
        request, reply, make, is_own = CLIENTS[k % 2]
        client = Client(request, reply)
        client.call(make(k), lambda r, k=k: is_own(r, k))
        client.close()


def tare(folder):
    """Where nothing touches a baseline is taken by the service."""
    scene = folder / "empty.toml"
    scene.write_text(EMPTY)
    running = Running("run", "--scene", scene, "--json", "--ros2")
    running.wait(lambda line: line["kind"] == "picture")
    for answer, events in asked(running):
        assert answer.success and events == ["baseline_begun", "baseline_in_force"], (answer, events)
    assert running.stop()[-1]["baseline"]["age_s"] < 60
    print("tare: two baselines by ~/tare")


def one_skin(folder):
    """Touches and pictures are those of the lines; no baseline is taken under a touch."""
    scene = folder / "pressed.toml"
    scene.write_text(PRESSED)
    listens = Subscriber(topics(["skin"], KINDS))
    running = Running("run", "--scene", scene, "--json", "--cells", "--every-frame", "--ros2")
    # Of the first frames, in which it hardly presses, some have none.
    running.wait(lambda line: line["kind"] == "picture" and any(t["id"] and t["force_n"] > 5 for t in line["touches"]))
    for answer, events in asked(running):
        assert not answer.success and "touches the sheet" in answer.message and not events, (answer, events)
    hurried()
    listens.wait("rt/skin/image")
    listens.wait("rt/skin/diagnostics", 2)
    lines = running.stop()
    assert " frames of 1 skin sent, " in running.said(), running.said()
    messages = listens.close()
    shown = {line["frame"]: line for line in running.pictures()}
    touches = messages["rt/skin/touches"]
    assert [m.frame for m in touches] == list(shown), (len(touches), len(shown), running.said())
    for message in touches:
        assert message.header.frame_id == "skin_sheet"
        same_touches(message, shown[message.frame])
    some = sum(len(m.touches) for m in touches)
    assert some > 0
    times = {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: m.frame for m in touches}
    images = messages["rt/skin/image"]
    for message in images:
        frame = times[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec]
        same_image(message, shown[frame], lines[0]["cells"])
    assert images and max(numpy.nanmax(numpy.frombuffer(bytes(m.data), "<f4")) for m in images) > 0.02
    statuses = [s for m in messages["rt/skin/diagnostics"] for s in m.status]
    assert {s.name for s in statuses} == {f"skin: {part}" for part in ("board", "touches", "baseline", "publisher")}
    assert {s.hardware_id for s in statuses} == {lines[0]["board"]["serial"]}
    assert not messages["rt/tf_static"] and not any(s.level == 2 for s in statuses)
    graph = [[(n.namespace, n.name) for n in m.nodes] for m in messages["ros_discovery_info"]]
    assert [("/", "skin")] in graph and graph[-1] == [], graph
    print(f"one skin: {len(touches)} frames with {some} touches and {len(images)} pictures, the same as the lines")


def several(folder):
    """Four skins send all frames, and points lie where their places put them."""
    places = {
        "palm": ("hand", [0.0, 0.0, 20.0], [0.0, 0.0, 0.0]),
        "chest": ("torso", [110.0, 0.0, 300.0], [90.0, 0.0, 90.0]),
        "forearm": ("elbow", [150.0, -30.0, 45.0], [20.0, -75.0, 130.0]),
        "left-thigh": ("hip", [0.0, 0.0, -200.0], [180.0, 0.0, -45.0]),
    }
    text = ""
    for name, (frame, position, angles) in places.items():
        text += f'[[skin]]\nname = "{name}"\nsimulate = true\n[skin.place]\nframe = "{frame}"\n'
        text += f"position_mm = {position}\nroll_pitch_yaw_deg = {angles}\n"
    file = folder / "skins.toml"
    file.write_text(text)
    ros = {name: name.replace("-", "_") for name in places}
    wanted = topics(ros.values(), ["touches", "points"], "/robot1")
    listens = Subscriber(wanted)
    frames = round(115 * SECONDS)
    began = time.monotonic()
    running = Running("run", "--skins", file, "--json", "--every-frame", "--frames", frames, "--ros2", "robot1")
    listens.wait("rt/robot1/palm/touches", seconds=60)
    discovered = time.monotonic() - began
    # Who comes later gets what is latched, and everything from now on.
    late = Subscriber(wanted)
    late.wait("rt/robot1/palm/touches")
    late.wait("rt/tf_static")
    lines = running.end()
    took = time.monotonic() - began
    messages, later = listens.close(), late.close()
    lost = lost_points = checked = 0
    for name, of_ros in ros.items():
        shown = {line["frame"]: line for line in running.pictures(name)}
        place = next(line["place"] for line in lines if line["kind"] == "header" and line["skin"] == name)
        touches = messages[f"rt/robot1/{of_ros}/touches"]
        assert len(shown) == frames and len({m.frame for m in touches}) == len(touches)
        lost += len(set(shown) - {m.frame for m in touches})
        for message in touches:
            same_touches(message, shown[message.frame])
        times = {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: m.frame for m in touches}
        points = messages[f"rt/robot1/{of_ros}/points"]
        lost_points += len(shown) - len(points)
        for message in points:
            frame = times[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec]
            same_points(message, shown[frame], place)
            checked += message.width
        # From its first message on a late one has every frame, too.
        after = [m.frame for m in later[f"rt/robot1/{of_ros}/touches"]]
        assert after == list(shown)[len(shown) - len(after):] and after, (name, len(after))
        # The transform of the sheet is that of the points.
        transforms = [t for m in messages["rt/tf_static"] for t in m.transforms]
        transform = next(t for t in transforms if t.child_frame_id == f"{of_ros}_sheet")
        assert transform.header.frame_id == place["frame"]
        q = numpy.array([transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w])
        x, y, z, w = q
        matrix = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        assert numpy.abs(matrix - turn(place)).max() < 1e-12
    assert lost == 0, f"{lost} of {4 * frames} frames lost: {running.said()}"
    assert checked > 0
    nodes = {(n.namespace, n.name) for m in messages["ros_discovery_info"] for n in m.nodes}
    assert nodes == {("/robot1", name) for name in ros.values()}, nodes
    shown = running.pictures("palm")
    rate = (len(shown) - 1) / (shown[-1]["unix_s"] - shown[0]["unix_s"])
    print(f"four skins: {4 * frames} frames, none lost, {lost_points} clouds lost, {checked} points where the places put them;"
          f" {rate:.0f} frames/s each; first after {discovered:.1f} s, late joiner after {late.first['rt/robot1/palm/touches']:.2f} s;"
          f" all took {took:.0f} s")
    print("\n".join(line for line in running.said().splitlines() if "ROS 2" in line or "skins:" in line))


def restart(folder):
    """A subscriber that stays hears a publisher that comes back, killed or ended."""
    listens = Subscriber(topics(["skin"], ["touches"]))
    count = 0
    for kill in (True, False):
        running = Running("run", "--simulate", "--json", "--baseline-frames", "8", "--ros2")
        listens.wait("rt/skin/touches", count + 20)
        if kill:
            running.process.kill()
            running.process.wait()
            running.thread.join()
        else:
            running.stop()
        time.sleep(0.2)
        count = len(listens.messages["rt/skin/touches"])
    listens.close()
    print(f"restart: {count} messages of two publishers")


def replayed(folder):
    """A recording is published as it was, and no baseline is taken in it; its bag has the types of contrib/ros2."""
    file = folder / "hand.mcap"
    subprocess.run([SKIN, "run", "--scene", "hand", "--json", "--frames", "60", "--record", file], check=True, capture_output=True)
    listens = Subscriber(topics(["skin"], ["touches"]))
    running = Running("replay", file, "--json", "--ros2")
    shown = running.end()
    touches = listens.close()["rt/skin/touches"]
    by_frame = {line["frame"]: line for line in running.pictures()}
    assert touches and shown
    for message in touches:
        same_touches(message, by_frame[message.frame])
    print(f"replay: {len(touches)} of {len(by_frame)} frames, the same as the lines")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as missing:
        print(f"not held: {missing}")
        return
    subprocess.run([SKIN, "export", file, "--to", "rosbag2", "--out", folder / "bag"], check=True, capture_output=True)
    store = get_typestore(Stores.ROS2_JAZZY)
    for definition in sorted((ROOT / "contrib/ros2/skin_msgs/msg").glob("*.msg")):
        store.register(get_types_from_msg(definition.read_text(), f"skin_msgs/msg/{definition.stem}"))
    with AnyReader([folder / "bag"]) as reader:
        for connection in reader.connections:
            theirs, ours = store.hash_rihs01(connection.msgtype), reader.typestore.hash_rihs01(connection.msgtype)
            assert theirs == ours, connection.msgtype
        bagged = {}
        for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == "/skin/touches"]):
            message = store.deserialize_cdr(raw, connection.msgtype)
            bagged[message.frame] = message
    for message in touches:
        same = bagged[message.frame]
        assert [t.position.x for t in same.touches] == [t.position.x for t in message.touches]
        assert same.header.frame_id == message.header.frame_id
    print(f"rosbags: the types of contrib/ros2, {len(bagged)} frames, the same touches as sent")
    rclpy_node(store, file, by_frame)


# --- the node for rclpy, without rclpy -----------------------------------------------------------------------------------


def rclpy_node(store, file, by_frame):
    """skin_node.py publishes the same; messages are checked against their definitions as ROS 2 checks them."""
    published = {}

    class Publisher:
        def __init__(self, kind, topic, _qos):
            self.kind, self.topic = kind, topic

        def publish(self, message):
            assert isinstance(message, self.kind)
            published.setdefault(self.topic, []).append(store.serialize_cdr(message.checked(), message.kind))

    modules = fake_modules(store, Publisher)
    sys.modules.update(modules)
    spec = importlib.util.spec_from_file_location("skin_node", ROOT / "contrib/ros2/skin_msgs/scripts/skin_node.py")
    module = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode = True
    spec.loader.exec_module(module)
    node = module.SkinNode.__new__(module.SkinNode)
    node.skins, node.transforms = {}, Publisher(modules["tf2_msgs.msg"].TFMessage, "/tf_static", None)
    text = subprocess.run([SKIN, "replay", file, "--json", "--cells", "--speed", "max"], check=True, capture_output=True, text=True)
    lines = [json.loads(line) for line in text.stdout.splitlines()]
    # As of a placed skin of several.
    place = {"frame": "elbow", "position_mm": [150.0, -30.0, 45.0], "roll_pitch_yaw_deg": [20.0, -75.0, 130.0]}
    lines[0]["place"] = place
    for line in lines:
        node.line({"skin": "left-arm"} | line)
    node.tell()
    shown = [line for line in lines if line["kind"] == "picture"]
    read = {topic: [store.deserialize_cdr(raw, KIND_OF[topic.rsplit("/", 1)[1]]) for raw in of] for topic, of in published.items()}
    assert set(read) == {f"left_arm/{kind}" for kind in KINDS} | {"/tf_static"}, set(read)
    assert len(shown) == len(read["left_arm/touches"]) == len(by_frame)
    for k, line in enumerate(shown):
        same_touches(read["left_arm/touches"][k], line)
        same_points(read["left_arm/points"][k], line, place)
        same_image(read["left_arm/image"][k], line, lines[0]["cells"])
    assert read["/tf_static"][0].transforms[0].child_frame_id == "left_arm_sheet"
    assert read["left_arm/diagnostics"][0].status[0].name == "left_arm: board"
    print(f"skin_node.py: {len(shown)} frames, the same as the lines")


KIND_OF = {"touches": "skin_msgs/msg/Touches", "image": "sensor_msgs/msg/Image", "points": "sensor_msgs/msg/PointCloud2",
           "diagnostics": "diagnostic_msgs/msg/DiagnosticArray", "tf_static": "tf2_msgs/msg/TFMessage"}


def fake_modules(store, publisher):
    """rclpy and the packages of messages, as far as the node uses them."""

    def message(kind):
        fields = dict(store.fielddefs[kind][1])

        def default(of):
            name, detail = of[0].name, of[1]
            if name == "BASE":
                return {"string": "", "bool": False}.get(detail[0], 0.0 if "float" in detail[0] else 0)
            if name == "NAME":
                return classes[detail]()
            return [] if name == "SEQUENCE" else [default(detail[0])] * detail[1]

        class Message:
            def __init__(self, **given):
                assert given.keys() <= fields.keys(), (kind, given.keys() - fields.keys())
                for name, of in fields.items():
                    setattr(self, name, given[name] if name in given else default(of))

            def checked(self):
                """As the store's own type; a value of another type than the definition's is refused."""
                return store.types[kind](**{name: checked(of, getattr(self, name), f"{kind}.{name}") for name, of in fields.items()})

        def checked(of, value, what):
            name, detail = of[0].name, of[1]
            if name == "BASE":
                wanted = {"string": str, "bool": bool}.get(detail[0], float if "float" in detail[0] else int)
                value = value[0] if detail[0] == "octet" or (detail[0] in ("byte", "uint8") and isinstance(value, bytes)) else value
                assert type(value) is wanted, (what, value, wanted)
                return value
            if name == "NAME":
                assert value.kind == detail, (what, value.kind)
                return value.checked()
            inner = detail[0]
            if inner[0].name == "BASE" and inner[1][0] != "string":
                numbers = numpy.frombuffer(value, "u1") if isinstance(value, bytes) else numpy.array(value)
                return numbers.astype(inner[1][0])
            return [checked(inner, v, what) for v in value]

        Message.kind, Message.__name__ = kind, kind.rsplit("/", 1)[1]
        return Message

    classes = {}
    for kind in ["builtin_interfaces/msg/Time", "std_msgs/msg/Header", "geometry_msgs/msg/Point", "geometry_msgs/msg/Vector3",
                 "geometry_msgs/msg/Quaternion", "geometry_msgs/msg/Transform", "geometry_msgs/msg/TransformStamped",
                 "diagnostic_msgs/msg/KeyValue", "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/DiagnosticArray",
                 "sensor_msgs/msg/Image", "sensor_msgs/msg/PointField", "sensor_msgs/msg/PointCloud2", "skin_msgs/msg/Touch",
                 "skin_msgs/msg/Touches", "tf2_msgs/msg/TFMessage"]:
        classes[kind] = message(kind)
        for name, _type, value in store.fielddefs[kind][0]:
            # rclpy has constants of the type byte as bytes.
            setattr(classes[kind], name, value)
    out = {}
    for kind, cls in classes.items():
        package = kind.split("/")[0]
        out.setdefault(package, types.ModuleType(package))
        setattr(out.setdefault(f"{package}.msg", types.ModuleType(f"{package}.msg")), cls.__name__, cls)
    now = types.SimpleNamespace(nanoseconds=time.time_ns())

    class Node:
        def create_publisher(self, kind, topic, qos):
            return publisher(kind, topic, qos)

        def get_clock(self):
            return types.SimpleNamespace(now=lambda: now)

    rclpy = {name: types.ModuleType(name) for name in ("rclpy", "rclpy.node", "rclpy.qos")}
    rclpy["rclpy.node"].Node = Node
    profile = lambda **values: values
    rclpy["rclpy.qos"].QoSProfile = profile
    rclpy["rclpy.qos"].DurabilityPolicy = types.SimpleNamespace(TRANSIENT_LOCAL=1)
    rclpy["rclpy.qos"].ReliabilityPolicy = types.SimpleNamespace(BEST_EFFORT=1)
    return out | rclpy


# --- what it costs ---------------------------------------------------------------------------------------------------------


def own_network():
    """From now on this process has a network that holds nothing but a loopback interface."""
    clone_newnet, siocsifflags, up_running = 0x40000000, 0x8914, 0x41
    if ctypes.CDLL(None, use_errno=True).unshare(clone_newnet):
        raise OSError(ctypes.get_errno(), "no network of its own (unshare)")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, siocsifflags, struct.pack("16sh14x", b"lo", up_running))


def loopback():
    """Packets and bytes on the loopback interface so far."""
    fields = next(line for line in pathlib.Path("/proc/net/dev").read_text().splitlines() if line.strip().startswith("lo:")).split()
    return numpy.array([int(fields[2]), int(fields[1])])


def threads_s(pid):
    """Processor time of a process by the kind of thread, s."""
    out = {"sending": 0.0, "skins": 0.0}
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        name, rest = re.match(r"\d+ \((.*)\) (.*)", (task / "stat").read_text(), re.S).groups()
        ticks = sum(map(int, rest.split()[11:13]))
        out["sending" if name.startswith(("ros2", "RustDDS")) else "skins"] += ticks / os.sysconf("SC_CLK_TCK")
    return out


def cost(folder, count):
    """Simulated skins, each with one reader of its touches and points."""
    file = folder / f"{count}.toml"
    place = '[skin.place]\nframe = "base"\nposition_mm = [0, 0, 0]\n'
    file.write_text("".join(f'[[skin]]\nname = "s{k}"\nsimulate = true\n{place}' for k in range(count)))
    listens = Subscriber(topics([f"s{k}" for k in range(count)], ["touches", "points"]))
    running = Running("run", "--skins", file, "--json", "--every-frame", "--ros2")
    for k in range(count):
        listens.wait(f"rt/s{k}/touches", 50, seconds=600)
    received = lambda: {name: len(messages) for name, messages in listens.messages.items()}
    before, at, wire, threads, own = received(), time.monotonic(), loopback(), threads_s(running.process.pid), time.process_time()
    time.sleep(SECONDS)
    after, took, wire, own = received(), time.monotonic() - at, loopback() - wire, time.process_time() - own
    threads = {kind: (s - threads[kind]) for kind, s in threads_s(running.process.pid).items()}
    # On a machine that carries no more it may not end in order within its second; what is measured is over.
    running.process.send_signal(signal.SIGINT)
    running.process.wait(timeout=120)
    running.thread.join()
    messages = listens.close()
    frames = sum(after[name] - before[name] for name in after if name.endswith("/touches"))
    got = {f"s{k}": {m.frame for m in messages[f"rt/s{k}/touches"]} for k in range(count)}
    shown = [(line["skin"], line["frame"]) for line in running.lines if line["kind"] == "picture"]
    # Before its publisher is known a reader gets nothing, nor what the end cut off.
    ends = {name: (min(frames), max(frames)) for name, frames in got.items()}
    known = [(name, frame) for name, frame in shown if ends[name][0] <= frame <= ends[name][1]]
    lost = sum(frame not in got[name] for name, frame in known)
    # Where the machine fell behind, the program itself sent newer ones in their place, and counted; its last line is missing where it
    # could not end in order.
    passed_over = (re.findall(r"frames of \d+ skins? sent, (\d+) passed over", running.said()) or ["an unknown number"])[0]
    points = [len(messages[f"rt/s{k}/points"]) for k in range(count)]
    mean = numpy.mean([len(m.touches) for k in range(count) for m in messages[f"rt/s{k}/touches"]])
    print(f"{count} skins: {frames / took:.0f} frames/s together, {frames / took / count:.0f} each, {mean:.2f} touches a frame; a frame costs"
          f" {wire[0] / frames:.2f} packets and {wire[1] / frames:.0f} bytes, {1e6 * threads['sending'] / frames:.0f} us of sending, {1e6 * threads['skins'] / frames:.0f} us of"
          f" skins with their boards, {1e6 * own / frames:.0f} us of this reader; {lost} of {len(known)} frames missing, {passed_over} passed"
          f" over by the program, {len(shown) - len(known)} before the reader knew of them or at the end; {len(shown) - sum(points)} clouds not"
          f" sent or lost")


with tempfile.TemporaryDirectory() as made:
    if SCALES:
        own_network()
        for skins in SCALES:
            cost(pathlib.Path(made), skins)
        sys.exit()
    for test in (one_skin, tare, several, restart, replayed):
        test(pathlib.Path(made))
