//! Arrays of frames in another program's order, as a table.

use super::arrays::{Array, Kind};
use super::measurements::{Column, MeasurementTable};
use super::order::{OrderError, described, fit, hint};
use ::forward::order::{Layout, ValueOrder};

/// The frames of a file's arrays as a table; `wanted` names the variables to take, all that fit where it is empty.
///
/// # Errors
/// [`OrderError`] lists what the file has.
pub(crate) fn table(
    order: ValueOrder,
    file: &str,
    kind: Kind,
    arrays: &[Array],
    wanted: &[String],
) -> Result<MeasurementTable, OrderError> {
    let found = described(arrays);
    if let Some(name) = wanted.iter().find(|w| arrays.iter().all(|a| a.name != **w)) {
        return Err(OrderError::NoSuchVariable {
            file: file.to_owned(),
            name: name.clone(),
            found,
        });
    }
    let asked = |array: &&Array| wanted.is_empty() || wanted.contains(&array.name);
    let fitting: Vec<(&Array, bool, Layout)> = arrays
        .iter()
        .filter(asked)
        .filter_map(|array| fit(order, array, kind).map(|(in_rows, layout)| (array, in_rows, layout)))
        .collect();
    let Some((_, _, layout)) = fitting.first() else {
        return Err(OrderError::Nothing {
            file: file.to_owned(),
            order: order.name(),
            counts: order.counts(),
            found,
            hint: hint(arrays),
        });
    };
    if let Some((_, _, other)) = fitting.iter().find(|(_, _, other)| other != layout) {
        return Err(OrderError::Mixed {
            file: file.to_owned(),
            first: layout.electrodes,
            second: other.electrodes,
        });
    }
    let kept: Vec<usize> = (0..layout.values.len())
        .filter(|k| layout.values[*k].is_some())
        .collect();
    let mut table = MeasurementTable {
        file: file.to_owned(),
        measurements: layout.values.iter().flatten().copied().collect(),
        electrodes: layout.electrodes,
        infinite: 0,
        columns: Vec::new(),
        sheet: None,
        rows: None,
        drive: None,
        notes: Vec::new(),
    };
    for (array, in_rows, _) in &fitting {
        for (line, comment) in &array.comments {
            let taken = table.comment(*line, comment);
            taken.map_err(|error| OrderError::Comment(error.to_string()))?;
        }
        let frames = if *in_rows { array.rows } else { array.columns };
        let across = if *in_rows { "rows" } else { "columns" };
        let subject = if array.name.is_empty() {
            "its".to_owned()
        } else {
            format!("variable {}: the", array.name)
        };
        table.notes.push(format!(
            "{subject} {across} are {frames} frames in the order {}",
            order.name()
        ));
        if array.complex {
            table
                .notes
                .push("the values are complex; their magnitudes are taken".to_owned());
        }
        for frame in 0..frames {
            let value = |k: usize| {
                let place = if *in_rows {
                    frame * array.columns + k
                } else {
                    k * array.columns + frame
                };
                array.values[place]
            };
            let mut values: Vec<f64> = kept.iter().map(|k| value(*k)).collect();
            for v in values.iter_mut().filter(|v| v.is_infinite()) {
                table.infinite += 1;
                *v = f64::NAN;
            }
            let number = (frame + 1).to_string();
            let name = match (fitting.len(), frames) {
                (1, _) => number,
                (_, 1) => array.name.clone(),
                _ => format!("{}:{number}", array.name),
            };
            table.columns.push(Column { name, values });
        }
    }
    let driven = layout.values.len() - kept.len();
    if driven > 0 {
        let all = layout.values.len();
        table.notes.push(format!(
            "{driven} of {all} values a frame were measured on electrodes that carry current and are left out"
        ));
    }
    let more = arrays.len() - fitting.len();
    if more > 0 && wanted.is_empty() {
        table.notes.push(format!(
            "{more} other variables are not frames in this order: the file has {found}"
        ));
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_rows_or_columns_by_what_fits() {
        let array = |name: &str, rows: usize, columns: usize| Array {
            name: name.to_owned(),
            rows,
            columns,
            values: (0..rows * columns).map(|k| k as f64).collect(),
            complex: false,
            comments: Vec::new(),
        };
        let rows = table(ValueOrder::Pyeit, "f", Kind::Npy, &[array("", 3, 208)], &[]).unwrap();
        assert_eq!((rows.columns.len(), rows.columns[1].values[2]), (3, 210.0));
        let columns = table(ValueOrder::Eidors, "f", Kind::Mat, &[array("vi", 208, 3)], &[]).unwrap();
        assert_eq!((columns.columns.len(), columns.columns[1].values[2]), (3, 7.0));
        // Both fit: MATLAB's are columns.
        let square = [array("v", 208, 928)];
        assert_eq!(
            table(ValueOrder::Eidors, "f", Kind::Mat, &square, &[])
                .unwrap()
                .electrodes,
            16
        );
        assert_eq!(
            table(ValueOrder::Eidors, "f", Kind::Npz, &square, &[])
                .unwrap()
                .electrodes,
            32
        );
        // Several variables keep their names, and what is no frame is said.
        let several = [array("vh", 208, 1), array("vi", 208, 2), array("t", 1, 7)];
        let taken = table(ValueOrder::Eidors, "f", Kind::Mat, &several, &[]).unwrap();
        let names: Vec<&str> = taken.columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["vh", "vi:1", "vi:2"]);
        assert!(taken.notes.iter().any(|n| n.contains("t (1 x 7)")), "{:?}", taken.notes);
        let one = table(ValueOrder::Eidors, "f", Kind::Mat, &several, &["vi".to_owned()]).unwrap();
        assert_eq!(one.columns.len(), 2);
        let error = table(ValueOrder::Eidors, "f", Kind::Mat, &several, &["x".to_owned()]).unwrap_err();
        assert!(error.to_string().contains("vh (208 x 1)"), "{error}");
        let error = table(ValueOrder::Adjacent16, "f", Kind::Npy, &[array("", 2, 928)], &[])
            .unwrap_err()
            .to_string();
        assert!(error.contains("--order pyeit") && error.contains("2 x 928"), "{error}");
        let timed = table(ValueOrder::Adjacent16, "f", Kind::Npy, &[array("", 999, 209)], &[]);
        let error = timed.unwrap_err().to_string();
        assert!(
            error.contains("209 is one more") && error.contains("leave out"),
            "{error}"
        );
    }
}
