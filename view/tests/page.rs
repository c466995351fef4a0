//! The live page in a browser: what it puts together from differences, and what that costs. Without Chromium on this machine
//! nothing is tried, and that is said.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use inverse::touches::touch::Touch;
use view::SCALE_FLOOR;
use view::picture::{Grid, Picture, Stats, circle_mm};
use view::shown::Shown;
use view::web::{LiveOptions, LiveView};
use view::wire::encode;

#[path = "page/browser.rs"]
mod browser;
#[path = "page/looks.rs"]
mod looks;
use browser::{Browser, Page};
#[path = "page/controls.rs"]
mod controls;
#[path = "page/time.rs"]
mod time;

/// Only for a browser that hangs.
const NOT_FOR_EVER: Duration = Duration::from_secs(300);

fn browser() -> Option<Browser> {
    let browser = Browser::start();
    if browser.is_none() {
        eprintln!("skipped: there is no chromium here");
    }
    browser
}

fn view() -> LiveView {
    LiveView::start(LiveOptions {
        listen: "127.0.0.1:0".parse().unwrap(),
        ..LiveOptions::default()
    })
    .unwrap()
}

/// Two fingers on a disc, one of which moves and goes. From the hundredth picture on the other is a new one. The label of one that was
/// there would stay on its side, which a page that passed over pictures chose otherwise than a fresh one.
fn picture(template: &Picture, sequence: u64) -> Picture {
    let t = 0.03 * sequence.min(100) as f64;
    let first = if sequence < 100 { 1 } else { 3 };
    let finger = |id, x_mm, y_mm, rise| Touch {
        id: Some(id),
        x_mm,
        y_mm,
        rise,
        area_mm2: 490.0,
        ..Touch::default()
    };
    let mut touches = vec![finger(first, 50.0 * t.cos(), 50.0 * t.sin(), 0.2)];
    if t < 2.0 {
        touches.push(finger(2, -60.0, -20.0, 0.3 - 0.1 * t));
    }
    let bump = |c: [f64; 2], f: &Touch| f.rise * (-((c[0] - f.x_mm).powi(2) + (c[1] - f.y_mm).powi(2)) / 300.0).exp();
    let values = template
        .grid
        .centres_mm()
        .map(|c| touches.iter().map(|f| bump(c, f)).sum::<f64>() as f32);
    Picture {
        sequence,
        time_s: 0.03 * sequence as f64,
        values: values.collect(),
        touches,
        ..template.clone()
    }
}

fn template() -> Picture {
    let outline = circle_mm(97.5, 120);
    let grid = Grid::cover(&outline, 5.0).unwrap();
    Picture {
        sequence: 0,
        time_s: 0.0,
        values: vec![0.0; grid.len()],
        grid: Arc::new(grid),
        outline_mm: Arc::new(outline),
        electrodes_mm: Arc::new(circle_mm(97.5, 16)),
        touches: Vec::new(),
        stats: Stats {
            source: "two fingers".into(),
            ..Stats::default()
        },
    }
}

/// Every pixel of the canvases of the sheet, and where those are that move.
fn pixels(page: &mut Page) -> String {
    let canvases = r##"[...document.querySelectorAll("#field, #frame, #marks canvas:not([hidden])")]
        .map((canvas) => canvas.toDataURL() + canvas.style.transform).join()"##;
    page.ask(canvases).as_str().unwrap_or_default().to_owned()
}

#[test]
fn a_board_that_is_away_is_a_state_of_its_own() {
    let Some(browser) = browser() else { return };
    let (view, template) = (view(), template());
    let mut page = browser.open(&view.url());
    let mut says = |picture: Picture, text: &str| {
        let end = Instant::now() + NOT_FOR_EVER;
        loop {
            // Pictures go on coming, as of a board that is there.
            view.publish(picture.clone()).unwrap();
            let state = page.ask(r##"document.querySelector("#connection-text").textContent"##);
            if state.as_str() == Some(text) {
                return page.ask(
                    r##"[document.querySelector("#banner").textContent, document.querySelector("#tare").disabled].join()"##,
                );
            }
            assert!(Instant::now() < end, "{state} is not {text}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    assert_eq!(says(picture(&template, 1), "live"), ",false");
    let mut away = picture(&template, 2);
    away.stats.away = Some("waiting for the board".into());
    assert_eq!(says(away, "board away"), "waiting for the board,true");
    assert_eq!(says(picture(&template, 3), "live"), ",false");
}

/// The button for a baseline can be used only on a page whose address has the token, or a ticket for it, which it turns into the token.
#[test]
fn only_a_page_with_the_printed_address_may_command() {
    let Some(browser) = browser() else { return };
    let (view, template) = (view(), template());
    let address = view.url();
    let (bare, token) = address.split_once('#').unwrap();
    let (once, start) = (view.url_once().unwrap(), Instant::now());
    let rights = r##"[document.querySelector("#tare").disabled, document.querySelector("#rights").hidden, location.hash].join()"##;
    let mut sequence = 0;
    let mut becomes = |page: &mut Page, wanted: &str| {
        while page.ask(rights).as_str() != Some(wanted) {
            sequence += 1;
            view.publish(picture(&template, sequence)).unwrap();
            assert!(start.elapsed() < NOT_FOR_EVER, "never {wanted}: {}", page.ask(rights));
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    let (may, watches) = (format!("false,true,#{token}"), "true,false,");
    becomes(&mut browser.open(&address), &may);
    let mut opened = browser.open(&once);
    becomes(&mut opened, &may);
    let late = once.split_once('#').unwrap().1;
    becomes(&mut browser.open(&once), &format!("{watches}#{late}"));
    let mut stranger = browser.open(bare);
    becomes(&mut stranger, watches);
    // Until somebody puts the printed address into it.
    stranger.ask(&format!("location.hash = '{token}'"));
    becomes(&mut stranger, &may);
    // There are touches: the first asks whether that is meant.
    opened.ask("document.querySelector('#tare').click(); document.querySelector('#tare').click()");
    while view.command().is_none() {
        assert!(start.elapsed() < NOT_FOR_EVER, "the command arrives");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_page_fed_with_differences_shows_what_a_fresh_one_shows() {
    let Some(browser) = browser() else { return };
    let (view, template) = (view(), template());
    let mut old = browser.open(&view.url());
    let start = Instant::now();
    let wait = |what: &str| {
        assert!(start.elapsed() < NOT_FOR_EVER, "never: {what}");
        std::thread::sleep(Duration::from_millis(30));
    };
    while view.clients() == 0 {
        wait("the page connects");
    }
    let mut sequence = 0;
    let mut next = || {
        sequence += 1;
        view.publish(picture(&template, sequence)).unwrap();
    };
    let empty = pixels(&mut old);
    for _ in 0..100 {
        next();
        wait("the fingers move");
    }
    // From here on every picture is the same, but for its number. A page behind another draws nothing: it has to come so far before.
    while old.ask("Number(document.querySelector('#sequence').textContent) > 100") != true {
        next();
        wait("the page has drawn the fingers");
    }
    assert_ne!(pixels(&mut old), empty);
    let mut fresh = browser.open(&view.url());
    let (mut a, mut b);
    while {
        next();
        (a, b) = (pixels(&mut old), pixels(&mut fresh));
        a != b
    } {
        wait("both show the same");
    }
    // Not the same nothing: the moving finger's ring and the field are there.
    assert!(a.len() > 3 * 2000 && a != empty, "{}", a.len());
}

#[test]
fn a_field_painted_where_it_changed_is_the_whole_field() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    // Any sheet, any changes: the same pixels as of a field that takes all cells at once, and areas that hold only what was reached.
    let wrong = page.ask(
        r#"(async () => {
            const { Field, table } = await import("/field.js");
            let seed = 1;
            const random = (n) => (seed = (seed * 48271) % 2147483647) % n;
            const colours = table("inferno");
            const wrong = [];
            for (let round = 0; round < 40; round++) {
                const [columns, rows] = [1 + random(45), 1 + random(45)];
                const all = Array.from({ length: columns * rows }, (_, k) => k);
                const cells = all.filter(() => random(10) > 2);
                if (!cells.length) continue;
                const corner = () => [random(5 * columns), random(5 * rows)];
                const outline_mm = [corner(), corner(), corner()];
                const scene = { columns, rows, cells, left_mm: 0, bottom_mm: 0, cell_mm: 5, outline_mm };
                const canvas = () => document.createElement("canvas");
                const field = new Field(scene, canvas());
                const steps = new Uint16Array(cells.length);
                for (let frame = 0; frame < 8; frame++) {
                    const changed = new Set();
                    for (let k = random(12); k > 0; k--) {
                        const cell = random(cells.length);
                        steps[cell] = random(3) ? random(510) : random(65536);
                        changed.add(cell);
                    }
                    field.take(steps, changed);
                    field.paint(colours);
                    const whole = new Field(scene, canvas());
                    whole.take(steps, cells.keys());
                    whole.paint(colours);
                    const data = (f) => f.context.getImageData(0, 0, f.columns, f.rows).data.join();
                    if (data(field) !== data(whole)) wrong.push([round, frame, columns, rows]);
                    if (field.areas().length) wrong.push("dirty after painting");
                }
            }
            return wrong;
        })()"#,
    );
    assert_eq!(wrong, serde_json::json!([]));
}

/// What a picture costs the program: taking it, telling the changes, and telling it whole. Least of many times.
/// `cargo test --release -p view --test page -- --ignored --nocapture telling`
#[test]
#[ignore = "a measurement"]
fn what_telling_a_picture_costs() {
    let template = template();
    println!("| picture | take us | tell us | bytes | cells |");
    println!("| --- | --- | --- | --- | --- |");
    for (name, step, base) in [
        ("the same", 0, true),
        ("a finger moves", 1, true),
        ("a finger moves, told whole", 1, false),
    ] {
        let mut shown = Shown::new(&template.grid, SCALE_FLOOR);
        let (mut take, mut tell) = (Duration::MAX, Duration::MAX);
        let (mut bytes, mut cells) = (0, 0);
        for k in 1..2000 {
            let next = picture(&template, 10 + step * (k % 90));
            let start = Instant::now();
            shown.take(&next, k);
            take = take.min(start.elapsed());
            let since = if base { k - 1 } else { 0 };
            let start = Instant::now();
            let told = encode(&next, &shown, 1, 0.0, since);
            tell = tell.min(start.elapsed());
            if k % 90 == 45 {
                (bytes, cells) = (told.len(), shown.changes(since).map(|r| r.steps.len()).sum::<usize>());
            }
        }
        let us = |d: Duration| 1e6 * d.as_secs_f64();
        println!("| {name} | {:.1} | {:.1} | {bytes} | {cells} |", us(take), us(tell));
    }
}

/// What a frame costs on the way to the eye. For docs/benchmarks.md:
/// `SKIN=target/release/skin cargo test --release -p view --test page -- --ignored --nocapture frame`.
#[test]
#[ignore = "a measurement"]
fn what_a_frame_costs() {
    let Some(browser) = browser() else { return };
    let program = std::env::var("SKIN").expect("SKIN names the program to measure, such as target/release/skin");
    let folder = tempfile::tempdir().unwrap();
    let finger = |keys: &str| format!("[[touch]]\nshape = \"finger\"\nkeys = [{keys}]\n");
    let comes =
        |x: i32, y: i32| format!("{{ t_s = 2.0, x_mm = {x}, y_mm = {y}, force_n = 0 }}, {{ t_s = 2.3, force_n = 20 }}");
    let stays = ", { t_s = 60.0 }";
    // There and back, 60 mm in 2 s.
    let moving = |x: i32, y: i32| {
        let there = (2..20).map(|k| format!(", {{ t_s = {}.5, x_mm = {}, y_mm = {y} }}", 2 * k - 1, x + 60 * (k % 2)));
        finger(&(comes(x, y) + &there.collect::<String>()))
    };
    let corners = [(-70, -35), (10, -35), (-70, 35), (10, 35)];
    let scenes = [
        ("idle", String::new()),
        (
            "four still",
            corners.map(|(x, y)| finger(&(comes(x, y) + stays))).concat(),
        ),
        ("one moving", moving(-30, 20)),
        ("four moving", corners.map(|(x, y)| moving(x, y)).concat()),
    ];
    println!(
        "| on the sheet | frames/s | bytes a frame | bytes/s | page: us a frame | page: us/s | browser: ms/s | program: ms/s |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, touches) in scenes {
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, format!("title = \"{name}\"\nduration_s = 60.0\n{touches}")).unwrap();
        let mut skin = std::process::Command::new(&program)
            .args(["run", "--no-open", "--listen", "18477", "--plan", "fast", "--scene"])
            .arg(&file)
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let connect = || std::net::TcpStream::connect("127.0.0.1:18477");
        while connect().is_err() && skin.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(100));
        }
        let mut page = browser.open("http://127.0.0.1:18477/");
        std::thread::sleep(Duration::from_secs(8));
        let on_processor = |id: u32| {
            let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
            let rest: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
            (rest[11].parse::<u64>().unwrap() + rest[12].parse::<u64>().unwrap()) as f64 / 100.0
        };
        let look = |page: &mut Page, skin: u32| {
            let worked = page.worked_s()[0];
            [
                page.frames as f64,
                page.bytes as f64,
                worked,
                browser.processor_s(),
                on_processor(skin),
            ]
        };
        let (start, before) = (Instant::now(), look(&mut page, skin.id()));
        std::thread::sleep(Duration::from_secs(15));
        let (span, after) = (start.elapsed().as_secs_f64(), look(&mut page, skin.id()));
        let [frames, bytes, worked, browser_s, skin_s]: [f64; 5] =
            std::array::from_fn(|k| (after[k] - before[k]) / span);
        println!(
            "| {name} | {frames:.1} | {:.0} | {bytes:.0} | {:.0} | {:.0} | {:.0} | {:.0} |",
            bytes / frames,
            1e6 * worked / frames,
            1e6 * worked,
            1e3 * browser_s,
            1e3 * skin_s
        );
        skin.kill().unwrap();
        skin.wait().unwrap();
        page.ask("window.close()");
    }
}
