//! What a program gets that reads the simulated board's serial port: frames a second, frames lost, and when they come.
//!
//!     skin sim --scene hand --pty --link /tmp/skin &
//!     cargo run --release -p skin-hil-sim --example serial /tmp/skin [seconds, default 30]
//!
//! Without a port's name it serves one itself, with the demo scene's sheet. Linux only.

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    linux::main()
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("pseudo-terminals of this kind need Linux");
}

#[cfg(target_os = "linux")]
mod linux {
    use forward::Sheet;
    use hil_sim::{Pty, PtyOptions, Rubber, Scene, SimBoard, SimConfig};
    use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, Plan, ToBoard, encode};
    use std::error::Error;
    use std::fs::File;
    use std::io::{Read, Write};
    use std::time::Instant;

    /// What came: when by this machine's clock, when by the board's, and its number.
    struct Arrival {
        here_s: f64,
        there_s: f64,
        sequence: u32,
    }

    fn send(port: &mut File, command: &ToBoard) -> Result<(), Box<dyn Error>> {
        let mut buffer = [0; MAX_TO_BOARD_LEN];
        let bytes = encode(command, &mut buffer).map_err(|e| format!("{e:?}"))?;
        Ok(port.write_all(bytes)?)
    }

    pub(crate) fn main() -> Result<(), Box<dyn Error>> {
        let mut arguments = std::env::args().skip(1);
        let given = arguments.next();
        let duration_s: f64 = arguments.next().map_or(Ok(30.0), |s| s.parse())?;
        let mut own = None;
        let path = match given {
            Some(name) if name != "-" => name.into(),
            _ => {
                let board = SimBoard::new(SimConfig::default(), Rubber::new(&Sheet::paper(), Scene::demo())?)?;
                let pty = own.insert(Pty::start(board, PtyOptions::default())?);
                pty.path().ok_or("the port is gone")?
            }
        };
        let mut port = File::options().read(true).write(true).open(path)?;
        port.write_all(&[0])?;
        send(&mut port, &ToBoard::SetPlan(Plan::fast()))?;
        send(&mut port, &ToBoard::Start)?;
        let (start, mut buffer) = (Instant::now(), [0; 4096]);
        let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
        let mut arrivals: Vec<Arrival> = Vec::new();
        let mut damaged = 0;
        while arrivals
            .first()
            .is_none_or(|a| start.elapsed().as_secs_f64() < a.here_s + duration_s)
        {
            let n = port.read(&mut buffer)?;
            let here_s = start.elapsed().as_secs_f64();
            decoder.push(&buffer[..n], |m| match m {
                Ok(FromBoard::Frame(frame)) if frame.plan == Plan::fast().id => arrivals.push(Arrival {
                    here_s,
                    there_s: hil_sim::seconds(frame.time),
                    sequence: frame.sequence,
                }),
                Ok(_) => {}
                Err(_) => damaged += 1,
            });
        }
        send(&mut port, &ToBoard::Stop)?;
        report(&arrivals, damaged)
    }

    fn report(arrivals: &[Arrival], damaged: u32) -> Result<(), Box<dyn Error>> {
        let [Some(first), Some(last)] = [arrivals.first(), arrivals.last()] else {
            return Err("no frame came".into());
        };
        let steps = (arrivals.len() - 1) as f64;
        let lost = f64::from(last.sequence.wrapping_sub(first.sequence)) - steps;
        println!(
            "frames        {} in {:.2} s",
            arrivals.len(),
            last.here_s - first.here_s
        );
        println!(
            "a second      {:.2} here, {:.2} by the board's clock",
            steps / (last.here_s - first.here_s),
            steps / (last.there_s - first.there_s)
        );
        println!("lost          {lost}");
        println!("damaged       {damaged}");
        // What the fastest frame took is not known; all others are compared with it.
        let mut late: Vec<f64> = arrivals.iter().map(|a| a.here_s - a.there_s).collect();
        late.sort_by(f64::total_cmp);
        let at = |part: f64| 1e3 * (late[((late.len() - 1) as f64 * part) as usize] - late[0]);
        println!(
            "later than the earliest, ms: median {:.1}, 95 % {:.1}, 99.9 % {:.1}, worst {:.1}",
            at(0.5),
            at(0.95),
            at(0.999),
            at(1.0)
        );
        Ok(())
    }
}
