"""Drawings of the board: the schematic as four SVG sheets, a KiCad 6 schematic, the outline of a shield.

Places of parts and wires are given here by hand; what is connected to what is board.py's. Every sheet is checked before
it is written: wires and labels must join the same pins as the description's nets do, and no others.
"""

import uuid
from html import escape

import board as hardware

LINE = 'stroke="#222" stroke-width="1.6" fill="none"'
BODY = 'stroke="#222" stroke-width="1.6" fill="#fffdf3"'


class DrawingError(Exception):
    pass


class Sheet:
    """One sheet: shapes, pins at their places, wires, labels."""

    def __init__(self, board, title, width, height):
        self.board, self.title, self.width, self.height = board, title, width, height
        self.shapes, self.pins, self.wires, self.labels = [], {}, [], []

    # Shapes.

    def text(self, x, y, words, anchor="start", size=13, bold=False, colour="#222"):
        weight = ' font-weight="bold"' if bold else ""
        self.shapes.append(f'<text x="{x}" y="{y}" text-anchor="{anchor}" font-size="{size}" fill="{colour}"{weight}>{escape(words)}</text>')

    def line(self, *points):
        self.shapes.append(f'<polyline points="{" ".join(f"{x},{y}" for x, y in points)}" {LINE}/>')

    def pin(self, ref, number, x, y):
        key = (ref, str(number))
        if key in self.pins:
            raise DrawingError(f"{self.title}: {ref}-{number} is drawn twice")
        self.board.part(ref).pin(number)
        self.pins[key] = (x, y)

    def two(self, ref, x, y, vertical, draw, flip=False):
        """A part of two pins, 60 long about (x, y); pin 1 is left or on top unless flipped."""
        part = self.board.part(ref)
        a, b = (((x, y - 30), (x, y + 30)) if vertical else ((x - 30, y), (x + 30, y)))
        if flip:
            a, b = b, a
        self.pin(ref, 1, *a)
        self.pin(ref, 2, *b)
        draw(x, y, vertical)
        value = part.value + (" F" if part.kind == "C" else "")
        value = value.replace(" F", "F")
        if vertical:
            self.text(x + 14, y - 2, ref, bold=True)
            self.text(x + 14, y + 14, value)
        else:
            lift = 6 if part.kind == "C" else 0
            self.text(x, y - 12 - lift, ref, "middle", bold=True)
            self.text(x, y + 24 + lift, value, "middle")

    def resistor(self, ref, x, y, vertical=False, flip=False):
        def draw(x, y, vertical):
            w, h = (12, 36) if vertical else (36, 12)
            self.shapes.append(f'<rect x="{x - w / 2}" y="{y - h / 2}" width="{w}" height="{h}" {BODY}/>')
            if vertical:
                self.line((x, y - 30), (x, y - 18))
                self.line((x, y + 18), (x, y + 30))
            else:
                self.line((x - 30, y), (x - 18, y))
                self.line((x + 18, y), (x + 30, y))
        self.two(ref, x, y, vertical, draw, flip)

    def capacitor(self, ref, x, y, vertical=False, flip=False):
        def draw(x, y, vertical):
            if vertical:
                for dy in (-4, 4):
                    self.line((x - 12, y + dy), (x + 12, y + dy))
                self.line((x, y - 30), (x, y - 4))
                self.line((x, y + 4), (x, y + 30))
            else:
                for dx in (-4, 4):
                    self.line((x + dx, y - 12), (x + dx, y + 12))
                self.line((x - 30, y), (x - 4, y))
                self.line((x + 4, y), (x + 30, y))
        self.two(ref, x, y, vertical, draw, flip)

    def diode_up(self, ref, x, y, both=False):
        """Cathode (pin 1) on top."""
        self.pin(ref, 1, x, y - 30)
        self.pin(ref, 2, x, y + 30)
        self.line((x, y - 30), (x, y + 30))
        self.shapes.append(f'<polygon points="{x - 9},{y + 8} {x + 9},{y + 8} {x},{y - 8}" {BODY}/>')
        self.line((x - 9, y - 8), (x + 9, y - 8))
        if both:
            self.line((x - 9, y - 8), (x - 9, y - 3))
            self.line((x + 9, y - 8), (x + 9, y - 13))
        self.text(x + 14, y - 2, ref, bold=True)
        self.text(x + 14, y + 14, self.board.part(ref).value)

    def opamp(self, ref, unit, x, y, plus_on_top=True):
        """Inputs at (x - 40, y -+ 20), output at (x + 40, y)."""
        part = self.board.part(ref)
        number = {p.name: p.number for p in part.pins}
        plus, minus = (y - 20, y + 20) if plus_on_top else (y + 20, y - 20)
        self.pin(ref, number[unit + "+"], x - 40, plus)
        self.pin(ref, number[unit + "-"], x - 40, minus)
        self.pin(ref, number[unit + "OUT"], x + 40, y)
        self.shapes.append(f'<polygon points="{x - 30},{y - 36} {x - 30},{y + 36} {x + 32},{y}" {BODY}/>')
        for py, sign, name in ((plus, "+", unit + "+"), (minus, "−", unit + "-")):
            self.line((x - 40, py), (x - 30, py))
            self.text(x - 26, py + 5, sign, size=15)
            self.text(x - 42, py - 4, number[name], "end", 10, colour="#666")
        self.line((x + 32, y), (x + 40, y))
        self.text(x + 36, y - 5, number[unit + "OUT"], size=10, colour="#666")
        self.text(x - 14, y + 4, ref + unit, size=12, bold=True)

    def box(self, ref, x, y, width, left, right, title=None, pitch=20):
        """A box with pins by number on either side; None leaves a gap. Returns nothing; pins end 20 outside."""
        part = self.board.part(ref)
        height = pitch * max(len(left), len(right)) + 16
        self.shapes.append(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {BODY}/>')
        self.text(x + width / 2, y - 6, title or f"{ref} {part.value}", "middle", bold=True)
        for side, numbers in (("l", left), ("r", right)):
            for k, number in enumerate(numbers):
                if number is None:
                    continue
                pin = part.pin(number)
                py = y + 18 + pitch * k
                edge, end = (x, x - 20) if side == "l" else (x + width, x + width + 20)
                self.line((edge, py), (end, py))
                self.pin(ref, number, end, py)
                inner = (edge + 5, "start") if side == "l" else (edge - 5, "end")
                self.text(inner[0], py + 4, pin.name, inner[1], 12)
                outer = (edge - 3, "end") if side == "l" else (edge + 3, "start")
                self.text(outer[0], py - 3, str(number), outer[1], 9, colour="#666")
                if pin.net is None:
                    self.line((end - 4, py - 4), (end + 4, py + 4))
                    self.line((end - 4, py + 4), (end + 4, py - 4))

    def test_point(self, ref, x, y, above=True):
        self.pin(ref, 1, x, y)
        self.shapes.append(f'<circle cx="{x}" cy="{y}" r="5" fill="#c33" stroke="#222"/>')
        self.text(x + 7, y - 7 if above else y + 17, ref, size=11, bold=True, colour="#a11")

    # Connections.

    def wire(self, *points):
        for a, b in zip(points, points[1:]):
            if a[0] != b[0] and a[1] != b[1]:
                raise DrawingError(f"{self.title}: a slanted wire at {a}")
            self.wires.append((a, b))
        self.line(*points)

    def label(self, x, y, net, side="right"):
        """A net's name at a place; `side` is where the words go."""
        self.labels.append(((x, y), net))
        if net == "GND":
            for k, half in enumerate((11, 7, 3)):
                self.line((x - half, y + 4 * k), (x + half, y + 4 * k))
            return
        colour = "#a33" if net[0] == "+" or net in ("AVDD",) else "#146"
        shown = net.replace("VR", "V_R") if net == "VR" else net
        dx, anchor = {"right": (6, "start"), "left": (-6, "end"), "up": (0, "middle"), "down": (0, "middle")}[side]
        dy = {"up": -6, "down": 15}.get(side, 4)
        self.text(x + dx, y + dy, shown, anchor, 12, True, colour)

    def pin_labels(self, ref, side_of, skip=()):
        """A label at every pin of a box that has no wire."""
        for pin in self.board.part(ref).pins:
            if (ref, pin.number) in self.pins and pin.net is not None and pin.number not in skip:
                x, y = self.pins[ref, pin.number]
                side = side_of(x)
                if pin.net == "GND":
                    self.labels.append(((x, y), "GND"))
                    self.text(x + (6 if side == "right" else -6), y + 4, "GND", "start" if side == "right" else "end", 12, True, "#444")
                else:
                    self.label(x, y, pin.net, side)

    # The check.

    def groups(self):
        """Pins and labels that the drawing joins."""
        places = set(self.pins.values()) | {p for p, _ in self.labels} | {p for w in self.wires for p in w}
        parent = {p: p for p in places}

        def find(p):
            while parent[p] != p:
                p = parent[p]
            return p

        for (ax, ay), (bx, by) in self.wires:
            for p in places:
                inside = min(ax, bx) <= p[0] <= max(ax, bx) and min(ay, by) <= p[1] <= max(ay, by)
                ends = p in ((ax, ay), (bx, by))
                # A wire that only crosses another has no end on it.
                if inside and (ends or p in self.pins.values() or any(p == l for l, _ in self.labels)
                               or any(p in w for w in self.wires)):
                    parent[find(p)] = find((ax, ay))
        joined = {}
        for key, place in self.pins.items():
            joined.setdefault(find(place), ([], []))[0].append(key)
        for place, net in self.labels:
            joined.setdefault(find(place), ([], []))[1].append(net)
        return joined.values()

    def check(self):
        for pins, labels in self.groups():
            nets = {self.board.part(ref).pin(number).net for ref, number in pins} | set(labels)
            names = ", ".join(f"{r}-{n}" for r, n in pins)
            if len(nets) > 1:
                raise DrawingError(f"{self.title}: {names} are joined, but are on {sorted(map(str, nets))}")
            net = nets.pop()
            if net is None:
                continue
            if not pins:
                raise DrawingError(f"{self.title}: the label {net} is at no pin")
            whole = {(p.ref, pin.number) for p, pin in self.board.nets()[net]}
            if not labels and whole != set(pins):
                missing = sorted(f"{r}-{n}" for r, n in whole - set(pins))
                raise DrawingError(f"{self.title}: {names} on {net} have no label and no wire to {', '.join(missing)}")

    def dots(self):
        """A dot where three wires or more meet."""
        ends = {}
        for a, b in self.wires:
            for p in (a, b):
                ends[p] = ends.get(p, 0) + 1
        for place in self.pins.values():
            if place in ends:
                ends[place] += 1
        for p in list(ends):
            for a, b in self.wires:
                if p not in (a, b) and min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1]):
                    ends[p] += 2
        return "".join(f'<circle cx="{x}" cy="{y}" r="3.2" fill="#222"/>' for (x, y), n in sorted(ends.items()) if n >= 3)

    def svg(self):
        self.check()
        head = (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
                f'font-family="DejaVu Sans, Helvetica, sans-serif"><rect width="{self.width}" height="{self.height}" fill="#fff"/>\n'
                f'<text x="20" y="30" font-size="18" font-weight="bold">{escape(self.title)}</text>\n')
        return head + "\n".join(self.shapes) + "\n" + self.dots() + "\n</svg>\n"


def protected(s, r, x, y, diodes, tp, pin, from_x):
    """470 ohm, diodes, test point and label of a converter input; from `from_x` on the wire at height y."""
    s.resistor(r, x, y)
    s.wire((from_x, y), (x - 30, y))
    s.wire((x + 30, y), (x + 70, y), (x + 150, y), (x + 190, y))
    up, down = diodes
    s.diode_up(up, x + 70, y - 50)
    s.wire((x + 70, y - 20), (x + 70, y))
    s.label(x + 70, y - 80, "+3V3", "up")
    s.diode_up(down, x + 70, y + 50)
    s.wire((x + 70, y), (x + 70, y + 20))
    s.label(x + 70, y + 80, "GND")
    s.test_point(tp, x + 150, y)
    s.label(x + 190, y, pin)


def power(s, ref, x, y, plus, minus, capacitor):
    """The supply pins of a chip that is drawn in units, and its capacitor."""
    part = s.board.part(ref)
    s.shapes.append(f'<rect x="{x - 30}" y="{y - 30}" width="60" height="60" {BODY}/>')
    s.text(x, y + 4, ref, "middle", bold=True)
    s.pin(ref, plus, x, y - 50)
    s.pin(ref, minus, x, y + 50)
    s.line((x, y - 50), (x, y - 30))
    s.line((x, y + 30), (x, y + 50))
    s.text(x + 4, y - 34, str(plus), size=10, colour="#666")
    s.text(x + 4, y + 44, str(minus), size=10, colour="#666")
    s.text(x, y + 20, part.value, "middle", 10)
    s.capacitor(capacitor, x + 60, y, True)
    s.wire((x, y - 50), (x + 60, y - 50), (x + 60, y - 30))
    s.wire((x, y + 50), (x + 60, y + 50), (x + 60, y + 30))
    s.wire((x, y - 60), (x, y - 50))
    s.label(x, y - 60, "+5VA", "up")
    s.wire((x, y + 50), (x, y + 60))
    s.label(x, y + 60, "GND")


def drive_sheet(board):
    s = Sheet(board, "1  Source: filter, inverter, references, monitor, supply", 1180, 960)
    # The filter.
    s.label(60, 200, "PA4", "left")
    s.wire((60, 200), (90, 200), (110, 200))
    s.test_point("TP1", 90, 200)
    s.capacitor("C3", 140, 200)
    s.wire((170, 200), (190, 200))
    s.resistor("R5", 220, 200)
    s.wire((250, 200), (290, 200), (340, 200))
    s.resistor("R6", 290, 250, True)
    s.wire((290, 200), (290, 220))
    s.label(290, 280, "VR", "down")
    s.resistor("R7", 370, 200)
    s.wire((400, 200), (440, 200), (500, 200))
    s.capacitor("C5", 440, 250, True)
    s.wire((440, 200), (440, 220))
    s.label(440, 280, "VR", "down")
    s.capacitor("C4", 440, 120)
    s.wire((290, 200), (290, 120), (410, 120))
    s.wire((470, 120), (620, 120), (620, 220))
    s.opamp("U1", "A", 540, 220)
    s.wire((580, 220), (620, 220))
    s.wire((500, 240), (480, 240), (480, 330), (520, 330))
    s.resistor("R9", 550, 330)
    s.wire((580, 330), (620, 330), (620, 220))
    s.wire((480, 330), (480, 390), (520, 390))
    s.capacitor("C6", 550, 390)
    s.wire((580, 390), (620, 390), (620, 330))
    s.resistor("R8", 480, 440, True)
    s.wire((480, 390), (480, 410))
    s.label(480, 470, "VR", "down")
    # The inverter.
    s.wire((620, 220), (670, 220), (720, 220))
    s.test_point("TP2", 670, 220, above=False)
    s.wire((670, 220), (670, 190))
    s.label(670, 190, "DRIVE_P", "up")
    s.resistor("R10", 750, 220)
    s.wire((780, 220), (810, 220), (860, 220))
    s.opamp("U1", "B", 900, 240, plus_on_top=False)
    s.wire((860, 260), (840, 260), (840, 300))
    s.label(840, 300, "VR", "down")
    s.resistor("R11", 900, 160)
    s.wire((810, 220), (810, 160), (870, 160))
    s.wire((930, 160), (980, 160), (980, 240))
    s.capacitor("C7", 900, 100)
    s.wire((810, 160), (810, 100), (870, 100))
    s.wire((930, 100), (980, 100), (980, 160))
    s.wire((940, 240), (980, 240), (1030, 240), (1060, 240))
    s.test_point("TP3", 1030, 240)
    s.label(1060, 240, "DRIVE_N")
    # References.
    for x, top, div, r1, r2, c, unit, out, tp in ((90, "+5VA", "VR_DIV", "R1", "R2", "C1", "C", "VR", "TP4"),
                                                  (560, "AVDD", "V165_DIV", "R3", "R4", "C2", "D", "V165", "TP5")):
        s.label(x, 550, top, "up")
        s.resistor(r1, x, 580, True)
        s.wire((x, 610), (x, 640))
        s.resistor(r2, x, 670, True)
        s.label(x, 700, "GND")
        s.capacitor(c, x + 90, 670, True)
        s.wire((x, 610), (x + 90, 610), (x + 90, 640))
        s.label(x + 90, 700, "GND")
        s.wire((x + 90, 610), (x + 190, 610))
        s.opamp("U1", unit, x + 230, 630)
        s.wire((x + 190, 650), (x + 170, 650), (x + 170, 700), (x + 300, 700), (x + 300, 630))
        s.wire((x + 270, 630), (x + 300, 630), (x + 340, 630), (x + 370, 630))
        s.test_point(tp, x + 340, 630)
        s.label(x + 370, 630, out)
    # Supply.
    s.label(720, 420, "+5V", "left")
    s.wire((720, 420), (740, 420))
    s.resistor("R40", 770, 420)
    s.wire((800, 420), (860, 420), (920, 420), (960, 420))
    s.capacitor("C24", 860, 470, True)
    s.wire((860, 420), (860, 440))
    s.label(860, 500, "GND")
    s.test_point("TP12", 920, 420)
    s.label(960, 420, "+5VA")
    s.test_point("TP13", 1040, 480)
    s.wire((1040, 480), (1040, 500))
    s.label(1040, 500, "GND")
    power(s, "U1", 1060, 640, 4, 11, "C13")
    # The monitor.
    s.label(90, 850, "DRIVE_P", "left")
    s.wire((90, 850), (100, 850))
    s.resistor("R37", 130, 850)
    s.wire((160, 850), (200, 850), (290, 850), (370, 850))
    s.resistor("R39", 200, 800, True)
    s.wire((200, 830), (200, 850))
    s.label(200, 770, "AVDD", "up")
    s.resistor("R38", 200, 900, True)
    s.wire((200, 850), (200, 870))
    s.label(200, 930, "GND")
    s.capacitor("C12", 290, 900, True)
    s.wire((290, 850), (290, 870))
    s.label(290, 930, "GND")
    protected(s, "R41", 440, 850, ("D5", "D6"), "TP6", "PA6", 370)
    return s


def receive_sheet(board):
    s = Sheet(board, "2  Amplifiers and anti-alias filters", 1180, 800)
    s.box("U3", 280, 140, 110, [4, 3, 2, 1], [8, 7, 6, 5], title="U3 INA826", pitch=40)
    # Pins: 4 at y 158, 3 at 198, 2 at 238, 1 at 278.
    s.label(100, 158, "SENSE_P", "left")
    s.wire((100, 158), (150, 158), (260, 158))
    s.test_point("TP10", 150, 158)
    s.label(100, 278, "SENSE_N", "left")
    s.wire((100, 278), (150, 278), (260, 278))
    s.test_point("TP11", 150, 278)
    s.resistor("R12", 190, 218, True, flip=True)
    s.wire((260, 198), (240, 198), (240, 188), (190, 188))
    s.wire((260, 238), (240, 238), (240, 248), (190, 248))
    s.wire((410, 158), (430, 158), (430, 130))
    s.label(430, 130, "+5VA", "up")
    s.label(410, 238, "V165", "right")
    s.wire((410, 278), (430, 278), (430, 300))
    s.label(430, 300, "GND")
    s.wire((410, 198), (500, 198))
    s.resistor("R13", 530, 198)
    s.wire((560, 198), (620, 198), (690, 198))
    s.capacitor("C8", 620, 248, True)
    s.wire((620, 198), (620, 218))
    s.label(620, 278, "GND")
    protected(s, "R14", 760, 198, ("D1", "D2"), "TP7", "PA0", 690)
    s.capacitor("C15", 1080, 200, True)
    s.label(1080, 170, "+5VA", "up")
    s.label(1080, 230, "GND")
    s.text(1060, 280, "beside U3", "start", 11)
    # The difference amplifier.
    s.label(100, 480, "SENSE_P", "left")
    s.wire((100, 480), (130, 480))
    s.resistor("R15", 160, 480)
    s.wire((190, 480), (230, 480), (310, 480), (400, 480))
    s.label(100, 560, "SENSE_N", "left")
    s.wire((100, 560), (130, 560))
    s.resistor("R17", 160, 560)
    s.wire((190, 560), (370, 560))
    s.wire((370, 560), (370, 520), (400, 520))
    s.resistor("R16", 230, 430, True, flip=True)
    s.wire((230, 460), (230, 480))
    s.label(230, 400, "V165", "up")
    s.capacitor("C9", 310, 430, True, flip=True)
    s.wire((310, 460), (310, 480))
    s.label(310, 400, "V165", "up")
    s.opamp("U2", "A", 440, 500)
    s.resistor("R18", 440, 590)
    s.wire((370, 560), (370, 590), (410, 590))
    s.wire((470, 590), (520, 590), (520, 500))
    s.capacitor("C10", 440, 650)
    s.wire((370, 590), (370, 650), (410, 650))
    s.wire((470, 650), (520, 650), (520, 590))
    s.wire((480, 500), (520, 500), (550, 500))
    s.resistor("R19", 580, 500)
    s.wire((610, 500), (660, 500), (720, 500))
    s.capacitor("C11", 660, 550, True)
    s.wire((660, 500), (660, 520))
    s.label(660, 580, "GND")
    protected(s, "R20", 790, 500, ("D3", "D4"), "TP8", "PA1", 720)
    # The spare half, and the supply.
    s.opamp("U2", "B", 720, 710)
    s.label(660, 690, "V165", "left")
    s.wire((660, 690), (680, 690))
    s.wire((680, 730), (660, 730), (660, 770), (780, 770), (780, 710), (760, 710))
    s.text(800, 715, "spare half: follower, nothing on it", "start", 12)
    power(s, "U2", 200, 700, 8, 4, "C14")
    return s


def multiplexer_sheet(board):
    s = Sheet(board, "3  Multiplexers and electrodes", 1560, 1230)
    for row, (name, _, _, _, _, refs) in enumerate(hardware.MUXES):
        for half, ref in enumerate(refs):
            x, y = 130 + 380 * half, 90 + 290 * row
            s.box(ref, x, y, 120, list(hardware.MUX_Y), [3, None, 6, 11, 10, 9, 16, 8, 7],
                  title=f"{ref} 74HCT4051: {name}, electrodes {8 * half + 1}-{8 * half + 8}")
            s.pin_labels(ref, lambda px, x=x: "left" if px < x else "right")
            number = 12 + int(ref[1:])
            s.capacitor(f"C{number}", x + 265, y + 170, True)
            s.label(x + 265, y + 140, "+5VA", "up")
            s.label(x + 265, y + 200, "GND")
    # Electrodes: connector, ESD diode, 100 ohm.
    s.box("J1", 940, 90, 90, list(range(1, 17)), list(range(17, 21)), title="J1 electrodes, 2 x 10")
    s.pin_labels("J1", lambda px: "left" if px < 960 else "right")
    s.text(890, 470, "Each electrode: ESD diode to", size=12)
    s.text(890, 488, "ground, 100 ohm to sense.", size=12)
    for n in range(1, 17):
        k, column = (n - 1) % 8, (n - 1) // 8
        x, y = 1150 + 220 * column, 110 + 78 * k
        s.label(x, y, f"E{n}", "left")
        s.wire((x, y), (x + 20, y), (x + 70, y))
        s.resistor(f"R{20 + n}", x + 100, y)
        s.label(x + 130, y, f"S{n}", "right")
        s.pin(f"D{6 + n}", 1, x + 20, y + 6)
        s.pin(f"D{6 + n}", 2, x + 20, y + 46)
        s.wire((x + 20, y), (x + 20, y + 6))
        s.line((x + 20, y + 6), (x + 20, y + 46))
        s.shapes.append(f'<polygon points="{x + 12},{y + 34} {x + 28},{y + 34} {x + 20},{y + 22}" {BODY}/>')
        s.line((x + 10, y + 18), (x + 12, y + 22), (x + 28, y + 22), (x + 30, y + 26))
        s.text(x + 34, y + 40, f"D{6 + n}", size=11, bold=True)
        s.label(x + 20, y + 46, "GND")
    # Pull-ups.
    for k in range(8):
        x, y = 930 + 68 * k, 860
        s.label(x, y - 30, "+3V3", "up")
        s.resistor(f"R{42 + k}", x, y, True)
        s.label(x, y + 30, f"PC{k}", "down")
    s.text(900, 780, "Enables stay high, all switches open, until the program runs", size=12)
    for x, ref, top, bottom in ((930, "R51", "+3V3", "PC11"), (1030, "R52", "+3V3", "PB5"), (1130, "R50", "PB2", "GND")):
        s.resistor(ref, x, 1020, True)
        s.label(x, 990, top, "up")
        s.label(x, 1050, bottom, "down")
    s.text(900, 950, "Levels that the ROM bootloader wants: PC11 and PB5 high, PB2 (BOOT1) low", size=12)
    s.text(900, 1120, "PESD5V0V1BA: D7 to D22. All 4051: VEE to ground, supply +5VA, 100 nF beside each.", size=12)
    return s


def nucleo_sheet(board):
    s = Sheet(board, "4  Nucleo connectors and USB adapter", 1180, 920)
    for ref, x in (("CN7", 170), ("CN10", 540)):
        s.box(ref, x, 90, 170, list(range(1, 39, 2)), list(range(2, 39, 2)), title=f"{ref} (ST morpho)", pitch=38)
        s.pin_labels(ref, lambda px, x=x: "left" if px < x else "right")
    s.test_point("TP9", 560, 870)
    s.wire((560, 870), (600, 870))
    s.label(600, 870, "PA8")
    s.text(170, 860, "CN10-18 is the F446's core supply: leave it open.", size=12)
    # Adapter.
    s.box("J2", 920, 110, 160, [1, 2, 3, 4, 5, 6], [], title="J2 FT232RL, 3.3 V", pitch=24)
    s.pin_labels("J2", lambda px: "left")
    s.text(860, 300, "Only for an FT232RL adapter, not for the", size=12)
    s.text(860, 318, "Nucleo's own debugger (feature st-link):", size=12)
    s.text(860, 336, "J2, Q1, Q2, R53, R54, R55.", size=12)
    for (q, base, top, bottom, r, out, y) in (("Q1", "Q1_B", 1, 3, "R53", "NPN", 440), ("Q2", "Q2_B", 3, 1, "R54", "PNP", 620)):
        s.label(850, y, "DTR", "left")
        s.wire((850, y), (870, y))
        s.resistor(r, 900, y)
        s.wire((930, y), (960, y))
        s.pin(q, 2, 960, y)
        s.pin(q, top, 1010, y - 50)
        s.pin(q, bottom, 1010, y + 50)
        s.shapes.append(f'<circle cx="994" cy="{y}" r="28" {BODY}/>')
        s.line((960, y), (984, y))
        s.shapes.append(f'<line x1="984" y1="{y - 16}" x2="984" y2="{y + 16}" stroke="#222" stroke-width="3"/>')
        s.line((984, y - 8), (1010, y - 22), (1010, y - 50))
        s.line((984, y + 8), (1010, y + 22), (1010, y + 50))
        # The arrow is at the emitter: outwards for NPN, inwards for PNP.
        if out == "NPN":
            s.shapes.append(f'<polygon points="1008,{y + 21} 998,{y + 20} 1002,{y + 12}" fill="#222"/>')
        else:
            s.shapes.append(f'<polygon points="988,{y - 10} 998,{y - 20} 1001,{y - 12}" fill="#222"/>')
        s.text(1030, y + 4, f"{q} {board.part(q).value}", bold=True)
        s.label(1010, y - 50, board.part(q).pin(top).net, "up")
        s.label(1010, y + 50, board.part(q).pin(bottom).net, "down")
    s.resistor("R55", 900, 760, True)
    s.label(900, 730, "BOOT0", "up")
    s.label(900, 790, "GND")
    return s


def sheets(board):
    return {"drive": drive_sheet(board), "receive": receive_sheet(board), "multiplexers": multiplexer_sheet(board),
            "nucleo": nucleo_sheet(board)}


# ---------------------------------------------------------------------------------------------------------------------
# KiCad 6: a box for every part, a global label at every pin.


def stable_id(*words):
    return str(uuid.uuid5(uuid.NAMESPACE_URL, "skin/hardware/" + "/".join(words)))


KICAD_TYPE = {"passive": "passive", "input": "input", "output": "output", "power_in": "power_in", "power_out": "power_out",
              "nc": "no_connect", "open": "open_collector"}


def kicad_schematic(board):
    """Opened by KiCad 6: its netlist has the same nets as ours. The drawing for people is the SVG."""
    effects = "(effects (font (size 1.27 1.27)))"
    hidden = "(effects (font (size 1.27 1.27)) hide)"
    root = stable_id("sheet")
    out = [f"(kicad_sch (version 20211123) (generator skin_hardware)\n\n  (uuid {root})\n\n  (paper \"A1\")\n",
           "  (title_block (title \"skin sensor board\") (comment 1 \"Generated from hardware/board.py\"))\n", "  (lib_symbols"]
    # One symbol for every kind of box: the same pins, the same symbol.
    symbols = {}
    for part in board.parts:
        shape = (part.kind, tuple((p.number, p.name, KICAD_TYPE[p.kind]) for p in part.pins))
        name = symbols.setdefault(shape, f"{part.kind}" if not any(k[0] == part.kind for k in symbols) else f"{part.kind}_{part.ref}")
    for (kind, pins), name in symbols.items():
        left = (len(pins) + 1) // 2
        top = 2.54 * (left - 1) / 2 // 2.54 * 2.54
        prefix = {"R": "R", "C": "C", "D": "D", "TVS": "D", "NPN": "Q", "PNP": "Q", "TP": "TP"}.get(kind, "U")
        out.append(f"    (symbol \"skin:{name}\" (pin_names (offset 1.016)) (in_bom yes) (on_board yes)")
        for k, (field, value) in enumerate((("Reference", prefix), ("Value", kind), ("Footprint", ""), ("Datasheet", ""))):
            out.append(f"      (property \"{field}\" \"{value}\" (id {k}) (at 0 {top + 5.08 + 2.54 * k:.2f} 0) {effects if k < 2 else hidden})")
        out.append(f"      (symbol \"{name}_0_1\" (rectangle (start -7.62 {top + 2.54:.2f}) (end 7.62 {top - 2.54 * left:.2f})"
                   " (stroke (width 0.254) (type default) (color 0 0 0 0)) (fill (type background))))")
        out.append(f"      (symbol \"{name}_1_1\"")
        for k, (number, label, ptype) in enumerate(pins):
            row, right = (k, False) if k < left else (k - left, True)
            x, angle = (10.16, 180) if right else (-10.16, 0)
            out.append(f"        (pin {ptype} line (at {x} {top - 2.54 * row:.2f} {angle}) (length 2.54)"
                       f" (name \"{label}\" {effects}) (number \"{number}\" {effects}))")
        out.append("      )\n    )")
    out.append("  )\n")
    x, y, tallest = 50.8, 50.8, 0.0
    instances = []
    for part in board.parts:
        shape = (part.kind, tuple((p.number, p.name, KICAD_TYPE[p.kind]) for p in part.pins))
        name = symbols[shape]
        left = (len(part.pins) + 1) // 2
        top = 2.54 * (left - 1) / 2 // 2.54 * 2.54
        height = 2.54 * left + 12.7
        if x > 780:
            x, y, tallest = 50.8, y + tallest, 0.0
        tallest = max(tallest, height // 2.54 * 2.54 + 7.62)
        cy = y + height / 2 // 2.54 * 2.54
        ident = stable_id(part.ref)
        _, footprint, maker, mpn, *_ = hardware.catalogue(part)
        out.append(f"  (symbol (lib_id \"skin:{name}\") (at {x:.2f} {cy:.2f} 0) (unit 1) (in_bom yes) (on_board yes)\n    (uuid {ident})")
        fields = (("Reference", part.ref), ("Value", part.value or part.ref), ("Footprint", footprint), ("Datasheet", ""),
                  ("Maker", maker), ("MPN", mpn))
        for k, (field, value) in enumerate(fields):
            where = f"(at {x:.2f} {cy - top - 5.08 - 2.54 * (1 - min(k, 1)):.2f} 0)"
            out.append(f"    (property \"{field}\" {hardware.quoted(value)} (id {k}) {where} {effects if k < 2 else hidden})")
        for pin in part.pins:
            out.append(f"    (pin \"{pin.number}\" (uuid {stable_id(part.ref, pin.number)}))")
        out.append("  )")
        instances.append((ident, part))
        for k, pin in enumerate(part.pins):
            row, right = (k, False) if k < left else (k - left, True)
            px, py = x + (10.16 if right else -10.16), cy - (top - 2.54 * row)
            if pin.net is None:
                out.append(f"  (no_connect (at {px:.2f} {py:.2f}) (uuid {stable_id(part.ref, pin.number, 'nc')}))")
            else:
                angle, justify = (0, "left") if right else (180, "right")
                out.append(f"  (global_label {hardware.quoted(pin.net)} (shape passive) (at {px:.2f} {py:.2f} {angle})"
                           f" (effects (font (size 1.27 1.27)) (justify {justify})) (uuid {stable_id(part.ref, pin.number, 'label')}))")
        x += 58.42
    out.append("\n  (sheet_instances (path \"/\" (page \"1\")))\n\n  (symbol_instances")
    for ident, part in instances:
        _, footprint, *_ = hardware.catalogue(part)
        out.append(f"    (path \"/{ident}\" (reference \"{part.ref}\") (unit 1) (value {hardware.quoted(part.value or part.ref)})"
                   f" (footprint {hardware.quoted(footprint)}))")
    out.append("  )\n)")
    return "\n".join(out) + "\n"


# ---------------------------------------------------------------------------------------------------------------------
# The shield's outline, in millimetres. The Nucleo's two sockets: outer columns 63.5 mm apart, from memory; measure.

SHIELD = (100.0, 100.0)
HOLES = ((4.0, 4.0), (96.0, 4.0), (4.0, 96.0), (96.0, 96.0))
SOCKETS = {"CN7": (18.25, 27.0, 1), "CN10": (81.75, 27.0, -1)}
HEADER = ("J1", 50.0, 95.0, 10)
AREAS = (("multiplexers U4-U11", 26.0, 26.0, 74.0, 74.0), ("source U1", 26.0, 6.0, 49.0, 24.0),
         ("amplifiers U2, U3", 51.0, 6.0, 74.0, 24.0), ("ESD, 100 ohm", 26.0, 76.0, 74.0, 86.0))


def shield_pads():
    """Pads as (name, x, y): the odd pins are the outer column of CN7 and the inner of CN10."""
    for ref, (x, y, inwards) in SOCKETS.items():
        for n in range(1, 39):
            row, even = divmod(n - 1, 2)
            # Odd pins lie on the left in both connectors, seen from above.
            column = even if inwards > 0 else even - 1
            yield f"{ref}-{n}", x + 2.54 * column, y + 2.54 * row
    _, x, y, columns = HEADER
    for n in range(1, 2 * columns + 1):
        column, even = divmod(n - 1, 2)
        yield f"J1-{n}", x + 2.54 * (column - (columns - 1) / 2), y - 2.54 * even


def shield_svg():
    w, h = SHIELD
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{w}mm" height="{h}mm" viewBox="-2 -2 {w + 4} {h + 4}" '
           'font-family="DejaVu Sans, sans-serif" font-size="2.4">',
           f'<rect x="-2" y="-2" width="{w + 4}" height="{h + 4}" fill="#fff"/>',
           f'<rect x="0" y="0" width="{w}" height="{h}" rx="2" fill="#eef5ee" stroke="#000" stroke-width="0.2"/>']
    for name, x0, y0, x1, y1 in AREAS:
        out.append(f'<rect x="{x0}" y="{y0}" width="{x1 - x0}" height="{y1 - y0}" fill="#fffdf3" stroke="#888" stroke-width="0.2" stroke-dasharray="1"/>')
        out.append(f'<text x="{(x0 + x1) / 2}" y="{(y0 + y1) / 2}" text-anchor="middle">{escape(name)}</text>')
    for x, y in HOLES:
        out.append(f'<circle cx="{x}" cy="{y}" r="1.6" fill="#fff" stroke="#000" stroke-width="0.2"/>')
    for name, x, y in shield_pads():
        shape = "rect" if name.endswith("-1") else "circle"
        if shape == "rect":
            out.append(f'<rect x="{x - 0.8:.2f}" y="{y - 0.8:.2f}" width="1.6" height="1.6" fill="#c9a227"/>')
        else:
            out.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="0.8" fill="#c9a227"/>')
        out.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="0.45" fill="#fff"/>')
    for ref, (x, y, inwards) in SOCKETS.items():
        out.append(f'<text x="{x + 1.27 * inwards}" y="{y - 2}" text-anchor="middle" font-weight="bold">{ref}</text>')
    out.append('<text x="50" y="90" text-anchor="middle" font-weight="bold">J1 electrodes</text>')
    out.append(f'<text x="50" y="{h - 0.9}" text-anchor="middle" font-size="1.7">{w:g} x {h:g} mm, holes 3.2 mm, outer socket columns '
               f'{SOCKETS["CN10"][0] - SOCKETS["CN7"][0]:g} mm apart: measure your Nucleo first</text>')
    return "\n".join([*out, "</svg>"]) + "\n"


def shield_dxf():
    w, h = SHIELD
    out = ["0\nSECTION\n2\nENTITIES"]
    corners = ((0, 0), (w, 0), (w, h), (0, h), (0, 0))
    for (ax, ay), (bx, by) in zip(corners, corners[1:]):
        out.append(f"0\nLINE\n8\nEdge\n10\n{ax}\n20\n{-ay}\n11\n{bx}\n21\n{-by}")
    for x, y in HOLES:
        out.append(f"0\nCIRCLE\n8\nEdge\n10\n{x}\n20\n{-y}\n40\n1.6")
    for _, x, y in shield_pads():
        out.append(f"0\nCIRCLE\n8\nPads\n10\n{x:.2f}\n20\n{-y:.2f}\n40\n0.5")
    return "\n".join([*out, "0\nENDSEC\n0\nEOF"]) + "\n"


def files(board):
    out = {f"schematic-{k + 1}-{name}.svg": sheet.svg() for k, (name, sheet) in enumerate(sheets(board).items())}
    drawn = {key for sheet in sheets(board).values() for key in sheet.pins}
    for part in board.parts:
        for pin in part.pins:
            if (part.ref, pin.number) not in drawn:
                raise DrawingError(f"{part.ref}-{pin.number} is on no sheet")
    out["board.kicad_sch"] = kicad_schematic(board)
    out["shield.svg"] = shield_svg()
    out["shield.dxf"] = shield_dxf()
    return out
