//! What is written is what ROS 2 reads, held against another decoder of CDR where there is one, and against turns by hand.

use super::*;
use std::f64::consts::FRAC_PI_2;

fn touch() -> Touch {
    Touch {
        id: Some(7),
        x_mm: 30.0,
        y_mm: -40.0,
        rise: 0.25,
        area_mm2: 500.0,
        total_mm2: 100.0,
        x_sd_mm: Some(0.5),
        y_sd_mm: Some(2.0),
        force_n: Some(12.5),
        ..Touch::default()
    }
}

/// About the frame's x, then y, then z, each by its own matrix.
fn by_hand(place: &Place, mm: [f64; 3]) -> [f64; 3] {
    let turned = |[a, b]: [f64; 2], deg: f64| {
        let (s, c) = deg.to_radians().sin_cos();
        [c * a - s * b, s * a + c * b]
    };
    let [roll, pitch, yaw] = place.roll_pitch_yaw_deg;
    let [mut x, mut y, mut z] = mm;
    [y, z] = turned([y, z], roll);
    [z, x] = turned([z, x], pitch);
    [x, y] = turned([x, y], yaw);
    let [a, b, c] = place.position_mm;
    [x + a, y + b, z + c]
}

fn place() -> Place {
    Place {
        frame: "elbow".to_owned(),
        position_mm: [150.0, -20.0, 45.0],
        roll_pitch_yaw_deg: [20.0, -75.0, 130.0],
    }
}

/// The last octets of a message of points that belong to its data, without the flag behind them.
fn data(message: Cdr, points: usize) -> Vec<[u8; 4]> {
    let bytes = message.into_bytes();
    let data = &bytes[..bytes.len() - 1];
    let words = data[data.len() - 4 * POINT.len() * points..].chunks_exact(4);
    words.map(|word| [word[0], word[1], word[2], word[3]]).collect()
}

#[test]
fn points_lie_where_the_place_puts_the_touches() {
    let place = place();
    let (a, b) = (
        touch(),
        Touch {
            x_mm: -90.0,
            force_n: None,
            id: None,
            ..touch()
        },
    );
    let header = Header {
        unix_ns: 0,
        frame: "elbow",
    };
    let words = data(points(header, &Pose::of(Some(&place)), &[a, b]), 2);
    let number = |k: usize| f64::from(f32::from_le_bytes(words[k]));
    let origin = by_hand(&place, [0.0; 3]);
    let tip = by_hand(&place, [0.0, 0.0, 1.0]);
    for (row, touch) in [a, b].iter().enumerate() {
        let at = by_hand(&place, [touch.x_mm, touch.y_mm, 0.0]);
        for k in 0..3 {
            assert!((number(9 * row + k) - 1e-3 * at[k]).abs() < 1e-7);
            assert!((number(9 * row + 3 + k) - (tip[k] - origin[k])).abs() < 1e-6);
        }
        assert_eq!(number(9 * row + 7), 0.25);
    }
    assert!(number(6) == 12.5 && number(15).is_nan());
    assert_eq!((u32::from_le_bytes(words[8]), u32::from_le_bytes(words[17])), (7, 0));
}

#[test]
fn a_transform_is_the_pose_of_the_points() {
    let turned = Place {
        roll_pitch_yaw_deg: [0.0, 0.0, 90.0],
        ..place()
    };
    let bytes = transforms(0, &[("elbow", "arm_sheet", &Pose::of(Some(&turned)))]).into_bytes();
    let numbers: Vec<f64> = bytes[bytes.len() - 56..]
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
        .collect();
    let half = (FRAC_PI_2 / 2.0).sin();
    for (found, expected) in numbers.iter().zip([0.15, -0.02, 0.045, 0.0, 0.0, half, half]) {
        assert!((found - expected).abs() < 1e-12, "{numbers:?}");
    }
}

#[test]
fn names_are_those_that_ros_takes() {
    for (skin, expected) in [
        ("palm", "palm"),
        ("left-arm", "left_arm"),
        ("2nd", "skin_2nd"),
        ("_x", "_x"),
    ] {
        assert_eq!(name(skin), expected);
    }
}

#[cfg(feature = "ros2")]
mod decoded {
    use super::*;
    use rustdds::RepresentationIdentifier;
    use rustdds::serialization::deserialize_from_cdr_with_rep_id;
    use serde::Deserialize;

    #[derive(Deserialize, Debug, PartialEq)]
    struct Stamped {
        sec: i32,
        nanosec: u32,
        frame_id: String,
    }

    #[derive(Deserialize)]
    struct TouchMessage {
        id: u32,
        position: [f64; 3],
        covariance: [f64; 9],
        rise: f64,
        area: [f64; 2],
        total: [f64; 2],
        force: f64,
        uncalibrated: bool,
    }

    #[derive(Deserialize)]
    struct TouchesMessage {
        header: Stamped,
        frame: u32,
        time_s: f64,
        touches: Vec<TouchMessage>,
        doubt: String,
    }

    #[derive(Deserialize)]
    struct ImageMessage {
        header: Stamped,
        height: u32,
        width: u32,
        encoding: String,
        is_bigendian: u8,
        step: u32,
        data: Vec<u8>,
    }

    fn read<T: serde::de::DeserializeOwned>(message: Cdr) -> T {
        let bytes = message.into_bytes();
        let (value, taken) = deserialize_from_cdr_with_rep_id(&bytes[4..], RepresentationIdentifier::CDR_LE).unwrap();
        assert_eq!(taken, bytes.len() - 4);
        value
    }

    #[test]
    fn another_decoder_reads_the_touches() {
        let header = Header {
            unix_ns: 1_700_000_000_123_456_789,
            frame: "palm_sheet",
        };
        let unknown = Touch {
            x_sd_mm: None,
            id: None,
            force_n: None,
            uncalibrated: true,
            ..touch()
        };
        let message: TouchesMessage = read(touches(header, 4_000_000_000, 0.5, &[touch(), unknown], "odd"));
        assert_eq!(
            (message.header.sec, message.header.nanosec),
            (1_700_000_000, 123_456_789)
        );
        assert_eq!(
            (message.header.frame_id.as_str(), message.frame),
            ("palm_sheet", 4_000_000_000)
        );
        assert_eq!((message.time_s, message.doubt.as_str()), (0.5, "odd"));
        let [first, second] = &message.touches[..] else {
            panic!()
        };
        assert_eq!((first.id, first.position), (7, [0.03, -0.04, 0.0]));
        assert!((first.covariance[0] - 0.25e-6).abs() < 1e-18 && (first.covariance[4] - 4e-6).abs() < 1e-18);
        assert_eq!((first.rise, first.force, first.uncalibrated), (0.25, 12.5, false));
        assert!((first.area[0] - 5e-4).abs() < 1e-15 && first.area[1].is_nan());
        assert!((first.total[0] - 1e-4).abs() < 1e-15 && first.total[1].is_nan());
        assert_eq!((second.id, second.covariance[0], second.uncalibrated), (0, -1.0, true));
        assert!(second.force.is_nan());
    }

    #[test]
    fn an_image_has_its_first_row_at_the_top() {
        let sheet = forward::Sheet::paper();
        let geometry = forward::Geometry::new(&sheet).unwrap();
        let grid = CellGrid::new(&geometry, 20.0).unwrap();
        let rise: Vec<f32> = (0..grid.len()).map(|cell| grid.centre(cell)[1] as f32).collect();
        let message: ImageMessage = read(image(Header { unix_ns: 0, frame: "s" }, &grid, &rise));
        let (columns, rows) = grid.shape();
        assert_eq!((message.width as usize, message.height as usize), (columns, rows));
        assert_eq!(
            (message.encoding.as_str(), message.is_bigendian, message.step),
            ("32FC1", 0, message.width * 4)
        );
        assert_eq!(
            message.header,
            Stamped {
                sec: 0,
                nanosec: 0,
                frame_id: "s".to_owned()
            }
        );
        let pixels: Vec<f32> = message
            .data
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        assert_eq!(pixels.iter().filter(|p| p.is_finite()).count(), grid.len());
        for row in 0..rows {
            let y_mm = grid.low_mm()[1] + (rows - 1 - row) as f64 * 20.0 + 10.0;
            let known = pixels[row * columns..][..columns].iter().filter(|p| p.is_finite());
            assert!(
                known.into_iter().all(|p| (f64::from(*p) - y_mm).abs() < 1e-4),
                "row {row}"
            );
        }
    }
}
