//! What is soldered to the pins of the board with sixteen channels.

use crate::world::{Fundamental, Multiplexer};
use firmware::{MAX_CHANNELS, Route, SAMPLES_PER_PERIOD, Sense, full_scale};
use forward::ElectrodeMatrix;
use hil_sim::{Analog, Broken, Electronics, Routing};
use protocol::Pair;
use std::sync::{Arc, Mutex};

/// As wired in docs/board.md: address lines on port E, enable lines on port D.
const SENSE_MINUS: Multiplexer = Multiplexer { address: 2, enable: 0 };
const SENSE_PLUS: Multiplexer = Multiplexer { address: 5, enable: 2 };
const DRIVE_PLUS: Multiplexer = Multiplexer { address: 8, enable: 4 };
const DRIVE_MINUS: Multiplexer = Multiplexer { address: 11, enable: 6 };
const ADDRESS_PINS: u32 = 0b0011_1111_1111_1100;

/// What a converter's input leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// The amplifier of an electrode and its next one.
    Amplifier(u8),
    /// Behind the multiplexers, by gain.
    Behind(u8),
    /// The source itself.
    Source,
}

/// A route that is always looked at, and what the electronics make of it.
#[derive(Debug)]
struct View {
    route: Route,
    routing: Routing,
}

/// The analogue world.
#[derive(Debug)]
pub struct World {
    analog: Analog,
    sheet: ElectrodeMatrix,
    /// The sheet from a trigger on, once.
    touched: Option<(u64, ElectrodeMatrix)>,
    /// Levels on the pins of ports D and E.
    enables: u32,
    addresses: u32,
    connected: Option<(Pair, Option<Pair>)>,
    /// All amplifiers, each gain behind the multiplexers, and the source; empty while nothing is connected.
    views: Vec<View>,
    /// The DAC's last codes, by phase.
    codes: [u16; SAMPLES_PER_PERIOD],
    source: Fundamental,
    /// The amplifiers' codes of a time.
    row: (u64, [u16; MAX_CHANNELS]),
    /// Conversions triggered since power-up: the time.
    pub triggers: u64,
    /// Address lines that changed while a switch was closed.
    pub without_break: u32,
    /// The trigger from which on a converter overruns, once.
    pub overrun_at: Option<u64>,
    /// The trigger after which the next start of the DAC finds a request left over, once.
    pub stale_request_at: Option<u64>,
}

/// The world as everything around the chip shares it.
pub type Shared = Arc<Mutex<World>>;

impl World {
    /// A board that is not powered yet.
    pub fn new(electronics: Electronics, sheet: ElectrodeMatrix) -> Self {
        Self {
            analog: Analog::new(electronics, 0).expect("electronics that can be"),
            sheet,
            touched: None,
            enables: 0,
            addresses: 0,
            connected: None,
            views: Vec::new(),
            codes: [2048; SAMPLES_PER_PERIOD],
            source: Fundamental::default(),
            row: (u64::MAX, [0; MAX_CHANNELS]),
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

    /// A pin of port D or E changes.
    pub fn pin(&mut self, port: &str, pin: usize, high: bool) {
        let word = match port {
            "GPIOD" => &mut self.enables,
            "GPIOE" => &mut self.addresses,
            _ => return,
        };
        *word = *word & !(1 << pin) | u32::from(high) << pin;
        if port == "GPIOE" {
            if self.connected.is_some() && ADDRESS_PINS >> pin & 1 == 1 {
                self.without_break += 1;
            }
            return;
        }
        let pair = |plus: Multiplexer, minus: Multiplexer| {
            Some(Pair {
                plus: plus.electrode(self.addresses, self.enables)?,
                minus: minus.electrode(self.addresses, self.enables)?,
            })
        };
        let before = self.connected;
        let sense = pair(SENSE_PLUS, SENSE_MINUS);
        self.connected = pair(DRIVE_PLUS, DRIVE_MINUS).map(|drive| (drive, sense));
        if self.connected != before {
            self.switch();
        }
    }

    /// Takes the new routes over, with a transient.
    fn switch(&mut self) {
        let Some((drive, sense)) = self.connected else {
            return;
        };
        let behind = sense.map(|pair| [0, 1].map(|gain| (Sense::One(pair), gain)));
        let senses = [(Sense::All { step: 1 }, 0), (Sense::Source, 0)]
            .into_iter()
            .chain(behind.into_iter().flatten());
        let before = std::mem::take(&mut self.views);
        for (sense, gain) in senses {
            let route = Route { drive, sense, gain };
            // What rings is what the same amplifiers had before.
            let old = before.iter().find(|v| kind(&v.route) == kind(&route));
            let old = old.map(|v| v.routing.clone()).unwrap_or_default();
            let amplitudes_v = self.amplitudes_v(&route);
            let mut view = View {
                route,
                routing: self
                    .analog
                    .switched(self.triggers + self.source.steps, &old, amplitudes_v),
            };
            self.wire(&mut view);
            self.views.push(view);
        }
    }

    fn amplitudes_v(&self, route: &Route) -> [f64; MAX_CHANNELS] {
        let full = self.analog.amplitudes_v(&self.sheet, route, &Broken::default());
        full.unwrap_or_default().map(|v| v * self.source.in_phase)
    }

    /// What a route has besides its amplitudes.
    fn wire(&mut self, view: &mut View) {
        let broken = Broken::default();
        self.analog.route(
            &mut view.routing,
            &self.sheet,
            &view.route,
            &broken,
            self.source.in_phase,
        );
    }

    /// The amplitudes of the present routes, whatever is on its way there.
    fn refresh(&mut self) {
        for mut view in std::mem::take(&mut self.views) {
            view.routing.amplitude_v = self.amplitudes_v(&view.route);
            self.wire(&mut view);
            self.views.push(view);
        }
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

    /// A converter's code for the sample of a time.
    pub fn sample(&mut self, time: u64, wire: Wire) -> u16 {
        let time = time + self.source.steps;
        let wanted = match wire {
            Wire::Amplifier(_) => (0, 0),
            Wire::Source => (1, 0),
            Wire::Behind(gain) => (2, gain),
        };
        let closed = self.connected.is_some();
        let Some(view) = self.views.iter().find(|v| closed && kind(&v.route) == wanted) else {
            // Nothing connected: the amplifiers' reference.
            return full_scale(self.analog.electronics().code_bits()) / 2;
        };
        let Wire::Amplifier(channel) = wire else {
            let mut code = [0];
            self.analog.sample(time, &view.routing, &mut code);
            return self.with_quadrature(time, &view.routing, 0, code[0]);
        };
        if self.row.0 != time {
            self.row.0 = time;
            self.analog.sample(time, &view.routing, &mut self.row.1);
        }
        let code = self.row.1.get(usize::from(channel)).copied().unwrap_or(0);
        self.with_quadrature(time, &view.routing, channel.into(), code)
    }

    /// A code with what of the source is not in phase, a quarter period ahead.
    fn with_quadrature(&self, time: u64, routing: &Routing, channel: usize, code: u16) -> u16 {
        let electronics = self.analog.electronics();
        let ahead_v = self.source.quadrature_v(&self.analog, time, routing, channel);
        let full_scale = f64::from(full_scale(electronics.code_bits()));
        let level = f64::from(code) + ahead_v * full_scale / electronics.adc_span_v;
        level.round().clamp(0.0, full_scale) as u16
    }
}

/// What looks at a route: all amplifiers, the source, or a gain behind the multiplexers.
fn kind(route: &Route) -> (u8, u8) {
    match route.sense {
        Sense::All { .. } => (0, 0),
        Sense::Source => (1, 0),
        Sense::One(_) => (2, route.gain),
    }
}
