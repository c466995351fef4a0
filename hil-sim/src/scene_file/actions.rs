//! From the file's actions to touches with keys.

use super::error::Mistake;
use super::schema::{HandTable, KeyTable, Press, Repeat, ShapeName, Slide, StretchTable, Tap, TouchTable};
use crate::stretch::{Stretch, StretchField};
use crate::touch::{Key, Shape, Touch};
use std::ops::Range;
use toml::Spanned;

/// The touch of a table.
pub(super) fn touch(table: &Spanned<TouchTable>) -> Result<Touch, Mistake> {
    let (span, table) = (table.span(), table.get_ref());
    let mistake = |message: &str| Mistake::new(span.clone(), message);
    if table.aspect.is_some() && table.shape != ShapeName::Pad {
        return Err(mistake("only a pad has an aspect; leave it out"));
    }
    if table.full_size_n.is_some() && table.shape == ShapeName::Disc {
        return Err(mistake(
            "a disc's size does not change with the force; leave full_size_n out",
        ));
    }
    let (shape, radius_mm) = match table.shape {
        ShapeName::Disc => (Shape::Disc, 12.5),
        ShapeName::Finger => (Shape::Finger, 6.75),
        ShapeName::Pad => {
            let aspect = table.aspect.map_or(0.5, |a| a.0);
            (Shape::Pad { aspect }, 10.0)
        }
        ShapeName::Palm => (Shape::Palm, 36.0),
    };
    let given = [
        table.keys.as_ref().map(|keys| keyed(keys)),
        table.press.as_ref().map(|p| Ok(pressed(p))),
        table.tap.as_ref().map(|t| Ok(tapped(t))),
        table.slide.as_ref().map(|s| Ok(slid(s))),
        table.repeat.as_ref().map(|r| Ok(repeated(r))),
    ];
    let keys = only(given).ok_or_else(|| mistake("a touch needs exactly one of keys, press, tap, slide and repeat"))?;
    Ok(Touch {
        full_size_n: table.full_size_n.map(|n| n.0),
        ..Touch::new(shape, table.radius_mm.map_or(radius_mm, |r| r.0), keys?)
    })
}

/// The one that is given.
fn only<T, const N: usize>(given: [Option<T>; N]) -> Option<T> {
    let mut given = given.into_iter().flatten();
    let first = given.next();
    first.filter(|_| given.next().is_none())
}

fn keyed(tables: &[Spanned<KeyTable>]) -> Result<Vec<Key>, Mistake> {
    let mut key = Key::new(f64::NEG_INFINITY, 0.0, 0.0, 0.0);
    let mut keys = Vec::new();
    for table in tables {
        let (span, table) = (table.span(), table.get_ref());
        later(span, table.t_s.0, key.t_s)?;
        key.t_s = table.t_s.0;
        key.x_mm = table.x_mm.map_or(key.x_mm, |v| v.0);
        key.y_mm = table.y_mm.map_or(key.y_mm, |v| v.0);
        key.force_n = table.force_n.map_or(key.force_n, |v| v.0);
        key.angle_deg = table.angle_deg.map_or(key.angle_deg, |v| v.0);
        keys.push(key);
    }
    Ok(keys)
}

fn later(span: Range<usize>, t_s: f64, before_s: f64) -> Result<(), Mistake> {
    if t_s > before_s {
        return Ok(());
    }
    let message = format_args!("t_s is {t_s}, but the key before is at {before_s}; keys must go on in time");
    Err(Mistake::new(span, message))
}

/// Up over a ramp, along a way, down over a ramp.
fn loaded(at_s: f64, for_s: f64, ramp_s: f64, from: Key, to: Key) -> Vec<Key> {
    let at = |t_s, key: Key, force_n| Key { t_s, force_n, ..key };
    let (up, end) = (at_s + ramp_s, at_s + ramp_s + for_s);
    let mut keys = vec![at(up, from, from.force_n), at(end, to, to.force_n)];
    if ramp_s > 0.0 {
        keys.insert(0, at(at_s, from, 0.0));
        if end.is_finite() {
            keys.push(at(end + ramp_s, to, 0.0));
        }
    }
    keys
}

fn pressed(press: &Press) -> Vec<Key> {
    let key = Key {
        angle_deg: press.angle_deg.0,
        ..Key::new(0.0, press.x_mm.0, press.y_mm.0, press.force_n.0)
    };
    let for_s = press.for_s.map_or(f64::INFINITY, |s| s.0);
    loaded(press.at_s.0, for_s, press.ramp_s.0, key, key)
}

fn tapped(tap: &Tap) -> Vec<Key> {
    let key = Key::new(0.0, tap.x_mm.0, tap.y_mm.0, tap.force_n.0);
    loaded(tap.at_s.0, tap.for_s.0, tap.ramp_s.0, key, key)
}

fn slid(slide: &Slide) -> Vec<Key> {
    let end = |[x, y]: [super::number::Finite; 2], angle_deg| Key {
        angle_deg,
        ..Key::new(0.0, x.0, y.0, slide.force_n.0)
    };
    let from = end(slide.from_mm, slide.from_deg.0);
    let to = end(slide.to_mm, slide.to_deg.0);
    loaded(slide.at_s.0, slide.for_s.0, slide.ramp_s.0, from, to)
}

fn repeated(repeat: &Repeat) -> Vec<Key> {
    let key = Key {
        angle_deg: repeat.angle_deg.0,
        ..Key::new(0.0, repeat.x_mm.0, repeat.y_mm.0, repeat.force_n.0)
    };
    // A moment without force parts loads that follow each other without a ramp or a rest.
    let ramp_s = repeat.ramp_s.0.max(1e-3);
    let each_s = repeat.press_s.0 + 2.0 * ramp_s + repeat.rest_s.0;
    let mut keys: Vec<Key> = Vec::new();
    for k in 0..repeat.count {
        let at_s = repeat.at_s.0 + f64::from(k) * each_s;
        for next in loaded(at_s, repeat.press_s.0, ramp_s, key, key) {
            // Without a rest one load's end is the next one's beginning.
            if keys.last().is_none_or(|last| next.t_s > last.t_s + 1e-9) {
                keys.push(next);
            }
        }
    }
    keys
}

/// Fingertips of a hand, in half widths of its palm, seen from above: thumb to little finger of a right hand.
const FINGERTIPS: [[f64; 2]; 5] = [[-1.60, 0.55], [-0.60, 2.35], [-0.02, 2.55], [0.52, 2.35], [1.05, 1.80]];

/// Largest turn between two keys of a fingertip, degrees: a chord of 5 degrees is within 0.1 % of its arc.
const TURN_DEG: f64 = 5.0;

/// The touches of a hand: the palm and five fingertips that move with it.
pub(super) fn hand(table: &Spanned<HandTable>) -> Result<Vec<Touch>, Mistake> {
    let (span, table) = (table.span(), table.get_ref());
    let given = [
        table.keys.as_ref().map(|keys| keyed(keys)),
        table.press.as_ref().map(|p| Ok(pressed(p))),
    ];
    let none = || Mistake::new(span.clone(), "a hand needs exactly one of keys and press");
    let keys = finer(&only(given).ok_or_else(none)??, &span)?;
    let half = 0.5 * table.palm_width_mm.0;
    let palm_share = table.palm_share_percent.0 / 100.0;
    let part = |shape, radius_mm, share: f64, [x, y]: [f64; 2]| {
        let keys = keys.iter().map(|key| {
            let (sin, cos) = libm::sincos(key.angle_deg.to_radians());
            Key {
                x_mm: key.x_mm + half * (x * cos - y * sin),
                y_mm: key.y_mm + half * (x * sin + y * cos),
                force_n: share * key.force_n,
                ..*key
            }
        });
        Touch::new(shape, radius_mm, keys.collect())
    };
    let palm = part(Shape::Palm, half, palm_share, [0.0; 2]);
    let tips = FINGERTIPS.map(|place| part(Shape::Finger, 6.75, (1.0 - palm_share) / 5.0, place));
    Ok([palm].into_iter().chain(tips).collect())
}

/// Most keys of a fingertip: it goes round some 1,400 times.
const MOST_KEYS: usize = 100_000;

/// The same keys with some between those that turn far.
fn finer(keys: &[Key], span: &Range<usize>) -> Result<Vec<Key>, Mistake> {
    let parts = |pair: &[Key]| {
        ((pair[1].angle_deg - pair[0].angle_deg).abs() / TURN_DEG)
            .ceil()
            .max(1.0)
    };
    let count: f64 = keys.windows(2).map(parts).sum();
    if count > MOST_KEYS as f64 {
        let message = format_args!("turns that take {count:e} keys, more than {MOST_KEYS}; turn less");
        return Err(Mistake::new(span.clone(), message));
    }
    let mut out = Vec::new();
    for pair in keys.windows(2) {
        let parts = parts(pair) as usize;
        out.extend((0..parts).map(|k| {
            crate::touch::between(&pair[0], &pair[1], {
                let u = k as f64 / parts as f64;
                // An endless stretch has one part only.
                if k == 0 {
                    pair[0].t_s
                } else {
                    pair[0].t_s + u * (pair[1].t_s - pair[0].t_s)
                }
            })
        }));
    }
    out.extend(keys.last());
    Ok(out)
}

/// The stretching of a table.
pub(super) fn stretch(table: &Spanned<StretchTable>) -> Result<Stretch, Mistake> {
    let (span, table) = (table.span(), table.get_ref());
    let field = match (table.x_mm, table.y_mm, table.radius_mm) {
        (None, None, None) => StretchField::Uniform,
        (Some(x), Some(y), Some(radius)) => StretchField::Bump {
            centre_mm: [x.0, y.0],
            radius_mm: radius.0,
        },
        _ => {
            let message = "a stretch around a place needs x_mm, y_mm and radius_mm; one all over has none of them";
            return Err(Mistake::new(span, message));
        }
    };
    if table.keys.is_empty() {
        return Err(Mistake::new(
            span,
            "a stretch needs at least one key with t_s and strain_percent",
        ));
    }
    let mut before_s = f64::NEG_INFINITY;
    let mut keys = Vec::new();
    for key in &table.keys {
        later(key.span(), key.get_ref().t_s.0, before_s)?;
        before_s = key.get_ref().t_s.0;
        keys.push((before_s, key.get_ref().strain_percent.0 / 100.0));
    }
    Ok(Stretch { field, keys })
}
