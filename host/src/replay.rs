//! `skin replay`: a recording through the very code that showed it live, frame by frame as it was taken then. A page may ask for
//! another place, or a pause.

use crate::baselines::Baselines;
use crate::commands::Commands;
use crate::live_output::Output;
use crate::live_run::Run;
use crate::page::{page, pages};
use crate::played_board::{Frames, PlayedBoard};
use crate::presses::file::PressCalibration;
use crate::progress::Progress;
use crate::recorded::SessionRecord;
use crate::replay_control::{Asked, Control};
use crate::replay_index::{Index, Stretch};
use crate::replayed::Replayed;
use crate::ros2::{self, Described, Node, Ros2};
use crate::run_arguments::ShowArguments;
use crate::run_session::{imager, shown_source};
use crate::say::{self, say};
use crate::script::{Script, Step};
use crate::usage::Usage;
use crate::{ending, skin_file};
use anyhow::{Context, Result, anyhow};
use clap::Args;
use inverse::live::Live;
use inverse::reference::imager::Imager;
use inverse::touches::gestures::Gestures;
use recording::Speed;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use view::web::{Command, LiveView, Recording, Replay};

/// Arguments of `skin replay`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The recording.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// How many times as fast as it was, or max for as fast as this machine can.
    #[arg(long, value_name = "X", default_value = "1", allow_negative_numbers = true, value_parser = speed)]
    speed: Speed,
    #[command(flatten)]
    show: ShowArguments,
}

fn speed(text: &str) -> Result<Speed, String> {
    match text.parse::<f64>() {
        _ if text == "max" => Ok(Speed::Unpaced),
        Ok(times) if times.is_finite() && times > 0.0 => Ok(Speed::Times(times)),
        _ => Err("give a number above 0, such as 0.5, or max".to_owned()),
    }
}

/// Runs the command.
///
/// # Errors
/// A file that cannot be read, a page that cannot be served.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let stop = &*ending::flag()?;
    let control = &Control::default();
    let asked = skin_file::asked(&arguments.file)?;
    let with_page = !arguments.show.json || arguments.show.listen.is_some();
    let [(None, path)] = &asked[..] else {
        return several(arguments, &asked, with_page, stop, control);
    };
    let ros = ros2::start(&arguments.show)?;
    let mut player = Player::open(path, arguments, stop, control)?;
    player.page = with_page.then(|| page(&arguments.show)).transpose()?;
    player.node = ros.as_ref().map(|ros| player.node_of(ros)).transpose()?;
    player.run()
}

/// All skins of a recording at once, with the times between them. One that fails is said at once, and the others go on.
fn several(
    arguments: &Arguments,
    asked: &[(Option<String>, PathBuf)],
    with_page: bool,
    stop: &AtomicBool,
    control: &Control,
) -> Result<()> {
    if arguments.show.png.is_some() {
        let why = "--png is for one skin: name it, as FILE#NAME; the page of each saves its picture";
        return Err(Usage(why.to_owned()).into());
    }
    let names: Vec<&str> = asked.iter().filter_map(|(name, _)| name.as_deref()).collect();
    let mut served = if with_page {
        pages(&arguments.show, &names)?
    } else {
        Vec::new()
    }
    .into_iter();
    let ros = ros2::start(&arguments.show)?;
    let ros = ros.as_ref();
    let outcomes: Vec<Result<()>> = std::thread::scope(|scope| {
        let threads: Vec<_> = names
            .iter()
            .zip(asked)
            .map(|(name, (_, path))| {
                let page = served.next();
                let run = move || {
                    say::set_skin(Some(Arc::from(*name)));
                    let mut player = Player::open(path, arguments, stop, control)?;
                    player.page = page;
                    player.node = ros.map(|ros| player.node_of(ros)).transpose()?;
                    player.run()
                };
                let said = move || run().inspect_err(|why| say!("warning: {why:#}; the other skins go on"));
                std::thread::Builder::new()
                    .name((*name).to_owned())
                    .spawn_scoped(scope, said)
            })
            .collect();
        threads
            .into_iter()
            .map(|thread| match thread?.join() {
                Ok(outcome) => outcome,
                Err(_) => Err(anyhow!("the thread of a skin ended badly")),
            })
            .collect()
    });
    let failed = outcomes
        .into_iter()
        .zip(&names)
        .find_map(|(o, name)| Some(o.err()?.context((*name).to_owned())));
    failed.map_or(Ok(()), Err)
}

/// What a page is told of the place, so often.
const TOLD: Duration = Duration::from_millis(100);
/// A replay that stands still looks so often what is asked for.
const LOOK: Duration = Duration::from_millis(20);

/// How a stretch ended.
enum Went {
    /// At the end of the recording.
    Ended,
    /// Its baseline is in force.
    ToBaseline,
    /// Something else was asked for, or the replay is to stand still.
    Over,
    /// Its first frame came before it: nothing was taken.
    Missed,
    /// It is enough.
    Stopped,
}

/// A skin of a recording that is shown.
struct Player<'a> {
    path: &'a Path,
    arguments: &'a Arguments,
    stop: &'a AtomicBool,
    control: &'a Control,
    /// Of the file.
    bytes: usize,
    record: SessionRecord,
    learned: Option<PressCalibration>,
    /// Until it is shown.
    page: Option<LiveView>,
    node: Option<Node>,
    /// Read beside the first pictures, where there is a page.
    index: Option<Index>,
    reading: Option<Receiver<Index>>,
    /// What it plays now.
    asked: Asked,
    /// Log time of the last step, ns.
    at_ns: u64,
    /// Pictures so far.
    pictures: u64,
    replayed: Replayed,
    gestures: Gestures,
    /// The model of the sheet, once it was made.
    nominal: Option<Arc<Imager>>,
    told: Option<Instant>,
    /// When it began to play last.
    began: Instant,
}

impl<'a> Player<'a> {
    fn open(path: &'a Path, arguments: &'a Arguments, stop: &'a AtomicBool, control: &'a Control) -> Result<Self> {
        let record = SessionRecord::read(path)?;
        // Lines are of the skin, as they were then.
        say::set_skin(record.skin.as_deref().map(Arc::from));
        if let Some(differs) = record.differs() {
            say!("warning: {}: {differs}", path.display());
        }
        Ok(Self {
            path,
            arguments,
            stop,
            control,
            bytes: std::fs::metadata(recording::split(path).0)
                .with_context(|| path.display().to_string())?
                .len() as usize,
            learned: record.presses()?,
            page: None,
            node: None,
            index: None,
            reading: None,
            asked: control.asked(),
            at_ns: 0,
            pictures: 0,
            replayed: Replayed::default(),
            gestures: Gestures::new(record.gestures()),
            nominal: None,
            told: None,
            began: Instant::now(),
            record,
        })
    }

    /// Its node of ROS 2.
    fn node_of(&self, ros: &Ros2) -> Result<Node> {
        ros.node(&Described {
            skin: self.record.skin.as_deref(),
            place: self.record.place.as_ref(),
            serial: &self.record.board.serial,
            live: false,
        })
    }

    /// Shows it, from place to place, until it is enough.
    fn run(mut self) -> Result<()> {
        let show = &self.arguments.show;
        let mut commands = Commands::new(&show.on, self.record.place.as_ref())?;
        let source = shown_source(&format!("recording of {}", self.record.source), &self.record);
        let page = self.page.take();
        let with_page = page.is_some();
        let mut output = Output::new(page, show, source);
        if let Some(node) = self.node.take() {
            output.set_node(node);
        }
        if with_page {
            self.read_index()?;
        }
        let outcome = self.play(&mut output, &mut commands);
        if let Ok(ended) = outcome {
            self.replayed.say(&self.path.display().to_string(), ended);
        }
        output.end_status();
        commands.say();
        let png = show.png.as_deref();
        let written = png.map_or(Ok(()), |path| output.write_png(path));
        outcome.map(|_| ()).and(written)
    }

    /// Reads what is where, on a thread of its own.
    fn read_index(&mut self) -> Result<()> {
        let (tell, index) = channel();
        let (path, skin) = (self.path.to_owned(), say::skin());
        let read = move || {
            say::set_skin(skin);
            match Index::of(&path, &AtomicBool::new(false)) {
                Ok(index) => drop(index.map(|index| tell.send(index))),
                Err(why) => say!("warning: the page cannot go back and forth: {why:#}"),
            }
        };
        std::thread::Builder::new().name("index".to_owned()).spawn(read)?;
        self.reading = Some(index);
        Ok(())
    }

    /// Plays; whether to the end.
    fn play(&mut self, output: &mut Output, commands: &mut Commands) -> Result<bool> {
        let mut live = None;
        let mut way = vec![Stretch::default()];
        let mut is_first = true;
        loop {
            let mut went = Went::Over;
            for mut stretch in std::mem::take(&mut way) {
                went = self.stretch(&stretch, is_first, &mut live, output, commands)?;
                is_first = false;
                while let (Went::Missed, Some(index)) = (&went, &self.index) {
                    stretch = index.earlier(&stretch);
                    went = self.stretch(&stretch, false, &mut live, output, commands)?;
                }
                if !matches!(went, Went::ToBaseline) {
                    break;
                }
            }
            match went {
                Went::Stopped => return Ok(false),
                // Where nobody watches, or whoever reads the lines waits for their end.
                Went::Ended if self.arguments.show.json || !self.control.is_watched() => return Ok(true),
                Went::Ended => say!(
                    "{}: at its end; the page goes back, and Ctrl-C ends",
                    self.path.display()
                ),
                Went::Over | Went::ToBaseline | Went::Missed => {}
            }
            let at_end = matches!(went, Went::Ended);
            // It stands still until something else is asked for.
            while !self.control.is_over(self.asked.number) {
                self.look(output);
                if self.began.elapsed() >= TOLD {
                    self.tell(output, true);
                }
                if self.stop.load(Ordering::Relaxed) || !self.control.is_watched() {
                    return Ok(at_end);
                }
                std::thread::sleep(LOOK);
            }
            self.asked = self.control.asked();
            if !self.asked.paused {
                // A page sees that it plays, however soon it is at its end.
                (self.told, self.began) = (None, Instant::now());
                self.tell(output, false);
            }
            self.replayed.jumped = true;
            let to_ns = self.asked.to_ns.unwrap_or(0);
            // Another skin's page may ask before this one's was read.
            if let (None, Some(reading)) = (&self.index, self.reading.take()) {
                self.index = reading.recv().ok();
            }
            if let Some(index) = &self.index {
                way = index.way(self.at_ns, to_ns);
            }
        }
    }

    /// Shows a part of the recording.
    fn stretch(
        &mut self,
        of: &Stretch,
        is_first: bool,
        live: &mut Option<Live>,
        output: &mut Output,
        commands: &mut Commands,
    ) -> Result<Went> {
        let speed = if of.to_baseline {
            Speed::Unpaced
        } else {
            self.arguments.speed
        };
        let known = self.index.as_ref().map(Index::known).zip(of.place);
        let board = PlayedBoard::open_at(self.path, speed, self.asked.pace.clone(), known)?;
        let session = &board.session;
        let mut script = match known {
            Some((known, place)) => Script::open_at(self.path, known, place)?,
            None => Script::open(self.path)?,
        };
        let live = match live {
            Some(live) => {
                if of.anew {
                    *live = live.anew();
                } else {
                    live.gap();
                }
                live
            }
            None => live.insert(self.live(session)?),
        };
        let mut run = Run {
            show: &self.arguments.show,
            seconds: None,
            every_frame: true,
            session,
            live,
            gestures: std::mem::take(&mut self.gestures),
            commands: std::mem::take(commands),
            output,
            baselines: &mut Baselines::default(),
            watch: None,
            held: None,
            wanted: None,
            renews: true,
            notes: None,
            recorder: None,
            not_recorded: Ok(()),
            recordable: None,
            replayed: Some(std::mem::take(&mut self.replayed)),
        };
        if is_first {
            run.output.header(session, &self.record, &run.live.imager().grid)?;
        } else {
            run.gestures = Gestures::new(self.record.gestures());
            run.output.begin_anew();
        }
        let went = self.steps(of, &mut run, &mut script, &board);
        self.gestures = std::mem::take(&mut run.gestures);
        self.replayed = run.replayed.take().unwrap_or_default();
        *commands = std::mem::take(&mut run.commands);
        if let (Ok(Went::Ended), Some(lacks)) = (&went, script.lacks()) {
            say!(
                "warning: {}: {lacks}; skin recover makes a file of the rest for other programs",
                self.path.display()
            );
        }
        went
    }

    /// A reconstruction as it began then.
    fn live(&mut self, session: &link::Session) -> Result<Live> {
        let nominal = match &self.nominal {
            Some(nominal) => nominal,
            None => self
                .nominal
                .insert(imager(session, &self.record.sheet()?, &self.record.wires)?),
        };
        let live = Live::new(Arc::clone(nominal), self.record.options()?).with_told(self.record.told()?);
        Ok(match &self.learned {
            Some(learned) => live.with_learned(learned.taught()),
            None => live,
        })
    }

    /// Takes the steps of a part of a recording.
    fn steps(&mut self, of: &Stretch, run: &mut Run<'_>, script: &mut Script, board: &PlayedBoard) -> Result<Went> {
        let mut frames = Frames::default();
        let mut took = false;
        let told = match (of.to_baseline, self.arguments.speed) {
            (true, _) => Some(Progress::new("going there")),
            (false, Speed::Unpaced) => Some(Progress::new("replaying")),
            (false, Speed::Times(_)) => None,
        };
        let most = self.arguments.show.frames;
        while !self.stop.load(Ordering::Relaxed) && most.is_none_or(|most| self.pictures < most) {
            self.look(run.output);
            self.tell(run.output, false);
            if self.control.is_over(self.asked.number) {
                return Ok(Went::Over);
            }
            let Some(step) = script.next_from(of.pictures_ns)? else {
                return Ok(Went::Ended);
            };
            if script.log_ns() < of.begin_ns {
                if let Step::Event(said) = &step {
                    frames.happened(&said.event);
                }
                continue;
            }
            self.at_ns = script.log_ns();
            if let Some(told) = &told {
                told.at(script.place() as usize, self.bytes);
            }
            run.output.set_now(script.unix_s());
            match step {
                Step::Tare => run.begin_baseline()?,
                Step::Resume(baseline, touching) => {
                    run.live.resume(baseline)?;
                    // A jump takes frames of the baseline only: they are seconds or hours before what it shows.
                    if let Some(touching) = touching.filter(|_| !of.to_baseline) {
                        run.live.go_on(touching.numbered);
                        run.gestures = touching.gestures.with(self.record.gestures());
                    }
                    run.in_force()?;
                }
                Step::InForce(note) => {
                    run.in_force_as(note)?;
                    if of.to_baseline {
                        return Ok(Went::ToBaseline);
                    }
                }
                Step::Event(said) => {
                    frames.happened(&said.event);
                    run.happened(&said)?;
                }
                Step::Frame { frame, picture } => {
                    let found = frames.find(board, frame, self.stop)?;
                    let Some(replayed) = &mut run.replayed else {
                        return Ok(Went::Stopped);
                    };
                    let stopped = self.stop.load(Ordering::Relaxed);
                    if found.is_none() && !took && of.may_be_earlier() && !stopped {
                        return Ok(Went::Missed);
                    }
                    took = true;
                    let Some(found) = found else {
                        replayed.missing += u64::from(!stopped);
                        continue;
                    };
                    replayed.expected = picture;
                    if run.take(&found)? {
                        self.pictures += 1;
                        if self.asked.paused {
                            return Ok(Went::Over);
                        }
                    }
                }
            }
        }
        Ok(Went::Stopped)
    }

    /// Takes what the page asks for.
    fn look(&mut self, output: &mut Output) {
        if output.is_watched() {
            self.control.watched();
        }
        if let Some(index) = self.reading.as_ref().and_then(|reading| reading.try_recv().ok()) {
            (self.index, self.reading) = (Some(index), None);
        }
        let began_ns = self.index.as_ref().map(|index| index.began_ns);
        match (output.command(), began_ns) {
            (Some(Command::Tare | Command::UndoBaseline), _) => {
                say!("this is a recording: its baselines are those that were taken then");
            }
            (Some(Command::StartRecording | Command::StopRecording), _) => output.set_recording(Recording {
                note: Some("a replay is not recorded: what it shows is in its file already".to_owned()),
                ..Recording::default()
            }),
            (Some(Command::Seek { at_ms }), Some(began_ns)) => {
                let to_ns = began_ns.saturating_add(at_ms.saturating_mul(1_000_000));
                self.control.go(to_ns, self.asked.paused);
            }
            (Some(Command::Pause), Some(_)) => self.control.go(self.at_ns, true),
            // At the end, from the beginning.
            (Some(Command::Play), Some(began_ns)) => {
                let ended = self.index.as_ref().is_some_and(|index| self.at_ns >= index.ended_ns);
                self.control.go(if ended { began_ns } else { self.at_ns }, false);
            }
            (
                Some(Command::Seek { .. } | Command::Pause | Command::Play | Command::RepeatPress | Command::SkipPress)
                | None,
                _,
            ) => {}
        }
    }

    /// How long the recording is, ms; none before that is known.
    fn length(&self) -> Option<u64> {
        let index = self.index.as_ref()?;
        Some((index.ended_ns - index.began_ns) / 1_000_000)
    }

    /// Tells the page where the replay is, now and then.
    fn tell(&mut self, output: &Output, still: bool) {
        if !still && self.told.is_some_and(|at| at.elapsed() < TOLD) {
            return;
        }
        self.told = Some(Instant::now());
        let (Some(index), Some(length_ms)) = (&self.index, self.length()) else {
            return;
        };
        output.set_replay(Replay {
            at_ms: self.at_ns.saturating_sub(index.began_ns) / 1_000_000,
            length_ms,
            paused: still,
        });
    }
}
