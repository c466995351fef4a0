//! What is soldered to the pins: multiplexers, sheet, amplifiers, the source's filter. Electronics and sheet are
//! `hil-sim`'s.

use firmware::{MAX_CHANNELS, Route, SAMPLES_PER_PERIOD, Sense};
use forward::ElectrodeMatrix;
use hil_sim::{Analog, Broken, Electronics, Routing};
use protocol::Pair;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// DAC codes of the source's amplitude at full scale.
const FULL_SCALE: f64 = 1788.0;
/// How much later than the DAC's steps the fundamental arrives at the converter, in periods, in the circuit of
/// docs/board.md. The delay is half a step of the DAC, that of the source's low-pass (15.8 k, 1 nF, gain 1.59), that of the
/// filter before the converter (1.58 k, 6.8 nF), and 1.2 degrees of amplifiers and wires (hardware/check.py).
fn lag_turns() -> f64 {
    let w = 84e6 / 1425.0 / 16.0 * TAU;
    let source = w * 15.8e3 * 1e-9;
    let source = (source * (3.0 - 1.59)).atan2(1.0 - source * source) / TAU;
    let receiver = (w * 1.58e3 * 6.8e-9).atan() / TAU;
    source + receiver + 1.2 / 360.0 + 0.5 / SAMPLES_PER_PERIOD as f64
}

/// How far the source may be from what it should be and count as exact: the DAC has twelve bits.
const EXACT: f64 = 2e-3;

/// One multiplexer of two halves: lowest address line and enable line of the first half, as bits of their ports.
#[derive(Clone, Copy)]
pub(crate) struct Multiplexer {
    pub address: u32,
    pub enable: u32,
}

/// As wired in docs/board.md.
const SENSE_MINUS: Multiplexer = Multiplexer { address: 0, enable: 0 };
const SENSE_PLUS: Multiplexer = Multiplexer { address: 3, enable: 2 };
const DRIVE_PLUS: Multiplexer = Multiplexer { address: 6, enable: 4 };
const DRIVE_MINUS: Multiplexer = Multiplexer { address: 12, enable: 6 };
const ADDRESS_PINS: u32 = 0b0111_0001_1111_1111;

impl Multiplexer {
    /// The electrode that it connects; `None`: none, or two at once.
    pub fn electrode(self, addresses: u32, enables: u32) -> Option<u8> {
        let address = (addresses >> self.address & 7) as u8;
        match !enables >> self.enable & 3 {
            1 => Some(address),
            2 => Some(address + 8),
            _ => None,
        }
    }
}

/// Levels on the pins of the ports, a bit each.
#[derive(Clone, Copy, Debug, Default)]
struct Ports {
    b: u32,
    c: u32,
}

/// The fundamental of the DAC's steps behind the filter.
///
/// A source that was started anew begins its period at any sample of the world's own time. Whole steps are therefore counted
/// apart, and no law of the electronics depends on them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Fundamental {
    /// Steps by which it is ahead of the world's time.
    pub steps: u64,
    /// What is in phase then, over full scale, and a quarter period ahead of it.
    pub in_phase: f64,
    quadrature: f64,
}

impl Fundamental {
    pub fn of(codes: &[u16; SAMPLES_PER_PERIOD]) -> Self {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (k, code) in codes.iter().enumerate() {
            let x = TAU * (k as f64 / SAMPLES_PER_PERIOD as f64 + lag_turns());
            let value = (f64::from(*code) - 2048.0) / FULL_SCALE * 2.0 / SAMPLES_PER_PERIOD as f64;
            sine += value * x.sin();
            cosine += value * x.cos();
        }
        let amplitude = sine.hypot(cosine);
        if amplitude < EXACT {
            return Self::default();
        }
        let ahead = cosine.atan2(sine) / TAU * SAMPLES_PER_PERIOD as f64;
        let left = TAU * (ahead - ahead.round()) / SAMPLES_PER_PERIOD as f64;
        let (in_phase, quadrature) = (amplitude * left.cos(), amplitude * left.sin());
        let exact = (in_phase - 1.0).hypot(quadrature) < EXACT;
        Self {
            steps: (ahead.round() as i64).rem_euclid(SAMPLES_PER_PERIOD as i64) as u64,
            in_phase: if exact { 1.0 } else { in_phase },
            quadrature: if exact { 0.0 } else { quadrature },
        }
    }

    /// What of it is not in phase, as a channel sees it at a time that has the steps in it, V.
    pub fn quadrature_v(&self, analog: &Analog, time: u64, routing: &Routing, channel: usize) -> f64 {
        if self.quadrature == 0.0 {
            return 0.0;
        }
        let quiet = Routing {
            residue_v: [0.0; MAX_CHANNELS],
            ..routing.clone()
        };
        let quarter = SAMPLES_PER_PERIOD as u64 / 4;
        analog.voltage_v(time + quarter, channel, &quiet) / self.in_phase * self.quadrature
    }
}

/// The analogue world.
#[derive(Debug)]
pub struct World {
    analog: Analog,
    sheet: ElectrodeMatrix,
    /// The sheet from a trigger on, once.
    touched: Option<(u64, ElectrodeMatrix)>,
    ports: Ports,
    /// What is connected now.
    connected: Option<(Pair, Option<Pair>)>,
    /// The converter's input.
    input: u32,
    /// The last route that was connected, and what the channel makes of it.
    route: Option<Route>,
    routing: Routing,
    /// The DAC's last codes, by phase.
    codes: [u16; SAMPLES_PER_PERIOD],
    source: Fundamental,
    /// Conversions triggered since power-up: the time.
    pub triggers: u64,
    /// Address lines that changed while a switch was closed.
    pub without_break: u32,
    /// The trigger at which the converter overruns, once.
    pub overrun_at: Option<u64>,
    /// The trigger after which the next start of the DAC finds a request left over, once.
    pub stale_request_at: Option<u64>,
}

/// The world as everything around the chip shares it.
pub type Shared = Arc<Mutex<World>>;

/// A lock is only poisoned by a panic elsewhere, which fails the test anyway.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl World {
    /// A board that is not powered yet.
    pub fn new(electronics: Electronics, sheet: ElectrodeMatrix) -> Self {
        Self {
            analog: Analog::new(electronics, 0).expect("electronics that can be"),
            sheet,
            touched: None,
            ports: Ports::default(),
            connected: None,
            input: 0,
            route: None,
            routing: Routing::default(),
            codes: [2048; SAMPLES_PER_PERIOD],
            source: Fundamental::default(),
            triggers: 0,
            without_break: 0,
            overrun_at: None,
            stale_request_at: None,
        }
    }

    /// Something touches the sheet from a trigger on.
    pub fn touched_at(mut self, trigger: u64, sheet: ElectrodeMatrix) -> Self {
        self.touched = Some((trigger, sheet));
        self
    }

    /// The board restarts.
    pub fn reset(&mut self) {
        *self = Self {
            without_break: self.without_break,
            touched: self.touched.take(),
            ..Self::new(self.analog.electronics().clone(), self.sheet.clone())
        };
    }

    /// A pin of port B or C changes.
    pub fn pin(&mut self, port: &str, pin: usize, high: bool) {
        let word = match port {
            "GPIOB" => &mut self.ports.b,
            "GPIOC" => &mut self.ports.c,
            _ => return,
        };
        *word = *word & !(1 << pin) | u32::from(high) << pin;
        if port == "GPIOB" {
            let closed = self.connected.is_some();
            if closed && ADDRESS_PINS >> pin & 1 == 1 {
                self.without_break += 1;
            }
            return;
        }
        let pair = |plus: Multiplexer, minus: Multiplexer| {
            Some(Pair {
                plus: plus.electrode(self.ports.b, self.ports.c)?,
                minus: minus.electrode(self.ports.b, self.ports.c)?,
            })
        };
        let sense = pair(SENSE_PLUS, SENSE_MINUS);
        let before = self.connected;
        // A drive alone is a route while the source itself is looked at.
        self.connected = pair(DRIVE_PLUS, DRIVE_MINUS).map(|drive| (drive, sense));
        if self.connected != before {
            self.switch();
        }
    }

    /// The converter looks at another input.
    pub fn select_input(&mut self, input: u32) {
        self.input = input;
    }

    /// What the switches and the input make of it now.
    fn present_route(&self) -> Option<Route> {
        let (drive, sense) = self.connected?;
        let (sense, gain) = match (self.input, sense) {
            (0, Some(pair)) => (Sense::One(pair), 0),
            (1, Some(pair)) => (Sense::One(pair), 1),
            (6, _) => (Sense::Source, 0),
            _ => return None,
        };
        Some(Route { drive, sense, gain })
    }

    /// Takes the new route over, with a transient.
    fn switch(&mut self) {
        let Some(route) = self.present_route() else {
            return;
        };
        self.route = Some(route);
        self.routing = self.analog.switched(
            self.triggers + self.source.steps,
            &self.routing,
            self.amplitudes_v(&route),
        );
        self.wire(&route);
    }

    /// The amplitude of the present route, whatever is on its way there.
    fn refresh(&mut self) {
        if let Some(route) = self.route {
            self.routing.amplitude_v = self.amplitudes_v(&route);
            self.wire(&route);
        }
    }

    fn amplitudes_v(&self, route: &Route) -> [f64; MAX_CHANNELS] {
        let full = self.analog.amplitudes_v(&self.sheet, route, &Broken::default());
        full.unwrap_or_default().map(|v| v * self.source.in_phase)
    }

    /// What a route has besides its amplitudes.
    fn wire(&mut self, route: &Route) {
        let (broken, scale) = (Broken::default(), self.source.in_phase);
        self.analog.route(&mut self.routing, &self.sheet, route, &broken, scale);
    }

    /// The timer's pulse steps the DAC to this code.
    pub fn step(&mut self, code: u16) {
        if let Some((_, sheet)) = self.touched.take_if(|(at, _)| *at <= self.triggers) {
            self.sheet = sheet;
            self.refresh();
        }
        // The trigger was counted before.
        let phase = (self.triggers.wrapping_sub(1) % SAMPLES_PER_PERIOD as u64) as usize;
        // A source that goes on as it was is the same source.
        if std::mem::replace(&mut self.codes[phase], code) == code {
            return;
        }
        let source = Fundamental::of(&self.codes);
        if source != self.source {
            self.source = source;
            self.refresh();
        }
    }

    /// The converter's code for the sample of a time.
    pub fn sample(&mut self, time: u64) -> u16 {
        let full_scale = f64::from(firmware::FULL_SCALE);
        if self.present_route().is_none() {
            // Nothing connected, or an input that is open.
            return firmware::FULL_SCALE / 2;
        }
        let mut code = [0];
        let time = time + self.source.steps;
        self.analog.sample(time, &self.routing, &mut code);
        let ahead = self.source.quadrature_v(&self.analog, time, &self.routing, 0);
        let level = f64::from(code[0]) + ahead * full_scale / self.analog.electronics().adc_span_v;
        level.round().clamp(0.0, full_scale) as u16
    }
}
