//! What touches do, as events: contact, lift, tap, double tap, stroke, hold, slip, palm.
//!
//! Every numbered touch has a state machine of its own (`State`). It sees frames one after another and nothing else, so that the same
//! frames give the same events. Definitions are lengths, times and areas ([`GestureOptions`]); docs/events.md has them for readers.

use crate::touches::touch::Touch;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// What the events are defined by. Chosen by hand where no source is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GestureOptions {
    /// Most frames in which a touch was seen when it gets its number
    /// ([`TrackerOptions::frames`](crate::touches::tracker::TrackerOptions)).
    pub frames: usize,
    /// A touch that is not seen for so long is lifted, s. More says it later; less lifts what flickers.
    pub lift_s: f64,
    /// A touch whose integrated rise is below this part of its greatest is lifted: what is left is the dent that it leaves. None where
    /// dents are taken out by a calibration. Of the rubber of docs/scenes.md a quarter of a lasting strain is delayed; more than that.
    pub dent_part: Option<f64>,
    /// Time constant with which a dent recovers, s: that of the same rubber.
    pub dent_s: f64,
    /// For so long after a contact its place is not certain, s: the touch comes down while frames are measured.
    pub settle_s: f64,
    /// A touch that is farther from where it rested than this has moved, mm: about the radius of a fingertip's contact.
    pub move_mm: f64,
    /// And farther than so many standard uncertainties of its place.
    pub move_sd: f64,
    /// A contact as short as this, without a move, is a tap, s.
    pub tap_s: f64,
    /// A tap that begins so soon after another was lifted, s, and so near to it, mm, makes a double tap.
    pub double_s: f64,
    /// See [`Self::double_s`]. About the width of a fingertip.
    pub double_mm: f64,
    /// A touch that has not moved for so long is held, s.
    pub hold_s: f64,
    /// A touch of this area or more, by two standard uncertainties, is a palm, mm². Fingers cover less than 1,000.
    pub palm_mm2: f64,
}

impl Default for GestureOptions {
    fn default() -> Self {
        Self {
            frames: 3,
            lift_s: 0.05,
            dent_part: Some(0.3),
            dent_s: 5.0,
            settle_s: 0.05,
            move_mm: 6.0,
            move_sd: 4.0,
            tap_s: 0.3,
            double_s: 0.4,
            double_mm: 15.0,
            hold_s: 0.5,
            palm_mm2: 2000.0,
        }
    }
}

/// What a touch did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Gesture {
    /// It is there.
    Contact,
    /// It is gone.
    Lift,
    /// It was there for a moment, at one place.
    Tap,
    /// The same a second time.
    DoubleTap,
    /// It moves, and had not rested.
    Stroke,
    /// It rests.
    Hold,
    /// It moves after it rested.
    Slip,
    /// It is larger than a finger.
    Palm,
}

impl Gesture {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Contact,
        Self::Lift,
        Self::Tap,
        Self::DoubleTap,
        Self::Stroke,
        Self::Hold,
        Self::Slip,
        Self::Palm,
    ];

    /// As in JSON and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Contact => "contact",
            Self::Lift => "lift",
            Self::Tap => "tap",
            Self::DoubleTap => "double_tap",
            Self::Stroke => "stroke",
            Self::Hold => "hold",
            Self::Slip => "slip",
            Self::Palm => "palm",
        }
    }
}

/// Something that a touch did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TouchEvent {
    /// What.
    pub event: Gesture,
    /// Number of the touch.
    pub touch: u32,
    /// When it happened: the board's time of the frame that showed it first, s.
    pub time_s: f64,
    /// How much later the frame was measured that decided it, s.
    pub latency_s: f64,
    /// Where the touch was, mm right of the sheet's centre.
    pub x_mm: f64,
    /// mm above the sheet's centre.
    pub y_mm: f64,
    /// Its area, mm².
    pub area_mm2: f64,
    /// Time since its contact, s.
    pub duration_s: f64,
    /// Distance from the place of its contact, mm.
    pub distance_mm: f64,
    /// Its force, N; of a lift, the greatest of the contact. None where the touch has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<f64>,
    /// Whether the force is that of a typical rubber.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub uncalibrated: bool,
}

/// What a touch is doing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum State {
    /// It came down, and has neither moved nor rested.
    Down,
    Moving,
    Resting,
    /// It was lifted; what is seen since is its dent. Its least integrated rise since then, mm².
    Lifted(f64),
}

/// A touch that has a number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Followed {
    id: u32,
    state: State,
    /// Place and time of the contact.
    began_mm: [f64; 2],
    began_s: f64,
    /// Where it has been since it moved last, and since when.
    rests_mm: [f64; 2],
    rests_s: f64,
    /// Since when it has been elsewhere. One frame alone does not tell: what is pressed or let go while it is measured seems elsewhere.
    away_s: Option<f64>,
    /// Where it rested before that.
    left_mm: [f64; 2],
    moved: bool,
    is_palm: bool,
    /// Greatest integrated rise of the contact, mm², and force, N.
    most_mm2: f64,
    /// Where it was then.
    strongest_mm: [f64; 2],
    most_n: Option<f64>,
    last: Touch,
    seen_s: f64,
}

/// A tap that may be the first of two.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Tapped {
    lifted_s: f64,
    at_mm: [f64; 2],
}

/// What a touch left where it was lifted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Dent {
    lifted_s: f64,
    at_mm: [f64; 2],
    radius_mm: f64,
    /// Greatest integrated rise of the touch, mm².
    most_mm2: f64,
    /// Which contact left it, by its beginning, s.
    began_s: f64,
}

/// Makes events of touches, frame after frame. One that is read again goes on where it was, with the options that it is given.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gestures {
    #[serde(skip)]
    options: GestureOptions,
    followed: Vec<Followed>,
    taps: Vec<Tapped>,
    dents: Vec<Dent>,
    /// Times of the last frames, s, oldest first.
    times: Vec<f64>,
    #[serde(skip)]
    events: Vec<TouchEvent>,
}

fn apart_mm(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// What has not been seen for so long is forgotten, s: at least as long as a touch may be gone and keep its number.
const FORGOTTEN_S: f64 = 1.0;

impl Gestures {
    /// Knows no touch yet.
    pub fn new(options: GestureOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// The same touches, with these options.
    #[must_use]
    pub fn with(self, options: GestureOptions) -> Self {
        Self { options, ..self }
    }

    /// Takes the numbered touches of a frame, measured at the board's time (s); what they did. Touches without a number are passed over.
    pub fn update(&mut self, time_s: f64, touches: &[Touch]) -> &[TouchEvent] {
        self.events.clear();
        self.clock(time_s);
        let options = self.options;
        for touch in touches.iter().filter(|t| t.is_pressed()) {
            let Some(id) = touch.id else { continue };
            let is_known_dent = self.is_dent(touch, time_s);
            match self.followed.iter_mut().find(|f| f.id == id) {
                Some(followed) => followed.seen(touch, time_s, is_known_dent, &options, &mut self.events),
                None => {
                    // It has its number since this frame, and may have been seen in some before it.
                    let seen = options.frames.min(touch.frames as usize).clamp(1, self.times.len());
                    let began_s = self.times[self.times.len() - seen];
                    let mut followed = Followed::new(id, touch, began_s, time_s);
                    if is_known_dent {
                        followed.state = State::Lifted(touch.total_mm2.abs());
                    } else {
                        self.events.push(followed.event(Gesture::Contact, began_s, time_s));
                    }
                    self.followed.push(followed);
                }
            }
        }
        for followed in self.followed.iter_mut().filter(|f| f.state.touches()) {
            if time_s - followed.seen_s >= options.lift_s {
                let lifted_s = followed.seen_s;
                followed.lift(lifted_s, time_s, &mut self.events);
            }
        }
        self.leave_dents(time_s);
        self.tap(time_s);
        self.followed.retain(|f| time_s - f.seen_s <= FORGOTTEN_S);
        &self.events
    }

    /// Whether a touch that is new is no more than the dents of one contact: what it left where it rested and where it was lifted adds up,
    /// and is felt as one anywhere between them.
    fn is_dent(&self, touch: &Touch, time_s: f64) -> bool {
        let left_by = |contact: &Dent| -> f64 {
            let same = self.dents.iter().filter(|dent| dent.began_s == contact.began_s);
            same.map(|dent| dent.left_mm2(touch, time_s, &self.options)).sum()
        };
        let mut near = self.dents.iter().filter(|dent| dent.radii_from(touch) <= 1.0);
        near.any(|contact| touch.total_mm2.abs() < left_by(contact))
    }

    /// Keeps the times of frames. After a reset the board's clock begins anew, and all that was before is as long ago as it was.
    fn clock(&mut self, time_s: f64) {
        let shift_s = self.times.last().map_or(0.0, |last| (time_s - last).min(0.0));
        if shift_s < 0.0 {
            self.times.iter_mut().for_each(|t| *t += shift_s);
            self.taps.iter_mut().for_each(|t| t.lifted_s += shift_s);
            for dent in &mut self.dents {
                dent.lifted_s += shift_s;
                dent.began_s += shift_s;
            }
            for followed in &mut self.followed {
                let times = [&mut followed.began_s, &mut followed.rests_s, &mut followed.seen_s];
                times
                    .into_iter()
                    .chain(&mut followed.away_s)
                    .for_each(|t| *t += shift_s);
            }
        }
        self.times.push(time_s);
        if self.times.len() > self.options.frames.max(1) {
            self.times.remove(0);
        }
    }

    /// Keeps what the touches left that were lifted just now, or slipped from where they rested.
    fn leave_dents(&mut self, time_s: f64) {
        let options = self.options;
        if options.dent_part.is_none() {
            return;
        }
        // What has recovered to less than a hundredth is none any more.
        self.dents.retain(|d| time_s - d.lifted_s <= 5.0 * options.dent_s);
        for event in &self.events {
            let Some(touch) = self.followed.iter().find(|f| f.id == event.touch) else {
                continue;
            };
            let at_mm = match event.event {
                Gesture::Lift => [event.x_mm, event.y_mm],
                Gesture::Slip => touch.left_mm,
                _ => continue,
            };
            let dent = Dent {
                lifted_s: event.time_s,
                at_mm,
                radius_mm: (event.area_mm2.max(0.0) / PI).sqrt().max(options.double_mm),
                most_mm2: touch.most_mm2,
                began_s: touch.began_s,
            };
            // A contact that comes back to a place leaves one dent there.
            self.dents
                .retain(|d| d.began_s != dent.began_s || apart_mm(d.at_mm, at_mm) > options.move_mm);
            self.dents.push(dent);
        }
    }

    /// Of the touches that were lifted just now, those that were taps, and the second of two.
    fn tap(&mut self, time_s: f64) {
        let GestureOptions {
            tap_s,
            double_s,
            double_mm,
            ..
        } = self.options;
        self.taps
            .retain(|t| time_s - t.lifted_s <= tap_s + double_s + FORGOTTEN_S);
        let lifted: Vec<TouchEvent> = self
            .events
            .iter()
            .filter(|e| e.event == Gesture::Lift)
            .copied()
            .collect();
        for lift in lifted {
            let touch = self.followed.iter().find(|f| f.id == lift.touch);
            if lift.duration_s > tap_s || touch.is_none_or(|f| f.moved || f.is_palm) {
                continue;
            }
            self.events.push(TouchEvent {
                event: Gesture::Tap,
                ..lift
            });
            let (began_s, at_mm) = (lift.time_s - lift.duration_s, [lift.x_mm, lift.y_mm]);
            let first = self.taps.iter().position(|tap| {
                (0.0..=double_s).contains(&(began_s - tap.lifted_s)) && apart_mm(tap.at_mm, at_mm) <= double_mm
            });
            match first {
                Some(first) => {
                    self.taps.remove(first);
                    self.events.push(TouchEvent {
                        event: Gesture::DoubleTap,
                        ..lift
                    });
                }
                None => self.taps.push(Tapped {
                    lifted_s: lift.time_s,
                    at_mm,
                }),
            }
        }
    }
}

impl Dent {
    /// How far away a touch is, in radii.
    fn radii_from(&self, touch: &Touch) -> f64 {
        apart_mm(self.at_mm, [touch.x_mm, touch.y_mm]) / self.radius_mm
    }

    /// Integrated rise that is left of it by now, at most, as far as a touch beside it may be the same, mm².
    fn left_mm2(&self, touch: &Touch, time_s: f64, options: &GestureOptions) -> f64 {
        if self.radii_from(touch) > 2.0 {
            return 0.0;
        }
        let part = options.dent_part.unwrap_or(0.0) * (-(time_s - self.lifted_s) / options.dent_s).exp();
        part * self.most_mm2
    }
}

impl State {
    fn touches(self) -> bool {
        !matches!(self, Self::Lifted(_))
    }
}

impl Followed {
    fn new(id: u32, touch: &Touch, began_s: f64, time_s: f64) -> Self {
        let at_mm = [touch.x_mm, touch.y_mm];
        Self {
            id,
            state: State::Down,
            began_mm: at_mm,
            began_s,
            rests_mm: at_mm,
            rests_s: began_s,
            away_s: None,
            left_mm: at_mm,
            moved: false,
            is_palm: false,
            most_mm2: touch.total_mm2.abs(),
            strongest_mm: at_mm,
            most_n: touch.force_n,
            last: *touch,
            seen_s: time_s,
        }
    }

    fn event(&self, event: Gesture, time_s: f64, now_s: f64) -> TouchEvent {
        // A touch that leaves is weak and its place uncertain: where it did not move, it was where it was strongest.
        let at_mm = if event == Gesture::Lift && !self.moved {
            self.strongest_mm
        } else {
            [self.last.x_mm, self.last.y_mm]
        };
        TouchEvent {
            event,
            touch: self.id,
            time_s,
            latency_s: now_s - time_s,
            x_mm: at_mm[0],
            y_mm: at_mm[1],
            area_mm2: self.last.area_mm2,
            duration_s: time_s - self.began_s,
            distance_mm: apart_mm(at_mm, self.began_mm),
            force_n: if event == Gesture::Lift {
                self.most_n
            } else {
                self.last.force_n
            },
            uncalibrated: self.last.uncalibrated,
        }
    }

    fn lift(&mut self, lifted_s: f64, now_s: f64, events: &mut Vec<TouchEvent>) {
        events.push(self.event(Gesture::Lift, lifted_s, now_s));
        self.state = State::Lifted(self.last.total_mm2.abs());
    }

    /// It is in a frame.
    fn seen(
        &mut self,
        touch: &Touch,
        time_s: f64,
        is_known_dent: bool,
        options: &GestureOptions,
        events: &mut Vec<TouchEvent>,
    ) {
        let (total_mm2, away_s) = (touch.total_mm2.abs(), time_s - self.seen_s);
        if let State::Lifted(least_mm2) = self.state {
            let is_dent = if away_s < options.lift_s {
                // By more than it scatters.
                let sure_mm2 = total_mm2 - options.move_sd * touch.total_sd_mm2.unwrap_or(0.0);
                options.dent_part.is_some() && sure_mm2 < 2.0 * least_mm2
            } else {
                is_known_dent
            };
            if is_dent {
                // A dent recovers; what doubles is pressed again.
                self.state = State::Lifted(total_mm2.min(least_mm2));
                (self.last, self.seen_s) = (*touch, time_s);
            } else {
                *self = Self::new(self.id, touch, time_s, time_s);
                events.push(self.event(Gesture::Contact, time_s, time_s));
            }
            return;
        }
        if options.dent_part.is_some_and(|part| total_mm2 < part * self.most_mm2) {
            let before_s = self.seen_s;
            self.lift(before_s, time_s, events);
            self.state = State::Lifted(total_mm2);
            (self.last, self.seen_s) = (*touch, time_s);
            return;
        }
        (self.last, self.seen_s) = (*touch, time_s);
        if total_mm2 >= self.most_mm2 {
            (self.most_mm2, self.strongest_mm) = (total_mm2, [touch.x_mm, touch.y_mm]);
        }
        self.most_n = touch.force_n.map(|n| self.most_n.map_or(n, |most| most.max(n)));
        self.follow(time_s, options, events);
    }

    /// Whether it moves, rests, or is a palm.
    fn follow(&mut self, time_s: f64, options: &GestureOptions, events: &mut Vec<TouchEvent>) {
        let touch = self.last;
        let sd_mm = touch.x_sd_mm.unwrap_or(0.0).hypot(touch.y_sd_mm.unwrap_or(0.0));
        let at_mm = [touch.x_mm, touch.y_mm];
        if time_s - self.began_s < options.settle_s {
            (self.began_mm, self.rests_mm) = (at_mm, at_mm);
        }
        let is_away = apart_mm(at_mm, self.rests_mm) > options.move_mm.max(options.move_sd * sd_mm);
        let before_s = std::mem::replace(&mut self.away_s, is_away.then_some(time_s));
        if let (true, Some(first_s)) = (is_away, before_s) {
            let event = match self.state {
                State::Down => Some(Gesture::Stroke),
                State::Resting => Some(Gesture::Slip),
                State::Moving | State::Lifted(_) => None,
            };
            events.extend(event.map(|event| self.event(event, first_s, time_s)));
            (self.state, self.moved) = (State::Moving, true);
            self.left_mm = self.rests_mm;
            (self.rests_mm, self.rests_s) = (at_mm, time_s);
        } else if self.state != State::Resting && time_s - self.rests_s >= options.hold_s {
            self.state = State::Resting;
            events.push(self.event(Gesture::Hold, self.rests_s + options.hold_s, time_s));
        }
        let sure_mm2 = touch.area_mm2 - 2.0 * touch.area_sd_mm2.unwrap_or(0.0);
        if !self.is_palm && sure_mm2 >= options.palm_mm2 {
            self.is_palm = true;
            events.push(self.event(Gesture::Palm, time_s, time_s));
        }
    }
}

#[cfg(test)]
mod tests;
