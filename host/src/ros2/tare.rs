//! `~/tare`: a new baseline as the page's key takes it, refused under touches.

use crate::event::{Event, Said};
use crate::files::cdr::Cdr;
use rustdds::rpc::SampleIdentity;

/// Who asked, and how the answer is to look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request {
    pub(super) from: SampleIdentity,
    /// What Cyclone's nodes put in front of every request, to find its answer by; others know it by DDS.
    head: Option<[u8; HEAD]>,
}

/// The number of a client and of its request.
const HEAD: usize = 16;

impl Request {
    /// A request of `std_srvs/Trigger`, which holds nothing but a filler; none where it is something else.
    pub(super) fn read(from: SampleIdentity, body: &[u8]) -> Option<Self> {
        // A filler of a byte, which some pad to four.
        let head = match body.len() {
            0..=4 => None,
            17..=20 => Some(*body.first_chunk()?),
            _ => return None,
        };
        Some(Self { from, head })
    }

    /// What nobody asked: clients of all kinds can read its answer, and pass it over.
    pub(super) fn of_nobody() -> Self {
        let mut head = [0; HEAD];
        // Who expects no head reads "no", and the length of an empty text.
        head[4] = 1;
        Self {
            from: SampleIdentity::default(),
            head: Some(head),
        }
    }

    /// The answer to it.
    pub(super) fn answer(&self, success: bool, text: &str) -> Cdr {
        let mut message = Cdr::new();
        if let Some(head) = &self.head {
            message.octets(head);
        }
        message.bool(success).text(text);
        message
    }
}

/// What is known of the sheet when somebody asks.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sheet {
    /// A recording is played.
    pub(super) recorded: bool,
    pub(super) away: bool,
    /// A baseline is in force, and none is being taken.
    pub(super) in_force: bool,
    pub(super) touches: usize,
}

/// A service of one skin.
#[derive(Debug, Default)]
pub(super) struct Tare {
    /// Who waits for the new baseline, and whether the skin's thread knows.
    waiting: Option<(Request, bool)>,
    /// Answers that are to be sent.
    answers: Vec<(Request, bool, String)>,
}

impl Tare {
    /// Somebody asks.
    pub(super) fn ask(&mut self, request: Request, sheet: &Sheet) {
        match refusal(sheet) {
            _ if self.waiting.is_some() => self.refuse(request, "a baseline is being taken already".to_owned()),
            Some(why) => self.refuse(request, why),
            None => self.waiting = Some((request, false)),
        }
    }

    fn refuse(&mut self, request: Request, why: String) {
        self.answers.push((request, false, why));
    }

    /// Whether the skin is to take one now; says so once.
    pub(super) fn wanted(&mut self) -> bool {
        match &mut self.waiting {
            Some((_, known @ false)) => {
                *known = true;
                true
            }
            _ => false,
        }
    }

    /// Something happened, perhaps what somebody waits for.
    pub(super) fn event(&mut self, said: &Said) {
        let success = match said.event {
            Event::BaselineInForce { .. } => true,
            Event::BoardAway { .. } => false,
            _ => return,
        };
        // A baseline that came in force before the skin knew of the request is another one.
        if let Some((request, _)) = self.waiting.take_if(|(_, known)| *known || !success) {
            self.answers.push((request, success, said.text.clone()));
        }
    }

    /// The skin has ended.
    pub(super) fn end(&mut self) {
        if let Some((request, _)) = self.waiting.take() {
            self.refuse(request, "the skin has ended".to_owned());
        }
    }

    /// What is to be sent.
    pub(super) fn answers(&mut self) -> Vec<(Request, bool, String)> {
        std::mem::take(&mut self.answers)
    }
}

/// Why no baseline is taken now.
fn refusal(sheet: &Sheet) -> Option<String> {
    if sheet.recorded {
        return Some("this is a recording: its baselines are those that were taken then".to_owned());
    }
    if sheet.away {
        return Some("the board is away: ask again when it is back".to_owned());
    }
    if !sheet.in_force {
        return Some("a baseline is being taken already".to_owned());
    }
    let touches = match sheet.touches {
        0 => return None,
        1 => "something touches the sheet".to_owned(),
        touches => format!("{touches} touches on the sheet"),
    };
    Some(format!(
        "{touches}: what rests there would count as untouched; lift it and ask again, or take the baseline at the page"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Request {
        Request::read(SampleIdentity::default(), &[0]).unwrap()
    }

    const FREE: Sheet = Sheet {
        recorded: false,
        away: false,
        in_force: true,
        touches: 0,
    };

    #[test]
    fn a_request_is_answered_once_its_own_baseline_is_in_force() {
        let mut tare = Tare::default();
        let in_force = Said::baseline_in_force(false);
        tare.ask(request(), &FREE);
        // One that was begun before.
        tare.event(&in_force);
        assert!(tare.answers().is_empty() && tare.wanted() && !tare.wanted());
        tare.event(&Said::baseline_begun());
        assert!(tare.answers().is_empty());
        tare.ask(request(), &FREE);
        let refused = tare.answers();
        assert!(refused.len() == 1 && !refused[0].1);
        tare.event(&in_force);
        let answers = tare.answers();
        assert!(answers.len() == 1 && answers[0].1);
        tare.event(&in_force);
        assert!(tare.answers().is_empty());
    }

    #[test]
    fn no_baseline_is_taken_under_touches_nor_without_frames() {
        for (sheet, says) in [
            (Sheet { touches: 2, ..FREE }, "2 touches"),
            (Sheet { touches: 1, ..FREE }, "touches"),
            (Sheet { away: true, ..FREE }, "away"),
            (
                Sheet {
                    in_force: false,
                    ..FREE
                },
                "being taken",
            ),
            (Sheet { recorded: true, ..FREE }, "recording"),
        ] {
            let mut tare = Tare::default();
            tare.ask(request(), &sheet);
            let answers = tare.answers();
            assert!(!tare.wanted() && answers.len() == 1);
            assert!(!answers[0].1 && answers[0].2.contains(says), "{answers:?}");
        }
    }

    #[test]
    fn a_request_that_nobody_can_grant_any_more_is_answered_too() {
        let mut tare = Tare::default();
        tare.ask(request(), &FREE);
        tare.end();
        assert_eq!(tare.answers().len(), 1);
        tare.ask(request(), &FREE);
        let why = "gone".to_owned();
        let said = Said {
            event: Event::BoardAway { why: why.clone() },
            text: why,
        };
        tare.event(&said);
        assert!(matches!(&tare.answers()[..], [(_, false, why)] if why == "gone"));
    }

    #[test]
    fn answers_begin_as_the_request_did() {
        let identity = SampleIdentity::default();
        let head: Vec<u8> = (1..=17).collect();
        let cyclone = Request::read(identity, &head).unwrap().answer(true, "a").into_bytes();
        assert_eq!(cyclone[4..20], head[..16]);
        // The text's length stands at a place that four divides.
        assert_eq!(cyclone[20..], [1, 0, 0, 0, 2, 0, 0, 0, b'a', 0]);
        let plain = Request::read(identity, &[0]).unwrap().answer(true, "a").into_bytes();
        assert_eq!(plain[4..], cyclone[20..]);
        let nobody = Request::of_nobody().answer(false, "").into_bytes();
        let empty = Request::read(identity, &[0]).unwrap().answer(false, "").into_bytes();
        assert_eq!((&nobody[4..empty.len()], nobody[20..].len()), (&empty[4..], 9));
        assert!(Request::read(identity, &[0; 40]).is_none() && Request::read(identity, &[0; 9]).is_none());
    }
}
