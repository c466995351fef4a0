//! Settings and power cuts: at whatever byte the power goes, the old settings are there or the new.

use crate::common::{Bench, disc};
use firmware::settings::{self, Settings, StoreFault};
use firmware::{Sector, Store, laws};
use hil_sim::{Chip, Clock, FixedSheet, Flash, SimConfig, Torn};
use protocol::{BoardError, Command, FromBoard, Plan, Refusal, ResetCause, Status, Stored, ToBoard, Watch, Watching};

const TORN: [Torn; 3] = [Torn::Before, Torn::Mixed, Torn::After];

/// Settings that differ from each other in length and content.
fn settings(k: u16) -> Settings {
    let mut plan = Plan::fast();
    plan.slots.truncate(1 + usize::from(k) % 16);
    Settings {
        autostart: k.is_multiple_of(2),
        excitation_permille: k,
        plan,
        watch: k.is_multiple_of(3).then(Watch::default),
    }
}

/// A memory with a history of so many savings, and the settings that count.
fn worn(sector_len: u32, savings: u16) -> (Flash, Option<Settings>) {
    let mut flash = Flash::new(sector_len);
    let mut last = None;
    for k in 0..savings {
        settings::save(&mut flash, &settings(k)).unwrap();
        last = Some(settings(k));
    }
    (flash, last)
}

#[test]
fn the_memory_keeps_the_laws_of_a_store() {
    assert_eq!(laws::store(&mut Flash::new(777)), Ok(()));
    let mut chip = Chip::new(Clock::new(), Flash::new(512));
    assert_eq!(laws::store(&mut chip), Ok(()));
}

#[test]
fn what_is_saved_last_is_loaded_through_many_turns_of_the_log() {
    let mut flash = Flash::new(1024);
    assert_eq!(settings::load(&mut flash), Ok(None));
    for k in 0..300 {
        settings::save(&mut flash, &settings(k)).unwrap();
        assert_eq!(settings::load(&mut flash), Ok(Some(settings(k))), "{k}");
    }
    settings::forget(&mut flash).unwrap();
    assert_eq!(settings::load(&mut flash), Ok(None));
    settings::save(&mut flash, &settings(7)).unwrap();
    assert_eq!(settings::load(&mut flash), Ok(Some(settings(7))));
}

#[test]
fn a_power_cut_at_any_byte_leaves_the_old_settings_or_the_new() {
    let new = settings(999);
    let (mut kept_old, mut erasing) = (0, 0);
    // Histories that end in all places of the log, also just before it turns to the other sector.
    for savings in 0..24 {
        let (before, old) = worn(1024, savings);
        // How much work the saving is, uncut.
        let mut whole = before.clone();
        settings::save(&mut whole, &new).unwrap();
        let work = whole.worked() - before.worked();
        erasing += u32::from(work > 1024);
        for torn in TORN {
            for cut in 0..work {
                let mut flash = before.clone();
                flash.cut_after(cut, torn);
                assert!(settings::save(&mut flash, &new).is_err());
                flash.power_on();
                let found = settings::load(&mut flash).unwrap();
                let is_old = found == old;
                assert!(
                    is_old || found.as_ref() == Some(&new),
                    "{savings} {torn:?} {cut}: {found:?}"
                );
                kept_old += u32::from(is_old);
                // And it is as good as before: the next saving works.
                settings::save(&mut flash, &settings(5)).unwrap();
                assert_eq!(
                    settings::load(&mut flash),
                    Ok(Some(settings(5))),
                    "{savings} {torn:?} {cut}"
                );
            }
        }
    }
    assert!(erasing >= 2 && kept_old > 1000, "{erasing} {kept_old}");
}

#[test]
fn cuts_one_after_the_other_do_not_add_up() {
    let (mut flash, mut last) = worn(1024, 3);
    let mut state = 1u64;
    for k in 0..2000u16 {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        flash.cut_after((state >> 33) % 400, TORN[usize::from(k) % 3]);
        let new = settings(k);
        let done = settings::save(&mut flash, &new);
        flash.power_on();
        let found = settings::load(&mut flash).unwrap();
        assert!(found == last || found.as_ref() == Some(&new), "{k}");
        assert!(done.is_err() || found == Some(new), "{k}");
        last = found;
    }
}

#[test]
fn a_sector_that_is_too_small_or_a_dead_store_is_an_error() {
    let mut small = Flash::new(32);
    assert!(settings::save(&mut small, &settings(15)).is_err());
    let mut none = Flash::new(0);
    assert_eq!(settings::load(&mut none), Ok(None));
    assert!(settings::save(&mut none, &settings(1)).is_err());
    let mut dead = Flash::new(1024);
    dead.cut_after(0, Torn::Before);
    assert!(dead.write(firmware::Sector::A, 0, &[1]).is_err());
    assert!(settings::load(&mut dead).is_err());
}

#[test]
fn a_board_comes_back_with_what_it_was_told_to_keep() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    bench.run(0.01);
    bench.send(&ToBoard::SetPlan(Plan::fourteen()));
    bench.send(&ToBoard::SetExcitation(700));
    bench.send(&ToBoard::SetAutostart(true));
    bench.send(&ToBoard::SaveSettings);
    assert!(bench.run(0.05).contains(&FromBoard::Ack(Command::SaveSettings)));
    let flash = bench.board.flash().clone();

    let config = |flash: &Flash, reset| SimConfig {
        flash: Some(flash.clone()),
        reset,
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config(&flash, ResetCause::PowerOn), FixedSheet(disc(16)));
    let said = bench.run(0.1);
    assert!(matches!(&said[0], FromBoard::Hello(h) if h.reset == ResetCause::PowerOn));
    assert!(matches!(&said[1], FromBoard::Frame(f) if f.plan == Plan::fourteen().id && f.values.len() == 182));
    // Not while it measures.
    bench.send(&ToBoard::ForgetSettings);
    let busy = FromBoard::Error(BoardError::Refused(Refusal::Busy));
    assert!(bench.run(0.05).contains(&busy));
    bench.send(&ToBoard::Stop);
    bench.send(&ToBoard::ForgetSettings);
    assert!(bench.run(0.05).contains(&FromBoard::Ack(Command::ForgetSettings)));
    let flash = bench.board.flash().clone();
    let mut bench = Bench::new(config(&flash, ResetCause::PowerOn), FixedSheet(disc(16)));
    bench.send(&ToBoard::GetPlan);
    assert!(bench.run(0.1).contains(&FromBoard::Plan(Plan::fast())));
}

#[test]
fn settings_that_do_not_suit_the_board_are_left_alone() {
    let mut flash = Flash::new(2048);
    settings::save(
        &mut flash,
        &Settings {
            autostart: true,
            ..settings(500)
        },
    )
    .unwrap();
    // Sixteen electrodes' plan on a board of eight.
    let config = SimConfig {
        flash: Some(flash),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(8)));
    bench.send(&ToBoard::GetPlan);
    let said = bench.run(0.1);
    assert!(said.contains(&FromBoard::Plan(Plan::adjacent(8).unwrap())), "{said:?}");
    assert!(!said.iter().any(|m| matches!(m, FromBoard::Frame(_))));
}

fn status(bench: &mut Bench<FixedSheet>) -> Status {
    bench.send(&ToBoard::GetStatus);
    let said = bench.run(0.05);
    let found = said.iter().find_map(|m| match m {
        FromBoard::Status(s) => Some(*s),
        _ => None,
    });
    found.unwrap()
}

#[test]
fn the_status_says_what_is_set_and_whether_it_is_stored() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    bench.run(0.01);
    let fresh = Status {
        excitation_permille: 1000,
        ..Status::default()
    };
    assert_eq!(status(&mut bench), fresh);
    bench.send(&ToBoard::SetAutostart(true));
    bench.send(&ToBoard::SetExcitation(700));
    bench.send(&ToBoard::SaveSettings);
    let kept = Status {
        autostart: true,
        excitation_permille: 700,
        stored: Stored::InForce,
        ..fresh
    };
    assert_eq!(status(&mut bench), kept);
    // The same once more is no change; another is.
    bench.send(&ToBoard::SetPlan(Plan::fast()));
    bench.send(&ToBoard::SetExcitation(700));
    assert_eq!(status(&mut bench), kept);
    for change in [
        ToBoard::SetPlan(Plan::fastest()),
        ToBoard::SetWatch(Some(Watch::paper())),
    ] {
        bench.send(&ToBoard::SaveSettings);
        assert_eq!(status(&mut bench), kept);
        bench.send(&change);
        let others = Stored::Others;
        assert_eq!(status(&mut bench), Status { stored: others, ..kept }, "{change:?}");
    }
    // After a restart what was stored is in force, and the board measures; what it does about its watch is told.
    bench.send(&ToBoard::SaveSettings);
    bench.run(0.05);
    let flash = bench.board.flash().clone();
    let config = |flash: &Flash| SimConfig {
        flash: Some(flash.clone()),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config(&flash), FixedSheet(disc(16)));
    let running = Status {
        running: true,
        watching: Watching::Asleep,
        ..kept
    };
    bench.run(0.1);
    assert_eq!(status(&mut bench), running);
    bench.run(1.0);
    bench.send(&ToBoard::Stop);
    assert_eq!(status(&mut bench), kept);
    bench.send(&ToBoard::ForgetSettings);
    let forgotten = Stored::Nothing;
    assert_eq!(
        status(&mut bench),
        Status {
            stored: forgotten,
            ..kept
        }
    );
    // Sixteen electrodes' settings on a board of eight.
    let mut bench = Bench::new(config(&flash), FixedSheet(disc(8)));
    let unusable = Stored::Unusable;
    assert_eq!(
        status(&mut bench),
        Status {
            stored: unusable,
            ..fresh
        }
    );
}

#[test]
fn a_memory_that_does_not_keep_what_is_written_is_told_and_the_older_settings_stay() {
    let new = settings(999);
    let mut refused = 0;
    // Histories that end in all places of the log; every byte of the new record in turn has a bit that cannot become 0.
    for savings in 0..24 {
        let (before, old) = worn(1024, savings);
        let mut whole = before.clone();
        settings::save(&mut whole, &new).unwrap();
        for (sector, offset) in written_bytes(&before, &whole) {
            for bit in 0..8 {
                let mut flash = before.clone();
                flash.stuck = Some((sector, offset, 1 << bit));
                let saved = settings::save(&mut flash, &new);
                let found = settings::load(&mut flash).unwrap();
                let mut byte = [0];
                whole.read(sector, offset, &mut byte).unwrap();
                let harmless = byte[0] >> bit & 1 == 1;
                let expected = if harmless { Ok(()) } else { Err(StoreFault::ReadBack) };
                assert_eq!(saved, expected, "{savings} {sector:?} {offset} {bit}");
                let in_force = if harmless { Some(new.clone()) } else { old.clone() };
                assert_eq!(found, in_force, "{savings} {sector:?} {offset} {bit}");
                refused += u32::from(!harmless);
            }
        }
    }
    println!("{refused} savings with one bit that does not hold, every one refused, the older settings in force");
    assert!(refused > 1000, "{refused}");
}

/// Where two memories differ in what was written: the bytes of one saving.
fn written_bytes(before: &Flash, after: &Flash) -> Vec<(Sector, u32)> {
    let (mut before, mut after, mut out) = (before.clone(), after.clone(), Vec::new());
    for sector in [Sector::A, Sector::B] {
        for offset in 0..after.sector_len() {
            let [mut a, mut b] = [[0], [0]];
            before.read(sector, offset, &mut a).unwrap();
            after.read(sector, offset, &mut b).unwrap();
            if a != b && b != [0xFF] {
                out.push((sector, offset));
            }
        }
    }
    out
}

#[test]
fn a_board_says_that_its_memory_does_not_keep_what_is_written() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    bench.run(0.01);
    bench.send(&ToBoard::SaveSettings);
    assert_eq!(status(&mut bench).stored, Stored::InForce);
    // The first byte behind the record, and behind what a cut may have left there.
    let last = written_bytes(&Flash::new(2048), bench.board.flash()).pop().unwrap().1;
    bench.board.flash().stuck = Some((Sector::A, last + 17, 0xFF));
    bench.send(&ToBoard::SetExcitation(700));
    bench.send(&ToBoard::SaveSettings);
    let said = bench.run(0.05);
    let refused = FromBoard::Error(BoardError::Refused(Refusal::ReadBack));
    assert_eq!(said, [FromBoard::Ack(Command::SetExcitation), refused]);
    assert_eq!(status(&mut bench).stored, Stored::Others);
    let found = settings::load(bench.board.flash()).unwrap().unwrap();
    assert_eq!(found.excitation_permille, 1000);
    // Behind it is room that holds.
    bench.send(&ToBoard::SaveSettings);
    assert_eq!(status(&mut bench).stored, Stored::InForce);
}

#[test]
fn a_hostile_memory_is_looked_through_without_keeping_the_watchdog_waiting() {
    // What looks like the beginning of a record of 421 bytes at every second byte, at every fourth, and noise.
    let fills: [fn(usize) -> u8; 3] = [
        |k| [0xA5, 0x01][k % 2],
        |k| [0xA5, 0x01, 0x00, 0x02][k % 4],
        |k| (k as u32).wrapping_mul(2_654_435_761).to_be_bytes()[0],
    ];
    for fill in fills {
        let mut flash = Flash::new(16 * 1024);
        for sector in [Sector::A, Sector::B] {
            let bytes: Vec<u8> = (0..16 * 1024).map(fill).collect();
            flash.write(sector, 0, &bytes).unwrap();
        }
        assert_eq!(settings::load(&mut flash), Ok(None));
        let (read, unfed) = flash.read_unfed();
        println!("{read} bytes read, {unfed} at most between two feeds");
        // A record, and what is read of it once it counts.
        assert!(unfed <= 1100, "{unfed}");
        // And it is a memory like any other afterwards.
        settings::save(&mut flash, &settings(3)).unwrap();
        assert_eq!(settings::load(&mut flash), Ok(Some(settings(3))));
    }
}
