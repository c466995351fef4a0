//! The electronics at work: from what the electrodes see to codes.

pub(crate) mod lock_in;

use crate::clock::{PERIOD_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ};
use crate::converter::Converter;
use crate::current::{Broken, Current};
use crate::electronics::Electronics;
use crate::electronics_error::ElectronicsError;
use crate::head_room::HeadRoom;
use crate::interference::Running;
use crate::noise::{Flicker, Noise};
use crate::wave::Wave;
use firmware::{MAX_CHANNELS, Route, SAMPLES_PER_PERIOD, Sense, full_scale};
use forward::ElectrodeMatrix;
use std::f64::consts::TAU;

/// After so many time constants a transient is less than 10^-17 of what it was.
const OVER: f64 = 40.0;

/// Electronics at work.
#[derive(Clone, Debug)]
pub struct Analog {
    electronics: Electronics,
    /// Samples that the simulation was old when the board was powered up.
    origin: u64,
    /// True time from one sample to the next, and of each channel after the first, s.
    sample_s: f64,
    late_s: [f64; MAX_CHANNELS],
    /// What a transient decays by until each channel's turn.
    late_decay: [f64; MAX_CHANNELS],
    permille: u16,
    wave: Wave,
    white: Noise,
    /// The drive's noise and the supply's, one value each for all channels.
    common: Noise,
    jitter: Noise,
    flicker: Option<Box<Flicker>>,
    lines: Vec<Running>,
    converter: Converter,
}

/// What the channels are connected to, and the decaying residue of what they were connected to before.
#[derive(Clone, Debug)]
pub struct Routing {
    /// Amplitude of each channel, V at the converter.
    pub amplitude_v: [f64; MAX_CHANNELS],
    /// How far apart along x and y the electrodes of each channel's pair lie, of the rim's diameter, times the gain.
    pub chords: [[f64; 2]; MAX_CHANNELS],
    /// What each channel gets of a voltage between the drive's ends, at the converter.
    pub drive_part: [f64; MAX_CHANNELS],
    /// What each channel's period differs by from its sine, at each sample, V at the converter, where source or amplifier
    /// meet their supply.
    pub bent_v: Option<Box<[[f64; SAMPLES_PER_PERIOD]; MAX_CHANNELS]>>,
    /// How far the resting channels are from the middle of the converter's range, V.
    pub rest_v: f64,
    /// When the switches opened, in samples since power-up.
    pub switched_at: u64,
    /// How long they stayed open, s.
    pub open_s: f64,
    /// Voltage of each channel when they opened, V at the converter.
    pub before_v: [f64; MAX_CHANNELS],
    /// How far each channel was from its new voltage when they closed, V at the converter.
    pub residue_v: [f64; MAX_CHANNELS],
}

impl Default for Routing {
    fn default() -> Self {
        Self {
            amplitude_v: [0.0; MAX_CHANNELS],
            chords: [[0.0; 2]; MAX_CHANNELS],
            drive_part: [0.0; MAX_CHANNELS],
            bent_v: None,
            rest_v: 0.0,
            switched_at: 0,
            open_s: 0.0,
            before_v: [0.0; MAX_CHANNELS],
            residue_v: [0.0; MAX_CHANNELS],
        }
    }
}

/// Of a list with none, one for all, or one for each.
fn of_channel(list: &[f64], channel: usize) -> f64 {
    match list {
        [all] => *all,
        each => each.get(channel).copied().unwrap_or(0.0),
    }
}

impl Analog {
    /// Electronics that are powered up `origin` samples after the simulation began: noise and interference go on from there.
    ///
    /// # Errors
    /// As for [`Electronics::validate`].
    pub fn new(electronics: Electronics, origin: u64) -> Result<Self, ElectronicsError> {
        electronics.validate()?;
        let e = &electronics;
        let rate = 1.0 + 1e-6 * e.crystal_ppm;
        let tick_s = 1.0 / (f64::from(TIMER_HZ) * rate);
        let late_s = std::array::from_fn(|channel| e.late_ticks(channel) * tick_s);
        Ok(Self {
            origin,
            sample_s: f64::from(TICKS_PER_SAMPLE) * tick_s,
            late_decay: late_s.map(|late| decay(late, e.settling_s)),
            permille: 1000,
            wave: Wave::new(e, 1000),
            white: Noise::new(e.seed),
            common: Noise::new(e.seed ^ 0xD21F_E5B9),
            jitter: Noise::new(e.seed ^ 0x6A17_7E12),
            flicker: (e.flicker_codes > 0.0).then(|| Box::new(Flicker::new(e.seed ^ 0xF11C_4E12))),
            lines: e
                .interference
                .iter()
                .filter_map(|line| Running::new(line, e.settling_s, &late_s))
                .collect(),
            converter: Converter::new(e),
            late_s,
            electronics,
        })
    }

    /// What they are.
    pub fn electronics(&self) -> &Electronics {
        &self.electronics
    }

    /// True time of a sample, s since the simulation began.
    pub fn true_s(&self, time: u64) -> f64 {
        self.absolute(time) as f64 * self.sample_s
    }

    /// Samples since the simulation began.
    pub(crate) fn absolute(&self, time: u64) -> u64 {
        self.origin + time
    }

    /// Sets the source to so many thousandths of full scale.
    pub fn set_amplitude(&mut self, permille: u16) {
        if self.permille != permille {
            self.permille = permille;
            // A coarse DAC's steps are larger against a smaller sine.
            if self.electronics.source_bits > 0 {
                self.wave = Wave::new(&self.electronics, permille);
            }
        }
    }

    /// Amplitude of every channel of a route on this sheet with the source as it is set, V at the converter; 0 for channels
    /// that do not exist. `None` for a gain that does not exist.
    pub fn amplitudes_v(&self, sheet: &ElectrodeMatrix, route: &Route, broken: &Broken) -> Option<[f64; MAX_CHANNELS]> {
        let source_v = self.source_v();
        Some(self.drive_parts(sheet, route, broken)?.map(|part| part * source_v))
    }

    /// Amplitude of the source as it is set, V.
    fn source_v(&self) -> f64 {
        self.electronics.excitation_v * f64::from(self.permille) / 1000.0
    }

    /// [`Routing::drive_part`] of a route.
    fn drive_parts(&self, sheet: &ElectrodeMatrix, route: &Route, broken: &Broken) -> Option<[f64; MAX_CHANNELS]> {
        let e = &self.electronics;
        let gain = self.gain(route)?;
        if route.sense == Sense::Source {
            let mut out = [0.0; MAX_CHANNELS];
            out[0] = f64::from(e.source_gain_milli) / 1000.0;
            return Some(out);
        }
        if broken.amplifier_dead && route.gain == 0 {
            return Some([0.0; MAX_CHANNELS]);
        }
        let current = Current::new(sheet, route, e.switch_ohm, broken);
        let mut out = self.channels(route, sheet.electrodes(), |a, b| gain * current.share(a, b));
        if matches!(route.sense, Sense::All { .. }) {
            let dead = |channel: usize| broken.channels_dead >> channel & 1 == 1;
            let parts = out.iter_mut().enumerate().filter(|(channel, _)| dead(*channel));
            parts.for_each(|(_, part)| *part = 0.0);
        }
        Some(out)
    }

    /// What a route has besides its amplitudes: what it picks up, where it rests, and what is missing where source or
    /// amplifiers meet their supply, with the source at `scale` of what it is set to. Crosstalk passes on the sine alone.
    pub fn route(&self, routing: &mut Routing, sheet: &ElectrodeMatrix, route: &Route, broken: &Broken, scale: f64) {
        let e = &self.electronics;
        routing.chords = self.chords(route, sheet.electrodes());
        routing.drive_part = self.drive_parts(sheet, route, broken).unwrap_or_default();
        routing.rest_v = if broken.converter_reference_lost {
            -0.5 * e.adc_span_v
        } else {
            0.0
        };
        routing.bent_v = self.bent_v(sheet, route, broken, scale * self.source_v());
    }

    fn bent_v(
        &self,
        sheet: &ElectrodeMatrix,
        route: &Route,
        broken: &Broken,
        amplitude_v: f64,
    ) -> Option<Box<[[f64; SAMPLES_PER_PERIOD]; MAX_CHANNELS]>> {
        let e = &self.electronics;
        let room = HeadRoom::new(e, broken.drive_reference_lost, broken.reach_lost_v)?;
        let gain = self.gain(route)?;
        let mut out = None;
        let mut bend = |channel: usize, missing: Option<[f64; SAMPLES_PER_PERIOD]>| {
            if let Some(missing) = missing {
                let all = out.get_or_insert_with(|| Box::new([[0.0; SAMPLES_PER_PERIOD]; MAX_CHANNELS]));
                all[channel] = missing;
            }
        };
        if route.sense == Sense::Source {
            let gain = f64::from(e.source_gain_milli) / 1000.0;
            bend(0, room.missing_of_source_v(gain, amplitude_v));
            return out;
        }
        let instrument = route.gain == 0;
        if route.drive.plus == route.drive.minus || instrument && broken.amplifier_dead {
            return None;
        }
        let current = Current::new(sheet, route, e.switch_ohm, broken);
        let electrodes = sheet.electrodes();
        let mut pair = |room: &HeadRoom, channel: usize, a: usize, b: usize| {
            let late_turns = self.late_s[channel] / self.period_s();
            let own = gain * (1.0 + of_channel(&e.gain_error, channel));
            bend(
                channel,
                room.missing_v(instrument, own, current.pickup(a, b), amplitude_v, late_turns),
            );
        };
        match route.sense {
            Sense::Source => {}
            Sense::One(sense) => pair(&room, 0, sense.plus.into(), sense.minus.into()),
            Sense::All { step } => {
                for n in 0..electrodes.min(MAX_CHANNELS) {
                    if broken.channels_dead >> n & 1 == 0 {
                        let lost_v = broken.reach_lost_v + broken.channels_reach_lost_v[n];
                        if let Some(room) = HeadRoom::new(e, broken.drive_reference_lost, lost_v) {
                            pair(&room, n, (n + usize::from(step)) % electrodes, n);
                        }
                    }
                }
            }
        }
        out
    }

    /// [`Routing::chords`] of a route with so many electrodes on the rim.
    pub fn chords(&self, route: &Route, electrodes: usize) -> [[f64; 2]; MAX_CHANNELS] {
        if self.lines.is_empty() {
            return [[0.0; 2]; MAX_CHANNELS];
        }
        let gain = self.gain(route).unwrap_or(0.0);
        let place = |n: usize| {
            let (sin, cos) = libm::sincos(TAU * n as f64 / electrodes.max(1) as f64);
            (0.5 * cos, 0.5 * sin)
        };
        let x = self.channels(route, electrodes, |a, b| gain * (place(a).0 - place(b).0));
        let y = self.channels(route, electrodes, |a, b| gain * (place(a).1 - place(b).1));
        std::array::from_fn(|n| [x[n], y[n]])
    }

    fn gain(&self, route: &Route) -> Option<f64> {
        let milli = self.electronics.gains_milli.get(usize::from(route.gain))?;
        Some(f64::from(*milli) / 1000.0)
    }

    /// A voltage of every channel's pair behind its own amplifier, with what it gets of its neighbours'.
    fn channels(&self, route: &Route, electrodes: usize, voltage: impl Fn(usize, usize) -> f64) -> [f64; MAX_CHANNELS] {
        let e = &self.electronics;
        let behind = |channel, v: f64| v * (1.0 + of_channel(&e.gain_error, channel));
        let mut out = [0.0; MAX_CHANNELS];
        match route.sense {
            Sense::Source => {}
            Sense::One(pair) => out[0] = behind(0, voltage(pair.plus.into(), pair.minus.into())),
            Sense::All { step } => {
                for (n, v) in out.iter_mut().enumerate().take(electrodes) {
                    *v = behind(n, voltage((n + usize::from(step)) % electrodes, n));
                }
                if e.crosstalk != 0.0 {
                    let own = out;
                    let last = electrodes.min(MAX_CHANNELS);
                    for (n, v) in out.iter_mut().enumerate().take(last) {
                        let below = n.checked_sub(1).map_or(0.0, |k| own[k]);
                        let above = own.get(n + 1).copied().unwrap_or(0.0);
                        *v += e.crosstalk * (below + above);
                    }
                }
            }
        }
        out
    }

    /// Signal of a channel when it is converted in the row of this time, V at the converter from the middle of its range:
    /// the excitation and the residue of a switch.
    pub fn voltage_v(&self, time: u64, channel: usize, routing: &Routing) -> f64 {
        let since_s = time.saturating_sub(routing.switched_at) as f64 * self.sample_s;
        let decay = decay(since_s - routing.open_s, self.electronics.settling_s);
        self.connected_v(time, channel, since_s, decay, routing)
    }

    /// The same, given how long ago the switches opened and the decay since they closed, both for the first channel.
    fn connected_v(&self, time: u64, channel: usize, since_s: f64, decayed: f64, routing: &Routing) -> f64 {
        let tau = self.electronics.settling_s;
        let own_s = since_s + self.late_s[channel];
        if own_s < routing.open_s {
            return routing.before_v[channel] * decay(own_s, tau);
        }
        let left = if since_s < routing.open_s {
            decay(own_s - routing.open_s, tau)
        } else {
            decayed * self.late_decay[channel]
        };
        let wave = self.wave.value(channel, (time % PERIOD_SAMPLES) as usize);
        let bent = routing
            .bent_v
            .as_ref()
            .map_or(0.0, |b| b[channel][(time % PERIOD_SAMPLES) as usize]);
        routing.amplitude_v[channel] * wave + bent + routing.residue_v[channel] * left
    }

    /// The routing after the switches opened at `time` and closed on channels of these amplitudes.
    pub fn switched(&self, time: u64, before: &Routing, amplitude_v: [f64; MAX_CHANNELS]) -> Routing {
        let e = &self.electronics;
        self.changed(time, before, amplitude_v, e.break_s, e.injection_v)
    }

    /// The routing after the source was changed at `time`, and the channels' amplitudes with it.
    pub fn driven(&self, time: u64, before: &Routing, amplitude_v: [f64; MAX_CHANNELS]) -> Routing {
        self.changed(time, before, amplitude_v, 0.0, 0.0)
    }

    fn changed(
        &self,
        time: u64,
        before: &Routing,
        amplitude_v: [f64; MAX_CHANNELS],
        open_s: f64,
        injection_v: f64,
    ) -> Routing {
        let tau = self.electronics.settling_s;
        let turns = |time_s: f64| (time % PERIOD_SAMPLES) as f64 / PERIOD_SAMPLES as f64 + time_s / self.period_s();
        let since_s = time.saturating_sub(before.switched_at) as f64 * self.sample_s;
        let (then, now) = (self.wave.fundamental(turns(0.0)), self.wave.fundamental(turns(open_s)));
        let mut after = Routing {
            amplitude_v,
            switched_at: time,
            open_s,
            ..before.clone()
        };
        for (channel, amplitude_v) in amplitude_v.iter().enumerate() {
            after.before_v[channel] = if since_s < before.open_s {
                before.before_v[channel] * decay(since_s, tau)
            } else {
                before.amplitude_v[channel] * then + before.residue_v[channel] * decay(since_s - before.open_s, tau)
            };
            after.residue_v[channel] = after.before_v[channel] * decay(open_s, tau) + injection_v - amplitude_v * now;
        }
        after
    }

    fn period_s(&self) -> f64 {
        self.sample_s * PERIOD_SAMPLES as f64
    }

    /// One row of samples: the codes of the channels at a time. The excitation's phase is the time's, since one timer makes
    /// both.
    pub fn sample(&mut self, time: u64, routing: &Routing, out: &mut [u16]) {
        let e = &self.electronics;
        let used = out.len().min(MAX_CHANNELS);
        let absolute = self.absolute(time);
        let mut volts = [0.0; MAX_CHANNELS];
        let since_s = time.saturating_sub(routing.switched_at) as f64 * self.sample_s;
        let decayed = decay(since_s - routing.open_s, e.settling_s);
        for (channel, v) in volts.iter_mut().enumerate().take(used) {
            *v = self.connected_v(time, channel, since_s, decayed, routing)
                + of_channel(&e.offset_v, channel)
                + routing.rest_v;
        }
        if e.drive_noise_v > 0.0 || e.supply_noise_v > 0.0 {
            let mut common = [0.0; 2];
            self.common.fill(absolute, &mut common);
            let (drive_v, supply_v) = (e.drive_noise_v * common[0], e.supply_noise_v * common[1]);
            let between_v = drive_v + e.supply_to_drive * supply_v;
            for (v, part) in volts.iter_mut().zip(routing.drive_part).take(used) {
                *v += part * between_v + e.supply_to_channels * supply_v;
            }
        }
        let mut noise = [0.0; MAX_CHANNELS];
        if e.jitter_s > 0.0 {
            self.jitter.fill(absolute, &mut noise[..used]);
            let phase = (time % PERIOD_SAMPLES) as usize;
            for (channel, (v, noise)) in volts.iter_mut().zip(noise).enumerate().take(used) {
                *v += routing.amplitude_v[channel] * self.wave.slope_per_s(channel, phase) * e.jitter_s * noise;
            }
        }
        for line in &self.lines {
            line.add(self.true_s(time), &routing.chords, &mut volts[..used]);
        }
        let full_scale = f64::from(full_scale(e.code_bits()));
        let (codes_per_volt, in_one) = (full_scale / e.adc_span_v, e.codes_in_one());
        if let Some(flicker) = &mut self.flicker {
            flicker.fill(absolute, &mut noise);
            let scale = e.flicker_codes * in_one / codes_per_volt;
            volts.iter_mut().zip(noise).for_each(|(v, noise)| *v += scale * noise);
        }
        if let Some(swing_v) = e.swing_v {
            volts.iter_mut().for_each(|v| *v = v.clamp(-swing_v, swing_v));
        }
        noise = [0.0; MAX_CHANNELS];
        if e.noise_codes > 0.0 {
            self.white.fill(absolute, &mut noise[..used]);
        }
        for ((code, volts), noise) in out.iter_mut().zip(volts).zip(noise) {
            let level = volts * codes_per_volt + full_scale / 2.0 + e.noise_codes * in_one * noise;
            *code = self.converter.code(level);
        }
    }
}

/// The part of a transient that remains after a time.
fn decay(since_s: f64, settling_s: f64) -> f64 {
    if settling_s == 0.0 || since_s > OVER * settling_s {
        return 0.0;
    }
    libm::exp(-since_s / settling_s)
}
