#!/usr/bin/env python3
"""Recordings and their exports, read by other people's programs.

    tests/recordings.py [SKIN]

SKIN is the program, target/debug/skin unless said. Needs the packages mcap and numpy; scipy and pyeit where they are there.
Exit code 77: skipped, with the reason.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

try:
    import numpy
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
except ImportError as missing:
    print(f"skipped: {missing} (pip install mcap numpy scipy)")
    sys.exit(77)

SKIN = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent / "../target/debug/skin"


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
