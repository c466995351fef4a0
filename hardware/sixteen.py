#!/usr/bin/env python3
"""The sensor board with sixteen channels, for a NUCLEO-H743ZI2: the board of board.py and sixteen amplifiers more.

    python3 hardware/sixteen.py             writes generated/sixteen/
    python3 hardware/sixteen.py --files     exit code 1 if a file is stale or a rule is broken
    python3 hardware/sixteen.py --check     exit code 1 if a file is stale, a rule is broken, or the circuit is not what it should be
                                            (ngspice; 77 if it is not installed)

Source, multiplexers, electrodes, the amplifier and the difference amplifier behind the multiplexers are those of board.py.
Each electrode and its next one have an INA826 of their own besides, with the same gain and filter.
"""

import cmath
import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import board as hardware
import draw

HERE = Path(__file__).resolve().parent
GENERATED = hardware.GENERATED / "sixteen"

# The Nucleo-144's connectors (UM2407, tables of CN11 and CN12), from memory: check them with the manual.
CN11 = ("PC10 PC11 PC12 PD2 VDD E5V BOOT0 GND PF6 - PF7 IOREF PA13 RESET PA14 +3V3 PA15 +5V GND GND PB7 GND PC13 VIN PC14 - "
        "PC15 PA0 PH0 PA1 PH1 PA4 VBAT PB0 PC2 PC1 PC3 PC0 PD4 PD3 PD5 PG2 PD6 PG3 PD7 PE2 PE3 PE4 GND PE5 PF1 PF2 PF0 PF8 "
        "PD1 PF9 PD0 PG1 PG0 GND PE1 PE6 PG9 PG15 PG12 PG10 - PG13 PD9 PG11").split()
CN12 = ("PC9 PC8 PB8 PC6 PB9 PC5 VREFP U5V GND PD8 PA5 PA12 PA6 PA11 PA7 PB12 PB6 PB11 PC7 GND PA9 PB2 PA8 PB1 PB10 PB15 PB4 "
        "PB14 PB5 PB13 PB3 AGND PA10 PC4 PA2 PF5 PA3 PF4 GND PE8 PD13 PF10 PD12 PE7 PD11 PD14 PE10 PD15 PE12 PF14 PE14 PE9 "
        "PE15 GND PE13 PE11 PF13 PF3 PF12 PF15 PG14 PF11 GND PE0 PD10 PG8 PG7 PG5 PG4 PG6").split()

# The channels' pins, in their order: channel n is electrode n + 1 against n, counted from 0. The first eight on ADC1, the
# others on ADC3, two at a time.
CHANNELS = "PA0 PF11 PF12 PA3 PA5 PA6 PB1 PC0 PF3 PF4 PF5 PF6 PF7 PF8 PF9 PF10".split()

# What board.py calls by the STM32F4's pins, by the STM32H743's. The last row is what was measured at PA0, PA1 and PA6.
RENAMED = {f"PB{bit}": f"PE{2 + k}" for k, bit in enumerate((0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14))}
RENAMED |= {f"PC{bit}": f"PD{bit}" for bit in range(8)}
RENAMED |= {"PA8": "PE14", "PA0": "PF13", "PA1": "PF14", "PA6": "PC1"}

# Parts that the STM32F4's ROM bootloader and BOOT1 pin want, and nobody here.
WITHOUT = ("R50", "R51", "R52")
# ADC2 converts amplifier, difference amplifier and source one after the other, 1.00 us (1.33 degrees) each. The later ones'
# filters are as much faster.
FASTER = {"C11": "6.2n", "C12": "1.5n"}

hardware.CAPACITORS |= {
    "6.2n": ("C0G 50 V 5 %", hardware.DISC, "Kemet", "C320C622J5G5TA", "TDK", "FG28C0G1H622JNT06", "scheme"),
    "1.5n": ("C0G 50 V 5 %", hardware.DISC, "Kemet", "C315C152J5G5TA", "TDK", "FG18C0G1H152JNT06", "scheme"),
}
hardware.CHIPS["MORPHO70"] = (
    "socket 2 x 35, 2.54 mm, for the Nucleo", "Connector_PinSocket_2.54mm:PinSocket_2x35_P2.54mm_Vertical", "Samtec",
    "SSQ-135-01-T-D", "Samtec", "SSW-135-01-T-D", "memory")


def processor():
    """What each pin is for, as board.py words it."""
    pins = {RENAMED.get(name, name): what for name, what in hardware.PROCESSOR.items()
            if name not in ("PA9", "PA10", "PC11")}
    for n, pin in enumerate(CHANNELS):
        pins[pin] = (f"converter, channel {n}", "input")
    return pins


def amplifier(board, n):
    """The channel of electrode n + 1 (positive) and n, counted from 0."""
    b = f"channel {n}"
    minus, plus = f"S{n + 1}", f"S{(n + 1) % hardware.ELECTRODES + 1}"
    board.add(f"U{12 + n}", "INA826", "INA826", b, [
        (1, "-IN", "input", minus), (2, "RG", "passive", f"RG_A{n}"), (3, "RG", "passive", f"RG_B{n}"),
        (4, "+IN", "input", plus), (5, "-VS", "power_in", "GND"), (6, "REF", "input", "V165"),
        (7, "OUT", "output", f"AMP{n}"), (8, "+VS", "power_in", "+5VA")])
    board.r(f"R{60 + n}", "4.12k", f"RG_A{n}", f"RG_B{n}", b)
    board.r(f"R{80 + n}", "1.58k", f"AMP{n}", f"AMP_F{n}", b)
    board.c(f"C{40 + n}", "6.8n", f"AMP_F{n}", "GND", b)
    hardware.protected(board, f"R{100 + n}", f"AMP_F{n}", f"CH{n}", (f"D{40 + 2 * n}", f"D{41 + 2 * n}"), b)
    board.c(f"C{60 + n}", "100n", "+5VA", "GND", f"beside U{12 + n}")


def circuit():
    """All but the Nucleo, with the names of board.py: what is simulated."""
    board = hardware.Board()
    hardware.references(board)
    hardware.excitation(board)
    hardware.multiplexers(board)
    hardware.electrodes(board)
    hardware.amplifiers(board)
    hardware.decoupling(board)
    hardware.test_points(board)
    board.parts = [p for p in board.parts if p.ref not in WITHOUT]
    for ref, value in FASTER.items():
        board.part(ref).value = value
    for n in range(hardware.ELECTRODES):
        amplifier(board, n)
    return board


def nucleo(board, pins):
    fixed = {"GND": ("GND", "passive"), "AGND": ("GND", "passive"), "+5V": ("+5V", "power_out"),
             "+3V3": ("+3V3", "power_out"), "VREFP": ("AVDD", "power_out")}
    for ref, names in (("CN11", CN11), ("CN12", CN12)):
        described = []
        for number, name in enumerate(names, 1):
            net, kind = fixed.get(name, (None, "nc"))
            if name in pins:
                net, kind = name, pins[name][1]
            described.append((number, name, kind, net))
        board.add(ref, "Nucleo " + ref, "MORPHO70", "nucleo", described)
    board.power_flags.add("GND")


def describe():
    board = circuit()
    names = RENAMED | {f"CH{n}": pin for n, pin in enumerate(CHANNELS)}
    for part in board.parts:
        for pin in part.pins:
            pin.net = names.get(pin.net, pin.net)
    nucleo(board, processor())
    return board


def pin_list(board):
    out = hardware.csv_line("pin connector function goes_to".split())
    nets, pins = board.nets(), processor()
    for name in sorted(pins, key=hardware.natural):
        place = next(f"{ref}-{names.index(name) + 1}" for ref, names in (("CN11", CN11), ("CN12", CN12)) if name in names)
        to = [f"{part.ref}-{pin.number}" for part, pin in nets[name] if part.kind not in ("MORPHO70", "TP")]
        out += hardware.csv_line([name, place, pins[name][0], " ".join(sorted(to, key=hardware.natural))])
    return out


def channel_list(_board):
    out = hardware.csv_line("channel pin amplifier plus minus gain_resistor filter capacitor protection".split())
    for n, pin in enumerate(CHANNELS):
        plus = (n + 1) % hardware.ELECTRODES + 1
        out += hardware.csv_line([str(n), pin, f"U{12 + n}", f"R{20 + plus} (electrode {plus})",
                                  f"R{21 + n} (electrode {n + 1})", f"R{60 + n}", f"R{80 + n}", f"C{40 + n}", f"R{100 + n}"])
    return out


def parts_list(board):
    old, new = "1,NUCLEO-F446RE,", "1,NUCLEO-H743ZI2,"
    lines = [line for line in hardware.bom(board).splitlines() if old not in line]
    lines.append(hardware.csv_line(["-", new.split(",")[0], "NUCLEO-H743ZI2", "processor board, MB1364", "-", "STMicroelectronics",
                                    "NUCLEO-H743ZI2", "-", "-", "UM2407", ""]).strip())
    return "\n".join(lines) + "\n"


def test_points(_board):
    out = hardware.csv_line("point net expected".split())
    for point, net, expected in hardware.TEST_POINTS:
        out += hardware.csv_line([point, RENAMED.get(net, net), expected])
    return out


def drawing(board):
    """The first channel, checked against the description; the others differ by their numbers only."""
    s = draw.Sheet(board, "The first of sixteen channels", 1180, 620)
    for y, electrode, resistor, sense in ((158, "E2", "R22", "S2"), (278, "E1", "R21", "S1")):
        s.label(90, y, electrode, "left")
        s.wire((90, y), (130, y))
        s.resistor(resistor, 160, y)
        s.wire((190, y), (230, y), (420, y))
        s.wire((230, y), (230, y - 50 if y < 200 else y + 50))
        s.label(230, y - 50 if y < 200 else y + 50, sense, "up" if y < 200 else "down")
    s.text(250, 100, "to the sense multiplexers, and to channel 1", "start", 12)
    s.text(250, 344, "to the sense multiplexers, and to channel 15", "start", 12)
    s.box("U12", 440, 140, 110, [4, 3, 2, 1], [8, 7, 6, 5], title="U12 INA826", pitch=40)
    s.resistor("R60", 350, 218, True, flip=True)
    s.wire((420, 198), (400, 198), (400, 188), (350, 188))
    s.wire((420, 238), (400, 238), (400, 248), (350, 248))
    s.wire((570, 158), (590, 158), (590, 130))
    s.label(590, 130, "+5VA", "up")
    s.label(570, 238, "V165", "right")
    s.wire((570, 278), (590, 278), (590, 300))
    s.label(590, 300, "GND")
    s.wire((570, 198), (640, 198))
    s.resistor("R80", 670, 198)
    s.wire((700, 198), (760, 198), (820, 198))
    s.capacitor("C40", 760, 248, True)
    s.wire((760, 198), (760, 218))
    s.label(760, 278, "GND")
    s.resistor("R100", 850, 198)
    s.wire((880, 198), (930, 198), (1000, 198))
    s.diode_up("D40", 930, 148)
    s.wire((930, 178), (930, 198))
    s.label(930, 118, "+3V3", "up")
    s.diode_up("D41", 930, 248)
    s.wire((930, 198), (930, 218))
    s.label(930, 278, "GND")
    s.label(1000, 198, CHANNELS[0])
    s.capacitor("C60", 1090, 300, True)
    s.label(1090, 270, "+5VA", "up")
    s.label(1090, 330, "GND")
    s.text(1070, 380, "beside U12", "start", 11)
    pins = [f"{n} {p}" for n, p in enumerate(CHANNELS)]
    for y, words in ((420, "Channel n, 0 to 15, has U(12+n), R(60+n), R(80+n), R(100+n), C(40+n), C(60+n), D(40+2n) and D(41+2n)."),
                     (445, "It is electrode n + 2 (R(22+n)) against electrode n + 1 (R(21+n)); after electrode 16 (R36) comes 1 (R21)."),
                     (485, "ADC1, channel and pin: " + ", ".join(pins[:8])),
                     (510, "ADC3, channel and pin: " + ", ".join(pins[8:])),
                     (535, "ADC2: PF13 behind the multiplexers (U3), PF14 difference amplifier (U2A), PC1 source. "
                           "All else is as on the board with one channel."),
                     (560, f"ADC2's later conversions have faster filters: here C11 is {FASTER['C11']}F and C12 {FASTER['C12']}F.")):
        s.text(30, y, words)
    return s.svg()


def generated(board):
    files = {
        "bom.csv": parts_list(board),
        "wiring.csv": hardware.wiring(board),
        "pins.csv": pin_list(board),
        "channels.csv": channel_list(board),
        "electrodes.csv": hardware.electrode_wires(board),
        "test_points.csv": test_points(board),
        "board.net": hardware.kicad_netlist(board),
        "board.spice": hardware.spice(circuit()),
        "channel.svg": drawing(board),
    }
    return {GENERATED / name: text for name, text in files.items()}


def broken_rules(board):
    """What board.py refuses, and what is special here."""
    wrong = hardware.broken_rules(board)
    for part in board.parts:
        if part.kind == "MORPHO70" and len(part.pins) != 70:
            wrong.append(f"{part.ref}: {len(part.pins)} pins described, the connector has 70")
    names = CN11 + CN12
    wrong += [f"{pin}: not on a connector" for pin in processor() if pin not in names]
    if len(set(CHANNELS)) != hardware.ELECTRODES or set(CHANNELS) & (set(RENAMED.values()) | {"PA4"}):
        wrong.append("a channel's pin has two uses")
    for n in range(hardware.ELECTRODES):
        chip = board.part(f"U{12 + n}")
        if (chip.pin(4).net, chip.pin(1).net) != (f"S{(n + 1) % hardware.ELECTRODES + 1}", f"S{n + 1}"):
            wrong.append(f"{chip.ref}: not on electrodes {n + 1} and its next")
    return wrong


# ---------------------------------------------------------------------------------------------------------------------
# The circuit in ngspice: the drive between electrodes 1 and 2, all channels at once.

F = 200e6 / 3392 / 16
BENCH = """* All channels, and what is behind the multiplexers.
.param vusb=5.0 ron=100 rtol=1 ctol=1 f={f} amp=1.4409
.param dp=0 dm=1 sp={sp} sm={sm}
.param dp2=0 dm2=1 sp2={sp} sm2={sm} tsw=10
.include models.inc
.include bench.inc
.include board.spice
.include {sheet}
Xsheet e1 e2 e3 e4 e5 e6 e7 e8 e9 e10 e11 e12 e13 e14 e15 e16 sheet
Vdac pa4 0 DC 1.65 AC 1
.control
ac lin 1 {f} {f}
foreach name {names}
  let re = real(v($name))
  let im = imag(v($name))
  echo RESULT $name $&re $&im
end
quit
.endc
.end
"""


def simulated(circuit_text, sense_plus=2, sense_minus=3):
    """Voltages by net, complex, for 1 V from the DAC."""
    nets = [f"ch{n}" for n in range(16)] + [f"s{n + 1}" for n in range(16)] + "pa0 pa1 pa6 drive_p drive_n".split()
    bench = BENCH.format(f=F, sp=sense_plus, sm=sense_minus, names=" ".join(nets),
                         sheet=hardware.GENERATED / "sheet.spice")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "board.spice").write_text(circuit_text, encoding="utf-8")
        for name in ("models.inc", "bench.inc"):
            text = (HERE / "spice" / name).read_text(encoding="utf-8")
            # Resistors of nets that this board has not.
            text = "\n".join(line for line in text.splitlines() if not re.match(r"Rpc11 ", line))
            (folder / name).write_text(text + "\n", encoding="utf-8")
        (folder / "sixteen.cir").write_text(bench, encoding="utf-8")
        done = subprocess.run(["ngspice", "-b", "sixteen.cir"], cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    found = {}
    for row in done.stdout.splitlines():
        if row.startswith("RESULT "):
            _, name, real, imag = row.split()
            found[name] = complex(float(real), float(imag))
    if len(found) != len(nets):
        raise RuntimeError(done.stdout[-2000:] + done.stderr[-2000:])
    return found


def lag_deg(value):
    """From the DAC's table to a pin: half a step of 22.5 degrees, and the circuit."""
    return -math.degrees(cmath.phase(value)) + 11.25


def faults(circuit_text):
    """What the simulated circuit is not as it should be, in words, and the figures."""
    v = simulated(circuit_text)
    wrong, figures = [], {}
    pairs = {n: v[f"s{(n + 1) % 16 + 1}"] - v[f"s{n + 1}"] for n in range(16)}
    # Channel 0 sees the drive pair itself, which is beyond its amplifier's range; 15 and 1 share an electrode with it.
    gains = {n: abs(v[f"ch{n}"]) / abs(pairs[n]) for n in range(16)}
    inner = {n: g for n, g in gains.items() if n not in (15, 0, 1)}
    figures["gain of channels 2 to 14"] = (min(inner.values()), max(inner.values()), 12.5, 12.75)
    # The drive enters at electrode 1: all channels of the far side see the voltage fall in the same direction.
    lags = [lag_deg(v[f"ch{n}"]) % 180 for n in inner]
    figures["lag of channels 2 to 14, degrees"] = (min(lags), max(lags), 56.0, 58.5)
    turns = [math.degrees(cmath.phase(v[f"ch{n}"] / pairs[n])) for n in inner]
    figures["phase of channels 2 to 14 against their pairs, degrees"] = (min(turns), max(turns), -15.5, -13.5)
    figures["behind the multiplexers: gain"] = (abs(v["pa0"] / (v["s3"] - v["s4"])),) * 2 + (12.5, 12.75)
    own = simulated(circuit_text, 0, 1)
    late = {"pa1": 1.33, "pa6": 2.65}
    figures["difference amplifier: gain"] = (abs(own["pa1"] / (own["s1"] - own["s2"])),) * 2 + (0.576, 0.594)
    figures["difference amplifier: lag with its later conversion, degrees"] = (lag_deg(own["pa1"]) + late["pa1"],) * 2 + (55.0, 62.0)
    figures["source: gain"] = (abs(v["pa6"] / (v["drive_p"] - v["drive_n"])),) * 2 + (0.282, 0.291)
    figures["source: lag with its later conversion, degrees"] = (lag_deg(v["pa6"]) + late["pa6"],) * 2 + (54.0, 59.5)
    drive = abs(v["drive_p"] - v["drive_n"]) * 1.4409 * 0.9936
    figures["drive between neighbours, V"] = (drive, drive, 2.2275, 2.2725)
    for name, (low, high, least, most) in figures.items():
        if not least <= low <= high <= most:
            wrong.append(f"{name}: {low:.4g} to {high:.4g}, not {least} to {most}")
    return wrong, figures


# What firmware and hil-sim assume of this board: file, where in it to begin, pattern, unit, figure, allowed relative difference
# (absolute for degrees).
ASSUMED = (
    *((f"{path}, {name}", path, "const INFO", pattern, unit, figure, 0.01)
      for path in ("boards/stm32h7/src/main.rs", "boards/stm32h7/src/bin/laws.rs")
      for name, pattern, unit, figure in (
          ("excitation_uv", r"excitation_uv: ([\d_]+)", 1e-6, "drive between neighbours, V"),
          ("gains_milli[0]", r"gains_milli: \[([\d_]+),", 1e-3, "gain of channels 2 to 14"),
          ("gains_milli[1]", r"gains_milli: \[[\d_]+, ([\d_]+)", 1e-3, "difference amplifier: gain"),
          ("source_gain_milli", r"source_gain_milli: ([\d_]+)", 1e-3, "source: gain"))),
    ("LEAD_TURNS, degrees", "boards/stm32f4/src/sine.rs", "", r"([\d.]+) / 360\.0", 1.0, "lag of channels 2 to 14, degrees", 1.0),
    *((f"hil-sim {name}", "hil-sim/src/electronics.rs", "fn drawn_sixteen", pattern, 1e-3, figure, 0.01)
      for name, pattern, figure in (
          ("gains_milli[0]", r"gains_milli: vec!\[([\d_]+),", "gain of channels 2 to 14"),
          ("gains_milli[1]", r"gains_milli: vec!\[[\d_]+, ([\d_]+)", "difference amplifier: gain"),
          ("source_gain_milli", r"source_gain_milli: ([\d_]+)", "source: gain"))),
)


def assumed(figures):
    """What is said of each assumption, and whether all are the circuit's."""
    good = True
    for name, path, begin, pattern, unit, figure, allowed in ASSUMED:
        text = (HERE.parent / path).read_text(encoding="utf-8")
        found = re.search(pattern, text[text.find(begin):]) if begin in text else None
        value = float(found.group(1).replace("_", "")) * unit if found else math.nan
        low, high = figures[figure][:2]
        off = max(abs(value - low), abs(value - high)) / (1 if "degrees" in name else low)
        good &= off <= allowed
        print(f"{'ok ' if off <= allowed else 'BAD'} {name}: {value:.4g}; the circuit: {low:.4g} to {high:.4g}")
    return good


# Planted, each must be found.
PLANTED = (
    ("no capacitor in a channel's filter", lambda text: re.sub(r"\nC47 [^\n]*", "", text)),
    ("a gain resistor of 4.7 k", lambda text: text.replace("{4.12k*rtol}", "{4.7k*rtol}", 2)),
    ("two inputs exchanged", lambda text: re.sub(r"(XU17) (\S+) (\S+ \S+) (\S+)", r"\1 \4 \3 \2", text)),
    ("an input on the next but one electrode", lambda text: re.sub(r"(XU19 \S+ \S+ \S+) (\S+)", r"\1 s10", text)),
)


def simulate():
    good = True
    text = hardware.spice(circuit())
    wrong, figures = faults(text)
    for name, (low, high, least, most) in figures.items():
        print(f"{'ok ' if least <= low <= high <= most else 'BAD'} {name}: {low:.4g} to {high:.4g} [{least} to {most}]")
    good &= not wrong
    good &= assumed(figures)
    for words, plant in PLANTED:
        planted = plant(text)
        found = planted != text and faults(planted)[0]
        print(f"{'ok ' if found else 'BAD'} planted: {words}: {found[0] if found else 'not found'}")
        good &= bool(found)
    return 0 if good else 1


def main(arguments):
    board = describe()
    wrong = broken_rules(board)
    for line in wrong:
        print(f"rule: {line}", file=sys.stderr)
    if wrong or arguments not in ([], ["--check"], ["--files"]):
        return 1
    stale = 0
    for path, text in generated(board).items():
        if not arguments:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(path.relative_to(HERE.parent))
        elif not path.exists() or path.read_text(encoding="utf-8") != text:
            print(f"stale: {path.relative_to(HERE.parent)}; run python3 hardware/sixteen.py", file=sys.stderr)
            stale = 1
    if stale or arguments != ["--check"]:
        return stale
    if shutil.which("ngspice") is None:
        print("skipped: no ngspice (apt-get install ngspice); nothing was simulated")
        return 77
    return simulate()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
