//! Outlines, electrodes on them, and what is refused.

use super::*;

#[test]
fn a_polygon_on_a_line_is_flat() {
    let sheet = Sheet {
        outline: Outline::Polygon {
            points_mm: vec![[0.0, 0.0], [100.0, 0.0], [200.0, 0.0]],
        },
        ..Sheet::paper()
    };
    let error = Geometry::new(&sheet).unwrap_err();
    assert!(matches!(error, GeometryError::Flat { .. }), "{error}");
}

#[test]
fn electrodes_of_the_paper_sit_at_their_angles() {
    let g = Geometry::new(&Sheet::paper()).unwrap();
    for (l, p) in g.electrode_centres().iter().enumerate() {
        let a = std::f64::consts::TAU * l as f64 / 16.0;
        assert!(distance(*p, [97.5 * a.cos(), 97.5 * a.sin()]) < 1e-9);
    }
}

#[test]
fn angles_meet_other_outlines_where_the_ray_does() {
    let mut sheet = Sheet::paper();
    sheet.outline = Outline::Rectangle {
        width_mm: 200.0,
        height_mm: 100.0,
        centre_mm: [10.0, -5.0],
    };
    let g = Geometry::new(&sheet).unwrap();
    let c = g.electrode_centres();
    assert!(distance(c[0], [110.0, -5.0]) < 1e-6, "{:?}", c[0]);
    assert!(distance(c[4], [10.0, 45.0]) < 1e-6, "{:?}", c[4]);
    assert!(distance(c[2], [60.0, 45.0]) < 1e-6, "{:?}", c[2]);
    assert!(distance(c[8], [-90.0, -5.0]) < 1e-6, "{:?}", c[8]);
    // A triangle, so that a ray and its opposite differ: bounding box centre (50, 50).
    sheet.outline = Outline::Polygon {
        points_mm: vec![[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]],
    };
    sheet.electrodes = [180.0, 270.0]
        .map(|angle_deg| Electrode {
            place: Place::Angle {
                angle_deg,
                width_mm: 5.0,
            },
            contact_mm: 1.0,
        })
        .to_vec();
    let c = Geometry::new(&sheet).unwrap().electrode_centres();
    assert!(distance(c[0], [0.0, 50.0]) < 1e-6, "{:?}", c[0]);
    assert!(distance(c[1], [50.0, 0.0]) < 1e-6, "{:?}", c[1]);
}

#[test]
fn a_smooth_outline_is_no_circle_however_many_points_it_has() {
    // An ellipse through eight points: as many segments as a circle's polyline has.
    let (a, b) = (100.0, 50.0);
    let points_mm = (0..8).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4);
    let sheet = Sheet {
        outline: Outline::Smooth {
            points_mm: points_mm.map(|t| [a * t.cos(), b * t.sin()]).collect(),
        },
        ..Sheet::paper()
    };
    let g = Geometry::new(&sheet).unwrap();
    for (l, p) in g.electrode_centres().iter().enumerate() {
        let (seen, wanted) = (p[1].atan2(p[0]), std::f64::consts::TAU * l as f64 / 16.0);
        assert!((seen - wanted).sin().abs() < 0.01, "{l}: {seen} {wanted}");
    }
    // Two of the points exchanged: the outline crosses itself.
    let Outline::Smooth { mut points_mm } = sheet.outline else {
        unreachable!()
    };
    points_mm.swap(2, 6);
    let outline = Outline::Smooth { points_mm };
    let error = Geometry::new(&Sheet { outline, ..sheet }).unwrap_err();
    assert!(matches!(error, GeometryError::Crossing { .. }), "{error}");
}

#[test]
fn nonsense_is_refused_by_name() {
    let bow = Outline::Polygon {
        points_mm: vec![[0.0, 0.0], [100.0, 100.0], [100.0, 0.0], [0.0, 100.0]],
    };
    let check = |f: &dyn Fn(&mut Sheet)| {
        let mut sheet = Sheet::paper();
        f(&mut sheet);
        Geometry::new(&sheet).unwrap_err()
    };
    assert!(matches!(
        check(&|s| s.outline = bow.clone()),
        GeometryError::Crossing {
            segment: 0,
            other_segment: 2,
            ..
        }
    ));
    assert!(matches!(
        check(&|s| s.electrodes[3].place = Place::Angle {
            angle_deg: 46.0,
            width_mm: 10.0
        }),
        GeometryError::Overlap { first: 2, second: 3 }
    ));
    assert!(matches!(
        check(&|s| s.electrodes[5].place = Place::Point {
            point_mm: [90.0, 0.0],
            width_mm: 5.0
        }),
        GeometryError::OffTheRim { electrode: 5, .. }
    ));
    assert!(matches!(
        check(&|s| s.electrodes[7].place = Place::Angle {
            angle_deg: 157.5,
            width_mm: 0.0
        }),
        GeometryError::NotPositive { .. }
    ));
    assert!(matches!(
        check(&|s| s.electrodes[7].contact_mm = f64::NAN),
        GeometryError::NotPositive { .. }
    ));
    assert!(matches!(
        check(&|s| s.electrodes[7].place = Place::Inside {
            centre_mm: [95.0, 0.0],
            radius_mm: 5.0
        }),
        GeometryError::NotInside { electrode: 7 }
    ));
    assert!(matches!(
        check(&|s| s.holes.push(Outline::Disc {
            diameter_mm: 10.0,
            centre_mm: [200.0, 0.0]
        })),
        GeometryError::HoleOutside { .. }
    ));
    assert!(matches!(
        check(&|s| s.holes.push(Outline::Disc {
            diameter_mm: 20.0,
            centre_mm: [95.0, 0.0]
        })),
        GeometryError::Crossing { .. }
    ));
    assert!(matches!(
        check(&|s| s.electrodes.truncate(1)),
        GeometryError::TooFewElectrodes { count: 1 }
    ));
    let message = check(&|s| {
        s.electrodes[3].place = Place::Angle {
            angle_deg: 46.0,
            width_mm: 10.0,
        }
    })
    .to_string();
    // The third and the fourth.
    assert!(message.contains("electrodes 3 and 4"), "{message}");
}

#[test]
fn lengths_that_no_sheet_has_are_refused_before_they_overflow() {
    let disc = |diameter_mm| Geometry::new(&Sheet::disc(diameter_mm, 16, 0.05 * diameter_mm, 1.0, 1000.0));
    assert!(disc(1e5).is_ok() && disc(0.1).is_ok());
    for wild in [1e-4, 1e7, 1e18, f64::MAX] {
        let error = disc(wild).unwrap_err();
        assert!(matches!(error, GeometryError::OutOfRange { .. }), "{error}");
    }
    let points_mm = vec![[-50.0, -50.0], [60.0, 1e308], [40.0, 70.0]];
    for outline in [
        Outline::Smooth {
            points_mm: points_mm.clone(),
        },
        Outline::Polygon { points_mm },
    ] {
        let error = Geometry::new(&Sheet {
            outline,
            ..Sheet::paper()
        })
        .unwrap_err()
        .to_string();
        assert!(error.contains("point 1") && error.contains("(mm)"), "{error}");
    }
    let points_mm = (0..20_000).map(|k| [f64::from(k), 0.0]).collect();
    let outline = Outline::Polygon { points_mm };
    let error = Geometry::new(&Sheet {
        outline,
        ..Sheet::paper()
    })
    .unwrap_err();
    assert_eq!(error, GeometryError::TooManySegments { segments: 20_000 });
}
