//! Where the labels of the touches go: beside their ring, not on another ring or label, not off the edge.

use inverse::touches::touch::Touch;

/// A ring that wants a label; pixels, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Centre.
    pub x: f32,
    /// Centre.
    pub y: f32,
    /// Radius.
    pub radius: f32,
    /// Width of its label.
    pub width: f32,
    /// Height of its label.
    pub height: f32,
}

/// A rectangle; pixels, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Width.
    pub width: f32,
    /// Height.
    pub height: f32,
}

impl Area {
    /// Area shared with another, px².
    pub fn overlap(&self, other: &Self) -> f32 {
        let shared = |a: f32, al: f32, b: f32, bl: f32| ((a + al).min(b + bl) - a.max(b)).max(0.0);
        shared(self.x, self.width, other.x, other.width) * shared(self.y, self.height, other.y, other.height)
    }
}

/// Sides of a ring in the order in which they are liked.
const SIDES: [(f32, f32); 8] = [
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.7, -0.7),
    (-0.7, -0.7),
    (0.7, 0.7),
    (-0.7, 0.7),
    (0.0, -1.0),
    (0.0, 1.0),
];

/// A place for every label, inside `bounds` wherever possible and off the `marks` where that is cheap. Earlier rings
/// choose first: give the strongest first.
pub fn place(all: &[Ring], bounds: Area, marks: &[Area]) -> Vec<Area> {
    let circles: Vec<Area> = all.iter().map(|r| square(r.x, r.y, r.radius + 2.0)).collect();
    let mut placed: Vec<Area> = Vec::with_capacity(all.len());
    for ring in all {
        let cost = |(liking, area): &(f32, Area)| {
            let outside = area.width * area.height - area.overlap(&bounds);
            let labels: f32 = placed.iter().map(|p| p.overlap(area)).sum();
            let covered: f32 = circles.iter().map(|c| c.overlap(area)).sum();
            let marks: f32 = marks.iter().map(|m| m.overlap(area)).sum();
            let crossed = rings_between(ring, area, all) as f32;
            40.0 * outside + 25.0 * labels + 20.0 * covered + 0.25 * marks + 150.0 * crossed + liking
        };
        let best = candidates(ring).min_by(|a, b| cost(a).total_cmp(&cost(b)));
        placed.extend(best.map(|(_, area)| area));
    }
    placed
}

/// How many other rings the way from a ring to the middle of its label crosses.
fn rings_between(ring: &Ring, label: &Area, all: &[Ring]) -> usize {
    let (dx, dy) = (
        label.x + 0.5 * label.width - ring.x,
        label.y + 0.5 * label.height - ring.y,
    );
    let crosses = |other: &&Ring| {
        let (ox, oy) = (other.x - ring.x, other.y - ring.y);
        let t = ((ox * dx + oy * dy) / (dx * dx + dy * dy).max(1.0)).clamp(0.0, 1.0);
        *other != ring && (ox - t * dx).hypot(oy - t * dy) < other.radius
    };
    // Rings that overlap are not between.
    let apart = |other: &&Ring| (other.x - ring.x).hypot(other.y - ring.y) > other.radius;
    all.iter().filter(apart).filter(crosses).count()
}

fn candidates(ring: &Ring) -> impl Iterator<Item = (f32, Area)> + '_ {
    let gaps = [0.0, 1.0, 2.2, 3.6].map(|k| 6.0 + k * ring.height);
    gaps.into_iter().flat_map(move |gap| {
        SIDES.iter().enumerate().map(move |(k, &(dx, dy))| {
            let reach = ring.radius + gap;
            let area = Area {
                x: ring.x + dx * reach + 0.5 * ring.width * (sign(dx) - 1.0),
                y: ring.y + dy * reach + 0.5 * ring.height * (sign(dy) - 1.0),
                width: ring.width,
                height: ring.height,
            };
            (4.0 * gap + k as f32, area)
        })
    })
}

/// Sign, with 0 for 0.
fn sign(v: f32) -> f32 {
    if v == 0.0 { 0.0 } else { v.signum() }
}

/// A square around a point.
pub(super) fn square(x: f32, y: f32, half: f32) -> Area {
    Area {
        x: x - half,
        y: y - half,
        width: 2.0 * half,
        height: 2.0 * half,
    }
}

/// Radius of the ring drawn around a touch, mm: a disc of the pressed area and a little more, within what can be seen.
pub fn ring_radius_mm(touch: &Touch) -> f64 {
    let radius = (touch.area_mm2.max(0.0) / std::f64::consts::PI).sqrt() + 2.0;
    if radius.is_finite() {
        radius.clamp(7.0, 30.0)
    } else {
        7.0
    }
}

/// A rise in whole per cent, with its sign: "+20 %".
pub fn rise_text(rise: f64) -> String {
    format!("{:+.0} %", 100.0 * rise).replace('-', "\u{2212}")
}

/// How strong a touch is: "+20 %", and "≥ +1133 %" where that is the model's limit. Where the force is known "+20 %  12.3 N", and where
/// it is that of a typical rubber "+20 %  ≈ 12 N".
pub fn strength_text(touch: &Touch) -> String {
    let force = match touch.force_n {
        Some(force_n) if touch.uncalibrated => format!("  \u{2248} {force_n:.0} N"),
        Some(force_n) => format!("  {force_n:.1} N"),
        None => String::new(),
    };
    let limit = match (touch.at_limit, touch.rise < 0.0) {
        (false, _) => "",
        (true, false) => "\u{2265} ",
        (true, true) => "\u{2264} ",
    };
    format!("{limit}{}{force}", rise_text(touch.rise))
}

/// A place: "12.3, −40.1 mm".
pub fn place_text(touch: &Touch) -> String {
    // Adding 0 turns a rounded "-0.0" into "0.0".
    let tenth = |v: f64| (v * 10.0).round() / 10.0 + 0.0;
    format!("{:.1}, {:.1} mm", tenth(touch.x_mm), tenth(touch.y_mm)).replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Area = Area {
        x: 0.0,
        y: 0.0,
        width: 600.0,
        height: 600.0,
    };

    fn ring(x: f32, y: f32) -> Ring {
        Ring {
            x,
            y,
            radius: 25.0,
            width: 110.0,
            height: 36.0,
        }
    }

    #[test]
    fn labels_keep_clear_of_rings_and_of_each_other() {
        // Four fingers side by side, one at the edge, one in a corner.
        let rings = [
            ring(250.0, 300.0),
            ring(310.0, 290.0),
            ring(370.0, 300.0),
            ring(300.0, 350.0),
            ring(590.0, 300.0),
        ];
        let places = place(&rings, BOUNDS, &[]);
        assert_eq!(places.len(), rings.len());
        for (k, a) in places.iter().enumerate() {
            assert!(
                (a.overlap(&BOUNDS) - a.width * a.height).abs() < 0.1,
                "label {k} leaves the image: {a:?}"
            );
            assert!(
                places[..k].iter().all(|b| a.overlap(b) == 0.0),
                "label {k} covers another"
            );
            for r in &rings {
                assert_eq!(a.overlap(&square(r.x, r.y, r.radius)), 0.0, "label {k} covers a ring");
            }
        }
    }

    #[test]
    fn a_lone_label_is_to_the_right() {
        let free = place(&[ring(100.0, 200.0)], BOUNDS, &[])[0];
        assert_eq!((free.x, free.y), (131.0, 182.0));
        // Unless a mark is there.
        let beside = place(&[ring(300.0, 200.0)], BOUNDS, &[square(350.0, 200.0, 8.0)])[0];
        assert_eq!((beside.x, beside.y), (300.0 - 31.0 - 110.0, 182.0));
    }

    #[test]
    fn numbers_read_well() {
        let touch = Touch {
            id: Some(1),
            x_mm: -0.04,
            y_mm: -40.06,
            rise: 0.2,
            area_mm2: 300.0,
            ..Touch::default()
        };
        assert_eq!(place_text(&touch), "0.0, \u{2212}40.1 mm");
        assert_eq!(
            (rise_text(0.204), rise_text(-0.5)),
            ("+20 %".into(), "\u{2212}50 %".into())
        );
        let pressed = Touch {
            force_n: Some(12.34),
            ..touch
        };
        assert_eq!(
            (strength_text(&touch), strength_text(&pressed)),
            ("+20 %".into(), "+20 %  12.3 N".into())
        );
        let typical = Touch {
            uncalibrated: true,
            ..pressed
        };
        assert_eq!(strength_text(&typical), "+20 %  \u{2248} 12 N");
        let limit = |rise| Touch {
            rise,
            at_limit: true,
            ..touch
        };
        assert_eq!(
            (strength_text(&limit(11.3333)), strength_text(&limit(-0.919))),
            ("\u{2265} +1133 %".into(), "\u{2264} \u{2212}92 %".into())
        );
    }
}
