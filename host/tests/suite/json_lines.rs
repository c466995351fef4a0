//! The lines of `skin run --json` against their schema, docs/live.schema.json.

use crate::program::{Started, lines, output, program};
use inverse::reference::screening::FindingKind;
use serde_json::Value;
use std::process::Stdio;

/// Why a value is not as a schema has it; none where it is. Knows what the schema uses, and refuses what it does not know.
pub(crate) fn wrong(root: &Value, schema: &Value, value: &Value) -> Option<String> {
    let fail = |what: &str| Some(format!("{value} is not {what} {schema}"));
    for (key, rule) in schema.as_object().unwrap() {
        let is_wrong = match key.as_str() {
            "$schema" | "title" | "description" | "$defs" => None,
            "$ref" => {
                let path = rule.as_str().unwrap().strip_prefix('#').unwrap();
                wrong(root, root.pointer(path).unwrap(), value)
            }
            "oneOf" => {
                let fits = rule.as_array().unwrap().iter();
                match fits.filter(|s| wrong(root, s, value).is_none()).count() {
                    1 => None,
                    _ => fail("one of"),
                }
            }
            "const" => (value != rule).then(|| fail("const")).flatten(),
            "enum" => (!rule.as_array().unwrap().contains(value))
                .then(|| fail("in"))
                .flatten(),
            "type" => {
                let one = [rule.clone()];
                let types = rule.as_array().map_or(&one[..], Vec::as_slice);
                let is = |name: &Value| match name.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "number" => value.is_number(),
                    "integer" => value.is_u64() || value.is_i64(),
                    "null" => value.is_null(),
                    other => panic!("unknown type {other}"),
                };
                (!types.iter().any(is)).then(|| fail("of")).flatten()
            }
            "minimum" => (value.as_f64().is_some_and(|v| v < rule.as_f64().unwrap()))
                .then(|| fail("in"))
                .flatten(),
            "minItems" | "maxItems" => {
                let (count, bound) = (value.as_array().map_or(0, Vec::len), rule.as_u64().unwrap() as usize);
                let fits = if key == "minItems" {
                    count >= bound
                } else {
                    count <= bound
                };
                (!fits).then(|| fail("as long as")).flatten()
            }
            "items" => value
                .as_array()
                .and_then(|items| items.iter().find_map(|item| wrong(root, rule, item))),
            "required" => {
                let missing = rule.as_array().unwrap().iter();
                let missing = missing.filter(|name| value.get(name.as_str().unwrap()).is_none());
                (missing.count() > 0).then(|| fail("whole")).flatten()
            }
            "properties" => value.as_object().and_then(|fields| {
                let rule = rule.as_object().unwrap();
                let known = fields.iter().filter_map(|(name, v)| Some((rule.get(name)?, v)));
                known.into_iter().find_map(|(schema, v)| wrong(root, schema, v))
            }),
            "additionalProperties" => {
                assert_eq!(*rule, false);
                let known = schema["properties"].as_object().unwrap();
                let others = value.as_object().into_iter().flatten();
                let others = others.filter(|(name, _)| !known.contains_key(*name));
                (others.count() > 0).then(|| fail("known by")).flatten()
            }
            other => panic!("unknown keyword {other}"),
        };
        if is_wrong.is_some() {
            return is_wrong;
        }
    }
    None
}

/// One header, then pictures and events, all as the schema has them.
pub(crate) fn are_by_the_schema(lines: &[Value]) {
    let schema: Value = serde_json::from_str(include_str!("../../../docs/live.schema.json")).unwrap();
    for line in lines {
        let kind = line["kind"].as_str().unwrap();
        // Named by its kind: a message that helps.
        let of_kind = &schema["$defs"][kind];
        assert_eq!(wrong(&schema, of_kind, line), None);
        assert_eq!(wrong(&schema, &schema, line), None);
    }
    let headers = lines.iter().filter(|l| l["kind"] == "header").count();
    assert_eq!((headers, &lines[0]["kind"]), (1, &Value::from("header")));
}

/// Every picture has a rise for each of the header's cells: none at rest, and the greatest is where the touch is.
#[test]
fn cells_are_told_where_they_are_asked_for() {
    let lines = lines(&output(&[
        "run",
        "--json",
        "--cells",
        "--scene",
        "one-touch",
        "--frames",
        "420",
        "--every-frame",
    ]));
    are_by_the_schema(&lines);
    let cells = &lines[0]["cells"];
    let side_mm = cells["side_mm"].as_f64().unwrap();
    let centres = cells["centres_mm"].as_array().unwrap();
    let number = |v: &Value| v.as_f64().unwrap();
    let (mut rest, mut touched) = (0, 0);
    for picture in lines.iter().filter(|l| l["kind"] == "picture") {
        let rises: Vec<f64> = picture["cells"].as_array().unwrap().iter().map(number).collect();
        assert_eq!(rises.len(), centres.len());
        let Some(touch) = picture["touches"].get(0) else {
            rest += usize::from(rises.iter().all(|rise| *rise == 0.0));
            continue;
        };
        // Not while it comes down.
        if number(&touch["rise"]) < 0.1 {
            continue;
        }
        let greatest = (0..rises.len()).max_by(|a, b| rises[*a].total_cmp(&rises[*b])).unwrap();
        let off = [(0, "x_mm"), (1, "y_mm")].map(|(k, key)| number(&centres[greatest][k]) - number(&touch[key]));
        assert!(off[0].hypot(off[1]) < 2.0 * side_mm, "{off:?}");
        touched += 1;
    }
    assert!(rest > 100 && touched > 100, "{rest} {touched}");
}

#[test]
fn every_line_is_as_the_schema_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = |scene: &str, extra: &[&str]| {
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, scene).unwrap();
        let file = file.to_str().unwrap().to_owned();
        lines(&output(&[&["run", "--json", "--scene", &file], extra].concat()))
    };
    let finger = "duration_s = 3.0\n[[touch]]\nshape = \"finger\"\npress = { at_s = 0.3, for_s = 2.6, x_mm = 30.0, y_mm = 20.0, force_n = 15.0 }\n";
    let fault = |kind: &str| format!("{finger}[[fault]]\nat_s = 0.8\n{kind}\n");
    let open = run(
        &fault("kind = { electrode_open = { electrode = 3 } }"),
        &["--frames", "200"],
    );
    are_by_the_schema(&open);
    assert!(open.iter().any(|l| l["faults"][0]["kind"] == "electrode_open"));
    let reset = run(&fault("kind = \"board_reset\""), &["--frames", "200"]);
    are_by_the_schema(&reset);
    assert!(reset.iter().any(|l| l["event"] == "board_reset"));
    assert!(reset.iter().any(|l| l["line"].is_string()));
    // What the board says of itself: that it was restarted by its own fault, and that its source is not what it was.
    let own = format!(
        "{}[[fault]]\nat_s = 1.2\nkind = {{ source_sags = {{ part = 0.8 }} }}\n",
        fault("kind = \"board_hangs\"")
    );
    let own = run(&own, &["--frames", "300"]);
    are_by_the_schema(&own);
    let event = |name: &str| {
        own.iter()
            .find(|l| l["event"] == name)
            .unwrap_or_else(|| panic!("no {name}"))
    };
    assert_eq!(
        (&event("board_careful")["resets"], &event("board_careful")["settings"]),
        (&Value::from(1), &Value::from(true))
    );
    let sag = event("source_changed");
    assert!(sag["right"] == false && sag["permille"].as_f64() < Some(850.0), "{sag}");
    assert!(own.iter().any(|l| l["line"] == sag["text"]));
    let header = &open[0];
    assert_eq!(header["plan"]["measurements"].as_array().unwrap().len(), 208);
    // The board's clock and this computer's go alike.
    let pictures: Vec<&Value> = open.iter().filter(|l| l["kind"] == "picture").collect();
    assert_eq!(pictures.len(), 200);
    let mut times = pictures.windows(2).map(|w| (&w[0], &w[1]));
    assert!(
        times.all(|(a, b)| a["time_s"].as_f64() < b["time_s"].as_f64() && a["unix_s"].as_f64() <= b["unix_s"].as_f64())
    );
}

#[test]
fn every_kind_of_finding_is_in_the_schema() {
    use FindingKind as Kind;
    let schema: Value = serde_json::from_str(include_str!("../../../docs/live.schema.json")).unwrap();
    let known = schema.pointer("/$defs/finding/properties/kind/enum").unwrap();
    for kind in [
        Kind::Electrode,
        Kind::ElectrodeElsewhere,
        Kind::DrivePair,
        Kind::SensePair,
        Kind::Contact,
        Kind::Value,
        Kind::AllSigns,
        Kind::DriveSign,
        Kind::SenseSign,
        Kind::DriveGain,
        Kind::SenseGain,
        Kind::SenseOffset,
        Kind::SenseMissing,
        Kind::SenseNoise,
        Kind::Noise,
        Kind::Untold,
        Kind::Unsearched,
        Kind::Ambiguous,
        Kind::Moved,
        Kind::Frames,
    ] {
        let kind = serde_json::to_value(kind).unwrap();
        assert!(known.as_array().unwrap().contains(&kind), "{kind}");
    }
}

#[test]
fn a_line_that_is_not_by_the_schema_is_found() {
    let schema: Value = serde_json::from_str(include_str!("../../../docs/live.schema.json")).unwrap();
    let good = serde_json::json!({"kind": "event", "event": "silence", "text": "", "time_s": null, "unix_s": 1.0, "silent_s": 0.5});
    assert_eq!(wrong(&schema, &schema, &good), None);
    for (name, value) in [
        ("event", Value::from("earthquake")),
        ("unix_s", Value::from(-1)),
        ("text", Value::Null),
        ("more", Value::from(1)),
    ] {
        let mut bad = good.clone();
        bad[name] = value;
        assert!(wrong(&schema, &schema, &bad).is_some(), "{bad}");
    }
}

/// Whoever closes what the program writes to gets no panic: `skin ... 2>&1 | head -1`.
#[cfg(unix)]
#[test]
fn a_reader_that_has_seen_enough_is_no_reason_to_panic() {
    use std::io::Read;
    let commands: [&[&str]; 6] = [
        &["run", "--simulate", "--json", "--frames", "20"],
        &["run", "--simulate", "--no-open", "--listen", "0", "--frames", "3"],
        &["hello", "--simulate"],
        &["settings", "show", "--simulate"],
        &["list"],
        &["reconstruct", "tests/cli/malformed.csv", "--baseline", "1"],
    ];
    for arguments in commands {
        for to_stderr in [false, true] {
            let (mut reader, writer) = std::io::pipe().unwrap();
            let mut command = program(arguments);
            // The other one is kept: what it says is looked at.
            if to_stderr {
                command.stdout(Stdio::piped()).stderr(writer);
            } else {
                command.stdout(writer).stderr(Stdio::piped());
            }
            let mut child = Started::new(&mut command);
            drop(command);
            // A byte at most, and gone.
            let _ = reader.read(&mut [0]);
            drop(reader);
            let mut other = String::new();
            if to_stderr {
                drop(child.0.stdout.take());
            } else {
                child.0.stderr.take().unwrap().read_to_string(&mut other).unwrap();
            }
            let code = child.0.wait().unwrap().code();
            // 101 is a panic's.
            assert!(matches!(code, Some(0..=2)), "{arguments:?}: {code:?} {other}");
            assert!(!other.contains("panicked"), "{arguments:?}: {other}");
        }
    }
}
