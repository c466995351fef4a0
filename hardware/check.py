#!/usr/bin/env python3
"""Simulates the sensor board in ngspice and compares it with what docs/board.md, the firmware and hil-sim say.

    python3 hardware/check.py              prints the table; exit code 1 on a miss, 77 if ngspice is not installed
    python3 hardware/check.py --verbose    also the simulator's warnings

First the description's own rules and its generated files (board.py --check). Then every netlist of hardware/spice.
Last the same checks on boards with planted faults, and on the circuit as it was drawn before: each must be found.
Only Python's standard library and Debian's ngspice are used. All bounds are in BOUNDS and ASSUMED.
"""

import cmath
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import board as hardware
import draw

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent

# Excitation and converter: 84 MHz / 1425 / 16; 12 bits over 3.3 V; the DAC's amplitude in codes.
F = 84e6 / 1425 / 16
CODE_V = 3.3 / 4095
DAC_V = 1788 / 4096 * 3.3
SAMPLE_S = 1 / F / 16
SUPPLIES = (4.40, 4.75, 5.00, 5.25)

# name: lowest, highest, unit, what it is. One place for all bounds of the simulated circuit.
BOUNDS = {
    # The source.
    "drive_v": (2.2275, 2.2725, "V", "amplitude between two driven neighbours: 2.25 V within 1 %"),
    "drive_balance": (0.0, 0.01, "", "common part of drive + and drive - against one of them"),
    "drive_dc_v": (-0.010, 0.010, "V", "mean voltage between the drive's ends"),
    "drive_image_15": (0.0, 0.005, "", "what is left of the DAC's steps at 15 times the frequency"),
    "drive_image_17": (0.0, 0.005, "", "the same at 17 times"),
    "drive_peak_room_v": (0.40, 9.0, "V", "from the highest crest of either end to the op-amp's rail, at 4.40 V"),
    # Transfer to the converter.
    "lag_pa0_deg": (56.0, 58.5, "deg", "from the DAC's table to the amplifier's converter input, half a step included"),
    "lag_pa1_deg": (55.0, 62.0, "deg", "the same for the difference amplifier"),
    "lag_pa6_deg": (54.0, 58.0, "deg", "the same for the source's monitor"),
    "gain_pa0": (12.5, 12.75, "", "sense pair to PA0, filter included"),
    "gain_pa1": (0.576, 0.594, "", "drive pair to PA1, filter included, in phase with PA0"),
    "gain_pa6": (0.282, 0.289, "", "drive pair's open voltage to PA6, filter included"),
    "alias_15_db": (-99.0, -11.0, "dB", "a signal at 15 times the frequency at PA0, against the signal"),
    "alias_17_db": (-99.0, -12.0, "dB", "the same at 17 times"),
    # Head room.
    **{f"head_error_{int(v * 100)}": (0.0, 0.002, "", f"worst error of the 13 values of a drive at {v:.2f} V") for v in SUPPLIES},
    **{f"head_room_{int(v * 100)}_v": (0.25, 9.0, "V", f"of the INA826's inner amplifiers at {v:.2f} V") for v in SUPPLIES},
    "converter_room_v": (0.20, 9.0, "V", "from the crests at PA0 to the ends of the converter, strongest pair"),
    # Settling after a multiplexer step: from the strongest pair of a drive to a weak one, and to another drive.
    **{f"{name}_{rest}": bound for name, words in (("settle", "weak pair"), ("settle_drive", "another drive"))
       for rest, bound in (
           ("quarter_codes", (0.0, 4.0, "codes", f"{words}: left at PA0 after a quarter period")),
           ("value_codes", (0.0, 0.5, "codes", f"{words}: error of a value of one period, begun after that quarter")),
           # The simulator's own steps are uncertain by some 0.1 code.
           ("period_codes", (0.0, 0.25, "codes", f"{words}: left at PA0 after one period")))},
    # Stability.
    **{f"margin_{a}_deg": (45.0, 120.0, "deg", f"phase margin of {a.upper()}: {what}") for a, what in (
        ("u1a", "source filter"), ("u1b", "inverter"), ("u1c", "2.5 V"), ("u1d", "1.65 V"),
        ("u2a", "difference amplifier"), ("u2b", "spare"))},
    # The same with worse chips than assumed: input capacitances 1.5 and 2 times as large, 30 % more bandwidth. And an
    # INA826 that reaches 0.1 V less far, 0.1 V higher up.
    "margin_worse_deg": (35.0, 120.0, "deg", "least phase margin of all with worse op-amps than assumed"),
    "head_worse_error": (0.0, 0.002, "", "worst of 13 values at 4.40 V with a worse INA826 than assumed"),
    "head_worse_room_v": (0.1, 9.0, "V", "its inner amplifiers' room"),
    # Noise without the converter's own.
    "noise_pa0_codes": (0.0, 0.10, "codes", "analogue noise at PA0, rms"),
    "noise_pa1_codes": (0.0, 0.10, "codes", "the same at PA1"),
    "noise_drive_ppm": (0.0, 60.0, "ppm", "noise of the drive, rms, against its amplitude"),
    # Supplies.
    "usb_to_vr_db": (-999.0, -60.0, "dB", "from the USB supply to V_R at the excitation's frequency"),
    "usb_to_drive_db": (-999.0, -60.0, "dB", "from the USB supply to the drive between neighbours"),
    "usb_to_pa0_db": (-999.0, -60.0, "dB", "from the USB supply to PA0"),
    "avdd_to_pa0_db": (-999.0, -60.0, "dB", "from the processor's analogue supply to PA0"),
    "supply_ma": (2.0, 15.0, "mA", "drawn from 5 V"),
    "power_up_s": (0.0, 0.6, "s", "until the drive's mean is within 10 mV after power-up"),
    # The phantom: sixteen resistors of 470 ohm in a ring.
    "phantom_codes": (1580.0, 1650.0, "codes", "amplitude of every sense pair at PA0"),
    # The difference amplifier's 1 M load the pair that is connected: 0.25 % next to the drive.
    "phantom_spread": (0.0, 0.004, "", "largest departure of one of the 13 values from their mean"),
    "phantom_formula": (0.995, 1.005, "", "the same against 2.25 V (R/16) / (15 R/16 + 2 R_on)"),
    "phantom_pa1_codes": (1080.0, 1180.0, "codes", "amplitude of the drive pair itself at PA1"),
    # Tolerances: resistors 1 %, capacitors 5 %, one at a time, added up to the worse side.
    # The firmware stops at a source 10 % off; the monitor's own resistors take 2 % of that.
    "tolerance_drive": (0.0, 0.07, "", "change of the drive's amplitude"),
    "tolerance_value": (0.0, 0.04, "", "change of a value against the drive's"),
    "tolerance_lag_deg": (0.0, 5.0, "deg", "change of the lag at PA0"),
    "tolerance_quadrature": (0.0, 0.005, "", "part of a value that such a lag costs"),
}

# What firmware and hil-sim assume: file, pattern of the number there, unit, figure of the circuit, allowed relative
# difference (absolute for degrees).
ASSUMED = {
    "firmware excitation_uv": ("boards/stm32f4/src/main.rs", r"excitation_uv: ([\d_]+)", 1e-6, "drive_v", 0.01),
    "firmware gains_milli[0]": ("boards/stm32f4/src/main.rs", r"gains_milli: \[([\d_]+),", 1e-3, "gain_pa0", 0.01),
    "firmware gains_milli[1]": ("boards/stm32f4/src/main.rs", r"gains_milli: \[[\d_]+, ([\d_]+),", 1e-3, "gain_pa1", 0.01),
    "firmware source_gain_milli": ("boards/stm32f4/src/main.rs", r"source_gain_milli: ([\d_]+)", 1e-3, "gain_pa6", 0.01),
    "firmware LEAD_TURNS, degrees": ("boards/stm32f4/src/sine.rs", r"([\d.]+) / 360\.0", 1.0, "lag_pa0_deg", 1.0),
    "hil-sim excitation_v": ("hil-sim/src/electronics.rs", r"excitation_v: ([\d.]+)", 1.0, "drive_v", 0.01),
    "hil-sim switch_ohm": ("hil-sim/src/electronics.rs", r"switch_ohm: ([\d.]+)", 1.0, "switch_ohm", 0.01),
    "hil-sim settling_s": ("hil-sim/src/electronics.rs", r"settling_s: ([\d.e-]+)", 1.0, "settling_s", 0.1),
    "hil-sim source_filter_hz": ("hil-sim/src/electronics.rs", r"source_filter_hz: ([\d_.]+)", 1.0, "_corner_hz", 0.01),
    "hil-sim supply_v": ("hil-sim/src/electronics.rs", r"supply_v: Some\(([\d.]+)\)", 1.0, "_p5va", 0.002),
    "hil-sim drive_noise_v": ("hil-sim/src/electronics.rs", r"drive_noise_v: ([\d.e-]+)", 1.0, "_drive_noise_v", 0.05),
    "hil-sim supply_to_drive": ("hil-sim/src/electronics.rs", r"supply_to_drive: ([\d.e-]+)", 1.0, "_usb_to_drive", 0.05),
    "hil-sim supply_to_channels": ("hil-sim/src/electronics.rs", r"supply_to_channels: ([\d.e-]+)", 1.0, "_usb_to_pa0", 0.05),
    "hil-sim gains_milli[0]": ("hil-sim/src/electronics.rs", r"gains_milli: vec!\[([\d_]+),", 1e-3, "gain_pa0", 0.01),
    "hil-sim gains_milli[1]": ("hil-sim/src/electronics.rs", r"gains_milli: vec!\[[\d_]+, ([\d_]+)", 1e-3, "gain_pa1", 0.01),
    "hil-sim source_gain_milli": ("hil-sim/src/electronics.rs", r"source_gain_milli: ([\d_]+)", 1e-3, "gain_pa6", 0.01),
}

# What the list of test points says in volts: point, pattern of the number, allowed difference in volts.
TEST_POINTS = {
    "TP1": (r"([\d.]+) V amplitude", lambda f: DAC_V, 0.01),
    "TP2": (r"([\d.]+) V amplitude", lambda f: f["drive_v"] / 2, 0.01),
    "TP4": (r"([\d.]+) V at 5.00 V", lambda f: f["_vr"], 0.01),
    "TP6": (r"([\d.]+) V amplitude", lambda f: f["gain_pa6"] * f["drive_v"], 0.01),
    "TP7": (r"([\d.]+) V amplitude", lambda f: f["phantom_codes"] * CODE_V, 0.01),
    "TP8": (r"([\d.]+) V amplitude", lambda f: f["phantom_pa1_codes"] * CODE_V, 0.01),
    "TP12": (r"([\d.]+) mV below", lambda f: 1e3 * (5.0 - f["_p5va"]), 2.0),
}

# Simulated figures in docs/board.md: pattern of the number there, and the figure. The number must be the figure, rounded
# as it is written there.
DOCUMENTED = (
    (r"drive between neighbours \|[^|]*\|[^|]*\| ([\d.]+) V", lambda f: f["drive_v"]),
    (r"left at 15 f, 17 f \|[^|]*\|[^|]*\| ([\d.]+) %", lambda f: 100 * f["drive_image_15"]),
    (r"left at 15 f, 17 f \|[^|]*\|[^|]*\| [\d.]+ %, ([\d.]+) %", lambda f: 100 * f["drive_image_17"]),
    (r"sense pair to PA0 \|[^|]*\|[^|]*\| ([\d.]+)", lambda f: f["gain_pa0"]),
    (r"at PA0, against f \|[^|]*\|[^|]*\| (-[\d.]+),", lambda f: f["alias_15_db"]),
    (r"at PA0, against f \|[^|]*\|[^|]*\| -[\d.]+, (-[\d.]+) dB", lambda f: f["alias_17_db"]),
    (r"drive pair to PA1 \|[^|]*\|[^|]*\| ([\d.]+)", lambda f: f["gain_pa1"]),
    (r"open voltage to PA6 \|[^|]*\|[^|]*\| ([\d.]+)", lambda f: f["gain_pa6"]),
    (r"table to PA0, lag \|[^|]*\|[^|]*\| ([\d.]+) degrees", lambda f: f["lag_pa0_deg"]),
    (r"\| (-\d+) dB from 5 V at f", lambda f: f["usb_to_vr_db"]),
    (r"([\d.]+) s to 10 mV", lambda f: f["power_up_s"]),
    (r"drawn from 5 V \|[^|]*\|[^|]*\| ([\d.]+) mA", lambda f: f["supply_ma"]),
    (r"Simulated room is ([\d.]+) V at 4.40", lambda f: f["head_room_440_v"]),
    (r"at 4.40 V, ([\d.]+) at 4.75", lambda f: f["head_room_475_v"]),
    (r"([\d.]+) at 5.00 and [\d.]+ at 5.25 V\.", lambda f: f["head_room_500_v"]),
    (r"at 5.00 and ([\d.]+) at 5.25 V\.", lambda f: f["head_room_525_v"]),
    (r"13 values of a drive is ([\d.]+) % off", lambda f: 100 * max(f[f"head_error_{int(v * 100)}"] for v in SUPPLIES)),
    (r"Phase margins are (\d+) \(U1A\)", lambda f: f["margin_u1a_deg"]),
    (r"(\d+) \(U1B\)", lambda f: f["margin_u1b_deg"]),
    (r"(\d+) \(U1C\)", lambda f: f["margin_u1c_deg"]),
    (r"(\d+) \(U1D\)", lambda f: f["margin_u1d_deg"]),
    (r"(\d+) degrees \(U2A\)", lambda f: f["margin_u2a_deg"]),
    (r"bandwidth the least is (\d+) degrees", lambda f: f["margin_worse_deg"]),
    (r"still has ([\d.]+) V at 4.40 V", lambda f: f["head_worse_room_v"]),
    (r"weak one ([\d.]+) codes are left", lambda f: f["settle_quarter_codes"]),
    (r"is off by ([\d.]+)\s+code", lambda f: f["settle_value_codes"]),
    (r"it is ([\d.]+) code rms at PA0", lambda f: f["noise_pa0_codes"]),
    (r"and ([\d.]+) at PA1", lambda f: f["noise_pa1_codes"]),
    (r"the drive is off by\s+([\d.]+) %", lambda f: 100 * f["tolerance_drive"]),
    (r"a value against the drive by ([\d.]+) %", lambda f: 100 * f["tolerance_value"]),
    (r"the lag by ([\d.]+) degrees", lambda f: f["tolerance_lag_deg"]),
    (r"ngspice gives (\d+) codes", lambda f: f["phantom_codes"]),
    (r"read up to ([\d.]+) % more", lambda f: 100 * f["phantom_spread"]),
    (r"drive pair are ([\d.]+) % off at 5.00 V", lambda f: 100 * f["_old_500"]),
    (r"and ([\d.]+) % at 4.75 V", lambda f: 100 * f["_old_475"]),
)

# ---------------------------------------------------------------------------------------------------------------------
# ngspice.

VERBOSE = "--verbose" in sys.argv


class NgspiceError(Exception):
    pass


def run(bench, parameters=None, board_text=None, sheet="sheet.spice", edit=None):
    """One netlist in a folder of its own: its RESULT lines and the files that it wrote."""
    text = (HERE / "spice" / bench).read_text(encoding="utf-8")
    for name, value in (parameters or {}).items():
        text, found = re.subn(rf"(\.param[^\n]*\b{name}=)[^\s]+", rf"\g<1>{value!r}", text, count=1)
        if not found:
            raise NgspiceError(f"{bench} has no parameter {name}")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        board_file = folder / "board.spice"
        board_file.write_text(board_text or hardware.spice(hardware.describe()), encoding="utf-8")
        for name in ("models.inc", "bench.inc", "dac.inc"):
            include = (HERE / "spice" / name).read_text(encoding="utf-8")
            (folder / name).write_text(edit(name, include) if edit else include, encoding="utf-8")
        text = text.replace("../generated/board.spice", "board.spice")
        text = text.replace("../generated/sheet.spice", str(HERE / "generated" / sheet))
        (folder / bench).write_text(text, encoding="utf-8")
        done = subprocess.run(["ngspice", "-b", bench], cwd=folder, capture_output=True, text=True, timeout=120)
        if VERBOSE:
            print(done.stderr, file=sys.stderr)
        results = {}
        for line in done.stdout.splitlines():
            if line.startswith("RESULT "):
                _, name, *numbers = line.replace('"', "").split()
                if len(numbers) == 3:
                    name = f"{name}_{numbers.pop(0)}"
                results[name] = [float(x) for x in numbers]
        files = {}
        for path in folder.iterdir():
            if path.suffix in (".inc", ".spice", ".cir"):
                continue
            files[path.name.removesuffix(".data")] = [[float(x) for x in line.split()] for line in path.open()]
        if not results and not files:
            raise NgspiceError(f"{bench}: ngspice gave nothing\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
        return results, files


def column(rows, n):
    """Time and the n-th vector of a file of wrdata."""
    return [row[0] for row in rows], [row[2 * n + 1] for row in rows]


def at(times, values, moments):
    out, i = [], 0
    for t in moments:
        while i + 2 < len(times) and times[i + 1] < t:
            i += 1
        share = (t - times[i]) / (times[i + 1] - times[i])
        out.append(values[i] + share * (values[i + 1] - values[i]))
    return out


def lock_in(times, values, begin, periods=3):
    """Amplitude and phase as the firmware takes them: sixteen samples a period, against a sine from time 0."""
    count = 16 * periods
    first = round(begin / SAMPLE_S)
    samples = at(times, values, [(first + k) * SAMPLE_S for k in range(count)])
    total = sum(v * cmath.exp(-2j * math.pi * (first + k) / 16) for k, v in enumerate(samples))
    # A sine A sin(wt + p) correlates to A exp(j (p - 90 degrees)) / 2.
    return total * 2j / count, sum(samples) / count


def degrees(z):
    return math.degrees(cmath.phase(z))


# ---------------------------------------------------------------------------------------------------------------------
# Figures from simulations.


def transfer(board_text=None, own_too=True, **parameters):
    figures = {}
    near, _ = run("transfer.cir", parameters, board_text)
    own = near
    if own_too:
        own, _ = run("transfer.cir", {**parameters, "sp": 0, "sm": 1, "sp2": 0, "sm2": 1}, board_text)
    z = lambda r, name: complex(*r[name])
    hold = math.sin(math.pi / 16) / (math.pi / 16)
    drive = z(near, "drive_1")
    figures["drive_v"] = abs(drive) * DAC_V * hold
    figures["drive_balance"] = abs(z(near, "common_1") / z(near, "drive_p_1"))
    for k in (15, 17):
        # Held steps leave 1 / (k) of the fundamental at k = 15 and 17.
        figures[f"drive_image_{k}"] = abs(z(near, f"drive_{k}") / drive) / k
        ratio = (z(near, f"pa0_{k}") / z(near, f"sense_{k}")) / (z(near, "pa0_1") / z(near, "sense_1"))
        figures[f"alias_{k}_db"] = 20 * math.log10(abs(ratio))
    gain = -z(near, "pa0_1") / z(near, "sense_1")
    if gain.real < 0:
        gain = -gain
    figures["gain_pa0"] = abs(gain)
    lag = lambda x: -degrees(x) + 11.25
    # The sense pair next to the drive has the opposite sign.
    figures["lag_pa0_deg"] = lag(-z(near, "pa0_1"))
    figures["lag_pa1_deg"] = lag(z(own, "pa1_1"))
    figures["lag_pa6_deg"] = lag(z(near, "pa6_1"))
    pa1 = z(own, "pa1_1") / z(own, "own_1")
    figures["gain_pa1"] = abs(pa1) * math.cos(math.radians(figures["lag_pa1_deg"] - figures["lag_pa0_deg"]))
    figures["gain_pa6"] = abs(z(near, "pa6_1") / drive)
    figures["_value"] = abs(z(near, "pa0_1"))
    return figures


def chain_errors(rows, first, node_rail, gain_ohm=4120.0):
    """Of the 13 amplifiers: worst departure from the linear one, and the least room of their inner nodes."""
    worst, room = 0.0, 9.0
    signed = []
    for k in range(13):
        out, _ = lock_in(*column(rows, first + 4 * k), 4 / F)
        pair, _ = lock_in(*column(rows, first + 4 * k + 1), 4 / F)
        gain = 1 + 49.4e3 / gain_ohm
        # The amplifier's own 450 kHz are in its output, in phase and amplitude alike: compare along the expected phase.
        expected = pair * gain / complex(1, F / 450e3)
        error = (out / expected).real - 1
        signed.append(error)
        worst = max(worst, abs(error))
        for inner in (2, 3):
            times, values = column(rows, first + 4 * k + inner)
            room = min(room, node_rail - 0.1 - max(values), min(values) - 0.1)
    return worst, room, signed


def head_room(board_text=None, supplies=SUPPLIES, gain_ohm=4120.0):
    figures = {}

    def one(vusb):
        return vusb, run("chain.cir", {"vusb": vusb, "rg": gain_ohm}, board_text)[1]["chain"]

    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(one, supplies))
    for vusb, rows in runs:
        rail = rows[-1][2 * 6 + 1]
        worst, room, _ = chain_errors(rows, 8, rail, gain_ohm)
        figures[f"head_error_{int(vusb * 100)}"] = worst
        figures[f"head_room_{int(vusb * 100)}_v"] = room
        late = [i for i, row in enumerate(rows) if row[0] > 3 / F]
        peak = {name: [rows[i][2 * n + 1] for i in late] for n, name in ((0, "pa0"), (3, "p"), (4, "n"), (6, "rail"))}
        ends = peak["p"] + peak["n"]
        if vusb == min(supplies):
            figures["drive_peak_room_v"] = min(min(peak["rail"]) - 0.020 - max(ends), min(ends) - 0.015)
        if vusb == 5.00:
            figures["converter_room_v"] = min(3.3 - max(peak["pa0"]), min(peak["pa0"]))
            p, dc_p = lock_in(*column(rows, 3), 4 / F)
            n, dc_n = lock_in(*column(rows, 4), 4 / F)
            figures["drive_dc_v"] = dc_p - dc_n
            figures["_tran_drive_v"] = abs(p - n)
            pa0, _ = lock_in(*column(rows, 0), 4 / F)
            figures["_tran_lag_deg"] = -degrees(-pa0)
            figures["_tran_pa0_codes"] = abs(pa0) / CODE_V
    return figures


def settling(board_text=None):
    figures = {}
    before = {"dp": 0, "dm": 1, "sp": 3, "sm": 2}
    routes = {"settle": {"dp": 0, "dm": 1, "sp": 9, "sm": 8}, "settle_drive": {"dp": 4, "dm": 5, "sp": 7, "sm": 6}}
    for name, after in routes.items():
        second = {f"{k}2": v for k, v in after.items()}
        # Where the route has always been this one; and the step at the start of a quarter period, at either of two phases.
        rest = run("settle.cir", {**after, **second, "tsw": 10}, board_text)[1]["settle"]
        left = {"quarter": 0.0, "period": 0.0, "value": 0.0}
        for quarter in (8, 9):
            step = quarter / 4 / F
            moved = run("settle.cir", {**before, **second, "tsw": step}, board_text)[1]["settle"]
            moments = [step + k * SAMPLE_S / 4 for k in range(16, 4 * 20)]
            pairs = zip(at(*column(moved, 0), moments), at(*column(rest, 0), moments), moments)
            for x, y, t in pairs:
                apart = abs(x - y) / CODE_V
                left["quarter"] = max(left["quarter"], apart)
                if t >= step + 1 / F:
                    left["period"] = max(left["period"], apart)
            x, _ = lock_in(*column(moved, 0), step + 0.25 / F, 1)
            y, _ = lock_in(*column(rest, 0), step + 0.25 / F, 1)
            left["value"] = max(left["value"], abs(x - y) / CODE_V)
        figures[f"{name}_quarter_codes"] = left["quarter"]
        figures[f"{name}_period_codes"] = left["period"]
        figures[f"{name}_value_codes"] = left["value"]
    return figures


def margin(rows):
    """Phase margin at the last crossing of gain 1, degrees; the phase is followed from the lowest frequency."""
    phase = before = None
    found = None
    for _, re_, im_ in rows:
        gain, now = abs(complex(re_, im_)), degrees(complex(re_, im_))
        if phase is not None:
            while now - phase > 180:
                now -= 360
            while now - phase < -180:
                now += 360
        if before is not None and before >= 1 > gain:
            found = 180 + now
        phase, before = now, gain
    return found if found is not None else float("nan")


def loops(board_text=None):
    _, files = run("loops.cir", None, board_text)
    return {f"margin_{name.removeprefix('loop_')}_deg": margin(rows) for name, rows in files.items()}


def worse_chips(name, text):
    """The models with what is known from memory to the worse side."""
    if name != "models.inc":
        return text
    for old, new in (("Cp inp 0 6p", "Cp inp 0 9p"), ("Cn inn 0 6p", "Cn inn 0 9p"), ("Cd inp inn 3p", "Cd inp inn 6p"),
                     ("*6.2832m/", "*8.1681m/"),
                     ("max(V(vn)+0.1, min(V(vp)-0.1, V(inn)+0.8", "max(V(vn)+0.2, min(V(vp)-0.2, V(inn)+0.9"),
                     ("max(V(vn)+0.1, min(V(vp)-0.1, V(inp)+V(n1)+0.8", "max(V(vn)+0.2, min(V(vp)-0.2, V(inp)+V(n1)+0.9")):
        if old not in text:
            raise NgspiceError(f"models.inc has no '{old}'")
        text = text.replace(old, new)
    return text


def worse():
    _, files = run("loops.cir", None, None, edit=worse_chips)
    rows = run("chain.cir", {"vusb": min(SUPPLIES)}, None, edit=worse_chips)[1]["chain"]
    error, room, _ = chain_errors(rows, 8, rows[-1][2 * 6 + 1] - 0.1)
    return {
        "margin_worse_deg": min(margin(loop) for loop in files.values()),
        "head_worse_error": error,
        "head_worse_room_v": room,
    }


def noise(board_text=None):
    results, _ = run("noise.cir", None, board_text)
    return {
        "noise_pa0_codes": results["pa0"][0] / CODE_V,
        "noise_pa1_codes": results["pa1"][0] / CODE_V,
        "noise_drive_ppm": results["drive"][0] / 2.25 * 1e6,
        "_drive_noise_v": results["drive"][0],
    }


def supplies(board_text=None):
    results, files = run("supply.cir", None, board_text)
    db = lambda name: 20 * math.log10(max(results[name][0], 1e-12))
    times, values = column(files["powerup"], 0)
    late = [t for t, v in zip(times, values) if abs(v) > 0.010]
    return {
        "usb_to_vr_db": db("usb_vr"),
        "usb_to_drive_db": db("usb_drive"),
        "usb_to_pa0_db": db("usb_pa0"),
        "avdd_to_pa0_db": db("avdd_pa0"),
        "supply_ma": results["supply_a"][0] * 1e3,
        "power_up_s": max(late, default=0.0),
        "_usb_to_drive": results["usb_drive"][0],
        "_usb_to_pa0": results["usb_pa0"][0],
        "_p5va": results["p5va"][0],
        "_vr": results["vr"][0],
    }


def phantom(board_text=None, ron=100.0):
    figures = {}
    _, files = run("chain.cir", {"ron": ron}, board_text, "ring.spice")
    rows = files["chain"]
    pa0, _ = lock_in(*column(rows, 0), 4 / F)
    drive = abs(lock_in(*column(rows, 3), 4 / F)[0] - lock_in(*column(rows, 4), 4 / F)[0])
    values = [abs(lock_in(*column(rows, 8 + 4 * k), 4 / F)[0]) for k in range(13)]
    mean = sum(values) / 13
    ring = hardware.PHANTOM_OHM
    calculated = drive * (ring / 16) / (15 * ring / 16 + 2 * ron)
    figures["phantom_codes"] = abs(pa0) / CODE_V
    figures["phantom_spread"] = max(abs(v / mean - 1) for v in values)
    figures["phantom_formula"] = mean / calculated / (1 + 49.4 / 4.12)
    own = {"sp": 0, "sm": 1, "sp2": 0, "sm2": 1, "ron": ron}
    _, files = run("chain.cir", own, board_text, "ring.spice")
    figures["phantom_pa1_codes"] = abs(lock_in(*column(files["chain"], 1), 4 / F)[0]) / CODE_V
    return figures


# Parts that drive and value hang on, and how far each may be off.
TOLERANCES = {**{r: 0.01 for r in ("R5", "R6", "R7", "R8", "R9", "R10", "R11", "R12", "R13")},
              **{c: 0.05 for c in ("C4", "C5", "C8")}}


def tolerances(nominal):
    """Each part off by its tolerance, one at a time; the changes added up, all to the worse side."""
    worst = {"tolerance_drive": 0.0, "tolerance_lag_deg": 0.0, "tolerance_value": 0.0}
    for ref, off in TOLERANCES.items():
        value = hardware.describe().part(ref).value
        changed = transfer(with_part(ref, f"{value}*{1 + off}"), own_too=False)
        shift = changed["lag_pa0_deg"] - nominal["lag_pa0_deg"]
        drive = changed["drive_v"] / nominal["drive_v"]
        worst["tolerance_drive"] += abs(drive - 1)
        worst["tolerance_lag_deg"] += abs(shift)
        worst["tolerance_value"] += abs(changed["_value"] / nominal["_value"] / drive - 1)
    worst["tolerance_quadrature"] = 1 - math.cos(math.radians(worst["tolerance_lag_deg"]))
    return worst


def ohm(ref):
    """A part's value in ohm or farad."""
    number, unit = re.fullmatch(r"([\d.]+)([pnukM]?)", hardware.describe().part(ref).value).groups()
    return float(number) * {"": 1, "p": 1e-12, "n": 1e-9, "u": 1e-6, "k": 1e3, "M": 1e6}[unit]


def calculated():
    """The formulas of docs/board.md, with the values of the parts."""
    c = {"dac": DAC_V, "hold": math.sin(math.pi / 16) / (math.pi / 16)}
    divided = ohm("R6") / (ohm("R5") + ohm("R6"))
    first = ohm("R5") * ohm("R6") / (ohm("R5") + ohm("R6"))
    c["corner"] = 1 / (2 * math.pi * math.sqrt(first * ohm("R7") * ohm("C4") * ohm("C5")))
    c["k"] = 1 + ohm("R9") / ohm("R8")
    c["q"] = 1 / (3 - c["k"])

    def source(f):
        u = f / c["corner"]
        return 1 / complex(1 - u * u, u / c["q"])

    def low_pass(r, capacitor, f=F):
        return 1 / complex(1, 2 * math.pi * f * r * capacitor)

    c["factor"], c["lag"] = abs(source(F)), -degrees(source(F))
    c["drive"] = 2 * c["dac"] * c["hold"] * divided * c["k"] * c["factor"]
    for k in (15, 17):
        c[f"image_{k}"] = abs(source(k * F) / source(F)) / k
        c[f"alias_{k}"] = 20 * math.log10(abs(low_pass(ohm("R13"), ohm("C8"), k * F) / low_pass(ohm("R13"), ohm("C8"))))
    c["amplifier"] = 1 + 49.4e3 / ohm("R12")
    c["tau"] = ohm("R13") * ohm("C8")
    receive = low_pass(ohm("R13"), ohm("C8"))
    c["receive_factor"], c["receive_lag"] = abs(receive), -degrees(receive)
    c["pa0"] = c["amplifier"] * abs(receive)
    c["pa1"] = ohm("R18") / ohm("R17") * abs(low_pass(ohm("R19"), ohm("C11"))) * abs(low_pass(ohm("R18"), ohm("C10")))
    monitor = 1 / (1 / ohm("R37") + 1 / ohm("R38") + 1 / ohm("R39"))
    c["pa6"] = monitor / ohm("R37") / 2 * abs(low_pass(monitor, ohm("C12")))
    c["lag_pa0"] = 11.25 + c["lag"] + c["receive_lag"] + math.degrees(math.atan(F / 450e3))
    c["reference_tau"] = ohm("R1") / 2 * ohm("C1")
    c["power_up_tau"] = (ohm("R5") + ohm("R6")) * ohm("C3")
    return c


# Calculated figures in docs/board.md, as DOCUMENTED; and the simulated figure that each must be near, and how near.
CALCULATED = (
    (r"DAC amplitude \|[^|]*\| ([\d.]+) V", lambda c: c["dac"], None, 0),
    (r"held steps \|[^|]*\| ([\d.]+)", lambda c: c["hold"], None, 0),
    (r"source filter: corner \|[^|]*\| ([\d.]+) kHz", lambda c: c["corner"] / 1e3, None, 0),
    (r"gain at 0 Hz, and Q \|[^|]*\| ([\d.]+);", lambda c: c["k"], None, 0),
    (r"gain at 0 Hz, and Q \|[^|]*\| [\d.]+; ([\d.]+)", lambda c: c["q"], None, 0),
    (r"u = f / 10.07 kHz[^|]*\| ([\d.]+);", lambda c: c["factor"], None, 0),
    (r"u = f / 10.07 kHz[^|]*\| [\d.]+; ([\d.]+) degrees", lambda c: c["lag"], None, 0),
    (r"drive between neighbours \|[^|]*\| ([\d.]+) V", lambda c: c["drive"], "drive_v", 0.005),
    (r"left at 15 f, 17 f \|[^|]*\| ([\d.]+) %", lambda c: 100 * c["image_15"], None, 0),
    (r"left at 15 f, 17 f \|[^|]*\| [\d.]+ %, ([\d.]+) %", lambda c: 100 * c["image_17"], None, 0),
    (r"\| amplifier \|[^|]*\| ([\d.]+)", lambda c: c["amplifier"], None, 0),
    (r"corner, time constant \|[^|]*\| ([\d.]+) kHz", lambda c: 1e-3 / (2 * math.pi * c["tau"]), None, 0),
    (r"corner, time constant \|[^|]*\| [\d.]+ kHz; ([\d.]+) us", lambda c: 1e6 * c["tau"], None, 0),
    (r"f / 14.8 kHz\) \| ([\d.]+);", lambda c: c["receive_factor"], None, 0),
    (r"f / 14.8 kHz\) \| [\d.]+; ([\d.]+) degrees", lambda c: c["receive_lag"], None, 0),
    (r"sense pair to PA0 \|[^|]*\| ([\d.]+)", lambda c: c["pa0"], "gain_pa0", 0.005),
    (r"at PA0, against f \|[^|]*\| (-[\d.]+),", lambda c: c["alias_15"], "alias_15_db", 0.02),
    (r"at PA0, against f \|[^|]*\| -[\d.]+, (-[\d.]+) dB", lambda c: c["alias_17"], "alias_17_db", 0.02),
    (r"drive pair to PA1 \|[^|]*\| ([\d.]+)", lambda c: c["pa1"], "gain_pa1", 0.005),
    (r"open voltage to PA6 \|[^|]*\| ([\d.]+)", lambda c: c["pa6"], "gain_pa6", 0.005),
    (r"table to PA0, lag \|[^|]*\| ([\d.]+) \+ wires", lambda c: c["lag_pa0"], "lag_pa0_deg", 0.02),
    (r"time constant of V_R[^|]*\|[^|]*\| (\d+) ms", lambda c: 1e3 * c["reference_tau"], None, 0),
    (r"\| power-up \|[^|]*= (\d+) ms", lambda c: 1e3 * c["power_up_tau"], None, 0),
)


def everything():
    nominal = transfer()
    figures = dict(nominal)
    parts = (head_room, settling, phantom, loops, worse, noise, supplies, lambda: tolerances(nominal))
    with ThreadPoolExecutor(2) as pool:
        for part in pool.map(lambda part: part(), parts):
            figures.update(part)
    figures["switch_ohm"] = 100.0
    figures["settling_s"] = ohm("R13") * ohm("C8")
    figures["_corner_hz"] = calculated()["corner"]
    return figures


# ---------------------------------------------------------------------------------------------------------------------
# The circuit before, and planted faults.


def old_circuit():
    """Relative errors of the 13 values of a drive at 5.00 and 4.75 V, and the difference amplifier's phase margin."""
    out = {}
    for vusb in (5.00, 4.75):
        _, files = run("old.cir", {"vusb": vusb})
        worst, room, signed = chain_errors(files["chain"], 0, vusb)
        out[vusb] = (worst, room, signed, margin(files["loop_u2a"]))
    return out


def with_part(ref, value):
    """The netlist with another value of a part; None leaves it out."""
    text = hardware.spice(hardware.describe())
    pattern = rf"^{ref} (\S+) (\S+) \{{[^*]+(\*\w+)\}}$"
    line = "* left out" if value is None else rf"{ref} \1 \2 {{{value}\3}}"
    text, found = re.subn(pattern, line, text, flags=re.M)
    assert found == 1, ref
    return text


def swapped(first, second):
    """The netlist with two nets of the description exchanged on one side."""
    board = hardware.describe()
    for pin in board.part("U6").pins:
        if pin.net in (first, second):
            pin.net = second if pin.net == first else first
    return hardware.spice(board)


# What is planted: words, how it is measured, and the bounds of which at least one must be missed.
PLANTED = (
    ("no capacitors across R16 and R18", lambda: loops(re.sub(r"^C(9|10) .*$", "*", hardware.spice(hardware.describe()), flags=re.M)),
     ("margin_u2a_deg",)),
    ("10 k instead of 1.58 k before PA0's filter", lambda: transfer(with_part("R13", "10k")), ("lag_pa0_deg",)),
    ("no capacitor at PA0's filter", lambda: transfer(with_part("C8", None)), ("alias_15_db",)),
    ("gain of 50 instead of 13", lambda: head_room(with_part("R12", "1k"), (4.40,), 1000.0), ("head_error_440", "head_room_440_v")),
    ("V_R without its capacitor", lambda: supplies(with_part("C1", None)), ("usb_to_vr_db",)),
    ("inverter of gain 0.5", lambda: transfer(with_part("R11", "5k")), ("drive_v", "drive_balance")),
    ("filter capacitor of 2.2 nF instead of 1 nF", lambda: transfer(with_part("C4", "2.2n")), ("drive_v", "lag_pa0_deg")),
    ("two wires of sense + exchanged", lambda: transfer(swapped("S3", "S5")), ("gain_pa0", "lag_pa0_deg")),
)


def mutants():
    """Boards that break a rule of board.py: words, and the board."""

    def change(words, edit):
        board = hardware.describe()
        edit(board)
        return words, board

    def rewire(ref, pin, net, kind=None):
        def edit(board):
            target = board.part(ref).pin(pin)
            target.net = net
            target.kind = kind or target.kind
        return edit

    yield change("two outputs joined", rewire("U1", 7, "DRIVE_P"))
    yield change("a pin left open", rewire("U3", 6, None))
    yield change("an input that nothing drives", rewire("U2", 3, "NOWHERE"))
    yield change("a chip without supply", rewire("U4", 16, "+9V"))
    yield change("two electrodes exchanged at one multiplexer", lambda board: [
        setattr(board.part("U8").pin(13), "net", "E2"), setattr(board.part("U8").pin(14), "net", "E1")])
    yield change("the core's own supply on CN10-18 connected", rewire("CN10", 18, "+3V3"))
    yield change("no capacitor beside U5", lambda board: board.parts.remove(board.part("C17")))


# ---------------------------------------------------------------------------------------------------------------------
# The table.


def inside(name, value):
    low, high, *_ = BOUNDS[name]
    return low <= value <= high


def show(ok, name, value, text):
    print(f"{'ok  ' if ok else 'MISS'}  {name:28s} {value:>12s}  {text}")
    return ok


def number(value):
    return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def assumed_in_sources(figures):
    """Rows of what firmware and hil-sim assume."""
    good = True
    for name, (path, pattern, unit, figure, allowed) in ASSUMED.items():
        text = (ROOT / path).read_text(encoding="utf-8")
        # Of hil-sim the preset of the drawn board, without what it leaves at its default.
        begin = max(text.find("fn drawn_board"), 0)
        found = re.search(pattern, text[begin:]) or re.search(pattern, text)
        if not found:
            good = show(False, name, "-", f"not found in {path}")
            continue
        raw = float(found.group(1).replace("_", ""))
        want = figures[figure]
        off = abs(raw * unit - want) if "degrees" in name else abs(raw * unit / want - 1)
        right = off <= allowed
        text = f"{path}; the circuit: {number(want / unit)}"
        good &= show(right, name, number(raw), text)
    # The noise of a sample is the converter's: the circuit's own must not show in it (9 % of its square at most).
    text = (ROOT / "hil-sim/src/electronics.rs").read_text(encoding="utf-8")
    found = re.search(r"noise_codes: ([\d.]+)", text[text.find("fn drawn_board"):])
    assumed = float(found.group(1)) if found else 0.0
    own = figures["noise_pa0_codes"]
    good &= show(own <= 0.3 * assumed, "hil-sim noise_codes", number(assumed),
                 f"hil-sim/src/electronics.rs; the circuit without converter: {number(own)}, at most 0.3 of it")
    # Head room, in the words of the models: how near to the rails, and how far above the inputs.
    models = (HERE / "spice/models.inc").read_text(encoding="utf-8")
    preset = text[text.find("fn drawn_board"):]
    for field, pattern in (("inner_shift_v", r"Ba1 .*V\(inn\)\+([\d.]+)\+"), ("inner_margin_v", r"Ba1 a1 0 V = max\(V\(vn\)\+([\d.]+),"),
                           ("op_amp_margin_v", r"Bclip .*V\(vp\)-([\d.]+)m,")):
        said, is_ = re.search(rf"{field}: ([\d.]+)", preset), re.search(pattern, models)
        circuit = float(is_.group(1)) * (1e-3 if field == "op_amp_margin_v" else 1) if is_ else float("nan")
        value = float(said.group(1)) if said else float("nan")
        good &= show(abs(value - circuit) < 1e-9, f"hil-sim {field}", number(value), f"hil-sim/src/electronics.rs; the models: {number(circuit)}")
    return good


def documented(figures):
    """The test points' numbers, and the figures of docs/board.md."""
    good = True
    for point, _, words in hardware.TEST_POINTS:
        if point in TEST_POINTS:
            pattern, figure, allowed = TEST_POINTS[point]
            found = re.search(pattern, words)
            said, is_ = float(found.group(1)) if found else float("nan"), figure(figures)
            good &= show(abs(said - is_) <= allowed, point, number(is_), f"list of test points: {words}")
    page = (ROOT / "docs/board.md").read_text(encoding="utf-8")
    wrong = []
    formulas = calculated()
    for _, figure, simulated, near in CALCULATED:
        if simulated and abs(figure(formulas) / figures[simulated] - 1) > near:
            wrong.append(f"{simulated}: calculated {number(figure(formulas))}, simulated {number(figures[simulated])}")
    pairs = [(pattern, figure(figures)) for pattern, figure in DOCUMENTED]
    pairs += [(pattern, figure(formulas)) for pattern, figure, *_ in CALCULATED]
    for pattern, is_ in pairs:
        found = re.search(pattern, page)
        if not found:
            wrong.append(f"no sentence like {pattern}")
            continue
        said = found.group(1)
        step = 10.0 ** -len(said.partition(".")[2])
        # Half a step of rounding, and as much for another version of the simulator.
        if abs(float(said) - is_) > step:
            wrong.append(f"{said} in '{found.group(0)}' is {number(is_)}")
    good &= show(not wrong, "docs/board.md", f"{len(pairs)} figures", "; ".join(wrong) or "as simulated and calculated")
    return good


def main():
    good = True
    print("rules of the description and generated files")
    code = subprocess.run([sys.executable, str(HERE / "board.py"), "--check"], check=False).returncode
    good &= show(code == 0, "board.py --check", str(code), "0: every pin connected or open on purpose, files fresh")
    for words, mutant in mutants():
        found = hardware.broken_rules(mutant)
        good &= show(bool(found), "planted", str(len(found)), f"{words}: {found[0] if found else 'not found'}")
    for words, ref, pin, net in (("a wire of the drawing to another net", "R10", 1, "VR"),
                                 ("a label of the drawing on another net", "R39", 1, "+3V3")):
        moved = hardware.describe()
        moved.part(ref).pin(pin).net = net
        try:
            draw.files(moved)
            found = ""
        except draw.DrawingError as error:
            found = str(error)
        good &= show(bool(found), "planted", "found" if found else "NOT FOUND", f"{words}: {found}")
    if shutil.which("ngspice") is None:
        print("\nskipped: no ngspice (apt-get install ngspice); nothing was simulated")
        return 77 if good else 1

    print("\nthe circuit in ngspice")
    figures = everything()
    for name, (low, high, unit, what) in BOUNDS.items():
        value = figures.get(name, float("nan"))
        limits = f"{number(low)}..{number(high)} {unit}".rstrip()
        good &= show(inside(name, value), name, number(value), f"[{limits}] {what}")
    # The same by another analysis: sampled steps in time against a small signal at one frequency.
    same = abs(figures["_tran_drive_v"] / figures["drive_v"] - 1)
    good &= show(same < 0.003, "time against frequency", number(same), "[0..0.003] the drive's amplitude, both ways")
    turn = abs(figures["_tran_lag_deg"] - figures["lag_pa0_deg"])
    good &= show(turn < 1.0, "time against frequency", number(turn), "[0..1 deg] the lag at PA0, both ways")

    print("\nwhat firmware and hil-sim assume")
    good &= assumed_in_sources(figures)

    print("\nthe circuit before, which must fail")
    for vusb, (worst, room, signed, angle) in old_circuit().items():
        figures[f"_old_{int(vusb * 100)}"] = max(abs(signed[0]), abs(signed[-1]))
        low, high = {5.00: (0.05, 0.09), 4.75: (0.08, 0.13)}[vusb]
        near = max(abs(signed[0]), abs(signed[-1]))
        good &= show(low <= near <= high and not inside("head_error_500", worst), f"old circuit at {vusb:.2f} V",
                     f"{near * 100:.1f} %", f"[{low * 100:.0f}..{high * 100:.0f} %] error next to the drive pair; room {room:.2f} V")
        good &= show(not inside("margin_u2a_deg", angle), "old difference amplifier", number(angle), "phase margin, degrees")
    print("\nwhat the documents say")
    good &= documented(figures)
    print("\nplanted faults, each of which must miss a bound")
    with ThreadPoolExecutor(2) as pool:
        measured = list(pool.map(lambda planted: planted[1](), PLANTED))
    for (words, _, names), planted in zip(PLANTED, measured):
        missed = [n for n in names if n in planted and not inside(n, planted[n])]
        seen = ", ".join(f"{n} {number(planted[n])}" for n in names if n in planted)
        good &= show(bool(missed), "planted", "found" if missed else "NOT FOUND", f"{words}: {seen}")
    print("\nall within bounds" if good else "\nFAILED: see the rows with MISS")
    return 0 if good else 1


if __name__ == "__main__":
    os.environ.setdefault("LC_ALL", "C")
    sys.exit(main())
