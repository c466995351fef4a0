//! Datasets: their bytes, their labels, and how near their physics are to elements.

use forward::{Drive, Geometry, Sheet};
use studies::dataset::{Dataset, DatasetFile, Distribution, Physics, Row};
use studies::imager;

/// The file that docs/datasets.md begins with.
const EXAMPLE: &str = include_str!("../../scenes/touches.toml");

fn file(text: &str) -> DatasetFile {
    toml::from_str(text).unwrap()
}

fn dataset(text: &str) -> Dataset {
    Dataset::new(file(text), Sheet::paper()).unwrap()
}

/// A sheet of few frames.
fn small(change: impl FnOnce(&mut DatasetFile)) -> Dataset {
    let mut file = file(EXAMPLE);
    (file.frames_per_sheet, file.baseline_frames) = (60, 8);
    change(&mut file);
    Dataset::new(file, Sheet::paper()).unwrap()
}

fn frames(rows: &[Row]) -> impl Iterator<Item = &Row> {
    rows.iter().filter(|row| !row.baseline)
}

/// Not a number is equal to itself here.
fn bits(rows: &[Row]) -> Vec<u64> {
    rows.iter()
        .flat_map(|row| row.values_v.iter().map(|v| v.to_bits()))
        .collect()
}

#[test]
fn a_shard_is_told_by_its_number_alone() {
    let set = small(|file| file.frames_per_sheet = 12);
    let (first, second) = (set.shard(0).unwrap(), set.shard(1).unwrap());
    let again = small(|file| file.frames_per_sheet = 12).shard(1).unwrap();
    assert_eq!(bits(&second.rows), bits(&again.rows));
    assert_ne!(bits(&first.rows), bits(&second.rows));
    assert_ne!(first.devices[0].sheet, second.devices[0].sheet);
    assert_ne!(first.devices[0].electronics, second.devices[0].electronics);
    // A shard of two sheets has those of two shards of one.
    let both = small(|file| (file.frames_per_sheet, file.sheets_per_shard) = (12, 2));
    let both = both.shard(0).unwrap();
    let single: Vec<Row> = [first.rows, second.rows].concat();
    assert_eq!(bits(&both.rows), bits(&single));
    assert_eq!(
        both.rows.iter().map(|r| r.sheet).collect::<Vec<_>>(),
        [[0; 20], [1; 20]].concat()
    );
    let other = small(|file| (file.frames_per_sheet, file.seed) = (12, 2));
    assert_ne!(bits(&other.shard(1).unwrap().rows), bits(&again.rows));
}

#[test]
fn labels_are_what_the_file_asks_for() {
    let set = small(|file| file.frames_per_sheet = 600);
    let shard = set.shard(3).unwrap();
    let geometry = Geometry::new(&shard.devices[0].sheet).unwrap();
    let table = &set.file().touch;
    let mut counts = vec![0.0; table.count.len()];
    for row in frames(&shard.rows) {
        counts[row.touches.len()] += 1.0;
        assert_eq!(row.values_v.len(), 208);
        assert!(row.noise_v > 0.0 && row.resistance > 0.9 && row.resistance < 1.1);
        for (k, touch) in row.touches.iter().enumerate() {
            assert!(geometry.is_clear(touch.centre_mm, touch.radius_mm + table.rim_mm));
            assert!((6.0..=16.0).contains(&touch.radius_mm) && (0.05..=0.6).contains(&touch.rise));
            for other in &row.touches[..k] {
                let [dx, dy] = [0, 1].map(|axis| touch.centre_mm[axis] - other.centre_mm[axis]);
                assert!(dx.hypot(dy) > touch.radius_mm + other.radius_mm + table.apart_mm);
            }
        }
    }
    let weights: f64 = table.count.iter().sum();
    for (count, weight) in counts.iter().zip(&table.count) {
        let part = weight / weights;
        let deviation = (600.0 * part * (1.0 - part)).sqrt();
        assert!((count - 600.0 * part).abs() <= 5.0 * deviation, "{counts:?}");
    }
    let faults = frames(&shard.rows).filter(|row| row.fault.is_some()).count() as f64;
    let chance: f64 = set.file().fault.iter().map(|f| f.chance).sum();
    assert!((faults - 600.0 * chance).abs() < 5.0 * (600.0 * chance).sqrt());
    // Baselines are of whole, untouched sheets.
    let baselines: Vec<&Row> = shard.rows.iter().filter(|row| row.baseline).collect();
    assert_eq!(baselines.len(), 8);
    assert!(baselines.iter().all(|r| r.touches.is_empty() && r.fault.is_none()));
}

/// What discs change of the values, against elements on another mesh for every frame: the nonlinear model. Noise and all that is
/// drawn are the same. Touches are strong enough for a change far above a sixteenth of a code, to which values are rounded.
#[test]
fn discs_by_scattering_are_discs_on_a_mesh() {
    let without = |physics| {
        small(move |file| {
            file.physics = physics;
            file.fault.clear();
            file.touch.count = vec![0.0, 1.0, 1.0, 1.0];
            file.touch.radius_mm = Distribution::Fixed(13.0);
            file.touch.rise = Distribution::Fixed(0.6);
        })
    };
    let fast = without(Physics::Discs).shard(0).unwrap();
    let slow = without(Physics::Mesh).shard(0).unwrap();
    let baseline = |rows: &[Row]| -> Vec<f64> {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.baseline).collect();
        (0..208)
            .map(|k| rows.iter().map(|row| row.values_v[k]).sum::<f64>() / rows.len() as f64)
            .collect()
    };
    let untouched = baseline(&fast.rows);
    assert_eq!(untouched, baseline(&slow.rows));
    // Some values next to a strong touch clip.
    let square = |a: &[f64], b: &[f64]| {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
        squares.filter(|square| square.is_finite()).sum::<f64>()
    };
    let mut errors = Vec::new();
    for (a, b) in frames(&fast.rows).zip(frames(&slow.rows)) {
        assert_eq!(a.touches, b.touches);
        assert!(b.meshed);
        errors.push((square(&a.values_v, &b.values_v) / square(&b.values_v, &untouched)).sqrt());
    }
    errors.sort_by(f64::total_cmp);
    let (median, most) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    println!("error of the change, median {median:.2e}, largest {most:.2e}");
    assert!(median > 0.0 && median < 0.005 && most < 0.05, "{median} {most}");
    let meshed = frames(&fast.rows).filter(|row| row.meshed).count();
    assert!(meshed < 6, "{meshed} of 60 on a mesh");
}

/// A reconstruction that knows nothing of the sheet finds the touches where the labels say.
#[test]
fn the_labels_are_where_the_touches_are_found() {
    let set = small(|file| {
        file.fault.clear();
        file.touch.count = vec![0.0, 1.0];
        file.drift.resistance = Distribution::Fixed(1.0);
    });
    let shard = set.shard(0).unwrap();
    let baseline: Vec<f64> = (0..208)
        .map(|k| shard.rows[..8].iter().map(|row| row.values_v[k]).sum::<f64>() / 8.0)
        .collect();
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let found = inverse::reference::electrode_fit::find(&imager, &baseline).unwrap();
    let mut reconstructor = studies::reconstructor(&found.imager, &baseline).unwrap();
    let mut errors: Vec<f64> = frames(&shard.rows)
        .take(20)
        .map(|row| {
            let result = reconstructor.frame(&row.values_v).unwrap();
            let [x, y] = row.touches[0].centre_mm;
            let off = |t: &inverse::touches::touch::Touch| (t.x_mm - x).hypot(t.y_mm - y);
            result.touches.first().map_or(f64::INFINITY, off)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[10] < 1.5, "{errors:?}");
}

#[test]
fn an_uneven_sheet_is_solved_on_its_mesh() {
    let set = small(|file| {
        (file.frames_per_sheet, file.sheet.resistivity_sd) = (3, 0.05);
        file.touch.count = vec![0.0, 1.0];
    });
    assert!(frames(&set.shard(0).unwrap().rows).all(|row| row.meshed));
}

#[test]
fn what_cannot_be_is_said_with_its_key() {
    for (text, words) in [
        ("frames_per_sheet = 0", "frames_per_sheet: give 1 or more"),
        ("[touch]\ncount = [0.0, 0.0]", "touch.count: give how often"),
        ("[touch]\nradius_mm = -3", "touch.radius_mm: give numbers above 0"),
        (
            "[touch]\nradius_mm = { uniform = [9, 3] }",
            "touch.radius_mm: the first end is above",
        ),
        ("[touch]\nrise = -1.0", "touch.rise: give numbers above -1"),
        ("[board]\nplan = \"best\"", "board.plan: "),
        (
            "[board.electronics]\nnoise = 1.0",
            "board.electronics: there is no noise",
        ),
        ("[board.electronics]\nadc_bits = 99", "board.electronics: "),
        ("[board.electronics]\ninterference = 1.0", "interference is no number"),
        (
            "[[fault]]\nkind = \"contact_raised\"\nchance = 0.5",
            "fault.ohm: ContactRaised needs it",
        ),
        (
            "[[fault]]\nkind = \"source_lost\"\nchance = 1.5",
            "fault.chance: give parts",
        ),
        ("sheets_per_shard = 100000000", "sheets_per_shard: a shard has more"),
    ] {
        let failed = Dataset::new(file(text), Sheet::paper()).unwrap_err().to_string();
        assert!(failed.contains(words), "{text}: {failed}");
    }
    let wrong = toml::from_str::<DatasetFile>("[touch]\nrise = { around = 3 }").unwrap_err();
    assert!(wrong.to_string().contains("log_uniform"), "{wrong}");
    // As many frames as may be, and with 208 values too much for memory: 1.7 GB.
    let large = dataset("frames_per_sheet = 999_000").shard(0).unwrap_err().to_string();
    assert!(
        large.contains("sheets_per_shard: a shard has 999024 frames of 208 values"),
        "{large}"
    );
    let full = dataset("[touch]\ncount = [0, 1]\nradius_mm = 90\nrim_mm = 20");
    let failed = full.shard(0).unwrap_err().to_string();
    assert!(failed.contains("no room was found for 1 touches"), "{failed}");
    // Distributions without an end draw what no sheet has, sooner or later.
    for (text, words) in [
        (
            "[drift]\nresistance = { normal = [0.0, 1.0] }",
            "drift.resistance: a number that was drawn",
        ),
        (
            "[touch]\ncount = [0, 1]\nrise = { normal = [0.2, 1e308] }",
            "touch.rise: a number that was drawn",
        ),
    ] {
        let failed = dataset(text).shard(0).unwrap_err().to_string();
        assert!(failed.contains(words), "{text}: {failed}");
    }
}
