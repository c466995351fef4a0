//! A worse contact is not taken for a touch, and a touch at the rim is not taken for a contact.

use forward::{DiscTouch, Drive};
use inverse::pipeline::Reconstructor;
use inverse::reference::diagnosis::Fault;
use inverse::touches::touch::Touch;
use rand::Rng;
use studies::{LiveSheet, TestSheet, Worse, slipped};

const CURRENT: Drive = Drive::Current { amplitude_a: 1e-3 };

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// The noise is that of a finger half way to the rim at 27 dB.
fn live_sheet(drive: Drive, seed: u64) -> LiveSheet {
    LiveSheet::new(drive, seed, |sheet, _| sheet.clean_frame(&[finger(48.0, 0.0)])).unwrap()
}

/// Contacts named in the frame with noise, and places of the touches, mm.
fn contacts_and_touches(live: &mut LiveSheet, clean: &[f64]) -> (Vec<usize>, Vec<[f64; 2]>) {
    let found = live.reconstruct(clean).unwrap();
    // What is left out is said.
    assert_eq!(found.faults.is_empty(), found.contacts.is_empty());
    let mut once = found.contacts.clone();
    once.sort_unstable();
    once.dedup();
    assert_eq!(once.len(), found.contacts.len());
    (
        found.contacts.clone(),
        found.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect(),
    )
}

fn rest(live: &mut LiveSheet) {
    let clean = live.sheet.baseline.clone();
    assert_eq!(contacts_and_touches(live, &clean), (vec![], vec![]));
}

/// Asserts that the contact is named, without a touch and with a finger elsewhere, at most 1.5 mm off. It is named
/// after some frames, not in the first two.
fn assert_named(live: &mut LiveSheet, electrode: usize, worse: Worse) {
    let opposite = std::f64::consts::TAU * (electrode as f64 / 16.0 + live.rng.random_range(0.3..0.7));
    let at = [45.0 * opposite.cos(), 45.0 * opposite.sin()];
    for touches in [vec![], vec![finger(at[0], at[1])]] {
        rest(live);
        let clean = live.sheet.worse_frame(&touches, &[(electrode, worse)]).unwrap();
        for _ in 0..2 {
            assert!(contacts_and_touches(live, &clean).0.is_empty(), "{worse:?}");
        }
        let (contacts, found) = (0..28).map(|_| contacts_and_touches(live, &clean)).last().unwrap();
        assert_eq!(contacts, [electrode], "{worse:?}, {touches:?}: {found:?}");
        assert_eq!(found.len(), touches.len(), "{worse:?} at {electrode}: {found:?}");
        for [x, y] in found {
            assert!(
                (x - at[0]).hypot(y - at[1]) < 1.5,
                "{worse:?} at {electrode}: {x} {y}, {at:?}"
            );
        }
    }
}

#[test]
fn a_worse_contact_is_named_and_shows_no_touch() {
    for seed in 81..85 {
        let mut live = live_sheet(Drive::PAPER, seed);
        for (k, ohm) in [20.0, 60.0, 200.0, 500.0].into_iter().enumerate() {
            assert_named(&mut live, (5 * k + 1) % 16, Worse::Face(ohm));
            assert_named(&mut live, (7 * k + 4) % 16, Worse::Wire(ohm));
        }
    }
}

/// An electrode that slips along its rim by a fiftieth to a tenth of its width looks like a small touch beside it. It is named within half
/// a second, at rest and beside a finger. The finger is right then, and nothing else is shown.
#[test]
fn an_electrode_that_slips_is_named_and_shows_no_touch() {
    let (mut frames, mut wrong) = (0, 0);
    for (seed, electrode, by_mm) in [(89, 4, 0.2), (90, 13, -0.4), (91, 9, 0.7), (92, 0, -1.0)] {
        let mut live = live_sheet(Drive::PAPER, seed);
        let mut moved = TestSheet::of_sheet(&live.sheet.imager, Drive::PAPER, &slipped(electrode, by_mm)).unwrap();
        let opposite = std::f64::consts::TAU * (electrode as f64 / 16.0 + live.rng.random_range(0.2..0.8));
        let at = [45.0 * opposite.cos(), 45.0 * opposite.sin()];
        for touches in [vec![], vec![finger(at[0], at[1])]] {
            rest(&mut live);
            let clean = moved.clean_frame(&touches).unwrap();
            for frame in 0..120 {
                let result = live.reconstruct(&clean).unwrap();
                let off = |t: &Touch| (t.x_mm - at[0]).hypot(t.y_mm - at[1]);
                let right = result.touches.len() == touches.len() && result.touches.iter().all(|t| off(t) < 1.5);
                let said = format!(
                    "{by_mm} mm at {electrode}, frame {frame}: {:?} {:?}",
                    result.contacts, result.touches
                );
                if frame >= 57 {
                    assert!(right && result.contacts == [electrode], "{said}");
                } else {
                    frames += 1;
                    wrong += usize::from(!right && result.doubt.is_none());
                }
            }
        }
    }
    println!("{wrong} of {frames} frames before were wrong and silent");
    assert!(20 * wrong <= frames, "{wrong} of {frames}");
}

/// Whenever a contact holds again: the first frame at rest ends it, also one in which it was to be looked for.
#[test]
fn a_contact_that_was_worse_is_over_in_the_first_frame_at_rest() {
    let mut live = live_sheet(Drive::PAPER, 88);
    let worse = [(11, Worse::Wire(300.0))];
    let clean = live.sheet.worse_frame(&[], &worse).unwrap();
    for frames in 40..57 {
        rest(&mut live);
        let named = (0..frames).map(|_| contacts_and_touches(&mut live, &clean)).last();
        assert_eq!(named, Some((vec![11], vec![])), "after {frames} frames");
    }
    rest(&mut live);
}

/// A contact that is named is looked at again and again, also in frames that show nothing else. None of these looks shows a touch.
#[test]
fn looks_at_a_contact_that_is_named_show_no_touch() {
    for (electrode, ohm) in [(11, 200.0), (0, 500.0)] {
        let mut live = live_sheet(Drive::PAPER, 81);
        let clean = live.sheet.worse_frame(&[], &[(electrode, Worse::Face(ohm))]).unwrap();
        for frame in 0..800 {
            let (contacts, touches) = contacts_and_touches(&mut live, &clean);
            if frame >= 20 {
                assert_eq!(
                    (contacts, touches),
                    (vec![electrode], vec![]),
                    "{ohm} ohm, frame {frame}"
                );
            }
        }
    }
}

/// A current hides what a contact does but for the shunt. At rest it is named nearly always. Beside a finger it may pass for a disc
/// at the rim without a place, which is no touch: the finger is right all the same.
#[test]
fn with_a_given_current_the_shunt_shows_a_worse_contact() {
    let (mut at_rest, mut beside, mut tried) = (0, 0, 0);
    for (electrode, ohm) in [(2, 100.0), (9, 250.0), (5, 250.0), (12, 500.0)] {
        for seed in 82..86 {
            let mut live = live_sheet(CURRENT, seed);
            let opposite = std::f64::consts::TAU * (electrode as f64 / 16.0 + live.rng.random_range(0.3..0.7));
            let at = [45.0 * opposite.cos(), 45.0 * opposite.sin()];
            let mut named = |touches: &[DiscTouch]| {
                rest(&mut live);
                let clean = live
                    .sheet
                    .worse_frame(touches, &[(electrode, Worse::Face(ohm))])
                    .unwrap();
                let (contacts, found) = (0..30).map(|_| contacts_and_touches(&mut live, &clean)).last().unwrap();
                let said = format!("{ohm} ohm at {electrode}, seed {seed}: {contacts:?} {found:?}, {at:?}");
                assert!(contacts.is_empty() || contacts == [electrode], "{said}");
                assert_eq!(found.len(), touches.len(), "{said}");
                let off = |[x, y]: [f64; 2]| (x - at[0]).hypot(y - at[1]);
                assert!(found.iter().all(|p| off(*p) < 1.5), "{said}");
                usize::from(!contacts.is_empty())
            };
            at_rest += named(&[]);
            beside += named(&[finger(at[0], at[1])]);
            tried += 1;
        }
    }
    println!("of {tried} contacts {at_rest} named at rest, {beside} beside a finger");
    assert!(at_rest + 1 >= tried, "{at_rest} of {tried}");
    assert!(2 * beside >= tried, "{beside} of {tried}");
}

#[test]
fn touches_at_the_rim_are_no_contacts() {
    for (drive, seed) in [(Drive::PAPER, 83), (CURRENT, 84)] {
        let mut live = live_sheet(drive, seed);
        for k in 0..40 {
            // In front of an electrode and between two, the centre from 6 to 20 mm from the rim.
            let angle = std::f64::consts::TAU * f64::from(k) / 32.0;
            let radius = live.rng.random_range(77.5..91.5);
            let touch = finger(radius * angle.cos(), radius * angle.sin());
            let clean = live.sheet.clean_frame(&[touch]).unwrap();
            rest(&mut live);
            for _ in 0..20 {
                let (contacts, found) = contacts_and_touches(&mut live, &clean);
                assert!(contacts.is_empty(), "{drive:?} {k}: {contacts:?} {found:?}");
                assert_eq!(found.len(), 1, "{drive:?} {k}");
            }
        }
    }
}

/// Frames of a table are unrelated; each is tested alone.
#[test]
fn a_frame_alone_names_a_worse_contact_too() {
    let mut live = live_sheet(Drive::PAPER, 86);
    live.reconstructor = live.sheet.reconstructor().unwrap();
    for k in 0..8 {
        let electrode = (5 * k + 2) % 16;
        let worse = [Worse::Face(100.0), Worse::Wire(100.0)][k % 2];
        let clean = live.sheet.worse_frame(&[], &[(electrode, worse)]).unwrap();
        assert_eq!(
            contacts_and_touches(&mut live, &clean),
            (vec![electrode], vec![]),
            "{worse:?}"
        );
        let angle = std::f64::consts::TAU * k as f64 / 32.0;
        let radius = live.rng.random_range(77.5..91.5);
        let touch = finger(radius * angle.cos(), radius * angle.sin());
        let clean = live.sheet.clean_frame(&[touch]).unwrap();
        let (contacts, found) = contacts_and_touches(&mut live, &clean);
        assert!(contacts.is_empty() && found.len() == 1, "{k}: {contacts:?} {found:?}");
    }
}

#[test]
fn a_contact_that_recovers_is_accepted_again() {
    let mut live = live_sheet(Drive::PAPER, 85);
    let touch = [finger(-30.0, 20.0)];
    let worse = live.sheet.worse_frame(&touch, &[(6, Worse::Face(150.0))]).unwrap();
    let well = live.sheet.clean_frame(&touch).unwrap();
    for _ in 0..30 {
        contacts_and_touches(&mut live, &worse);
    }
    for _ in 0..40 {
        let (contacts, found) = contacts_and_touches(&mut live, &worse);
        assert_eq!((contacts.as_slice(), found.len()), ([6].as_slice(), 1));
    }
    let frames = (0..40)
        .take_while(|_| !contacts_and_touches(&mut live, &well).0.is_empty())
        .count();
    assert!(frames <= 20, "{frames}");
}

/// Moisture between two wires: a weak leak is named, a finger beside it is right, its resistance is followed as it dries, and it is over when
/// it has gone: at rest in the first frame.
#[test]
fn a_leak_that_dries_leaves_touches() {
    for (pair, ohms) in [([3, 4], [10e3, 20e3, 60e3]), ([2, 9], [200e3, 250e3, 300e3])] {
        let mut live = live_sheet(Drive::PAPER, 87);
        let touch = [finger(-20.0, 35.0)];
        let touches = |touched: bool| if touched { &touch[..] } else { &[] };
        rest(&mut live);
        let mut wrong = 0;
        // Whether the last of some frames is right, and what is named in it.
        let mut look = |live: &mut LiveSheet, clean: &[f64], touched: bool, frames: usize| {
            let mut last = (false, Vec::new());
            for _ in 0..frames {
                let result = live.reconstruct(clean).unwrap();
                let off = |t: &Touch| (t.x_mm + 20.0).hypot(t.y_mm - 35.0);
                let right = result.touches.len() == usize::from(touched) && result.touches.iter().all(|t| off(t) < 1.5);
                wrong += usize::from(!right && result.doubt.is_none());
                last = (right && result.doubt.is_none(), result.faults.clone());
            }
            last
        };
        for ohm in ohms {
            for touched in [false, true] {
                let clean = live.sheet.leaky_frame(touches(touched), pair, ohm).unwrap();
                let last = look(&mut live, &clean, touched, 60);
                let (true, [Fault::Leak { electrodes, ohm: told }]) = (last.0, &last.1[..]) else {
                    panic!("{pair:?} over {ohm}, touched {touched}: {last:?}");
                };
                assert_eq!(*electrodes, pair);
                assert!((told / ohm - 1.0).abs() < 0.3, "{told} of {ohm}");
            }
        }
        let clean = live.sheet.clean_frame(&touch).unwrap();
        assert_eq!(look(&mut live, &clean, true, 60), (true, vec![]), "{pair:?}");
        for frames in 50..58 {
            let clean = live.sheet.leaky_frame(&[], pair, ohms[0]).unwrap();
            assert_eq!(look(&mut live, &clean, false, frames).1.len(), 1, "{pair:?}");
            let clean = live.sheet.baseline.clone();
            assert_eq!(look(&mut live, &clean, false, 1), (true, vec![]), "{pair:?}");
        }
        println!("{pair:?}: {wrong} frames are wrong and silent");
        assert!(wrong < 42, "{pair:?}: {wrong} frames");
    }
}

/// A leak of hundreds of kilohms between electrodes near one another looks like weak touches before them. It is named with its resistance,
/// at rest and beside a finger. The finger is right then, to 0.7 mm, and nothing else is shown.
#[test]
fn a_weak_leak_between_electrodes_near_one_another_is_named() {
    let (mut frames, mut wrong, mut doubted) = (0, 0, 0);
    for (drive, seed, pair, ohm) in [
        (Drive::PAPER, 94, [3, 4], 300e3),
        (Drive::PAPER, 95, [0, 15], 1e6),
        (Drive::PAPER, 96, [9, 11], 1e6),
        (Drive::PAPER, 97, [12, 13], 3e6),
        (CURRENT, 94, [3, 4], 300e3),
        (CURRENT, 95, [0, 15], 1e6),
        (CURRENT, 96, [9, 11], 3e6),
    ] {
        let mut live = live_sheet(drive, seed);
        let at = [-20.0, 35.0];
        for touches in [vec![], vec![finger(at[0], at[1])]] {
            rest(&mut live);
            let clean = live.sheet.leaky_frame(&touches, pair, ohm).unwrap();
            for frame in 0..160 {
                let result = live.reconstruct(&clean).unwrap();
                let off = |t: &Touch| (t.x_mm - at[0]).hypot(t.y_mm - at[1]);
                let right =
                    |most| result.touches.len() == touches.len() && result.touches.iter().all(|t| off(t) < most);
                if frame < 97 {
                    frames += 1;
                    wrong += usize::from(!right(1.5) && result.doubt.is_none());
                    continue;
                }
                let [Fault::Leak { electrodes, ohm: told }] = result.faults[..] else {
                    panic!("{pair:?} over {ohm}, frame {frame}: {:?}", result.faults);
                };
                assert_eq!(electrodes, pair);
                doubted += usize::from(result.doubt.is_some());
                assert!((told / ohm - 1.0).abs() < 0.3, "{told} of {ohm}");
                assert!(right(0.7), "{pair:?}, frame {frame}: {:?}", result.touches);
            }
        }
    }
    println!("{wrong} of {frames} frames before were wrong and silent");
    assert!(20 * wrong <= frames, "{wrong} of {frames}");
    // Beside what is known noise alone is no doubt.
    println!("{doubted} of 882 frames after were doubted");
    assert!(doubted <= 8, "{doubted} of 882");
}

/// A weak leak is followed as it dries, and is over soon after it has gone under a finger.
#[test]
fn a_weak_leak_that_dries_under_a_finger_is_over() {
    let mut live = live_sheet(Drive::PAPER, 98);
    let touch = [finger(-20.0, 35.0)];
    rest(&mut live);
    for ohm in [300e3, 600e3] {
        let clean = live.sheet.leaky_frame(&touch, [3, 4], ohm).unwrap();
        for _ in 0..80 {
            live.reconstruct(&clean).unwrap();
        }
        let result = live.reconstruct(&clean).unwrap();
        let [
            Fault::Leak {
                electrodes: [3, 4],
                ohm: told,
            },
        ] = result.faults[..]
        else {
            panic!("{ohm}: {:?}", result.faults);
        };
        assert!((told / ohm - 1.0).abs() < 0.15, "{told} of {ohm}");
        assert_eq!(result.touches.len(), 1, "{:?}", result.touches);
    }
    let clean = live.sheet.clean_frame(&touch).unwrap();
    let frames = (0..60).take_while(|_| !live.reconstruct(&clean).unwrap().faults.is_empty());
    let frames = frames.count();
    assert!(frames <= 40, "named for {frames} frames more");
    let result = live.reconstruct(&clean).unwrap();
    assert_eq!((result.touches.len(), result.doubt), (1, None));
}

/// A row of a table says nothing of the next one, whatever leaks in it.
#[test]
fn a_leak_in_a_table_is_one_of_its_row() {
    let mut live = live_sheet(Drive::PAPER, 88);
    let touch = [finger(-20.0, 35.0)];
    let leaky = live.sheet.leaky_frame(&touch, [3, 4], 10e3).unwrap();
    let leaky = live.frame(&leaky);
    let clean = live.sheet.clean_frame(&touch).unwrap();
    let clean = live.frame(&clean);
    let rows = [&leaky, &leaky, &clean, &leaky];
    let of_row = |table: &mut Reconstructor, row: &[f64]| {
        let result = table.frame(row).unwrap();
        let places: Vec<[f64; 2]> = result.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect();
        (result.faults.clone(), places)
    };
    let alone = rows.map(|row| of_row(&mut live.sheet.reconstructor().unwrap(), row));
    assert!(matches!(alone[0].0[..], [Fault::Leak { .. }]) && alone[2].0.is_empty());
    assert!(alone.iter().all(|(_, places)| places.len() == 1), "{alone:?}");
    let mut table = live.sheet.reconstructor().unwrap();
    assert_eq!(rows.map(|row| of_row(&mut table, row)), alone);
}
