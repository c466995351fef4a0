//! Runs a program and keeps what it did.

use crate::board::{Chip, Machine, Wired};
use crate::line::Line;
use crate::world::{Shared, World, locked};
use forward::ElectrodeMatrix;
use hil_sim::Electronics;
use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, encode};
use rigless::emulator::{Access, AccessKind, Driver, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::machine::Board;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::time::VirtualNanos;
use std::collections::{BTreeSet, VecDeque};
use std::error::Error;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// How often the host looks at the line, ns.
const LOOK_NS: u64 = 1_000_000;
/// First address of the stack, on both chips. It ends where the processor's first stack pointer says.
const STACK: u64 = 0x2000_0000;
const FIRST_STACK_POINTER: u64 = 0x0800_0000;

/// What a run left behind.
#[derive(Debug)]
pub struct Outcome {
    /// What the board said, whole messages only, with the time of their last byte, ns.
    pub messages: Vec<(u64, FromBoard)>,
    /// Messages that were damaged.
    pub damaged: u32,
    /// Address lines that changed while a switch was closed.
    pub without_break: u32,
    /// Samples triggered since the last reset.
    pub triggers: u64,
    /// Restarts.
    pub resets: usize,
    /// The brown-out reset's level in the option bytes: 3 is off, 0 the highest.
    pub brown_out: u64,
    /// Whether the flash memory's prefetch is on at the end.
    pub prefetch: bool,
    /// When the light changed, in instructions, and whether it is on then.
    pub light: Vec<(u64, bool)>,
    /// What was logged, as it left the chip.
    pub log: Vec<u8>,
    /// What the emulator lacks and the program used: addresses without a register, refused accesses, registers without
    /// a model.
    pub gaps: Vec<String>,
    /// Instructions from the start of the work on a block to its end, of every block.
    pub work: Vec<u64>,
    /// The lives before the last one.
    pub lived: Vec<Lived>,
    /// Steps of the flash memory in the last life.
    pub steps: usize,
    /// What was to be read when the run ended.
    pub memory: Vec<Vec<u8>>,
    /// Bytes of the stack that were ever used.
    pub stack: u64,
    /// Bytes of the stack that there are.
    pub stack_size: u64,
    /// Virtual time of the end, ns, and instructions.
    pub end_ns: u64,
    pub instructions: u64,
}

/// A life of a board that its power begins and ends.
#[derive(Debug, Default)]
pub struct Life {
    /// Commands and when they are sent, ns from its beginning.
    pub commands: Vec<(u64, ToBoard)>,
    /// What the flash memory holds beside the program: where, and what; on the STM32H743 alone.
    pub flash: Vec<(u64, Vec<u8>)>,
    /// How many steps of the flash memory the power lasts for, if it is cut: words written, or sectors erased.
    pub power: Option<usize>,
}

/// What a life left behind.
#[derive(Debug)]
pub struct Lived {
    /// What the board said, with the time in the run, ns.
    pub messages: Vec<(u64, FromBoard)>,
    /// What was to be read when it ended.
    pub memory: Vec<Vec<u8>>,
    /// Steps of the flash memory, with the one that was cut off; counted on the STM32H743 alone.
    pub steps: usize,
}

/// What the program shows on pins that lead to no skin.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sign {
    /// The light goes on or off.
    pub light: Option<bool>,
    /// The work on a block begins or ends.
    pub work: Option<bool>,
}

impl Sign {
    /// What a write to a port's set and reset register says, if these are its pins.
    pub fn of(value: u64, light: u32, work: u32) -> Self {
        let pin = |pin: u32| match (value >> pin & 1, value >> (16 + pin) & 1) {
            (1, _) => Some(true),
            (0, 1) => Some(false),
            _ => None,
        };
        Self {
            light: pin(light),
            work: pin(work),
        }
    }
}

/// A machine that programs are run on.
pub trait Emulated: Board + 'static {
    /// What a write to an address shows.
    fn sign(address: u64, value: u64) -> Sign;

    /// The supply is so many millivolts from now on.
    fn supply(&mut self, millivolts: u32);

    /// Power comes, and lasts for so many steps of the flash memory, where these are counted. The program finds this in the
    /// memory.
    fn power_for(&mut self, _steps: usize, _holds: Vec<(u64, Vec<u8>)>) {}

    /// Whether it still has power.
    fn powered(&self) -> bool {
        true
    }

    /// Steps of the flash memory since power came.
    fn steps(&self) -> usize {
        0
    }

    /// What a memory with check bits holds there, if it is one.
    fn keeps(&self, _address: u64, _len: usize) -> Option<Vec<u8>> {
        None
    }

    /// Addresses of its words that read as a bus fault.
    fn broken(&self) -> BTreeSet<u64> {
        BTreeSet::new()
    }

    /// Whether an access there may change which.
    fn may_break(_address: u64) -> bool {
        false
    }

    /// One of these was read.
    fn found_broken(&mut self) {}
}

impl Emulated for Machine {
    fn sign(address: u64, value: u64) -> Sign {
        // Port A: pin 5 is the light, pin 8 high while a block is worked on.
        const PORT_A_BSRR: u64 = 0x4002_0018;
        if address == PORT_A_BSRR {
            Sign::of(value, 5, 8)
        } else {
            Sign::default()
        }
    }

    fn supply(&mut self, millivolts: u32) {
        self.chip.supply(millivolts);
    }
}

struct Watcher {
    look_ns: u64,
    read_back: Vec<(u64, usize)>,
    memory: Vec<Vec<u8>>,
    line: Line,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    taken: usize,
    messages: Vec<(u64, FromBoard)>,
    damaged: u32,
    commands: std::vec::IntoIter<(u64, ToBoard)>,
    next: Option<(u64, ToBoard)>,
    restart: Option<u64>,
    supply: VecDeque<(u64, u32)>,
    until: u64,
    frames: usize,
    last: Option<FromBoard>,
    life_ns: u64,
    lives: VecDeque<Life>,
    lived: Vec<Lived>,
    /// The words whose next access fails.
    armed: BTreeSet<u64>,
    busy_since: Option<u64>,
    work: Vec<u64>,
    light: Vec<(u64, bool)>,
    log_at: Option<u64>,
    log: Vec<u8>,
    stack: (u64, u64),
}

/// What the program logged since the last look, from the control block of SEGGER's RTT at an address: after 24 bytes the
/// first channel's name, buffer, size, end and beginning, a word each.
fn drain(block: u64, host: &mut dyn Host) -> Option<Vec<u8>> {
    let channel = block + 24;
    let mut word = |k: u64| host.read(channel + 4 * k, Width::W32).ok();
    let (buffer, size, end, mut begin) = (word(1)?, word(2)?, word(3)?, word(4)?);
    let mut out = Vec::new();
    while begin != end && begin < size {
        out.push(host.read(buffer + begin, Width::W8).ok()? as u8);
        begin = (begin + 1) % size;
    }
    host.write(channel + 16, Width::W32, begin).ok()?;
    Some(out)
}

/// Bytes of a word with check bits.
const WORD_LEN: u64 = 32;

impl Watcher {
    /// Words that are broken now fail, and no others.
    fn arm<M: Emulated>(&mut self, session: &mut Session<M>, host: &mut dyn Host) {
        let broken = session.board().broken();
        for word in broken.difference(&self.armed) {
            session.fail_next(*word, word + WORD_LEN);
        }
        for word in self.armed.difference(&broken) {
            // An access that is made to fail is the one way to take it back.
            session.access(
                Access::new(AccessKind::Read, *word, Width::W8, 0).by_instruction(0),
                host,
            );
            session.take_failure();
        }
        self.armed = broken;
    }

    /// The life ends, and another one begins: with other contents of the flash memory, and as the reset pin restarts it.
    fn begin<M: Emulated>(&mut self, life: Life, session: &mut Session<M>, stop: Stop, host: &mut dyn Host) {
        self.lived.push(Lived {
            messages: std::mem::take(&mut self.messages),
            memory: std::mem::take(&mut self.memory),
            steps: session.board().steps(),
        });
        let now = stop.at.0;
        let commands = life.commands.into_iter().map(|(at, command)| (now + at, command));
        self.commands = commands.collect::<Vec<_>>().into_iter();
        self.next = self.commands.next();
        self.until = now + self.life_ns;
        self.decoder = Decoder::new();
        locked(&self.line.input).clear();
        session
            .board_mut()
            .power_for(life.power.unwrap_or(usize::MAX), life.flash);
        self.arm(session, host);
        session.reset_by_pin(stop.at, stop.instruction_count, host);
    }
}

impl<M: Emulated> Driver<M> for Watcher {
    fn on_settled(&mut self, session: &mut Session<M>, host: &mut dyn Host, settled: Settled) {
        let Settled::Access { access, value, .. } = settled else {
            return;
        };
        let word = access.address / WORD_LEN * WORD_LEN;
        if self.armed.remove(&word) {
            session.board_mut().found_broken();
        }
        if M::may_break(access.address) {
            self.arm(session, host);
        }
        let (sign, at) = (M::sign(access.address, value), access.instruction_count);
        if let Some(on) = sign
            .light
            .filter(|on| self.light.last().is_none_or(|(_, before)| before != on))
        {
            self.light.push((at, on));
        }
        match sign.work {
            Some(true) if self.busy_since.is_none() => self.busy_since = Some(at),
            Some(false) => self.work.extend(self.busy_since.take().map(|since| at - since)),
            _ => {}
        }
    }

    fn on_stop(&mut self, session: &mut Session<M>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        let now = stop.at.0;
        if self.restart.is_some_and(|at| at <= now) {
            self.restart = None;
            session.reset_by_pin(stop.at, stop.instruction_count, host);
        }
        while let Some((_, millivolts)) = self.supply.pop_front_if(|(at, _)| *at <= now) {
            session.board_mut().supply(millivolts);
        }
        while let Some((at, command)) = self.next.take() {
            if at > now {
                self.next = Some((at, command));
                break;
            }
            let mut bytes = [0; MAX_TO_BOARD_LEN];
            if let Ok(framed) = encode(&command, &mut bytes) {
                locked(&self.line.input).extend(framed);
            }
            self.next = self.commands.next();
        }
        if let Some(block) = self.log_at {
            self.log.extend(drain(block, host).unwrap_or_default());
        }
        let mut ended = !session.board().powered();
        let sent = locked(&self.line.sent).clone();
        for (at, byte) in sent.get(self.taken..).unwrap_or_default() {
            match self.decoder.push_byte::<FromBoard>(*byte) {
                None => {}
                Some(Ok(message)) => {
                    self.frames = self
                        .frames
                        .saturating_sub(usize::from(matches!(message, FromBoard::Frame(_))));
                    ended |= self.last.as_ref() == Some(&message);
                    self.messages.push((*at, message));
                }
                Some(Err(_)) => self.damaged += 1,
            }
        }
        self.taken = sent.len();
        if now < self.until && self.frames > 0 && !ended {
            return Some(VirtualNanos(now + self.look_ns));
        }
        self.memory = self
            .read_back
            .iter()
            .map(|(start, len)| {
                if let Some(bytes) = session.board().keeps(*start, *len) {
                    return bytes;
                }
                let mut word = |a: usize| host.read(start + a as u64, Width::W32).unwrap_or(0) as u32;
                (0..*len).step_by(4).flat_map(|a| word(a).to_le_bytes()).collect()
            })
            .collect();
        if let Some(life) = self.lives.pop_front() {
            self.begin(life, session, stop, host);
            return Some(VirtualNanos(now + self.look_ns));
        }
        // Memory is zero at power-up, and the stack grows downwards.
        let end = host.read(FIRST_STACK_POINTER, Width::W32).unwrap_or(STACK);
        let used = (STACK..end)
            .step_by(4)
            .find(|a| host.read(*a, Width::W32).is_ok_and(|word| word != 0));
        self.stack = (end - used.unwrap_or(end), end - STACK);
        None
    }
}

/// What is around a program besides the world: all as it should be, unless it is set otherwise.
#[derive(Debug, Default)]
pub struct Setup {
    /// Commands and when they are sent, ns.
    pub commands: Vec<(u64, ToBoard)>,
    /// When the reset button is pressed, ns.
    pub restart: Option<u64>,
    /// The supply from a time (ns) on, mV.
    pub supply: Vec<(u64, u32)>,
    /// What the flash memory holds beside the program: where, and what.
    pub flash: Vec<(u64, Vec<u8>)>,
    /// How often the host looks at the line, ns; 0 is every millisecond. The run ends at such a time.
    pub look_ns: u64,
    /// Memory to read when the run ends: where, and how many bytes.
    pub read_back: Vec<(u64, usize)>,
    /// The message that a life ends with, if it comes.
    pub last: Option<FromBoard>,
    /// How many steps of the flash memory the power lasts for, as of [`Life::power`].
    pub power: Option<usize>,
    /// Lives after the first: each begins when the one before ends, and lasts as long at most.
    pub lives: Vec<Life>,
    /// What the high-speed clock input has.
    pub clock: Wired,
    /// The address of the log's control block, if it is to be read.
    pub log_at: Option<u64>,
}

/// Runs a program on a sheet: sends commands at times (ns), and ends when so many frames came or at a time.
///
/// # Errors
/// The program cannot be read or run.
pub fn run(
    program: &Path,
    electronics: Electronics,
    sheet: ElectrodeMatrix,
    commands: Vec<(u64, ToBoard)>,
    frames: usize,
    until_ns: u64,
) -> Result<Outcome, Box<dyn Error>> {
    let setup = Setup {
        commands,
        ..Setup::default()
    };
    run_in(program, World::new(electronics, sheet), setup, frames, until_ns)
}

/// The same in a world and with all around it set up already.
///
/// # Errors
/// As of [`run`].
pub fn run_in(
    program: &Path,
    world: World,
    setup: Setup,
    frames: usize,
    until_ns: u64,
) -> Result<Outcome, Box<dyn Error>> {
    let world: Shared = Arc::new(Mutex::new(world));
    let line = Line::default();
    let machine = Machine {
        chip: Chip::new(world.clone(), line.clone(), setup.clock)?,
    };
    let (outcome, session) = run_machine(machine, line, program, setup, frames, until_ns)?;
    let world = locked(&world);
    Ok(Outcome {
        without_break: world.without_break,
        triggers: world.triggers,
        brown_out: session.board().chip.brown_out(),
        prefetch: session.board().chip.prefetch(),
        ..outcome
    })
}

/// Runs a program on any machine. What its world and its chip have seen the outcome does not tell.
///
/// # Errors
/// As of [`run`].
pub fn run_machine<M: Emulated>(
    mut machine: M,
    line: Line,
    program: &Path,
    setup: Setup,
    frames: usize,
    until_ns: u64,
) -> Result<(Outcome, Session<M>), Box<dyn Error>> {
    let mut supply = VecDeque::from(setup.supply);
    if let Some((_, millivolts)) = supply.pop_front_if(|(at, _)| *at == 0) {
        machine.supply(millivolts);
    }
    let (kept, flash): (Vec<_>, Vec<_>) =
        (setup.flash.into_iter()).partition(|(a, b)| machine.keeps(*a, b.len()).is_some());
    machine.power_for(setup.power.unwrap_or(usize::MAX), kept);
    let look_ns = if setup.look_ns == 0 { LOOK_NS } else { setup.look_ns };
    let mut commands = setup.commands.into_iter();
    let watcher = Watcher {
        look_ns,
        read_back: setup.read_back,
        memory: Vec::new(),
        line,
        decoder: Decoder::new(),
        taken: 0,
        messages: Vec::new(),
        damaged: 0,
        next: commands.next(),
        commands,
        restart: setup.restart,
        supply,
        until: until_ns,
        frames,
        last: setup.last,
        life_ns: until_ns,
        lives: setup.lives.into(),
        lived: Vec::new(),
        armed: BTreeSet::new(),
        busy_since: None,
        work: Vec::new(),
        light: Vec::new(),
        log_at: setup.log_at,
        log: Vec::new(),
        stack: (0, 0),
    };
    let mut images = vec![Image::read(program, None)?];
    for (address, bytes) in flash {
        images.push(Image::new(Path::new("settings"), bytes, Some(address))?);
    }
    let session = Session::new(Box::new(machine), 0, VirtualNanos(look_ns))?;
    let finished = rigless::emulator::run(session, &Start::new(&images), watcher)?;
    let (session, watcher) = (finished.session, finished.driver);
    let mut gaps: Vec<String> = session.unmapped().iter().map(|g| format!("unmapped {g:x?}")).collect();
    gaps.extend(session.refused().iter().map(|g| format!("refused {g:x?}")));
    gaps.extend(session.unimplemented().iter().map(|g| format!("unimplemented {g:x?}")));
    let stop = finished.stop.ok_or("the run did not end by itself")?;
    let outcome = Outcome {
        messages: watcher.messages,
        damaged: watcher.damaged,
        without_break: 0,
        triggers: 0,
        resets: session.resets().len(),
        brown_out: 0,
        prefetch: false,
        light: watcher.light,
        log: watcher.log,
        gaps,
        work: watcher.work,
        lived: watcher.lived,
        steps: session.board().steps(),
        memory: watcher.memory,
        stack: watcher.stack.0,
        stack_size: watcher.stack.1,
        end_ns: stop.at.0,
        instructions: stop.instruction_count,
    };
    Ok((outcome, session))
}
