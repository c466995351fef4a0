#!/usr/bin/env python3
"""Recordings and their exports, read by other people's programs.

    tests/recordings.py [SKIN [RECORDINGS]]

SKIN is the program, target/debug/skin unless said; RECORDINGS how many make the fleet that DuckDB is asked about, 10 unless said.
Needs the packages mcap and numpy; scipy, pyeit, duckdb and rosbags where they are there.
Exit code 77: skipped, with the reason.
"""

import base64
import json
import pathlib
import subprocess
import sys
import tempfile
import time

try:
    import numpy
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
except ImportError as missing:
    print(f"skipped: {missing} (pip install mcap numpy scipy pyeit duckdb rosbags)")
    sys.exit(77)

SKIN = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent / "../target/debug/skin"
RECORDINGS = int(sys.argv[2]) if len(sys.argv) > 2 else 10


# Far from every line in which a disc is its own mirror.
SCENE = """duration_s = 9.0
[[touch]]
shape = "disc"
radius_mm = 12.5
keys = [{ t_s = 0.5, x_mm = 53.0, y_mm = 28.0, force_n = 0.0 }, { t_s = 0.8, force_n = 25.0 }, { t_s = 9.0 }]
"""


def skin(*arguments):
    return subprocess.run([SKIN, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def unstuffed(message):
    """COBS without its closing zero."""
    out, at = bytearray(), 0
    while at < len(message):
        code = message[at]
        out += message[at + 1 : at + code]
        at += code
        if code < 255 and at < len(message):
            out.append(0)
    return bytes(out)


class Postcard:
    """Takes values from postcard's bytes."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def integer(self):
        value = shift = 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def list(self, take):
        return [take() for _ in range(self.integer())]

    def sixteenths(self):
        self.at += 2
        return int.from_bytes(self.data[self.at - 2 : self.at], "little", signed=True)


def frame(message):
    """Sequence, samples since power-up, sixteenths of a code; None for what is no frame."""
    assert message[-1] == 0
    card = Postcard(unstuffed(message[:-1])[:-4])
    if card.integer() != 2:
        return None
    sequence, samples = card.integer(), card.integer()
    card.integer()  # the plan
    card.list(card.integer)  # what clipped
    return sequence, samples, card.list(card.sixteenths)


def same_digits(recorded, printed):
    """Whether two values are the same to the six digits that are printed."""
    if isinstance(recorded, list):
        return len(recorded) == len(printed) and all(map(same_digits, recorded, printed))
    if isinstance(recorded, dict):
        return recorded.keys() == printed.keys() and all(same_digits(recorded[k], printed[k]) for k in recorded)
    if isinstance(recorded, float):
        return abs(recorded - printed) <= 5.1e-6 * abs(recorded)
    return recorded == printed


def main(folder):
    whole = folder / "press.mcap"
    scene = folder / "press.toml"
    scene.write_text(SCENE)
    lines = skin("run", "--scene", scene, "--json", "--frames", "300", "--record", whole).splitlines()
    shown = [line for line in map(json.loads, lines) if line["kind"] == "picture"]
    info = json.loads(skin("info", whole, "--json"))

    frames, touches, schemas, log = [], [], {}, []
    with open(whole, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "skin"
        counts = {c.topic: reader.get_summary().statistics.channel_message_counts.get(i, 0)
                  for i, c in reader.get_summary().channels.items()}
        for schema, channel, message in reader.iter_messages():
            log.append(message.log_time)
            if channel.topic == "/board":
                taken = frame(message.data)
                if taken:
                    frames.append(taken)
                    # Measured before it arrived.
                    assert message.publish_time <= message.log_time
            elif channel.message_encoding == "json":
                schemas[channel.topic] = schema.name
                value = json.loads(message.data)
                if channel.topic == "/touches":
                    touches.append(value)
    assert counts == info["messages"], (counts, info["messages"])
    assert log == sorted(log)
    assert schemas["/picture"] == "foxglove.CompressedImage" and schemas["/log"] == "foxglove.Log"
    assert schemas["/touches/points"] == "foxglove.PointCloud"
    assert same_digits([t["touches"] for t in touches], [s["touches"] for s in shown])
    assert len(frames) == info["frames"]
    print(f"mcap: {len(frames)} frames, {len(touches)} pictures")

    skin("export", whole, "--to", "npz", "--out", folder / "a.npz")
    arrays = numpy.load(folder / "a.npz")
    by_sequence = {s: (t, v) for s, t, v in frames}
    assert arrays["v"].shape == (len(arrays["sequence"]), 208) and arrays["v0"].shape == (208,)
    # Volts over codes is one number of the board.
    codes = numpy.array([by_sequence[s][1] for s in arrays["sequence"]], float)
    good = numpy.isfinite(arrays["v"]) & (codes != 0)
    volts_per_code = (arrays["v"][good] / codes[good])
    assert numpy.ptp(volts_per_code) < 1e-12 * abs(volts_per_code[0]), numpy.ptp(volts_per_code)
    assert numpy.all(numpy.diff(arrays["time_s"]) > 0)
    skin("export", whole, "--to", "frames-csv", "--out", folder / "a.csv")
    assert numpy.array_equal(numpy.loadtxt(folder / "a.csv", delimiter=","), arrays["v"], equal_nan=True)
    print("numpy: the same values")

    try:
        import scipy.io
    except ImportError as missing:
        print(f"not held: {missing}")
    else:
        skin("export", whole, "--to", "mat", "--out", folder / "a.mat")
        mat = scipy.io.loadmat(folder / "a.mat")
        assert numpy.array_equal(mat["vi"].T, arrays["v"], equal_nan=True)
        assert mat["vh"].shape == (208, 1) and numpy.array_equal(mat["vh"][:, 0], arrays["v0"])
        assert numpy.array_equal(mat["drive"][:, 0], [1, 2]) and numpy.array_equal(mat["sense"][:, 0], [4, 3])
        print("scipy: the same values")

    try:
        from pyeit.eit import protocol
    except ImportError as missing:
        print(f"not held: {missing}")
    else:
        theirs = protocol.create(16, dist_exc=1, step_meas=1, parser_meas="std")
        assert numpy.array_equal(arrays["ex_mat"], theirs.ex_mat)
        assert numpy.array_equal(arrays["meas_mat"].reshape(theirs.meas_mat.shape), theirs.meas_mat)
        mirrored(arrays, touches)

    try:
        import duckdb
    except ImportError as missing:
        print(f"not held: {missing}")
    else:
        tables(folder, whole, arrays, touches)
        placed(folder)
        fleet(folder)

    try:
        import rosbags
    except ImportError as missing:
        print(f"not held: {missing}")
    else:
        bag(folder, whole, arrays, touches)

    # What was cut off is no file for others, until it is recovered.
    cut = folder / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    try:
        with open(cut, "rb") as file:
            list(make_reader(file).iter_messages())
        raise AssertionError("a file that was cut short passes for a whole one")
    except (McapError, EOFError, ValueError):
        pass
    skin("recover", cut, "--out", folder / "recovered.mcap")
    with open(folder / "recovered.mcap", "rb") as file:
        again = [frame(m.data) for _, c, m in make_reader(file).iter_messages(topics=["/board"])]
    again = [f for f in again if f]
    assert 0 < len(again) < len(frames) and again == frames[: len(again)]
    print(f"recovered: {len(again)} of {len(frames)} frames")


ROBOT = ["robot_x_mm", "robot_y_mm", "robot_z_mm"]
TOUCH = ["id", "x_mm", "y_mm", "rise", "area_mm2", "total_mm2", "force_n", "uncalibrated"]


def rows_of(touches):
    """Frame, time and the touch's own values, as the recording has them."""
    return [(t["frame"], t["time_s"], *(x.get(key) for key in TOUCH)) for t in touches for x in t["touches"]]


def tables(folder, whole, arrays, touches):
    """Parquet holds the recording's values to the last bit."""
    import duckdb

    skin("export", whole, "--to", "parquet", "--out", folder / "tables")
    frames = duckdb.sql(f"select frame, time_s, epoch_us(time), values_v from '{folder}/tables/frames/**/*.parquet' order by time_s").fetchall()
    assert [f[0] for f in frames] == arrays["sequence"].tolist()
    assert [f[1] for f in frames] == arrays["time_s"].tolist()
    assert numpy.allclose([f[2] for f in frames], 1e6 * arrays["unix_s"], rtol=0, atol=1.5)
    assert numpy.array_equal([f[3] for f in frames], arrays["v"], equal_nan=True)
    read = f"select frame, time_s, {', '.join(TOUCH)} from '{folder}/tables/touches/**/*.parquet' order by time_s"
    assert duckdb.sql(read).fetchall() == rows_of(touches) and touches
    said = duckdb.sql(f"select decode(value) from parquet_kv_metadata('{folder}/tables/touches/**/*.parquet') where decode(key) = 'skin.session'")
    assert json.loads(said.fetchall()[0][0])["values"] == 208
    again = subprocess.run([SKIN, "export", whole, "--to", "parquet", "--out", folder / "tables"], capture_output=True, text=True)
    assert again.returncode == 1 and "exported there before" in again.stderr, again
    print(f"DuckDB: {len(frames)} frames and {len(rows_of(touches))} touches, the same values")


PLACE = """[[skin]]
name = "placed"
scene = "press.toml"
[skin.place]
frame = "wrist"
position_mm = [10.0, -20.0, 30.0]
roll_pitch_yaw_deg = [25.0, -40.0, 110.0]

[[skin]]
name = "loose"
scene = "press.toml"
"""


def placed(folder):
    """Touches of a skin with a place are on the robot where its turns about x, y and z and its position take them."""
    import duckdb

    (folder / "placed.toml").write_text(PLACE)
    both = folder / "both.mcap"
    skin("run", "--skins", folder / "placed.toml", "--json", "--frames", "150", "--record", both)
    skin("export", both, "--to", "parquet", "--out", folder / "placed")
    [(roll_s, roll_c), (pitch_s, pitch_c), (yaw_s, yaw_c)] = [
        (numpy.sin(a), numpy.cos(a)) for a in numpy.radians([25.0, -40.0, 110.0])
    ]
    about_x = numpy.array([[1, 0, 0], [0, roll_c, -roll_s], [0, roll_s, roll_c]])
    about_y = numpy.array([[pitch_c, 0, pitch_s], [0, 1, 0], [-pitch_s, 0, pitch_c]])
    about_z = numpy.array([[yaw_c, -yaw_s, 0], [yaw_s, yaw_c, 0], [0, 0, 1]])
    columns = ", ".join(["x_mm", "y_mm", *ROBOT])
    rows = {}
    for name in ["placed", "loose"]:
        table = f"read_parquet('{folder}/placed/touches/**/*.parquet', hive_partitioning = true)"
        rows[name] = duckdb.sql(f"select {columns} from {table} where skin = '{name}' order by time_s").fetchall()
        # The same in CSV.
        skin("export", f"{both}#{name}", "--to", "touches-csv", "--out", folder / f"{name}.csv")
        csv = duckdb.sql(f"select {columns} from read_csv('{folder}/{name}.csv', all_varchar = true)").fetchall()
        assert [[v and float(v) for v in row] for row in csv] == [list(row) for row in rows[name]] and csv
    for x, y, *robot in rows["placed"]:
        wanted = about_z @ about_y @ about_x @ [x, y, 0.0] + [10.0, -20.0, 30.0]
        assert numpy.abs(wanted - robot).max() < 1e-9, (x, y, robot, wanted)
    assert all(row[2:] == (None, None, None) for row in rows["loose"])
    print(f"DuckDB: {len(rows['placed'])} touches on the robot")


def fleet(folder):
    """Many recordings are one table."""
    import duckdb
    from concurrent.futures import ThreadPoolExecutor

    def recording(k):
        file = folder / f"fleet-{k:03}.mcap"
        printed = skin("run", "--scene", folder / "press.toml", "--json", "--frames", "90", "--baseline-frames", "8", "--record", file)
        skin("export", file, "--to", "parquet", "--out", folder / "fleet")
        shown = [line for line in map(json.loads, printed.splitlines()) if line["kind"] == "picture"]
        return file.stem, sum(len(line["touches"]) for line in shown)

    with ThreadPoolExecutor(6) as pool:
        expected = dict(pool.map(recording, range(RECORDINGS)))
    query = f"""select recording, count(*), max(force_n) from read_parquet('{folder}/fleet/touches/**/*.parquet', hive_partitioning = true)
                where skin = 'sim' group by recording"""
    start = time.perf_counter()
    found = duckdb.sql(query).fetchall()
    took_ms = 1000 * (time.perf_counter() - start)
    assert {name: count for name, count, _ in found} == {name: count for name, count in expected.items() if count}
    assert len(expected) == RECORDINGS and sum(expected.values()) > 0
    frames = duckdb.sql(f"select count(*), count(distinct recording) from read_parquet('{folder}/fleet/frames/**/*.parquet', hive_partitioning = true)")
    frames, recordings = frames.fetchall()[0]
    assert recordings == RECORDINGS
    print(f"DuckDB: {recordings} recordings, {frames} frames, {sum(expected.values())} touches; one query over all takes {took_ms:.0f} ms")


def bag(folder, whole, arrays, touches):
    """ROS 2's own types are read by the definitions in the file."""
    from rosbags.highlevel import AnyReader

    skin("export", whole, "--to", "rosbag2", "--out", folder / "bag")
    read = {}
    with AnyReader([folder / "bag"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        times = []
        for connection, unix_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == unix_ns
            times.append(unix_ns)
            read.setdefault(connection.topic, []).append(message)
    assert counts == {topic: len(messages) for topic, messages in read.items()} and times == sorted(times)
    frames = read["/skin/frames"]
    assert [f.frame for f in frames] == arrays["sequence"].tolist()
    assert [f.time_s for f in frames] == arrays["time_s"].tolist()
    assert numpy.array_equal([f.values_v for f in frames], arrays["v"], equal_nan=True)
    assert [m.frame for m in read["/skin/touches"]] == [t["frame"] for t in touches]
    held = [touch for m in read["/skin/touches"] for touch in m.touches]
    rows = [x for t in touches for x in t["touches"]]
    assert len(held) == len(rows) and {m.header.frame_id for m in read["/skin/touches"]} == {"skin_sheet"}
    # Metres there, mm in the recording.
    for touch, row in zip(held, rows):
        variance = touch.position_covariance[0]
        found = [touch.id or None, touch.rise, 1e6 * touch.area, 1e6 * touch.total, touch.force]
        found += [1e3 * touch.position.x, 1e3 * touch.position.y, None if variance < 0 else 1e3 * variance**0.5]
        keys = ["id", "rise", "area_mm2", "total_mm2", "force_n", "x_mm", "y_mm", "x_sd_mm"]
        for f, key in zip(found, keys):
            expected = row.get(key)
            same = f is None or numpy.isnan(f) if expected is None else abs(f - expected) <= 1e-12 * abs(expected)
            assert same, (key, f, expected)
        assert touch.uncalibrated == row.get("uncalibrated", False)
    with open(whole, "rb") as file:
        pictures = [json.loads(m.data)["data"] for _, _, m in make_reader(file).iter_messages(topics=["/picture"])]
    assert [base64.b64decode(p) for p in pictures] == [m.data.tobytes() for m in read["/skin/picture"]] and pictures
    print(f"rosbags: {len(frames)} frames, {len(held)} touches, {len(pictures)} pictures, the same values")


def mirrored(arrays, touches):
    """pyEIT's back projection finds a lone touch on the side where it is, not its mirror's."""
    import pyeit.eit.bp as bp
    import pyeit.mesh as mesh
    from pyeit.eit.protocol import PyEITProtocol

    ours = PyEITProtocol(
        arrays["ex_mat"].astype(int), arrays["meas_mat"].astype(int).reshape(16, -1, 2), numpy.ones(208, bool)
    )
    disc = mesh.create(16, h0=0.1)
    eit = bp.BP(disc, ours)
    eit.setup(weight="none")
    strongest = max(touches, key=lambda t: max((x["total_mm2"] for x in t["touches"]), default=0))
    weight = sum(x["total_mm2"] for x in strongest["touches"])
    place = [sum(x["total_mm2"] * x[key] for x in strongest["touches"]) / weight / 97.5 for key in ("x_mm", "y_mm")]
    at = int(numpy.flatnonzero(arrays["sequence"] == strongest["frame"])[0])
    change = -eit.solve(arrays["v"][at], arrays["v0"], normalize=True)
    values = numpy.clip(numpy.real(change), 0, None) ** 4
    found = (disc.node[:, :2] * values[:, None]).sum(0) / values.sum()
    # Their mesh may have its electrodes elsewhere than ours (electrode 1 at +x, counter-clockwise).
    angles = 2 * numpy.pi * numpy.arange(16) / 16
    ours = numpy.stack([numpy.cos(angles), numpy.sin(angles)], 1)
    to_theirs = numpy.linalg.lstsq(ours, disc.node[disc.el_pos, :2], rcond=None)[0]
    x, y = place
    distance = [
        numpy.hypot(*(found - numpy.array(p) @ to_theirs)) for p in [(x, y), (-x, y), (x, -y), (-x, -y), (y, x), (-y, -x)]
    ]
    print(f"pyEIT: the touch is found {distance[0]:.2f} radii from its place, {min(distance[1:]):.2f} from its nearest mirror image")
    # Back projection smears by a quarter of the radius.
    assert distance[0] < 0.25 and distance[0] < 0.5 * min(distance[1:]), distance


with tempfile.TemporaryDirectory() as made:
    main(pathlib.Path(made))
