#!/usr/bin/env python3
"""The sensor board, described once: parts, values, pins, nets.

Everything else under hardware/ that is a list or a drawing of this board is generated from here:

    python3 hardware/board.py             writes the generated files
    python3 hardware/board.py --check     exit code 1 if one of them is stale, or if the description breaks a rule

Only Python's standard library is used. `check.py` simulates the same parts and nets in ngspice.
"""

import math
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
GENERATED = HERE / "generated"

# ---------------------------------------------------------------------------------------------------------------------
# What can be bought. MPN: manufacturer's number; the second source is another maker's part for the same footprint.
# `seen`: where the number was seen. "scheme": built by the maker's own numbering scheme, from memory, not looked up.

METAL_FILM = ("Yageo", "MFR-25FBF52-{yageo}", "Vishay", "MRS25000C{vishay}FCT00", "scheme")
AXIAL = "Resistor_THT:R_Axial_DIN0207_L6.3mm_D2.5mm_P10.16mm_Horizontal"
DISC = "Capacitor_THT:C_Disc_D5.0mm_W2.5mm_P5.00mm"
RADIAL = "Capacitor_THT:CP_Radial_D5.0mm_P2.00mm"


def resistor_codes(value):
    """`31.6k` as Yageo (31K6) and Vishay (3162) write it."""
    number, unit = re.fullmatch(r"([0-9.]+)([kM]?)", value).groups()
    ohm = float(number) * {"": 1, "k": 1e3, "M": 1e6}[unit]
    letter = {"": "R", "k": "K", "M": "M"}[unit]
    whole, _, part = number.partition(".")
    yageo = whole + letter + part.rstrip("0")
    if ohm < 10:
        return yageo, f"{round(ohm * 100):03d}8"
    exponent = 0
    while round(ohm / 10**exponent) > 999:
        exponent += 1
    return yageo, f"{round(ohm / 10**exponent):03d}{exponent}"


# value -> (kind, footprint, maker, MPN, second maker, second MPN, seen)
CAPACITORS = {
    "4.7p": ("C0G 50 V, 0.5 pF", DISC, "Kemet", "C315C479D5G5TA", "TDK", "FG18C0G1H4R7CNT06", "scheme"),
    "22p": ("C0G 50 V 5 %", DISC, "Kemet", "C315C220J5G5TA", "TDK", "FG18C0G1H220JNT06", "scheme"),
    "1n": ("C0G 50 V 5 %", DISC, "Kemet", "C315C102J5G5TA", "TDK", "FG18C0G1H102JNT06", "scheme"),
    "1.8n": ("C0G 50 V 5 %", DISC, "Kemet", "C315C182J5G5TA", "TDK", "FG18C0G1H182JNT06", "scheme"),
    "6.8n": ("C0G 50 V 5 %", DISC, "Kemet", "C320C682J5G5TA", "TDK", "FG28C0G1H682JNT06", "scheme"),
    "100n": ("X7R 50 V 10 %", DISC, "Kemet", "C320C104K5R5TA", "TDK", "FG18X7R1H104KNT06", "memory"),
    "1u": ("X7R 50 V 10 %", DISC, "Kemet", "C330C105K5R5TA", "TDK", "FG24X7R1H105KNT06", "memory"),
    "10u": ("electrolytic 50 V", RADIAL, "Panasonic", "ECA-1HM100", "Nichicon", "UVR1H100MDD", "memory"),
    "47u": ("electrolytic 25 V", RADIAL, "Panasonic", "ECA-1EM470", "Nichicon", "UVR1E470MDD", "memory"),
}

CHIPS = {
    "MCP6024": ("quad op-amp, 10 MHz, rail to rail", "Package_DIP:DIP-14_W7.62mm", "Microchip", "MCP6024-I/P",
                "Texas Instruments", "OPA4340PA", "datasheet DS21685D, page 1; second from memory"),
    "MCP6022": ("dual op-amp, 10 MHz, rail to rail", "Package_DIP:DIP-8_W7.62mm", "Microchip", "MCP6022-I/P",
                "Texas Instruments", "OPA2340PA", "datasheet DS21685D, page 1; second from memory"),
    "INA826": ("instrumentation amplifier", "Package_SO:SOIC-8_3.9x4.9mm_P1.27mm", "Texas Instruments", "INA826AID",
               "Analog Devices", "AD8226ARZ", "datasheet SBOS562E; second from memory, same pins and gain equation"),
    "74HCT4051": ("8-way analogue switch", "Package_DIP:DIP-16_W7.62mm", "Texas Instruments", "CD74HCT4051E",
                  "Nexperia", "74HCT4051D (SO-16, on an adapter)", "memory"),
    "BAT85": ("Schottky diode", "Diode_THT:D_DO-35_SOD27_P7.62mm_Horizontal", "Vishay", "BAT85S-TAP",
              "STMicroelectronics", "1N5711", "memory"),
    "PESD5V0V1BA": ("ESD diode, both directions, 5 V, 11 pF", "Diode_SMD:D_SOD-323", "Nexperia", "PESD5V0V1BA,115",
                    "Diodes Incorporated", "D5V0L1B2WS-7 (15 pF)", "datasheets of 9 November 2012 and DS35429"),
    "BC547": ("NPN", "Package_TO_SOT_THT:TO-92_Inline", "onsemi", "BC547BTA", "Diotec", "BC547B", "memory"),
    "BC557": ("PNP", "Package_TO_SOT_THT:TO-92_Inline", "onsemi", "BC557BTA", "Diotec", "BC557B", "memory"),
    "IDC20": ("box header 2 x 10, 2.54 mm", "Connector_IDC:IDC-Header_2x10_P2.54mm_Vertical", "Wuerth", "61202021621",
              "Amphenol", "T821120A1S100CEU", "memory"),
    "MORPHO": ("socket 2 x 19, 2.54 mm, for the Nucleo", "Connector_PinSocket_2.54mm:PinSocket_2x19_P2.54mm_Vertical",
               "Samtec", "SSQ-119-01-T-D", "Harwin", "M20-7831946", "memory; second by its scheme"),
    "FT232": ("header 1 x 6, 2.54 mm, for the USB adapter", "Connector_PinHeader_2.54mm:PinHeader_1x06_P2.54mm_Vertical",
              "Wuerth", "61300611121", "Harwin", "M20-9990645", "memory"),
    "TP": ("test point", "TestPoint:TestPoint_Pad_D1.5mm", "", "", "", "", ""),
}

# ---------------------------------------------------------------------------------------------------------------------
# Parts and nets.


class Pin:
    def __init__(self, number, name, kind, net):
        self.number, self.name, self.kind, self.net = number, name, kind, net


class Part:
    def __init__(self, ref, value, kind, block, option=""):
        self.ref, self.value, self.kind, self.block, self.option = ref, value, kind, block, option
        self.pins = []

    def pin(self, number):
        return next(p for p in self.pins if p.number == str(number))


class Board:
    """Parts, and with them the nets. A pin's net is None where it is not connected on purpose."""

    def __init__(self):
        self.parts = []
        # Nets that are supplied through a passive part, as a designer declares them.
        self.power_flags = set()

    def add(self, ref, value, kind, block, pins, option=""):
        part = Part(ref, value, kind, block, option)
        part.pins = [Pin(str(number), name, ptype, net) for number, name, ptype, net in pins]
        self.parts.append(part)
        return part

    def two(self, ref, value, kind, a, b, block, option=""):
        return self.add(ref, value, kind, block, [(1, "1", "passive", a), (2, "2", "passive", b)], option)

    def r(self, ref, value, a, b, block, option=""):
        return self.two(ref, value, "R", a, b, block, option)

    def c(self, ref, value, a, b, block, option=""):
        return self.two(ref, value, "C", a, b, block, option)

    def part(self, ref):
        return next(p for p in self.parts if p.ref == ref)

    def nets(self):
        nets = {}
        for part in self.parts:
            for pin in part.pins:
                if pin.net is not None:
                    nets.setdefault(pin.net, []).append((part, pin))
        return nets


def quad(board, ref, block, amps):
    """MCP6024; `amps`: plus, minus and output of A to D."""
    numbers = {"A": (3, 2, 1), "B": (5, 6, 7), "C": (10, 9, 8), "D": (12, 13, 14)}
    pins = []
    for unit, nets in amps.items():
        for number, name, kind, net in zip(numbers[unit], ("+", "-", "OUT"), ("input", "input", "output"), nets):
            pins.append((number, unit + name, kind, net))
    pins += [(4, "VDD", "power_in", "+5VA"), (11, "VSS", "power_in", "GND")]
    board.add(ref, "MCP6024", "MCP6024", block, sorted(pins, key=lambda p: p[0]))


def dual(board, ref, block, amps):
    """MCP6022; `amps`: plus, minus and output of A and B."""
    numbers = {"A": (3, 2, 1), "B": (5, 6, 7)}
    pins = []
    for unit, nets in amps.items():
        for number, name, kind, net in zip(numbers[unit], ("+", "-", "OUT"), ("input", "input", "output"), nets):
            pins.append((number, unit + name, kind, net))
    pins += [(8, "VDD", "power_in", "+5VA"), (4, "VSS", "power_in", "GND")]
    board.add(ref, "MCP6022", "MCP6022", block, sorted(pins, key=lambda p: p[0]))


# The 4051's switches Y0 to Y7 by pin.
MUX_Y = (13, 14, 15, 12, 1, 5, 2, 4)

# The four multiplexers: name, lowest address line on port B, first enable line on port C, what is behind the switches
# (E: the electrode itself, S: behind its 100 ohm), common, references of the two chips.
MUXES = (
    ("sense -", 0, 0, "S", "SENSE_N", ("U4", "U5")),
    ("sense +", 3, 2, "S", "SENSE_P", ("U6", "U7")),
    ("drive +", 6, 4, "E", "DRIVE_P", ("U8", "U9")),
    ("drive -", 12, 6, "E", "DRIVE_N", ("U10", "U11")),
)
ELECTRODES = 16

# The Nucleo-64's connectors (UM1724, table 29, for F401RE, F411RE and F446RE). CN10-18 is empty there; on the F446 it is
# the processor core's own 1.2 V and must stay open.
CN7 = ("PC10 PC11 PC12 PD2 VDD E5V BOOT0 GND - - - IOREF PA13 RESET PA14 +3V3 PA15 +5V GND GND PB7 GND PC13 VIN PC14 - "
       "PC15 PA0 PH0 PA1 PH1 PA4 VBAT PB0 PC2 PC1 PC3 PC0").split()
CN10 = ("PC9 PC8 PB8 PC6 PB9 PC5 AVDD U5V GND - PA5 PA12 PA6 PA11 PA7 PB12 PB6 VCAP PC7 GND PA9 PB2 PA8 PB1 PB10 PB15 "
        "PB4 PB14 PB5 PB13 PB3 AGND PA10 PC4 PA2 - PA3 -").split()

# What each processor pin is for: name in docs/board.md's words, direction seen from the processor.
PROCESSOR = {
    "PA4": ("DAC", "output"),
    "PA0": ("converter, amplifier", "input"),
    "PA1": ("converter, difference amplifier", "input"),
    "PA6": ("converter, source", "input"),
    "PA8": ("busy", "output"),
    "PA9": ("USART1 transmit", "output"),
    "PA10": ("USART1 receive", "input"),
    "PC11": ("held high for the ROM bootloader", "input"),
}
for _name, _address, _enable, *_rest in MUXES:
    for _bit in range(3):
        PROCESSOR[f"PB{_address + _bit}"] = (f"address A{_bit} of {_name}", "output")
    for _half in range(2):
        PROCESSOR[f"PC{_enable + _half}"] = (f"enable of {_name}, electrodes {8 * _half + 1}-{8 * _half + 8}", "output")


def nucleo(board):
    for ref, names in (("CN7", CN7), ("CN10", CN10)):
        pins = []
        for number, name in enumerate(names, 1):
            net, kind = None, "nc"
            if name in PROCESSOR:
                net, kind = name, PROCESSOR[name][1]
            elif name in ("GND", "AGND"):
                net, kind = "GND", "passive"
            elif name == "+5V":
                net, kind = "+5V", "power_out"
            elif name == "+3V3":
                net, kind = "+3V3", "power_out"
            elif name == "AVDD":
                net, kind = "AVDD", "power_out"
            elif name == "RESET":
                net, kind = "NRST", "input"
            elif name == "BOOT0":
                net, kind = "BOOT0", "input"
            pins.append((number, name, kind, net))
        board.add(ref, "Nucleo " + ref, "MORPHO", "nucleo", pins)
    board.power_flags.add("GND")


def references(board):
    b = "references"
    board.r("R1", "10.0k", "+5VA", "VR_DIV", b)
    board.r("R2", "10.0k", "VR_DIV", "GND", b)
    board.c("C1", "10u", "VR_DIV", "GND", b)
    board.r("R3", "10.0k", "AVDD", "V165_DIV", b)
    board.r("R4", "10.0k", "V165_DIV", "GND", b)
    board.c("C2", "10u", "V165_DIV", "GND", b)
    board.r("R40", "4.7", "+5V", "+5VA", b)
    board.c("C24", "47u", "+5VA", "GND", b)
    board.power_flags.add("+5VA")


def excitation(board):
    b = "drive"
    board.c("C3", "1u", "PA4", "DAC_AC", b)
    board.r("R5", "31.6k", "DAC_AC", "FILT_A", b)
    board.r("R6", "31.6k", "FILT_A", "VR", b)
    board.r("R7", "15.8k", "FILT_A", "FILT_B", b)
    board.c("C4", "1n", "FILT_A", "DRIVE_P", b)
    board.c("C5", "1n", "FILT_B", "VR", b)
    board.r("R8", "10.0k", "FB_A", "VR", b)
    board.r("R9", "5.90k", "FB_A", "DRIVE_P", b)
    board.c("C6", "22p", "FB_A", "DRIVE_P", b)
    board.r("R10", "10.0k", "DRIVE_P", "FB_B", b)
    board.r("R11", "10.0k", "FB_B", "DRIVE_N", b)
    board.c("C7", "22p", "FB_B", "DRIVE_N", b)
    quad(board, "U1", b, {
        "A": ("FILT_B", "FB_A", "DRIVE_P"),
        "B": ("VR", "FB_B", "DRIVE_N"),
        "C": ("VR_DIV", "VR", "VR"),
        "D": ("V165_DIV", "V165", "V165"),
    })
    # The source's own voltage to PA6.
    board.r("R37", "10.0k", "DRIVE_P", "MONITOR", b)
    board.r("R38", "16.5k", "MONITOR", "GND", b)
    board.r("R39", "105k", "AVDD", "MONITOR", b)
    board.c("C12", "1.8n", "MONITOR", "GND", b)
    protected(board, "R41", "MONITOR", "PA6", ("D5", "D6"), b)


def protected(board, r, net, pin, diodes, block):
    """470 ohm and two diodes before a converter input."""
    board.r(r, "470", net, pin, block)
    up, down = diodes
    board.add(up, "BAT85", "D", block, [(1, "K", "passive", "+3V3"), (2, "A", "passive", pin)])
    board.add(down, "BAT85", "D", block, [(1, "K", "passive", pin), (2, "A", "passive", "GND")])


def multiplexers(board):
    b = "multiplexers"
    for _, address, enable, side, common, refs in MUXES:
        for half, ref in enumerate(refs):
            pins = [(MUX_Y[k], f"Y{k}", "passive", f"{side}{8 * half + k + 1}") for k in range(8)]
            pins += [(3, "Z", "passive", common), (6, "E", "input", f"PC{enable + half}")]
            pins += [(11, "S0", "input", f"PB{address}"), (10, "S1", "input", f"PB{address + 1}"),
                     (9, "S2", "input", f"PB{address + 2}")]
            pins += [(16, "VCC", "power_in", "+5VA"), (8, "GND", "power_in", "GND"), (7, "VEE", "power_in", "GND")]
            board.add(ref, "74HCT4051", "74HCT4051", b, sorted(pins, key=lambda p: p[0]))
    for k in range(8):
        board.r(f"R{42 + k}", "10.0k", "+3V3", f"PC{k}", b)
    board.r("R50", "10.0k", "PB2", "GND", b)
    board.r("R51", "10.0k", "+3V3", "PC11", b)
    board.r("R52", "10.0k", "+3V3", "PB5", b)


def electrodes(board):
    b = "electrodes"
    pins = [(n, f"E{n}", "passive", f"E{n}") for n in range(1, ELECTRODES + 1)]
    pins += [(n, "SHIELD", "passive", "GND") for n in range(ELECTRODES + 1, 21)]
    board.add("J1", "electrodes", "IDC20", b, pins)
    for n in range(1, ELECTRODES + 1):
        board.two(f"D{6 + n}", "PESD5V0V1BA", "TVS", f"E{n}", "GND", b)
        board.r(f"R{20 + n}", "100", f"E{n}", f"S{n}", b)


def amplifiers(board):
    b = "amplifiers"
    board.add("U3", "INA826", "INA826", b, [
        (1, "-IN", "input", "SENSE_N"), (2, "RG", "passive", "RG_A"), (3, "RG", "passive", "RG_B"),
        (4, "+IN", "input", "SENSE_P"), (5, "-VS", "power_in", "GND"), (6, "REF", "input", "V165"),
        (7, "OUT", "output", "AMP"), (8, "+VS", "power_in", "+5VA")])
    board.r("R12", "4.12k", "RG_A", "RG_B", b)
    board.r("R13", "1.58k", "AMP", "AMP_F", b)
    board.c("C8", "6.8n", "AMP_F", "GND", b)
    protected(board, "R14", "AMP_F", "PA0", ("D1", "D2"), b)
    dual(board, "U2", b, {"A": ("DIFF_P", "DIFF_N", "DIFF"), "B": ("V165", "SPARE", "SPARE")})
    board.r("R15", "1.00M", "SENSE_P", "DIFF_P", b)
    board.r("R16", "604k", "DIFF_P", "V165", b)
    board.c("C9", "4.7p", "DIFF_P", "V165", b)
    board.r("R17", "1.00M", "SENSE_N", "DIFF_N", b)
    board.r("R18", "604k", "DIFF_N", "DIFF", b)
    board.c("C10", "4.7p", "DIFF_N", "DIFF", b)
    board.r("R19", "1.58k", "DIFF", "DIFF_F", b)
    board.c("C11", "6.8n", "DIFF_F", "GND", b)
    protected(board, "R20", "DIFF_F", "PA1", ("D3", "D4"), b)


def decoupling(board):
    for n in range(11):
        board.c(f"C{13 + n}", "100n", "+5VA", "GND", f"beside U{n + 1}")


def serial(board):
    """Only with an FT232RL adapter; a Nucleo's own debugger needs none of it."""
    b, o = "adapter", "FT232RL only"
    board.add("J2", "FT232RL adapter at 3.3 V", "FT232", b, [
        (1, "GND", "passive", "GND"), (2, "3V3", "power_out", "FT_3V3"), (3, "TXD", "output", "PA10"),
        (4, "RXD", "input", "PA9"), (5, "DTR#", "output", "DTR"), (6, "RTS#", "output", "RTS")], o)
    board.add("Q1", "BC547", "NPN", b, [(1, "C", "open", "NRST"), (2, "B", "passive", "Q1_B"), (3, "E", "passive", "RTS")], o)
    board.r("R53", "10.0k", "DTR", "Q1_B", b, o)
    board.add("Q2", "BC557", "PNP", b, [(1, "C", "open", "BOOT0"), (2, "B", "passive", "Q2_B"), (3, "E", "passive", "FT_3V3")], o)
    board.r("R54", "10.0k", "DTR", "Q2_B", b, o)
    board.r("R55", "10.0k", "BOOT0", "GND", b, o)


# Test points: net, and what must be seen there. check.py holds the numbers against the simulation.
TEST_POINTS = (
    ("TP1", "PA4", "1.65 V, sine of 1.44 V amplitude in 16 steps"),
    ("TP2", "DRIVE_P", "V_R, sine of 1.13 V amplitude"),
    ("TP3", "DRIVE_N", "V_R, the same sine upside down; mean within 10 mV of TP2's"),
    ("TP4", "VR", "half of TP12: 2.48 V at 5.00 V; ripple below 1 mV"),
    ("TP5", "V165", "half of AVDD: 1.65 V; ripple below 1 mV"),
    ("TP6", "PA6", "1.65 V, sine of 0.64 V amplitude"),
    ("TP7", "PA0", "1.65 V, sine of 1.30 V amplitude on the ring of 470 ohm"),
    ("TP8", "PA1", "1.65 V, sine of 0.91 V amplitude on the ring of 470 ohm, sense pair = drive pair"),
    ("TP9", "PA8", "high while a block of samples is worked on"),
    ("TP10", "SENSE_P", "V_R, and the sense electrode's sine"),
    ("TP11", "SENSE_N", "as TP10"),
    ("TP12", "+5VA", "30 mV below USB's 5 V"),
    ("TP13", "GND", "0 V"),
)


def test_points(board):
    for ref, net, _ in TEST_POINTS:
        board.add(ref, "", "TP", "test points", [(1, "1", "passive", net)])


def describe():
    board = Board()
    nucleo(board)
    references(board)
    excitation(board)
    multiplexers(board)
    electrodes(board)
    amplifiers(board)
    decoupling(board)
    serial(board)
    test_points(board)
    return board


# ---------------------------------------------------------------------------------------------------------------------
# Electrical rules.

DRIVES = {"output", "power_out"}
LISTENS = {"input", "power_in"}


def broken_rules(board):
    """What is wrong with the description, in words; empty when nothing is."""
    wrong = []
    refs = [p.ref for p in board.parts]
    wrong += [f"{ref}: twice in the description" for ref in sorted({r for r in refs if refs.count(r) > 1})]
    for part in board.parts:
        numbers = [pin.number for pin in part.pins]
        if len(set(numbers)) < len(numbers):
            wrong.append(f"{part.ref}: a pin twice")
        for pin in part.pins:
            if pin.net is None and pin.kind != "nc":
                wrong.append(f"{part.ref}-{pin.number} ({pin.name}): neither connected nor marked as open")
            if pin.net is not None and pin.kind == "nc":
                wrong.append(f"{part.ref}-{pin.number} ({pin.name}): marked as open, but connected")
    wanted = {"MCP6024": 14, "MCP6022": 8, "INA826": 8, "74HCT4051": 16, "MORPHO": 38, "IDC20": 20}
    for part in board.parts:
        if part.kind in wanted and len(part.pins) != wanted[part.kind]:
            wrong.append(f"{part.ref}: {len(part.pins)} pins described, the package has {wanted[part.kind]}")
    for net, members in sorted(board.nets().items()):
        real = [(part, pin) for part, pin in members if part.kind != "TP"]
        if len(members) < 2:
            wrong.append(f"net {net}: goes nowhere")
        drivers = [f"{part.ref}-{pin.number}" for part, pin in real if pin.kind in DRIVES]
        if len(drivers) > 1:
            wrong.append(f"net {net}: driven by {', '.join(drivers)} at once")
        needs_power = [f"{part.ref}-{pin.number}" for part, pin in real if pin.kind == "power_in"]
        supplied = net in board.power_flags or any(pin.kind == "power_out" for _, pin in real)
        if needs_power and not supplied:
            wrong.append(f"net {net}: no supply for {', '.join(needs_power)}")
        inputs = [f"{part.ref}-{pin.number}" for part, pin in real if pin.kind == "input"]
        others = [pin for _, pin in real if pin.kind not in LISTENS]
        if inputs and not others:
            wrong.append(f"net {net}: nothing drives {', '.join(inputs)}")
    # Every chip has its capacitor.
    beside = {p.block.removeprefix("beside ") for p in board.parts if p.block.startswith("beside ")}
    chips = {p.ref for p in board.parts if p.ref.startswith("U")}
    wrong += [f"{ref}: no capacitor beside it" for ref in sorted(chips - beside)]
    # Every electrode reaches every multiplexer once, by the switch that the program closes for it.
    for name, _, _, side, common, chips_of in MUXES:
        for n in range(ELECTRODES):
            chip = board.part(chips_of[n // 8])
            pin = chip.pin(MUX_Y[n % 8])
            if pin.net != f"{side}{n + 1}" or chip.pin(3).net != common:
                wrong.append(f"{chip.ref}: electrode {n + 1} of {name} is not on Y{n % 8}")
    return wrong


# ---------------------------------------------------------------------------------------------------------------------
# Lists.


def natural(text):
    return [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", text)]


def catalogue(part):
    """Description, footprint, maker, MPN, second maker, second MPN, where the numbers were seen."""
    if part.kind == "R":
        yageo, vishay = resistor_codes(part.value)
        maker, mpn, second, second_mpn, seen = METAL_FILM
        return ("metal film 1 % 0.25 W", AXIAL, maker, mpn.format(yageo=yageo), second,
                second_mpn.format(vishay=vishay), seen)
    if part.kind == "C":
        return CAPACITORS[part.value]
    return CHIPS[part.value if part.value in CHIPS else part.kind]


def csv_line(fields):
    return ",".join(f'"{f}"' if "," in f or '"' in f else f for f in fields) + "\n"


def bom(board):
    rows = {}
    for part in board.parts:
        if part.kind == "TP":
            continue
        value = part.value if part.kind not in ("MORPHO", "IDC20", "FT232") else catalogue(part)[0]
        rows.setdefault((part.kind, value, part.option), []).append(part)
    out = csv_line("references quantity value description package maker mpn second_maker second_mpn seen only".split())
    for (_, value, option), parts in sorted(rows.items(), key=lambda r: natural(r[1][0].ref)):
        kind, footprint, *rest = catalogue(parts[0])
        unit = {"R": " ohm", "C": "F"}.get(parts[0].kind, "")
        refs = " ".join(sorted((p.ref for p in parts), key=natural))
        out += csv_line([refs, str(len(parts)), value + unit, kind, footprint, *rest, option])
    out += csv_line(["-", "1", "NUCLEO-F446RE", "processor board, MB1136 C-02 or later", "-", "STMicroelectronics",
                     "NUCLEO-F446RE", "-", "-", "UM1724", ""])
    return out


def wiring(board):
    """Every wire from one pin to the next, net by net."""
    out = csv_line("net from from_pin to to_pin".split())
    for net, members in sorted(board.nets().items(), key=lambda n: natural(n[0])):
        members = sorted(members, key=lambda m: (natural(m[0].ref), natural(m[1].number)))
        for (a, pa), (b, pb) in zip(members, members[1:]):
            out += csv_line([net, f"{a.ref}-{pa.number}", pa.name, f"{b.ref}-{pb.number}", pb.name])
    return out


def pins(board):
    """The processor's pins, with the Nucleo's connector pins and what each goes to."""
    out = csv_line("pin connector function goes_to".split())
    nets = board.nets()
    for name in sorted(PROCESSOR, key=natural):
        place = next(f"{ref}-{names.index(name) + 1}" for ref, names in (("CN7", CN7), ("CN10", CN10)) if name in names)
        to = [f"{part.ref}-{pin.number}" for part, pin in nets[name] if part.kind not in ("MORPHO", "TP")]
        out += csv_line([name, place, PROCESSOR[name][0], " ".join(sorted(to, key=natural))])
    return out


def electrode_wires(_board):
    """64 wires: electrode by electrode, to the four multiplexers."""
    out = csv_line("electrode connector drive_plus drive_minus sense_plus sense_minus resistor esd".split())
    chips = {name: refs for name, *_, refs in MUXES}
    for n in range(1, ELECTRODES + 1):
        half, k = divmod(n - 1, 8)
        place = {name: f"{refs[half]}-{MUX_Y[k]}" for name, refs in chips.items()}
        out += csv_line([str(n), f"J1-{n}", place["drive +"], place["drive -"], place["sense +"], place["sense -"],
                         f"R{20 + n}", f"D{6 + n}"])
    return out


def test_point_list(_board):
    out = csv_line("point net expected".split())
    for row in TEST_POINTS:
        out += csv_line(list(row))
    return out


# ---------------------------------------------------------------------------------------------------------------------
# ngspice: the board as drawn. Testbenches add what is outside: supplies, the processor's pins, the sheet.


def node(net):
    return {"GND": "0"}.get(net, net.replace("+", "p").replace("-", "m").lower())


def spice(board):
    out = ["* The sensor board. Generated from hardware/board.py; do not edit.",
           "* rtol, ctol: factors on all resistors and capacitors, for tolerances. The testbench sets them."]
    for part in board.parts:
        n = {pin.number: node(pin.net) for pin in part.pins if pin.net is not None}
        if part.kind == "R":
            out.append(f"{part.ref} {n['1']} {n['2']} {{{part.value.replace('M', 'meg')}*rtol}}")
        elif part.kind == "C":
            out.append(f"{part.ref} {n['1']} {n['2']} {{{part.value}*ctol}}")
        elif part.kind == "D":
            out.append(f"{part.ref} {n['2']} {n['1']} schottky")
        elif part.kind == "TVS":
            out.append(f"C{part.ref} {n['1']} {n['2']} 11p")
        elif part.kind in ("MCP6024", "MCP6022"):
            units = sorted({p.name[0] for p in part.pins if p.kind in ("input", "output")})
            for unit in units:
                net = {p.name[1:]: node(p.net) for p in part.pins if p.name[0] == unit and p.kind in ("input", "output")}
                out.append(f"X{part.ref}{unit} {net['+']} {net['-']} p5va 0 {net['OUT']} mcp602x")
        elif part.kind == "INA826":
            out.append(f"X{part.ref} " + " ".join(n[str(k)] for k in range(1, 9)) + " ina826")
        elif part.kind == "74HCT4051":
            y = " ".join(n[str(MUX_Y[k])] for k in range(8))
            out.append(f"X{part.ref} {y} {n['3']} {n['6']} {n['11']} {n['10']} {n['9']} hct4051")
    return "\n".join(out) + "\n"


def sheet_values():
    """Own resistance of a drive pair and the transfer resistances to the sense pairs after it, ohm, of hardware/sheet.csv."""
    rows = [line.split(",") for line in (HERE / "sheet.csv").read_text(encoding="utf-8").splitlines()[1:]]
    return {int(pair): float(ohm) for pair, ohm in rows}


def sheet_network():
    """The paper's sheet as resistors between all electrodes, in ohm by distance round the rim.

    The sheet is the same turned by one electrode, so that a Fourier series along the rim inverts its matrix.
    """
    n = ELECTRODES
    d = [0.0] * n
    values = sheet_values()
    d[0] = values[0]
    for k in range(2, n - 1):
        d[k] = -values[min(k, n - k)]
    # Round the rim the voltages add up to nothing.
    d[1] = d[n - 1] = -sum(d) / 2
    angle = [2 * math.pi * m / n for m in range(n)]
    modes = [sum(d[k] * math.cos(a * k) for k in range(n)) for a in angle]
    conductance = [0.0] + [(2 - 2 * math.cos(a)) / mode for a, mode in zip(angle[1:], modes[1:])]
    return {k: -n / sum(g * math.cos(a * k) for g, a in zip(conductance, angle)) for k in range(1, n // 2 + 1)}


def network(name, title, between):
    """A subcircuit of resistors between electrodes; `between` gives ohm by distance round the rim."""
    out = [f"* {title} Generated from hardware/board.py; do not edit.",
           f".subckt {name} " + " ".join(f"e{n}" for n in range(1, ELECTRODES + 1))]
    for a in range(ELECTRODES):
        for b in range(a + 1, ELECTRODES):
            distance = min(b - a, ELECTRODES - (b - a))
            if distance in between:
                out.append(f"R{a + 1}_{b + 1} e{a + 1} e{b + 1} {between[distance]:.6g}")
    return "\n".join([*out, ".ends"]) + "\n"


PHANTOM_OHM = 470

# ---------------------------------------------------------------------------------------------------------------------
# KiCad.


def quoted(text):
    return '"' + text.replace('"', "'") + '"'


def kicad_netlist(board):
    out = ["(export (version D)", "  (design (source \"hardware/board.py\") (tool \"hardware/board.py\"))", "  (components"]
    for part in board.parts:
        _, footprint, maker, mpn, *_ = catalogue(part)
        value = part.value or part.ref
        out.append(f"    (comp (ref {quoted(part.ref)}) (value {quoted(value)}) (footprint {quoted(footprint)})"
                   f" (fields (field (name \"Maker\") {quoted(maker)}) (field (name \"MPN\") {quoted(mpn)})))")
    out.append("  )")
    out.append("  (nets")
    for code, (net, members) in enumerate(sorted(board.nets().items(), key=lambda n: natural(n[0])), 1):
        nodes = " ".join(f"(node (ref {quoted(p.ref)}) (pin {quoted(pin.number)}))" for p, pin in members)
        out.append(f"    (net (code \"{code}\") (name {quoted(net)}) {nodes})")
    out.append("  ))")
    return "\n".join(out) + "\n"


def generated(board):
    import draw

    files = {
        "bom.csv": bom(board),
        "wiring.csv": wiring(board),
        "pins.csv": pins(board),
        "electrodes.csv": electrode_wires(board),
        "test_points.csv": test_point_list(board),
        "board.net": kicad_netlist(board),
        "board.spice": spice(board),
        "sheet.spice": network("sheet", "The paper's sheet, of hardware/sheet.csv.", sheet_network()),
        "ring.spice": network("sheet", "The phantom: sixteen resistors in a ring.", {1: PHANTOM_OHM}),
    }
    files.update(draw.files(board))
    return {GENERATED / name: text for name, text in files.items()}


def main(arguments):
    board = describe()
    wrong = broken_rules(board)
    for line in wrong:
        print(f"rule: {line}", file=sys.stderr)
    if wrong:
        return 1
    stale = 0
    for path, text in generated(board).items():
        if arguments == ["--check"]:
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                print(f"stale: {path.relative_to(HERE.parent)}; run python3 hardware/board.py", file=sys.stderr)
                stale = 1
        elif not arguments:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(path.relative_to(HERE.parent))
        else:
            print(__doc__, file=sys.stderr)
            return 2
    return stale


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
