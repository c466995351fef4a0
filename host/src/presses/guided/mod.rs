//! `skin calibrate presses` with a board: it says where to press, and takes what is pressed; or takes what a robot presses by its list.

pub(crate) mod arguments;
mod guide;
mod interim;
mod marks;
mod pairing;
mod stream;
mod written;

pub(crate) use arguments::Arguments;

use self::guide::{Guide, Wish};
use self::interim::Interim;
use self::marks::Ways;
use self::stream::{Frame, Stream};
use super::extent::Extent;
use super::marks::words;
use crate::config::Config;
use crate::files::positions::{self, Listed};
use crate::recorded::SessionRecord;
use crate::say::say;
use crate::{ending, sheet};
use ::forward::{Geometry, Pattern, Sheet};
use anyhow::{Result, anyhow, bail};
use hil_sim::SceneFile;
use inverse::learned::{FEWEST, Marks, PressTaker, Seen, TakenPress, TakerOptions};
use inverse::reference::baseline::BaselineTaker;
use protocol::Hello;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Frames of so long make the first baseline, if they are more than so many.
const BASELINE_S: f64 = 0.7;
const BASELINE_FRAMES: usize = 24;
/// The simulated skin is waited for so long after its last press, s.
const PATIENCE_S: f64 = 3.0;

/// A press that was taken.
pub(super) struct Kept {
    press: TakenPress,
    lifted_s: f64,
    place_mm: Option<[f64; 2]>,
    force_n: Option<f64>,
}

/// What a guided calibration gathered.
pub(crate) struct Gathered {
    pub(crate) sheet: Sheet,
    /// Of a board that is no simulated one, or of a recording of it.
    pub(crate) hello: Hello,
    pattern: Pattern,
    presses: Vec<Kept>,
    /// Still there while is learned.
    guide: Guide,
}

impl Gathered {
    /// Says at last on the page what came of the presses.
    pub(crate) fn end(&mut self, text: &str) {
        let places: Vec<[f64; 2]> = self.presses.iter().filter_map(|kept| kept.place_mm).collect();
        self.guide.end(text, &places);
    }

    /// Writes the frames that were taken as a table, and the places of the presses.
    ///
    /// # Errors
    /// They cannot be written.
    pub(crate) fn write(&self, table: &Path, list: &Path) -> Result<()> {
        written::write(self, table, list)
    }
}

/// All that a run is about.
struct Run<'a> {
    arguments: &'a Arguments,
    sheet: Sheet,
    geometry: Geometry,
    /// The simulated skin without a presser.
    scene: Option<SceneFile>,
    /// The same with it.
    pressed: Option<SceneFile>,
    /// Presses of a robot; none where somebody is guided.
    listed: Option<Vec<Listed>>,
    ways: Option<Ways>,
    kept: Vec<Kept>,
    /// Whether the press that was taken last is still there.
    held: bool,
    count: usize,
    interim: Interim,
}

/// Takes presses, guided or by a list.
///
/// # Errors
/// The board, the list or the page cannot be used, or too few presses were found; the error says what to do.
pub(crate) fn gather(arguments: &Arguments, sheet_file: Option<&Path>) -> Result<Gathered> {
    let config = Config::load()?;
    let given = sheet_file.or(config.sheet.as_deref());
    let mut sheet = match &arguments.from {
        Some(recording) => SessionRecord::read(recording)?.sheet()?,
        None => sheet::load(given)?.0,
    };
    let simulated = arguments.simulate || arguments.scene.is_some();
    let scene = simulated.then(|| stream::scene(arguments, &sheet)).transpose()?;
    if let Some(scene) = &scene {
        sheet = scene.sheet.clone();
    }
    let listed = arguments.positions.as_deref().map(positions::read).transpose()?;
    if let (Some(list), Some(path)) = (&listed, &arguments.positions)
        && let Some(without) = list.iter().find(|press| press.place_mm.is_none())
    {
        bail!(
            "{}:{}: it has no position; a list of forces alone is for --gauge",
            path.display(),
            without.line
        );
    }
    let marks = arguments.marks.as_deref().map(written::marks).transpose()?;
    let given = match (&arguments.positions, &listed, &arguments.marks, &marks) {
        (Some(path), Some(list), ..) => {
            let places = list.iter().filter_map(|press| Some((press.line, press.place_mm?)));
            Some((path, places.collect::<Vec<_>>()))
        }
        (.., Some(path), Some(marks)) => Some((path, marks.clone())),
        _ => None,
    };
    if let Some((path, places)) = given {
        on_the_sheet(&sheet, path, &places)?;
    }
    let ways = match (&listed, marks) {
        (Some(_), _) => None,
        (None, Some(marks)) => Some(Ways::list(marks.into_iter().map(|(_, place_mm)| place_mm).collect())),
        (None, None) => Some(Ways::chosen(Marks::new(&sheet, arguments.tip_mm)?, arguments.count)),
    };
    let count = match (&listed, &ways) {
        (Some(list), _) => list.len(),
        (None, Some(ways)) => ways.ahead(arguments.count).len(),
        (None, None) => 0,
    };
    if count < FEWEST {
        bail!("{count} presses are too few to learn from; give {FEWEST} or more");
    }
    let mut run = Run {
        arguments,
        geometry: Geometry::new(&sheet)?,
        interim: Interim::new(&sheet)?,
        sheet,
        scene,
        pressed: None,
        listed,
        ways,
        kept: Vec::new(),
        held: false,
        count,
    };
    let stop = ending::flag()?;
    let (mut stream, source) = run.open()?;
    ending::stops(stream.session().link())?;
    let hello = stream.session().hello().clone();
    let (wired, described) = (usize::from(hello.electrodes), run.sheet.electrodes.len());
    if wired != described {
        bail!(
            "{source} has {wired} electrodes, the sheet {described}; describe the sheet that is wired to it with --sheet"
        );
    }
    let pattern = Pattern::from_pairs(stream.session().electrodes(), stream.session().measurements())?;
    let live = arguments.from.is_none() && !simulated;
    let wants_page = arguments.listen.is_some() || live;
    let mut guide = Guide::new(arguments, &run.sheet, source, count, wants_page)?;
    run.interim.measure(&pattern);
    // The simulated presser begins anew where the marks change.
    while run.pump(&stream, &mut guide, &stop)? {
        stream = run.open()?.0;
        ending::stops(stream.session().link())?;
    }
    guide.ask("all presses are taken; learning from them", None, &run.places());
    run.paired()?;
    Ok(Gathered {
        sheet: run.sheet,
        hello,
        pattern,
        presses: run.kept,
        guide,
    })
}

/// Sees before the first press that the places of a list can be pressed.
fn on_the_sheet(sheet: &Sheet, path: &Path, places: &[(u64, [f64; 2])]) -> Result<()> {
    let extent = Extent::of(sheet)?;
    let list = path.display().to_string();
    extent.check(&list, places.iter().copied())?;
    if let Some(doubt) = extent.doubt(places.iter().map(|(_, place_mm)| *place_mm)) {
        say!("warning: {list}: {doubt}");
    }
    Ok(())
}

impl Run<'_> {
    /// The stream, with the presses that are still to come where it is simulated.
    fn open(&mut self) -> Result<(Stream, String)> {
        if let Some(path) = &self.arguments.from {
            return Ok((Stream::play(path)?, path.display().to_string()));
        }
        let Some(scene) = &self.scene else {
            return Stream::board(self.arguments);
        };
        let places: Vec<([f64; 2], Option<f64>)> = match (&self.listed, &self.ways) {
            (Some(list), _) => list
                .iter()
                .filter_map(|p| Some((p.place_mm?, Some(p.from_s))))
                .collect(),
            (None, Some(ways)) => ways
                .ahead(self.count - self.kept.len())
                .into_iter()
                .map(|p| (p, None))
                .collect(),
            (None, None) => Vec::new(),
        };
        let own = !scene.scene.touches.is_empty();
        let pressed = if self.listed.is_some() && own {
            scene.clone()
        } else {
            if own {
                say!("notice: the scene's own touches are left out: a simulated finger presses the marks");
            }
            stream::pressed(scene, &places, self.arguments)
        };
        let stream = Stream::simulated(&pressed, self.arguments)?;
        self.pressed = Some(pressed);
        Ok((stream, "simulated skin".to_owned()))
    }

    fn places(&self) -> Vec<[f64; 2]> {
        self.kept.iter().filter_map(|kept| kept.place_mm).collect()
    }

    /// Whether all presses are there.
    fn has_all(&self) -> bool {
        // Of a list the last one has to be whole: its end tells it from others.
        self.kept.len() >= self.count && !(self.held && self.listed.is_some())
    }

    /// Whether no more frames are looked at. A recording is read to its end: it may hold presses that are not in the list, before and between
    /// those that are.
    fn is_done(&self) -> bool {
        self.arguments.from.is_none() && self.has_all()
    }

    /// What to do now, in a few words.
    fn status(&self) -> String {
        match &self.ways {
            _ if self.held => "taken: lift".to_owned(),
            Some(ways) if ways.next_mm().is_some() => format!("press {} of {}", self.kept.len() + 1, self.count),
            _ => self.task(),
        }
    }

    /// What to do now.
    fn task(&self) -> String {
        let Some(ways) = &self.ways else {
            return format!("{} of {} presses of the list found", self.kept.len(), self.count);
        };
        match ways.next_mm() {
            _ if self.held => "taken: lift".to_owned(),
            Some(mark) => format!(
                "{} at {}; hold for a second",
                self.status(),
                words(&self.geometry, mark)
            ),
            None => "there is no mark left".to_owned(),
        }
    }

    fn ask(&self, guide: &mut Guide) {
        let mark = self.ways.as_ref().and_then(Ways::next_mm).filter(|_| !self.has_all());
        // The page has the number of the press above it.
        let text = match mark.filter(|_| !self.held) {
            Some(mark) => format!("{}; hold for a second", words(&self.geometry, mark)),
            None => self.task(),
        };
        guide.ask(&text, mark, &self.places());
    }

    /// Takes presses until all are there; whether the stream has to begin anew.
    fn pump(&mut self, stream: &Stream, guide: &mut Guide, stop: &AtomicBool) -> Result<bool> {
        let session = stream.session();
        let frame_s = session.frame_s().max(1e-4);
        let values = session.plan().value_count();
        let wanted = BASELINE_FRAMES.max((BASELINE_S / frame_s).round() as usize);
        // Presses are taken from frames as they are.
        let mut baseline = BaselineTaker::new(values, wanted).with_gains();
        let mut taker: Option<PressTaker> = None;
        let ends_s = self.pressed.as_ref().map(|scene| scene.duration_s + PATIENCE_S);
        guide.ask("taking the baseline, do not touch", None, &self.places());
        say!("taking the baseline, do not touch");
        while !self.is_done() {
            if stop.load(Ordering::Relaxed) {
                bail!(
                    "ended before all presses were taken: {} of {}",
                    self.kept.len(),
                    self.count
                );
            }
            if let Some(wish) = guide.wish() {
                if wish == Wish::Enough {
                    return self.enough().map(|()| false);
                }
                if self.obey(wish, guide) && self.scene.is_some() {
                    return Ok(true);
                }
            }
            let frame = match stream.next()? {
                Frame::Some(frame) => frame,
                Frame::NoneYet => continue,
                Frame::End => return self.enough().map(|()| false),
            };
            if ends_s.is_some_and(|end| frame.time_s > end) {
                return self.enough().map(|()| false);
            }
            let Some(taker) = &mut taker else {
                if let Some(taken) = baseline.take(&frame.values_v) {
                    taker = Some(PressTaker::new(&taken, TakerOptions::default()));
                    self.say_task(guide);
                }
                guide.show(frame.time_s, frame_s, "taking the baseline, do not touch", None)?;
                continue;
            };
            let seen = taker.take(frame.time_s, &frame.values_v);
            let pressing = matches!(seen, Seen::Moving);
            self.see(seen, guide);
            let status = if pressing {
                "hold still".to_owned()
            } else {
                self.status()
            };
            guide.show(frame.time_s, frame_s, &status, self.interim.touch(frame.time_s))?;
        }
        Ok(false)
    }

    fn say_task(&self, guide: &mut Guide) {
        if !self.has_all() {
            say!("{}", self.task());
        }
        self.ask(guide);
    }

    fn see(&mut self, seen: Seen, guide: &mut Guide) {
        match seen {
            Seen::Taken(press) => self.taken(press, guide),
            Seen::Lifted(at_s) => {
                if let Some(kept) = self.kept.last_mut().filter(|_| self.held) {
                    kept.lifted_s = at_s;
                }
                self.held = false;
                self.say_task(guide);
            }
            Seen::TooLight => {
                guide.note("too light or too short to tell from noise; press again, and hold".to_owned());
                self.ask(guide);
            }
            Seen::Settling | Seen::Nothing | Seen::Moving | Seen::Held => {}
        }
    }

    fn taken(&mut self, press: TakenPress, guide: &mut Guide) {
        let place_mm = self.ways.as_ref().and_then(Ways::next_mm);
        let place_mm = place_mm.filter(|_| self.kept.len() < self.count);
        // A simulated skin has a gauge.
        let force_n = self.pressed.as_ref().map(|scene| {
            let forces = scene.scene.truth(press.taken_s);
            forces.iter().map(|touch| touch.force_n).sum()
        });
        let number = self.kept.len() + 1;
        let played = place_mm.and_then(|mark| self.interim.plays_back(&press, mark));
        guide.note(format!(
            "press {number} taken: {:.0} times the noise, mean of {} frames{}",
            press.size,
            press.frames,
            played.unwrap_or_default()
        ));
        if let Some(ways) = &mut self.ways {
            ways.press();
        }
        self.kept.push(Kept {
            lifted_s: press.taken_s,
            press,
            place_mm,
            force_n: force_n.filter(|f| *f > 0.0),
        });
        self.held = true;
        self.ask(guide);
        if self.kept.len() < self.count {
            self.interim.learn(&self.kept);
        }
    }

    /// Does what somebody asked for; whether the marks are others now.
    fn obey(&mut self, wish: Wish, guide: &mut Guide) -> bool {
        let Some(ways) = &mut self.ways else {
            say!("the list says where to press; q ends here");
            return false;
        };
        match wish {
            Wish::Repeat if self.kept.pop().is_some() => {
                ways.back();
                guide.note("the last press is forgotten; press it again".to_owned());
            }
            Wish::Repeat => {
                guide.note("there is no press to repeat".to_owned());
                return false;
            }
            Wish::Skip => {
                let Some(mark) = ways.next_mm() else { return false };
                ways.skip();
                guide.note(format!("skipped: {}", words(&self.geometry, mark)));
                let left = ways.ahead(self.count.saturating_sub(self.kept.len())).len();
                self.count = self.count.min(self.kept.len() + left);
            }
            Wish::Enough => return false,
        }
        self.say_task(guide);
        true
    }

    /// No more presses come: whether those that are there are enough.
    fn enough(&mut self) -> Result<()> {
        let found = self.kept.len();
        if found < FEWEST {
            bail!(
                "{found} presses were found, {FEWEST} are the fewest to learn from; each has to be held for a second, and lifted for another"
            );
        }
        if found < self.count {
            say!("notice: {found} presses of {} were found", self.count);
        }
        Ok(())
    }

    /// Places and forces by the lists.
    fn paired(&mut self) -> Result<()> {
        let spans: Vec<[f64; 2]> = self.kept.iter().map(|k| [k.press.began_s, k.lifted_s]).collect();
        let of = |list: &[Listed]| -> Result<Vec<(usize, usize)>> {
            let times: Vec<[f64; 2]> = list.iter().map(|p| [p.from_s, p.to_s]).collect();
            pairing::pair(&spans, &times, self.arguments.shift_s)
        };
        if let Some(list) = &self.listed {
            let pairs = of(list)?;
            for (press, line) in &pairs {
                self.kept[*press].place_mm = list[*line].place_mm;
                self.kept[*press].force_n = list[*line].force_n.or(self.kept[*press].force_n);
            }
            let without = self.kept.len() - pairs.len();
            if without > 0 {
                say!("notice: {without} presses of the stream are not in the list, and are left out");
            }
            if pairs.len() < list.len() {
                say!(
                    "notice: {} presses of the list were not found in the stream",
                    list.len() - pairs.len()
                );
            }
        } else {
            let without = self.kept.iter().filter(|kept| kept.place_mm.is_none()).count();
            if without > 0 {
                say!(
                    "notice: the recording has {without} presses more than the {} that are wanted; they are left out, unless --count and --marks ask for them",
                    self.count
                );
            }
        }
        self.kept.retain(|kept| kept.place_mm.is_some());
        if let Some(path) = &self.arguments.gauge {
            let list = positions::gauge_presses(path)?;
            let spans: Vec<[f64; 2]> = self.kept.iter().map(|k| [k.press.began_s, k.lifted_s]).collect();
            let times: Vec<[f64; 2]> = list.iter().map(|p| [p.from_s, p.to_s]).collect();
            let pairs = pairing::pair(&spans, &times, self.arguments.shift_s)
                .map_err(|why| anyhow!("{}: {why}", path.display()))?;
            for (press, line) in &pairs {
                self.kept[*press].force_n = list[*line].force_n;
            }
            if pairs.len() < self.kept.len() {
                say!(
                    "notice: {} presses have no force by the gauge",
                    self.kept.len() - pairs.len()
                );
            }
        }
        if self.kept.len() < FEWEST {
            bail!(
                "{} presses have a place, {FEWEST} are the fewest to learn from",
                self.kept.len()
            );
        }
        Ok(())
    }
}
